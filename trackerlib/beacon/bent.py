"""A covariance that stays true where the places that fit about as well lie along a bent curve.

The squared range is quadratic in the unknowns, so how the score changes away from a solution is known to the
last term: own d + B(d, d), with B from three weighted sums. In standard errors of the score a movement d comes from
the noise eta as d = A (eta - M g), where g holds the three (for a still beacon one) quadratic forms of d itself. The
noise that the score can have is mapped through that equation, which is one in g alone, and the covariance is that of
the places it leads to, widened until its 95 % ellipsoid holds 95 % of them. Where some noise leads nowhere the
ellipsoid means nothing.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from trackerlib.beacon.small_systems import product, root_of, scaled_solve, squares, whiten
from trackerlib.compiled import compiled, compiled_with

# root-mean-square second-order part of the score, in standard errors, that shows in an ellipsoid
CURVED_FROM = 0.5
MOST_WIDENED = 2.5  # times an ellipsoid may be widened before it says nothing
MOST_LOST = 0.01  # share of the noise that may lead nowhere
NEWTON_STEPS = 30
COUNT = 2048  # of draws
HELD = 0.95  # share of the places that an ellipsoid is to hold


def _balanced_draws(unknowns: int) -> np.ndarray:
    """Standard normal draws (unknowns, COUNT): mean zero, covariance the identity, sizes spread evenly."""
    rng = np.random.default_rng(7)
    half = rng.standard_normal((COUNT // 2, unknowns))
    size = np.sqrt(chi2.ppf((rng.permutation(COUNT // 2) + 0.5) / (COUNT // 2), unknowns))
    half *= (size / np.linalg.norm(half, axis=1))[:, None]
    draws = np.concatenate([half, -half])
    root = np.linalg.cholesky(np.cov(draws.T, bias=True))
    return np.ascontiguousarray(np.linalg.solve(root, draws.T))


DRAWS = {unknowns: _balanced_draws(unknowns) for unknowns in (4, 7)}
# The squared size that HELD of the draws stay within, of a place and of a place with its velocity.
STILL_SIZE = float(np.quantile(np.sum(DRAWS[4][:3] ** 2, axis=0), HELD))
MOVING_SIZE = float(np.quantile(np.sum(DRAWS[7][[0, 1, 2, 4, 5, 6]] ** 2, axis=0), HELD))

_fast = compiled_with("reassoc", "contract", "nsz")


@compiled
def _form(which, one, i, other, j):
    """The bilinear form of columns i and j of movements: of d's square, of its square times t and times t squared."""
    total = 0.0
    for k in range(3):
        if which == 0:
            total += one[k, i] * other[k, j]
        elif which == 1:
            total += one[k, i] * other[4 + k, j] + one[4 + k, i] * other[k, j]
        else:
            total += one[4 + k, i] * other[4 + k, j]
    return total - one[3, i] * other[3, j] if which == 0 else total


@compiled
def second_order(along, mixing):
    """Root-mean-square size of the score's second-order part, in standard errors."""
    unknowns, count = mixing.shape
    forms, mean, size = np.empty((count, unknowns, unknowns)), np.zeros((unknowns, 1)), 0.0
    for p in range(count):
        trace = 0.0
        for i in range(unknowns):
            for j in range(unknowns):
                forms[p, i, j] = _form(p, along, i, along, j)
            trace += forms[p, i, i]
        for i in range(unknowns):
            mean[i, 0] += mixing[i, p] * trace
        for q in range(p + 1):
            shared = together = 0.0
            for i in range(unknowns):
                together += mixing[i, p] * mixing[i, q]
                for j in range(unknowns):
                    shared += forms[p, i, j] * forms[q, i, j]
            size += (2 if q == p else 4) * together * shared
    return np.sqrt(size + squares(mean))


@compiled
def _root_near(start, linear, square, root):
    """Newton's steps from zero to g = start - 2 linear g + g' square g, halved while it gets worse; whether found."""
    count = len(start)
    miss, slope = np.empty((count, 1)), np.empty((count, count))
    trial, step = np.empty(count), np.empty((count, 1))
    root[:] = 0.0
    size = _miss(root, start, linear, square, miss, slope)
    for _ in range(NEWTON_STEPS):
        if size < 1e-12 * (1 + np.sum(start**2)):
            return True
        step[:] = miss
        if not scaled_solve(slope, step):
            return False
        share, before = 1.0, size
        while share > 1e-3:
            for p in range(count):
                trial[p] = root[p] - share * step[p, 0]
            size = _miss(trial, start, linear, square, miss, slope)
            if size < before:
                break
            share /= 2
        root[:] = trial
    return False


