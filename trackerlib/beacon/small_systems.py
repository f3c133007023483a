"""Linear algebra of a handful of unknowns, compiled without calls to a library.

solved, fine = scaled_solve(matrix, right)
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled

LEAST_PIVOT = 1e-12  # of a scaled system that determines its unknowns


@compiled
def scaled_solve(matrix, right):
    """Solution of a symmetric-looking system scaled by its diagonal, and whether it is well determined.

    By elimination with row exchange; a pivot below LEAST_PIVOT of the scaled system says that it is not.
    """
    count = len(matrix)
    scale = np.empty(count)
    left, solved = np.empty((count, count)), np.empty(right.shape)
    for i in range(count):
        scale[i] = np.sqrt(abs(matrix[i, i]))
        if not 0 < scale[i] < np.inf:
            return solved, False
    for i in range(count):
        for j in range(count):
            left[i, j] = matrix[i, j] / (scale[i] * scale[j])
        for j in range(right.shape[1]):
            solved[i, j] = right[i, j] / scale[i]
    for k in range(count):
        best = k
        for i in range(k + 1, count):
            if abs(left[i, k]) > abs(left[best, k]):
                best = i
        if not abs(left[best, k]) > LEAST_PIVOT:
            return solved, False
        if best != k:
            for j in range(k, count):
                left[k, j], left[best, j] = left[best, j], left[k, j]
            for j in range(right.shape[1]):
                solved[k, j], solved[best, j] = solved[best, j], solved[k, j]
        for i in range(k + 1, count):
            share = left[i, k] / left[k, k]
            for j in range(k + 1, count):
                left[i, j] -= share * left[k, j]
            for j in range(right.shape[1]):
                solved[i, j] -= share * solved[k, j]
    for k in range(count - 1, -1, -1):
        for j in range(right.shape[1]):
            value = solved[k, j]
            for i in range(k + 1, count):
                value -= left[k, i] * solved[i, j]
            solved[k, j] = value / left[k, k]
    for i in range(count):
        for j in range(right.shape[1]):
            solved[i, j] /= scale[i]
    return solved, True


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
