"""Straight lines at constant speed, and the noise about them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trackerlib.crossover.noise import autocorrelation, displacement, residual_noise
from trackerlib.crossover.straight_line import fit_straight_line, is_curved

COUNTS = np.array([1, 2, 3, 5, 8, 9, 12, 13, 20, 21])
START, STEP = np.array([20_000.0, -400.0, -300.0]), np.array([48.0, 5.0, -1.0])
LINE = START + np.outer(COUNTS, STEP)


def test_a_straight_run_is_its_own_line():
    line = fit_straight_line(LINE, COUNTS)
    assert line.at(COUNTS) == pytest.approx(LINE)
    assert abs(line.speed) == pytest.approx(np.linalg.norm(STEP))
    assert np.abs(line.direction) == pytest.approx(np.abs(STEP) / np.linalg.norm(STEP))


def test_three_points_by_hand():
    # (0,0,0), (10,1,0), (20,0,0) at counts 0, 1, 2: direction x; mean (10, 1/3, 0); speed 10.
    line = fit_straight_line(np.array([[0, 0, 0], [10, 1, 0], [20, 0, 0.0]]), np.array([0, 1, 2]))
    assert line.centre == pytest.approx([10, 1 / 3, 0])
    assert abs(line.speed) == pytest.approx(10)
    assert line.at([1])[0] == pytest.approx([10, 1 / 3, 0])


@pytest.mark.parametrize("seed", range(6))
def test_turning_the_axes_turns_the_line(seed):
    rng = np.random.default_rng(seed)
    track = LINE + rng.normal(0, 2, LINE.shape)
    turn = Rotation.random(rng=rng).as_matrix()
    turned = fit_straight_line(track @ turn.T, COUNTS).at(COUNTS)
    assert turned == pytest.approx(fit_straight_line(track, COUNTS).at(COUNTS) @ turn.T)


def test_points_left_out_do_not_move_the_line():
    track = LINE.copy()
    track[4] += [500, -900, 300]
    keep = np.arange(len(track)) != 4
    assert fit_straight_line(track, COUNTS, keep).at(COUNTS) == pytest.approx(LINE)


def test_one_point_count_makes_no_line():
    with pytest.raises(ValueError, match="two point counts"):
        fit_straight_line(LINE[:1], COUNTS[:1])


@pytest.mark.parametrize("seed", range(20))
def test_noise_alone_is_no_bend(seed):
    rng = np.random.default_rng(seed)
    counts = np.arange(60)
    track = START + np.outer(counts, STEP) + rng.normal(0, 3, (60, 3))
    assert not is_curved(track, counts)
    bent = track + np.outer(0.02 * (counts - 30.0) ** 2, [0, 1, 0])
    assert is_curved(bent, counts)


def test_covariances_by_simulation():
    """M is the covariance of the gap: common wandering cancels, its own divisor is right."""
    rng = np.random.default_rng(0)
    counts, runs = np.arange(12), 600
    first, second = np.diag([4.0, 1.0, 9.0]), np.diag([1.0, 16.0, 1.0])
    total, cross = np.zeros((3, 3)), np.zeros((3, 3))
    for _ in range(runs):
        common = rng.normal(0, 2.0, (12, 3))
        path = START + np.outer(counts, STEP) + common
        x = path + rng.normal(size=(12, 3)) @ np.sqrt(first)
        y = path + rng.normal(size=(12, 3)) @ np.sqrt(second)
        noise = residual_noise(x, y, counts)
        total += noise.gap / runs
        cross += noise.cross / runs
    # The line takes its two numbers along the track only where the track runs; across it, one (its
    # mean) and a direction: T - 2 again.
    assert np.diag(total) == pytest.approx(np.diag(first + second), rel=0.1)
    assert np.diag(cross) == pytest.approx([4.0] * 3, rel=0.15)


def test_noise_closes_on_m():
    rng = np.random.default_rng(1)
    noise = residual_noise(LINE + rng.normal(size=LINE.shape), LINE + rng.normal(size=LINE.shape), COUNTS)
    difference = noise.residual_x - noise.residual_y
    assert noise.gap == pytest.approx(difference.T @ difference / (len(COUNTS) - 2))


def test_too_few_points_make_no_noise():
    with pytest.raises(ValueError, match="5 points or more, got 3"):
        residual_noise(LINE[:3], LINE[:3], COUNTS[:3])


def test_displacement_is_a_length():
    assert displacement(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 2.0]])).tolist() == [5.0, 2.0]


def test_autocorrelation_is_by_point_count_not_by_row():
    # Series 1, -1, 1 at counts 0, 1, 3: deviations 2/3, -4/3, 2/3 about 1/3; sum of squares 24/9.
    rho = autocorrelation(np.array([1.0, -1.0, 1.0]), np.array([0, 1, 3]), lags=4)
    assert rho[0] == 1
    assert rho[1] == pytest.approx((2 / 3 * -4 / 3) / (24 / 9))  # only counts 0 and 1 are one apart
    assert rho[2] == pytest.approx((-4 / 3 * 2 / 3) / (24 / 9))  # counts 1 and 3
    assert rho[3] == pytest.approx((2 / 3 * 2 / 3) / (24 / 9))
    assert np.isnan(rho[4])
