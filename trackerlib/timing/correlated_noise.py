"""How sure least squares is where its noise hangs together in time, and nobody knows how much.

Read (1990), (17)-(19), takes the noise of one point count as independent of the next; its own Figures show that
it is not, and then the formula is too small. Here every strength of correlation in a small table is tried: each
has its restricted likelihood and the spread it would give, and the sigma is that of the mixture. Short series
cannot tell slow noise from a slow truth, so some weight stays on correlation that was not seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri, stdtr

from trackerlib.compiled import compiled, warms

SHARES = (0.4, 0.7, 1.0)  # of the variance that is correlated; the rest is white
DECAYS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)  # correlation from one count to the next
# Weight, before the data speak, of no correlation at all; the slower, the less of the rest. With it 95 % intervals from
# 45 points on hold 94 to 96 % with a correlation from none to 0.2, and 93.8 to 96.5 % up to 0.6
# (tests/benchmarks/study_timing_coverage.py).
WHITE = 0.65

STANDARD = float(ndtri(0.975))


@dataclass(frozen=True, eq=False)
class Spread:
    """How sure estimates are that are linear in correlated noise."""

    sigma: np.ndarray  # (P,) so that 1.96 sigma holds 95 %, the estimated correlation and scale allowed for
    correlation: np.ndarray  # (P, P) between the estimates
    length: float  # how many point counts are as good as one independent one, for a mean


def spread_of(
    gain: np.ndarray,
    residual: np.ndarray,
    design: np.ndarray,
    others: np.ndarray,
    point_count: np.ndarray,
    scale_known: bool = False,
) -> Spread:
    """Spread of estimates gain' noise, the noise's correlation in time told by the residuals of a fit.

    gain : (T, 2) what a unit of noise at each point count does to each estimate
    residual : (T,) of the fit that has `design` (T, 2), in units of its own standard deviation
    others : (T, K) further series with the same correlation, free of all but a mean and a slope
    point_count : (T,) growing; gaps are allowed
    scale_known : the residual's unit is exact, not estimated from these residuals
    """
    lags = np.diff(np.asarray(point_count, float))
    elapsed = np.asarray(point_count, float) - np.mean(point_count)
    plain = np.column_stack([np.ones(len(elapsed)), elapsed / max(np.abs(elapsed).max(), 1.0)])
    likelihood, scale, covariance = _try_all(
        MODELS[:, 1:], np.ascontiguousarray(gain), residual.reshape(-1, 1), np.ascontiguousarray(design),
        np.ascontiguousarray(others), plain, lags,
    )  # fmt: skip
    logs = np.log(MODELS[:, 0]) + likelihood
    chance = np.exp(logs - logs.max())
    chance /= chance.sum()
    if not scale_known:
        covariance *= scale[:, None, None]
    freedom = np.inf if scale_known else len(residual) - design.shape[1]
    sigma = np.array([_mixture_sigma(chance, v, freedom) for v in np.einsum("gpp->pg", covariance)])
    mean = np.einsum("g,gpq->pq", chance, covariance)
    size = np.sqrt(np.maximum(np.diag(mean), 1e-300))
    share, decay = MODELS[:, 1:].T
    length = float(chance @ (1 + 2 * share * decay / (1 - decay)))
    return Spread(sigma, mean / np.outer(size, size), length)


def _models() -> np.ndarray:
    """Weight, share and decay (G, 3) of each picture of the noise."""
    slow = np.array([[np.sqrt(1 - decay), share, decay] for decay in DECAYS for share in SHARES])
    slow[:, 0] *= (1 - WHITE) / slow[:, 0].sum()
    return np.vstack([[WHITE, 0.0, 0.0], slow])


MODELS = _models()


def _mixture_sigma(chance: np.ndarray, variance: np.ndarray, freedom: float) -> float:
    """A 1.96th of the distance that a mixture of t distributions stays within 95 times in 100."""
    size = np.sqrt(np.maximum(variance, 1e-300))
    if not variance.max() > 0:
        return 0.0

    def beyond(reach: float) -> float:
        tail = ndtr(-reach / size) if np.isinf(freedom) else stdtr(freedom, -reach / size)
        return float(chance @ tail) - 0.025

    return float(brentq(beyond, 0.0, 1e4 * size.max(), rtol=1e-6) / STANDARD)


@compiled
def _try_all(models, gain, residual, design, others, plain, lags):
    """Of each model (G, 2): restricted log-likelihood, squared scale of the residual, gain' R gain (G, P, P)."""
    count = len(models)
    likelihood, scale = np.zeros(count), np.zeros(count)
    covariance = np.empty((count, gain.shape[1], gain.shape[1]))
    for g in range(count):
        share, decay = models[g]
        likelihood[g], scale[g] = _restricted(residual, design, lags, share, decay)
        if others.shape[1]:
            likelihood[g] += _restricted(others, plain, lags, share, decay)[0]
        covariance[g] = _spread(gain, lags, share, decay)
    return likelihood, scale, covariance


