"""The gap of a set in a few numbers, by hand and with wild positions."""

import numpy as np
import pytest

from trackerlib.crossover.gaps import course_of, distance_along, heading_of, summarise_gap
from trackerlib.crossover.pairs import CrossoverSet


def crossover_of(gap):
    gap = np.asarray(gap, float)
    return CrossoverSet((1, 2), np.arange(len(gap)), gap, np.zeros_like(gap))


def test_median_and_spread_by_hand():
    summary = summarise_gap(crossover_of([[1, 0, 5], [2, 0, 5], [4, 0, 5]]))
    assert summary.median.tolist() == [2, 0, 5]
    assert summary.spread == pytest.approx([1.4826, 0, 0])
    assert not summary.far.any()


def test_spread_is_the_standard_deviation_of_normal_noise():
    noise = np.random.default_rng(5).normal([10, -3, 0], [2, 1, 4], (20_000, 3))
    summary = summarise_gap(crossover_of(noise))
    assert summary.median == pytest.approx([10, -3, 0], abs=0.1)
    assert summary.spread == pytest.approx([2, 1, 4], rel=0.03)


@pytest.mark.parametrize("size", [100, -5000, 1e6])
def test_a_wild_position_is_far_and_moves_nothing(size):
    gap = np.random.default_rng(6).normal(0, 2, (40, 3))
    calm = summarise_gap(crossover_of(gap))
    gap[7, 1] += size
    wild = summarise_gap(crossover_of(gap))
    assert np.flatnonzero(wild.far).tolist() == [7]
    assert wild.median == pytest.approx(calm.median, abs=0.5)


def test_one_point_has_a_gap_and_no_spread():
    summary = summarise_gap(crossover_of([[1, 2, 3]]))
    assert summary.median.tolist() == [1, 2, 3]
    assert np.isnan(summary.spread).all()
    assert not summary.far.any()


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5, -2.0])
def test_distance_along_grows_with_time_on_any_course(heading):
    t = np.arange(10)
    track = np.column_stack([40 * t * np.cos(heading), 40 * t * np.sin(heading), -300 + 2 * t])
    along = distance_along(track, track.mean(axis=0), course_of(track, t))
    assert along == pytest.approx(40 * (t - 4.5))


def test_a_track_that_goes_nowhere_is_seen_from_downrange():
    assert course_of(np.zeros((1, 3)), np.array([5])).tolist() == [1, 0]
    assert course_of(np.zeros((4, 3)) + [0, 0, 1] * np.arange(4)[:, None], np.arange(4)).tolist() == [1, 0]


def test_heading_follows_the_track_through_a_gap_and_for_two_points():
    counts = np.array([1, 2, 3, 4, 40, 41])
    track = np.column_stack([10.0 * counts, 10.0 * counts, 0.0 * counts])
    assert np.degrees(heading_of(track, counts)) == pytest.approx(45.0)
    assert np.degrees(heading_of(-track[[0, 4]], counts[[0, 4]])) == pytest.approx(-135.0)
    assert np.isnan(heading_of(track[:1], counts[:1])).all()
