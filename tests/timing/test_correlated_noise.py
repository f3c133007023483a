"""Sigmas of a fit whose noise hangs together in time: true where the plain formula is too small."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from trackerlib.timing.correlated_noise import spread_of

POINTS, RUNS = 45, 500
COUNT = np.arange(POINTS)
DESIGN = np.column_stack([np.ones(POINTS), COUNT - COUNT.mean()])
GAIN = DESIGN / np.sum(DESIGN**2, axis=0)


def noise(rng, decay: float, series: int) -> np.ndarray:
    """Series (POINTS, series) of unit variance whose neighbours correlate by `decay`."""
    white = rng.normal(size=(POINTS + 200, series))
    return lfilter([np.sqrt(1 - decay**2)], [1, -decay], white, axis=0)[200:]


def fitted(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimates (2,) and residual (POINTS,) of the plain fit."""
    estimate = GAIN.T @ values
    return estimate, values - DESIGN @ estimate


@pytest.mark.parametrize("decay", [0.0, 0.2, 0.5])
def test_95_percent_intervals_hold(decay):
    rng, runs = np.random.default_rng(1), 2 * RUNS
    inside = []
    for _ in range(runs):
        values = noise(rng, decay, 3)
        estimate, residual = fitted(values[:, 0])
        spread = spread_of(GAIN, residual, DESIGN, values[:, 1:], COUNT)
        inside.append(np.abs(estimate) < 1.96 * spread.sigma)
    low, high = binom.ppf(0.001, runs, 0.94), binom.ppf(0.999, runs, 0.96)
    held = np.sum(inside, axis=0)
    assert np.all((low <= held) & (held <= high)), held / runs
    assert held / runs == pytest.approx([0.95, 0.95], abs=0.025)


def test_the_formula_alone_is_too_small_where_noise_hangs_together():
    # Neighbours correlated by 0.05 to 0.1 make a mean 5 to 10 percent less sure than (17) says.
    rng = np.random.default_rng(2)
    for decay in (0.05, 0.1):
        estimates, stated, ours = [], [], []
        for _ in range(4 * RUNS):
            values = noise(rng, decay, 1)[:, 0]
            estimate, residual = fitted(values)
            estimates.append(estimate[0])
            stated.append(np.sqrt(residual @ residual / (POINTS - 2)) * np.linalg.norm(GAIN[:, 0]))
        for _ in range(RUNS // 2):
            values = noise(rng, decay, 3)
            ours.append(spread_of(GAIN, fitted(values[:, 0])[1], DESIGN, values[:, 1:], COUNT).sigma[0])
        too_small = 1 - np.mean(stated) / np.std(estimates)
        assert 0.02 < too_small < 0.14
        assert np.mean(ours) > 0.99 * np.std(estimates)


def test_gaps_make_neighbours_strangers():
    rng = np.random.default_rng(3)
    values = noise(rng, 0.8, 3)
    _, residual = fitted(values[:, 0])
    near = spread_of(GAIN, residual, DESIGN, values[:, 1:], COUNT)
    far = spread_of(GAIN, residual, DESIGN, values[:, 1:], COUNT * 1000)
    assert near.sigma[0] > 1.5 * far.sigma[0]
    assert near.length > 2
    assert far.sigma[0] == pytest.approx(
        np.linalg.norm(GAIN[:, 0]) * np.sqrt(residual @ residual / 43), rel=0.05
    )


def test_a_scale_that_is_told_is_kept():
    _, residual = fitted(noise(np.random.default_rng(4), 0.0, 1)[:, 0])
    told = spread_of(GAIN, residual, DESIGN, np.empty((POINTS, 0)), COUNT, scale_known=True)
    again = spread_of(GAIN, 3 * residual, DESIGN, np.empty((POINTS, 0)), COUNT, scale_known=True)
    assert told.sigma == pytest.approx(again.sigma)
    estimated = spread_of(GAIN, 3 * residual, DESIGN, np.empty((POINTS, 0)), COUNT)
    assert np.all(estimated.sigma > 2 * told.sigma)
