"""Linear algebra of a handful of unknowns, compiled without calls to a library.

fine = scaled_solve(left, right)
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled

LEAST_PIVOT = 1e-12  # of a scaled system that determines its unknowns


@compiled
def scaled_solve(left, right):
    """Replaces `right` by the solution of a symmetric-looking system scaled by its diagonal; whether it is one.

    By elimination with row exchange, which leaves nothing of use in `left`; a pivot below LEAST_PIVOT of the scaled
    system says that it does not determine its unknowns.
    """
    count, sides = right.shape
    scale = np.empty(count)
    for i in range(count):
        scale[i] = 1 / np.sqrt(abs(left[i, i]))
        if not 0 < scale[i] < np.inf:
            return False
    for i in range(count):
        for j in range(count):
            left[i, j] *= scale[i] * scale[j]
        for j in range(sides):
            right[i, j] *= scale[i]
    for k in range(count):
        if not _bring_up(k, left, right):
            return False
        per = 1 / left[k, k]
        for i in range(k + 1, count):
            share = left[i, k] * per
            for j in range(k + 1, count):
                left[i, j] -= share * left[k, j]
            for j in range(sides):
                right[i, j] -= share * right[k, j]
    for k in range(count - 1, -1, -1):
        per = 1 / left[k, k]
        for j in range(sides):
            value = right[k, j]
            for i in range(k + 1, count):
                value -= left[k, i] * right[i, j]
            right[k, j] = value * per
    for i in range(count):
        for j in range(sides):
            right[i, j] *= scale[i]
    return True


@compiled
def _bring_up(k, left, right):
    """Exchanges row k for the one below it whose pivot is largest; whether that is large enough."""
    best = k
    for i in range(k + 1, len(left)):
        if abs(left[i, k]) > abs(left[best, k]):
            best = i
    if best != k:
        for j in range(k, len(left)):
            left[k, j], left[best, j] = left[best, j], left[k, j]
        for j in range(right.shape[1]):
            right[k, j], right[best, j] = right[best, j], right[k, j]
    return abs(left[k, k]) > LEAST_PIVOT


@compiled
def root_of(matrix, root):
    """Fills `root` (P, P) with the lower triangle L, L L' a covariance; whether it is positive in every direction."""
    count = len(matrix)
    for i in range(count):
        for j in range(count):
            root[i, j] = 0.0
    for j in range(count):
        for i in range(j, count):
            value = matrix[i, j]
            for k in range(j):
                value -= root[i, k] * root[j, k]
            if i > j:
                root[i, j] = value / root[j, j]
            elif value > LEAST_PIVOT * matrix[j, j]:
                root[j, j] = np.sqrt(value)
            else:
                return False
    return True


@compiled
def whiten(root, values):
    """Replaces `values` (P, K) by the solution of root x = values."""
    for i in range(len(root)):
        for k in range(i):
            for j in range(values.shape[1]):
                values[i, j] -= root[i, k] * values[k, j]
        per = 1 / root[i, i]
        for j in range(values.shape[1]):
            values[i, j] *= per


@compiled
def product(left, right):
    """left @ right; a call of the linear algebra library would cost more than the product."""
    out = np.zeros((left.shape[0], right.shape[1]))
    for i in range(left.shape[0]):
        for k in range(left.shape[1]):
            for j in range(right.shape[1]):
                out[i, j] += left[i, k] * right[k, j]
    return out


@compiled
def squares(values):
    """Sum of the squares of `values` (P, K)."""
    total = 0.0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            total += values[i, j] * values[i, j]
    return total
