"""Straight pieces of one array's track: turns cut it, wild points and wobble do not."""

import numpy as np
import pytest

from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.segments import MIN_PIECE, straight_segments
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.segment_file import read_segment, segment_file_name, write_segment
from trackerlib.textfiles import InputError

SURVEY = ArraySurvey(
    np.array([4, 9]),
    np.array([[0.0, 0, -1300], [0, 0, 0]]),
    np.full(2, "NaT", "datetime64[D]"),
    np.array([False, True]),
)


def reports_of(counts, position, array=4):
    n = len(counts)
    return PositionReports(
        np.arange(n) + 32, counts, position, np.full(n, array), np.full(n, 7), np.zeros(n, bool)
    )


def bent_track(size, turn_at, degrees, noise=1.0, seed=1):
    """Counts and positions of a vehicle that turns once on the spot."""
    counts = np.arange(size)
    heading = np.where(counts < turn_at, 0.0, np.radians(degrees))
    step = 30 * np.column_stack([np.cos(heading), np.sin(heading), 0 * heading])
    path = np.cumsum(step, axis=0) - [1500, 0, 300]
    return counts, path + np.random.default_rng(seed).normal(0, noise, path.shape)


@pytest.mark.parametrize("seed", range(5))
def test_a_straight_track_stays_whole(seed):
    (segment,) = straight_segments(reports_of(*bent_track(80, 99, 0, seed=seed)), SURVEY, 7)
    assert segment.array == 4
    assert len(segment.point_count) >= 79


@pytest.mark.parametrize("turn_at", [25, 40, 52])
def test_a_turn_cuts_the_track_where_it_is(turn_at):
    first, second = straight_segments(reports_of(*bent_track(80, turn_at, 20)), SURVEY, 7)
    assert abs(int(second.point_count[0]) - turn_at) <= 3
    assert abs(int(first.point_count[-1]) - turn_at) <= 3
    assert (first.piece, second.piece) == (1, 2)


def test_wild_points_are_left_out_and_a_gap_cuts():
    counts, path = bent_track(80, 99, 0)
    path[20] += [0, 400, 0]
    counts = np.where(counts >= 50, counts + 100, counts)
    path[50:] += [0.0, 300.0, 0.0]
    first, second = straight_segments(reports_of(counts, path), SURVEY, 7)
    assert 20 not in first.point_count
    assert second.point_count[0] == 150


def test_arrays_without_a_place_far_points_and_short_runs_make_none():
    counts, path = bent_track(80, 99, 0)
    assert straight_segments(reports_of(counts, path, array=9), SURVEY, 7) == ()
    assert straight_segments(reports_of(counts, path, array=5), SURVEY, 7) == ()
    assert straight_segments(reports_of(counts, path + 9000), SURVEY, 7) == ()
    few = MIN_PIECE - 1
    assert straight_segments(reports_of(counts[:few], path[:few]), SURVEY, 7) == ()


def test_what_is_written_is_read_back(tmp_path):
    (segment,) = straight_segments(reports_of(*bent_track(30, 99, 0)), SURVEY, 7)
    path = tmp_path / segment_file_name(segment)
    write_segment(path, segment)
    back = read_segment(path).segment
    assert path.name == "segment_04_1.txt"
    assert (back.array, back.piece) == (4, 1)
    assert np.array_equal(back.point_count, segment.point_count)
    assert np.array_equal(back.position, np.round(segment.position, 1))


def test_a_file_that_is_none_is_refused_in_words(tmp_path):
    path = tmp_path / "segment_04_1.txt"
    path.write_text("RANGE\n 1 2 3 4\n")
    with pytest.raises(InputError, match="line 1: found 'RANGE', wanted range name and array"):
        read_segment(path)
    path.write_text("RANGE  4\n 1 2 3\n")
    with pytest.raises(InputError, match="line 2: found '1 2 3'"):
        read_segment(path)
