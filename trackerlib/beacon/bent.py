"""A covariance that stays true where the places that fit about as well lie along a bent curve.

The squared range is quadratic in the unknowns, so how the score changes away from a solution is known to the
last term: own d + B(d, d), with B from three weighted sums. In standard errors of the score that is eta + M g, where
g holds the three (for a still beacon one) quadratic forms eta' G eta. The noise that the score can have is mapped
through that equation, which is one in g alone, and the covariance is that of the places it leads to, widened until
its 95 % ellipsoid holds 95 % of them. Where some noise leads nowhere the ellipsoid means nothing.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from trackerlib.beacon.small_systems import product, root_of, scaled_solve, whiten
from trackerlib.compiled import compiled

CURVED_FROM = (
    0.5  # root-mean-square second-order part of the score, in standard errors, that shows in an ellipsoid
)
MOST_WIDENED = 2.5  # times an ellipsoid may be widened before it says nothing
MOST_LOST = 0.01  # share of the noise that may lead nowhere
NEWTON_STEPS = 30
_DRAWS = 1024


def _balanced_draws(unknowns: int) -> np.ndarray:
    """Standard normal draws (2 x _DRAWS, unknowns): mean zero, covariance the identity, sizes spread evenly."""
    rng = np.random.default_rng(7)
    half = rng.standard_normal((_DRAWS, unknowns))
    size = np.sqrt(chi2.ppf((rng.permutation(_DRAWS) + 0.5) / _DRAWS, unknowns))
    half *= (size / np.linalg.norm(half, axis=1))[:, None]
    draws = np.concatenate([half, -half])
    root = np.linalg.cholesky(np.cov(draws.T, bias=True))
    return np.ascontiguousarray(np.linalg.solve(root, draws.T).T)


DRAWS = {unknowns: _balanced_draws(unknowns) for unknowns in (4, 7)}


@compiled
def quadratic_forms(along):
    """Forms (1 or 3, P, P) of a movement along @ eta: of its square, square times t and square times t squared."""
    unknowns = len(along)
    forms = np.zeros((3 if unknowns > 4 else 1, unknowns, unknowns))
    for i in range(unknowns):
        for j in range(unknowns):
            for k in range(3):
                forms[0, i, j] += along[k, i] * along[k, j]
            forms[0, i, j] -= along[3, i] * along[3, j]
            if unknowns > 4:
                for k in range(3):
                    forms[1, i, j] += along[k, i] * along[4 + k, j] + along[4 + k, i] * along[k, j]
                    forms[2, i, j] += along[4 + k, i] * along[4 + k, j]
    return forms


@compiled
def second_order(forms, mixing):
    """Mean (P,) of the score's second-order part, and its root-mean-square size, in standard errors."""
    count, unknowns = len(forms), len(mixing)
    mean, size = np.zeros(unknowns), 0.0
    for p in range(count):
        trace = 0.0
        for i in range(unknowns):
            trace += forms[p, i, i]
        for i in range(unknowns):
            mean[i] += mixing[i, p] * trace
        for q in range(count):
            shared = along = 0.0
            for i in range(unknowns):
                along += mixing[i, p] * mixing[i, q]
                for j in range(unknowns):
                    shared += forms[p, i, j] * forms[q, i, j]
            size += 2 * along * shared
    return mean, np.sqrt(size + np.sum(mean**2))


@compiled
def _root_near(start, linear, square, root):
    """Newton's steps from zero to g = start - 2 linear g + g' square g, halved while it gets worse; whether found."""
    count = len(start)
    miss, slope = np.empty((count, 1)), np.empty((count, count))
    trial = np.empty(count)
    root[:] = 0.0
    size = _miss(root, start, linear, square, miss, slope)
    for _ in range(NEWTON_STEPS):
        if size < 1e-12 * (1 + np.sum(start**2)):
            return True
        step, fine = scaled_solve(slope, miss)
        if not fine:
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
def _places_reached(forms, mixing, along, draws, reached):
    """Fills movements (M, P) to which the noise of `draws` leads; how many of them are lost."""
    count, unknowns = len(forms), len(mixing)
    turned = np.zeros((count, count, unknowns))  # mixing' form
    square = np.zeros((count, count, count))
    for p in range(count):
        turned[p] = product(mixing.T, forms[p])
        square[p] = product(turned[p], mixing)
    start, linear, root = np.empty(count), np.empty((count, count)), np.empty(count)
    eta = np.empty(unknowns)
    lost = 0
    for m in range(len(draws)):
        noise = draws[m]
        for p in range(count):
            start[p] = 0.0
            for i in range(unknowns):
                for j in range(unknowns):
                    start[p] += noise[i] * forms[p, i, j] * noise[j]
            for q in range(count):
                linear[p, q] = 0.0
                for i in range(unknowns):
                    linear[p, q] += turned[p, q, i] * noise[i]
        if not _root_near(start, linear, square, root):
            lost += 1
            continue
        for i in range(unknowns):
            eta[i] = noise[i]
            for p in range(count):
                eta[i] -= mixing[i, p] * root[p]
        for i in range(unknowns):
            value = 0.0
            for j in range(unknowns):
                value += along[i, j] * eta[j]
            reached[m - lost, i] = value
    return lost


@compiled
def follow_the_bend(own, spread, moments, draws, covariance):
    """Fills `covariance` (P, P), also where the solutions lie on a bent curve; the bend, infinite if none is true.

    own, spread : (P, P) the score's matrix and its covariance
    moments : (P, 3) sums of weight times instrument times 1, t and t squared
    draws : (M, P) of `DRAWS`
    """
    unknowns = len(own)
    root = np.empty((unknowns, unknowns))
    if not root_of(spread, root):
        return np.inf
    along, fine = scaled_solve(own, root)
    if not fine:
        return np.inf
    mixing = moments.copy()
    whiten(root, mixing)
    forms = quadratic_forms(along)
    mixing = mixing[:, : len(forms)].copy()
    _, bend = second_order(forms, mixing)
    covariance[:] = product(along, along.T)
    if bend < CURVED_FROM:
        return bend
    reached = np.empty(draws.shape)
    lost = _places_reached(forms, mixing, along, draws, reached)
    if lost > MOST_LOST * len(draws):
        return np.inf
    reached = reached[: len(draws) - lost]
    bent = product(reached.T, reached) / len(reached)
    seen = np.array([0, 1, 2, 4, 5, 6] if unknowns > 4 else [0, 1, 2])
    widened = _quantile(reached, bent, seen) / _quantile(draws, np.eye(unknowns), seen)
    if not widened < MOST_WIDENED:
        return np.inf
    covariance[:] = bent * max(widened, 1.0)
    return bend


@compiled
def _quantile(places, covariance, seen):
    """The squared size, by a covariance, that 95 % of places (M, P) stay within, of the unknowns in `seen`."""
    count = len(seen)
    part, root = np.empty((count, count)), np.empty((count, count))
    for i in range(count):
        for j in range(count):
            part[i, j] = covariance[seen[i], seen[j]]
    if not root_of(part, root):
        return np.inf
    size = np.empty(len(places))
    one = np.empty((count, 1))
    for m in range(len(places)):
        for i in range(count):
            one[i, 0] = places[m, seen[i]]
        whiten(root, one)
        size[m] = np.sum(one**2)
    return np.quantile(size, 0.95)