@compiled
def _miss(g, start, linear, square, miss, slope):
    """Fills g - start + 2 linear g - g' square g and its slope; its square size."""
    count, size = len(g), 0.0
    for p in range(count):
        value = g[p] - start[p]
        for q in range(count):
            inner = 0.0
            for r in range(count):
                inner += square[p, q, r] * g[r]
            value += (2 * linear[p, q] - inner) * g[q]
            slope[p, q] = 2 * (linear[p, q] - inner) + (1.0 if p == q else 0.0)
        miss[p, 0] = value
        size += value * value
    return size


@compiled
def _lead_moving(mixed, places):
    """Replaces movements (7, COUNT) to first order by those to the last; zero and counted where there are none."""
    start, root = np.empty(3), np.empty(3)
    linear, square = np.empty((3, 3)), np.empty((3, 3, 3))
    lost = 0
    for p in range(3):
        for q in range(3):
            for r in range(3):
                square[p, q, r] = _form(p, mixed, q, mixed, r)
    for m in range(COUNT):
        for p in range(3):
            start[p] = _form(p, places, m, places, m)
            for q in range(3):
                linear[p, q] = _form(p, mixed, q, places, m)
        found = _root_near(start, linear, square, root)
        lost += not found
        for i in range(len(places)):
            for p in range(3):
                places[i, m] -= mixed[i, p] * root[p]
            if not found:
                places[i, m] = 0.0
    return lost


@_fast
def _lead_still(mixed, places):
    """The same for movements (4, COUNT), where g is the root, near zero, of g = start - 2 linear g + square g g."""
    a, b, c, d = mixed[0, 0], mixed[1, 0], mixed[2, 0], mixed[3, 0]
    square, lost = a * a + b * b + c * c - d * d, 0
    flat = places.reshape(4 * COUNT)
    for m in range(COUNT):
        x, y, z, r = flat[m], flat[COUNT + m], flat[2 * COUNT + m], flat[3 * COUNT + m]
        slope = 1 + 2 * (a * x + b * y + c * z - d * r)
        start = x * x + y * y + z * z - r * r
        below = slope * slope - 4 * square * start
        root = np.sqrt(abs(below))
        g = 2 * start / (slope + root if slope > 0 else slope - root)
        found = 1.0 if below > 0 else 0.0
        lost += below <= 0
        flat[m], flat[COUNT + m] = found * (x - a * g), found * (y - b * g)
        flat[2 * COUNT + m], flat[3 * COUNT + m] = found * (z - c * g), found * (r - d * g)
    return lost


@compiled
def follow_the_bend(own, spread, moments, draws, covariance):
    """Fills `covariance` (P, P), also where the solutions lie on a bent curve; the bend, infinite if none is true.

    own, spread : (P, P) the score's matrix, which is not kept, and its covariance
    moments : (P, 1 or 3) sums of weight times instrument times 1, t and t squared
    draws : (P, M) of `DRAWS`
    """
    unknowns = len(own)
    root, mixing = np.empty((unknowns, unknowns)), moments.copy()
    if not root_of(spread, root):
        return np.inf
    along = root.copy()
    if not scaled_solve(own, along):
        return np.inf
    whiten(root, mixing)
    bend = second_order(along, mixing)
    covariance[:] = product(along, along.T)
    if bend < CURVED_FROM:
        return bend
    places, mixed = product(along, draws), product(along, mixing)
    lost = _lead_moving(mixed, places) if unknowns > 4 else _lead_still(mixed, places)
    if lost > MOST_LOST * COUNT:
        return np.inf
    _second_moments(places, COUNT - lost, covariance)
    widened = _size_held(places, lost, covariance) / (MOVING_SIZE if unknowns > 4 else STILL_SIZE)
    if not widened < MOST_WIDENED:
        return np.inf
    covariance *= max(widened, 1.0)
    return bend


@_fast
def _second_moments(places, count, covariance):
    """Fills the covariance (P, P) of places (P, COUNT) of which `count` are not zero."""
    for i in range(len(places)):
        for j in range(i + 1):
            total = 0.0
            for m in range(COUNT):
                total += places[i, m] * places[j, m]
            covariance[i, j] = covariance[j, i] = total / count


@compiled
def _size_held(places, lost, covariance):
    """The squared size, by a covariance, that HELD of places (P, COUNT), less those lost, stay within; c0 aside."""
    unknowns = len(places)
    seen = unknowns - 1
    part, root, white = np.empty((seen, seen)), np.empty((seen, seen)), np.empty((seen, COUNT))
    for i in range(seen):
        white[i] = places[i if i < 3 else i + 1]
        for j in range(seen):
            part[i, j] = covariance[i if i < 3 else i + 1, j if j < 3 else j + 1]
    if not root_of(part, root):
        return np.inf
    whiten(root, white)
    size = np.zeros(COUNT)
    for i in range(seen):
        for m in range(COUNT):
            size[m] += white[i, m] ** 2
    at = lost + HELD * (COUNT - lost - 1)  # those lost have size zero
    size = np.partition(size, int(at))
    here, next_one = size[int(at)], np.min(size[int(at) + 1 :])
    return here + (at - int(at)) * (next_one - here)