@compiled
def _restricted(series, design, lags, share, decay):
    """Restricted log-likelihood of series (T, K) about a design of two columns, and their mean squared scale."""
    points, many = series.shape
    columns = np.empty((points, 2 + many))
    columns[:, :2], columns[:, 2:] = design, series
    log_det = _whiten(columns, lags, share, decay)
    s00 = s01 = s11 = 0.0
    for k in range(points):
        a, b = columns[k, 0], columns[k, 1]
        s00, s01, s11 = s00 + a * a, s01 + a * b, s11 + b * b
    slope = s01 / s00  # the second column less its part along the first
    left = max(s11 - slope * s01, 1e-300)
    total = scale = 0.0
    for j in range(2, 2 + many):
        first = second = square = 0.0
        for k in range(points):
            first += columns[k, 0] * columns[k, j]
        for k in range(points):
            rest = columns[k, j] - first / s00 * columns[k, 0]
            columns[k, j] = rest
            second += (columns[k, 1] - slope * columns[k, 0]) * rest
        for k in range(points):
            rest = columns[k, j] - second / left * (columns[k, 1] - slope * columns[k, 0])
            square += rest * rest
        square = max(square, 1e-300)
        total -= 0.5 * (log_det + np.log(s00) + np.log(left) + (points - 2) * np.log(square))
        scale += square / (points - 2) / many
    return total, scale


@compiled
def _whiten(columns, lags, share, decay):
    """Turns columns (T, K) into independent ones of unit variance, in place; log determinant of the noise.

    Kalman filter of a slow part (variance `share`, falling by `decay` a count) in white noise.
    """
    state, variance = np.zeros(columns.shape[1]), share
    log_det = 0.0
    for k in range(len(columns)):
        if k:
            kept = decay ** lags[k - 1]
            variance = kept * kept * variance + (1 - kept * kept) * share
            for j in range(len(state)):
                state[j] *= kept
        total = variance + 1 - share
        pull, root = variance / total, np.sqrt(total)
        log_det += np.log(total)
        for j in range(len(state)):
            innovation = columns[k, j] - state[j]
            state[j] += pull * innovation
            columns[k, j] = innovation / root
        variance *= 1 - pull
    return log_det


@compiled
def _spread(gain, lags, share, decay):
    """gain' R gain (P, P), R the correlation of the noise: `share` times decay^lag, 1 at lag 0."""
    count = gain.shape[1]
    total, before = np.zeros((count, count)), np.zeros(count)
    for k in range(len(gain)):
        if k:
            kept = decay ** lags[k - 1]
            for j in range(count):
                before[j] = (before[j] + gain[k - 1, j]) * kept
        for i in range(count):
            for j in range(count):
                slow = share * (gain[k, i] * before[j] + before[i] * gain[k, j])
                total[i, j] += gain[k, i] * gain[k, j] + slow
    return total


@warms
def _warm() -> None:
    design = np.column_stack([np.ones(6), np.arange(6.0)])
    spread_of(design, np.ones(6), design, np.ones((6, 2)), np.arange(6))
