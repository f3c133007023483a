"""A covariance that stays true where the places that fit about as well lie along a bent curve.

The squared range is quadratic in the unknowns, so how the score changes away from a solution is known to the
last term: own d + B(d, d), with B from three weighted sums. The noise that the score can have is mapped through
that equation, and the covariance is that of the places it leads to, widened until its 95 % ellipsoid holds
95 % of them. Where some noise leads nowhere, or where the matrix of the score and its covariance differ so much
that noise and not geometry made the solution, the ellipsoid means nothing and the fix is refused.
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled

STRAIGHT = 0.1  # root-mean-square second-order part of the score, in standard errors, that bends nothing
MOST_WIDENED = 2.5  # times an ellipsoid may be widened before it says nothing
MOST_APART = 0.3  # of the score's matrix from its covariance, which are equal where noise does not rule
MOST_LOST = 0.01  # share of the noise that may lead nowhere
NEWTON_STEPS = 30
_DRAWS = 256


def _balanced_draws(unknowns: int) -> np.ndarray:
    """Standard normal draws (2 x _DRAWS, unknowns) whose mean is zero and covariance the identity, exactly."""
    half = np.random.default_rng(7).standard_normal((_DRAWS, unknowns))
    draws = np.concatenate([half, -half])
    root = np.linalg.cholesky(np.cov(draws.T, bias=True))
    return np.ascontiguousarray(np.linalg.solve(root, draws.T).T)


DRAWS = {unknowns: _balanced_draws(unknowns) for unknowns in (4, 7)}


@compiled
def _second_order(d, moments, out):
    """Fills `out` with B(d, d): the score's part that is quadratic in the movement d of the unknowns."""
    square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - d[3] * d[3]
    mixed = speed = 0.0
    if len(d) > 4:
        mixed = 2 * (d[0] * d[4] + d[1] * d[5] + d[2] * d[6])
        speed = d[4] * d[4] + d[5] * d[5] + d[6] * d[6]
    for i in range(len(d)):
        out[i] = moments[i, 0] * square + moments[i, 1] * mixed + moments[i, 2] * speed


@compiled
def _slope(d, moments, out):
    """Fills `out` (P, P) with the derivative of B(d, d)."""
    unknowns = len(d)
    for i in range(unknowns):
        for k in range(3):
            out[i, k] = 2 * moments[i, 0] * d[k]
            if unknowns > 4:
                out[i, k] += 2 * moments[i, 1] * d[4 + k]
                out[i, 4 + k] = 2 * (moments[i, 1] * d[k] + moments[i, 2] * d[4 + k])
        out[i, 3] = -2 * moments[i, 0] * d[3]


@compiled
def _miss(eta, noise, along, out, moments, miss):
    """Fills `miss` with how far the score at a movement is from some noise, in standard errors; its square."""
    _second_order(along @ eta, moments, miss)
    whitened = out @ miss
    total = 0.0
    for i in range(len(eta)):
        miss[i] = eta[i] + whitened[i] - noise[i]
        total += miss[i] ** 2
    return total


@compiled
def follow_the_bend(own, spread, moments, draws, covariance):
    """Renews `covariance` (P, P) where the solutions lie on a bent curve; whether it can be stated at all.

    own, spread : (P, P) the score's matrix and its covariance
    moments : (P, 3) sums of weight times instrument times 1, t and t squared
    draws : (M, P) of `DRAWS`
    """
    unknowns = len(own)
    size = np.sqrt(np.diag(spread))
    root = np.linalg.cholesky(spread / size.reshape(-1, 1) / size.reshape(1, -1)) * size.reshape(-1, 1)
    out = np.linalg.inv(root)
    along = np.linalg.solve(own / size.reshape(-1, 1), root / size.reshape(-1, 1))  # own^-1 root
    apart = np.linalg.solve(along, np.ascontiguousarray(out.T)) - np.eye(
        unknowns
    )  # out own out' less the identity
    if np.sum(apart**2) > MOST_APART**2:
        return False
    second, miss, slope = np.empty(unknowns), np.empty(unknowns), np.empty((unknowns, unknowns))
    bend = 0.0
    for m in range(32):
        _second_order(along @ draws[m], moments, second)
        bend += np.sum((out @ second) ** 2) / 32
    if bend < STRAIGHT**2:
        return True
    reached = np.empty((len(draws), unknowns))
    lost = 0
    for m in range(len(draws)):
        eta, trial = draws[m].copy(), np.empty(unknowns)
        size_there = _miss(eta, draws[m], along, out, moments, miss)
        for _ in range(NEWTON_STEPS):
            if size_there < 1e-6:
                break
            _slope(along @ eta, moments, slope)
            step = np.linalg.solve(np.eye(unknowns) + out @ slope @ along, miss)
            share, before = 1.0, size_there
            while share > 1e-3:
                trial[:] = eta - share * step
                size_there = _miss(trial, draws[m], along, out, moments, miss)
                if size_there < before:
                    break
                share /= 2
            eta[:] = trial
        if size_there < 1e-6:
            reached[m - lost] = along @ eta
        else:
            lost += 1
    if lost > MOST_LOST * len(draws):
        return False
    reached = reached[: len(draws) - lost]
    seen = np.array([0, 1, 2, 4, 5, 6] if unknowns > 4 else [0, 1, 2])
    bent = reached.T @ reached / len(reached)
    widened = _quantile(reached, bent, seen) / _quantile(draws, np.eye(unknowns), seen)
    if not widened < MOST_WIDENED:
        return False
    covariance[:] = bent * max(widened, 1.0)
    return True


@compiled
def _quantile(places, covariance, seen):
    """The squared size, by a covariance, that 95 % of places (M, P) stay within, of the unknowns in `seen`."""
    part = np.empty((len(seen), len(seen)))
    for i in range(len(seen)):
        for j in range(len(seen)):
            part[i, j] = covariance[seen[i], seen[j]]
    scale = np.sqrt(np.diag(part))
    inverse = np.linalg.inv(part / scale.reshape(-1, 1) / scale.reshape(1, -1))
    size = np.empty(len(places))
    scaled = np.empty(len(seen))
    for m in range(len(places)):
        for i in range(len(seen)):
            scaled[i] = places[m, seen[i]] / scale[i]
        size[m] = scaled @ inverse @ scaled
    return np.quantile(size, 0.95)
