"""Correlation lengths, slow errors and ellipses."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.beacon.minimise import Misfit
from trackerlib.beacon.uncertainty import SlowErrors, uncertainty_of
from trackerlib.residuals import residual_correlation


def autoregressive(rho, count, rng):
    e = rng.normal(size=count)
    for k in range(1, count):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * e[k]
    return e


def test_white_residuals_count_as_white():
    rng = np.random.default_rng(0)
    shares = [residual_correlation(rng.normal(size=80)).share for _ in range(400)]
    assert np.mean(np.array(shares) == 0) > 0.97


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_a_first_order_process_is_recognised(rho):
    # Sum of its autocorrelations: (1 + rho) / (1 - rho); of their squares: (1 + rho^2) / (1 - rho^2).
    rng = np.random.default_rng(1)
    found = [residual_correlation(autoregressive(rho, 800, rng)) for _ in range(60)]
    assert np.median([c.length for c in found]) == pytest.approx((1 + rho) / (1 - rho), rel=0.15)
    assert np.median([c.variance_length for c in found]) == pytest.approx(
        (1 + rho**2) / (1 - rho**2), rel=0.15
    )


def test_a_slow_part_under_white_noise_is_recognised():
    rng = np.random.default_rng(3)
    found = [
        residual_correlation(0.6 * autoregressive(0.9, 3000, rng) + 0.8 * rng.normal(size=3000))
        for _ in range(40)
    ]
    assert np.median([c.share for c in found]) == pytest.approx(0.36, abs=0.06)
    assert np.median([c.decay for c in found]) == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize("series", [np.zeros(50), np.ones(3), np.arange(4.0), np.zeros(0)])
def test_series_that_tell_nothing_count_as_white(series):
    assert residual_correlation(series).share == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_correlated_noise_widens_the_covariance_as_it_must(seed):
    """Against many draws: spread of a weighted mean of correlated noise, and the covariance stated."""
    rng = np.random.default_rng(seed)
    slope = np.cos(np.linspace(0, 9, 150))
    estimates, stated = [], []
    for _ in range(200):
        noise = autoregressive(0.85, 150, rng)
        estimates.append(slope @ noise / (slope @ slope))
        misfit = _one_direction(slope, noise - slope * estimates[-1])
        found = uncertainty_of(
            misfit,
            np.ones(150, bool),
            axes=np.eye(3)[:1],
            floor_s=0.0,
            mean_speed_mps=1500.0,
            speed_sigma_mps=0.0,
        )
        stated.append(found.sigma[0])
    covered = np.mean(np.abs(estimates) < 1.96 * np.array(stated))
    # 150 such residuals count as twelve: their correlation is itself known to a fifth only.
    assert 0.86 < covered < 0.985


def _one_direction(slope, residual):
    gradient = np.zeros((1, len(slope), 3))
    gradient[0, :, 0] = slope
    ones = np.ones((1, len(slope)))
    return Misfit(
        residual[None], gradient, ones, ones, gradient,
        columns=np.zeros((1, len(slope), 0)), linear=np.zeros((1, 0)), follow=np.zeros((1, 0, 3)),
        inverse=np.zeros((1, 0, 0)), prior=np.zeros(0),
    )  # fmt: skip


def test_slow_errors_are_the_double_sum():
    rng = np.random.default_rng(2)
    seconds = np.sort(rng.integers(0, 600_000, 12)) * 1e-3
    response = rng.normal(size=(12, 2, 3))
    kernel = 4.0**2 * np.exp(-np.abs(seconds[:, None] - seconds) / 45.0)
    expected = sum(response[:, axis].T @ kernel @ response[:, axis] for axis in (0, 1))
    assert SlowErrors(4.0, 45.0, seconds).moved_by(response) == pytest.approx(expected, rel=1e-12)
