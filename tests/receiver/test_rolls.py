"""What was heard, laid on paper again: the same whatever the pieces it came in."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.beacon.pings import Pings
from trackerlib.receiver.arrivals import Arrivals, Heard
from trackerlib.receiver.chart import ChartSettings, line_of
from trackerlib.receiver.rolls import MarkRoll, PingRoll, SoundRoll

SETTINGS = ChartSettings(interval_s=2.0, columns=200)


def arrivals(time_s, level, rank=None):
    time_s = np.asarray(time_s, float)
    unknown = np.full(len(time_s), np.nan)
    ranks = np.ones(len(time_s), int) if rank is None else np.asarray(rank)
    return Arrivals(
        (time_s // 2).astype(int), ranks, time_s, np.asarray(level, float), unknown, unknown, unknown
    )


def nothing():
    return arrivals([], [])


def test_sound_is_the_same_paper_in_pieces_and_at_once():
    levels = np.random.default_rng(1).integers(0, 255, 20_000).astype(np.uint8)
    whole, pieces = SoundRoll("a"), SoundRoll("a")
    whole.feed(Heard(levels, nothing()))
    for k in range(0, len(levels), 777):
        pieces.feed(Heard(levels[k : k + 777], nothing()))
    assert whole.whole_lines(SETTINGS) == pieces.whole_lines(SETTINGS) == 10
    expected = whole.lines(SETTINGS, 0, 10)
    assert np.array_equal(expected, pieces.lines(SETTINGS, 0, 10))
    assert np.array_equal(expected[3:7], pieces.lines(SETTINGS, 3, 7))
    assert pieces.lines(SETTINGS, 4, 4).shape == (0, 200)


def test_a_line_waits_for_its_arrivals_until_the_sound_ends():
    roll = SoundRoll("a", held_s=3.0)
    roll.feed(Heard(np.zeros(10_000, np.uint8), nothing()))
    assert roll.whole_lines(SETTINGS) == 3
    roll.finish()
    assert roll.whole_lines(SETTINGS) == 5


def test_fainter_than_the_threshold_leaves_bare_paper():
    roll = SoundRoll("a")
    roll.feed(Heard(np.full(2000, 100, np.uint8), nothing()))
    assert roll.lines(SETTINGS, 0, 1).min() >= 100
    assert roll.lines(SETTINGS, 0, 1, threshold=101).max() < 30


def test_marks_are_as_dark_as_their_levels_and_stand_beside_their_noise():
    roll = MarkRoll("line", simulated=True)
    roll.add(arrivals([0.5, 1.5, 2.5, 3.4], [200, 90, 120, 80], [1, 2, 1, 2]), 4.0)
    lines = roll.lines(SETTINGS, 0, 2, threshold=100)
    assert [int(np.argmax(line)) // 5 * 5 for line in lines] == [50, 50]
    assert lines[0].max() > lines[1].max() > 60
    values = roll.beside(SETTINGS, 0, lines, threshold=150)
    assert values.level.tolist() == [200, 120]
    assert values.noise.tolist() == [90, 80]
    assert values.missed.tolist() == [False, True]
    assert np.isnan(values.lat_deg).all()


def test_the_ship_is_where_her_positions_say():
    roll = MarkRoll("line")
    second = np.arange(10.0)
    roll.fixes = NavigationFixes(second, 40 + second / 3600, np.full(10, 5.0), np.ones(10))
    lat, lon = roll.ship(np.array([2.5, 500.0]))
    assert lat[0] == pytest.approx(40 + 2.5 / 3600)
    assert np.isnan(lat[1])
    assert np.isnan(lon[1])


def test_a_survey_has_a_line_a_ping_whatever_the_time_between():
    clock = np.array([0.0, 13.0, 100.0])
    pings = Pings(
        np.arange(3), np.full(3, 40.0), np.full(3, 5.0), np.zeros(3), np.array([1.1, 1.2, 1.3]),
        np.full(3, np.datetime64("NaT", "ms")), clock_s=clock,
    )  # fmt: skip
    roll = PingRoll(pings)
    assert roll.whole_lines(SETTINGS) == 3
    _, line, folded = roll.placed(SETTINGS)
    assert line.tolist() == [0, 1, 2]
    assert folded == pytest.approx([1.1, 0.2, 1.3])
    assert roll.time_of(SETTINGS, np.array([1]), np.array([0.25])) == pytest.approx([14.25])


@pytest.mark.parametrize("offset_s", [0.0, 0.7, -0.3])
def test_a_place_on_paper_is_the_time_it_stands_for(offset_s):
    settings = ChartSettings(interval_s=1.7, offset_s=offset_s)
    time_s = np.random.default_rng(3).uniform(0, 500, 50)
    line, folded = line_of(time_s, settings)
    assert np.all((folded >= 0) & (folded < 1.7))
    assert MarkRoll("a").time_of(settings, line, folded) == pytest.approx(time_s)
