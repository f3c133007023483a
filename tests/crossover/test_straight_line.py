"""Straight lines at constant speed, and the noise about them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from trackerlib.crossover.noise import autocorrelation, displacement, gap_of_printed, residual_noise
from trackerlib.crossover.smooth_track import choose_degree, fit_track, is_curved
from trackerlib.crossover.straight_line import fit_straight_line

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


@pytest.mark.parametrize("points", [15, 60])
def test_noise_that_hangs_together_or_has_a_direction_is_no_bend(points):
    rng = np.random.default_rng(12)
    counts = np.arange(points)
    line = START + np.outer(counts, STEP)
    bent = line + np.outer(20 * (2 * counts / points - 1.0) ** 2, [0, 1, 0])
    slow, uneven, found = [], [], []
    for _ in range(100):
        noise = lfilter([0.8], [1, -0.6], rng.normal(size=(points + 50, 3)), axis=0)[50:]
        slow.append(is_curved(line + noise, counts))
        uneven.append(is_curved(line + rng.normal(size=(points, 3)) * [0.5, 0.5, 5.0], counts))
        found.append(is_curved(bent + 0.2 * noise, counts))
    assert max(np.mean(slow), np.mean(uneven)) < 0.03
    assert np.mean(found) > 0.9


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
    found = autocorrelation(np.array([1.0, -1.0, 1.0]), np.array([0, 1, 3]), lags=4)
    rho = found.value
    assert found.pairs.tolist() == [3, 1, 1, 1, 0]
    assert rho[0] == 1
    assert rho[1] == pytest.approx((2 / 3 * -4 / 3) / (24 / 9))  # only counts 0 and 1 are one apart
    assert rho[2] == pytest.approx((-4 / 3 * 2 / 3) / (24 / 9))  # counts 1 and 3
    assert rho[3] == pytest.approx((2 / 3 * 2 / 3) / (24 / 9))
    assert np.isnan(rho[4])


def test_white_noise_stays_within_the_band_95_times_in_100():
    rng = np.random.default_rng(5)
    counts = np.sort(rng.choice(120, 60, replace=False))
    inside = []
    for _ in range(300):
        found = autocorrelation(rng.normal(size=60), counts, lags=10)
        inside.append(np.abs(found.value[1:]) < found.band[1:])
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize(("bend", "degree"), [((0, 0), 1), ((0.05, 0), 2), ((0.0, 0.004), 3)])
def test_the_degree_of_a_track_is_found(bend, degree):
    counts = np.arange(60)
    t = counts - 30.0
    track = START + np.outer(counts, STEP) + (bend[0] * t**2 + bend[1] * t**3)[:, None] * [0, 1, 0]
    rng = np.random.default_rng(6)
    found = [choose_degree(track + rng.normal(size=track.shape), counts) for _ in range(40)]
    assert np.mean(np.array(found) == degree) > 0.94
    course = fit_track(track + rng.normal(size=track.shape), counts)
    assert np.abs(course.at(counts) - track).max() < 1.5


def test_a_bend_is_no_noise():
    counts = np.arange(60)
    bend = START + np.outer(counts, STEP) + (0.05 * (counts - 30.0) ** 2)[:, None] * [0, 1, 0]
    rng = np.random.default_rng(7)
    x, y = (bend + rng.normal(size=bend.shape) for _ in range(2))
    assert residual_noise(x, y, counts).first[1, 1] > 50
    smooth = residual_noise(x, y, counts, degree=None)
    assert smooth.degree == 2
    assert np.diag(smooth.first) == pytest.approx([1, 1, 1], rel=0.5)


def test_cross_correlations_are_correlations():
    rng = np.random.default_rng(8)
    common = rng.normal(size=LINE.shape)
    noise = residual_noise(LINE + common, LINE + common, COUNTS)
    assert np.diag(noise.cross_correlation) == pytest.approx([1, 1, 1])


def test_table_c1_closes_on_m_through_its_printed_correlations(shared):
    table = pd.read_csv(shared / "seed-data/seed000_tableC1_residual_covariances.csv")
    closed = 0
    for _, row in table.dropna(subset=["Dx11"]).iterrows():
        first, second, printed, wanted = (
            np.array([[row[f"{name}{i}{j}"] for j in (1, 2, 3)] for i in (1, 2, 3)])
            for name in ("Dx", "Dy", "Rxy", "M")
        )
        # Every printed number is rounded to 0.01: the farthest that the four together can lie from what they were.
        size = np.sqrt(np.outer(np.diag(second), np.diag(first)))
        most = np.sqrt(np.outer(np.diag(second) + 0.005, np.diag(first) + 0.005))
        cross = (np.abs(printed) + 0.005) * most - np.abs(printed) * size
        rounding = 0.015 + cross + cross.T
        apart = np.abs(gap_of_printed(first, second, printed) - wanted)
        assert np.all(apart <= rounding), f"set {row['set']}"
        closed += 1
    assert closed == 66
