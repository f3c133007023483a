"""A deck unit's ranges become pings: half the time, turnaround off, where the ship was half-way."""

from __future__ import annotations

import math
import sqlite3

import numpy as np
import pytest

from trackerlib.beacon.navigation import PositionLimits
from trackerlib.live.deck_pings import PATIENCE_S, RangePlacer, pings_of_ranges
from trackerlib.live.navigation_stream import DeckUnitRange, Fix
from trackerlib.live.session_file import SessionFile, read_session

BEGAN_S, LATE_S, TURNAROUND_S = 1_780_315_200.0, 0.4, 0.02


def fix(second):
    """A ship that goes east by a thousandth of a degree a second."""
    return Fix(BEGAN_S + second, 40.0, -67.0 + 1e-3 * second, 1.0)


def heard(placer, seconds):
    for second in range(seconds):
        placer.hear(BEGAN_S + second + LATE_S, fix(second))


def test_half_the_time_where_the_ship_was_between_question_and_reply():
    placer = RangePlacer(TURNAROUND_S, hydrophone_depth_m=4.0)
    heard(placer, 20)
    by_log = DeckUnitRange(BEGAN_S + 10 + LATE_S, 4.0, turnaround_removed=True)
    by_host = DeckUnitRange(BEGAN_S + 16 + LATE_S, 4.0, turnaround_removed=False)
    for one in (by_log, by_host):
        placer.hear(one.utc_s, one)
    first, second = placer.pings(BEGAN_S + 20)
    assert (first.number, second.number) == (1, 2)
    assert (first.travel_time_s, second.travel_time_s) == pytest.approx((2.0, 1.99))
    # The reply came 4.02 s after the question: half-way is 2.01 s before; in host mode all of it is 4 s.
    assert (first.lon_deg + 67, second.lon_deg + 67) == pytest.approx((7.99e-3, 14e-3), abs=1e-9)
    assert (first.up_m, first.utc) == (-4.0, np.datetime64(round(1e3 * (BEGAN_S + 7.99)), "ms"))
    assert placer.pings(BEGAN_S + 21) == []


def test_what_gives_no_ping_is_counted():
    placer = RangePlacer(TURNAROUND_S)
    for two_way_s, removed in ((None, True), (0.015, False), (3.0, True)):
        placer.hear(BEGAN_S + 5, DeckUnitRange(BEGAN_S + 5, two_way_s, removed))
    assert placer.pings(BEGAN_S + 6) == []
    assert (placer.ranges, placer.no_reply, placer.too_short, placer.unplaced) == (3, 1, 1, 0)
    assert placer.pings(BEGAN_S + 5 + PATIENCE_S) == []
    assert placer.unplaced == 1


def test_a_range_waits_for_the_position_after_it():
    placer = RangePlacer(TURNAROUND_S)
    placer.hear(BEGAN_S + 9.5, DeckUnitRange(BEGAN_S + 9.5, 1.0, True))
    assert placer.pings(BEGAN_S + 10) == []
    heard(placer, 12)
    assert [ping.number for ping in placer.pings(BEGAN_S + 12)] == [1]


def test_limits_of_positions_hold_for_ranges_and_the_antenna_is_put_to_the_hydrophone():
    placer = RangePlacer(TURNAROUND_S)
    heard(placer, 20)
    placer.hear(BEGAN_S + 10, DeckUnitRange(BEGAN_S + 10, 2.0, True))
    assert placer.pings(BEGAN_S + 11, PositionLimits(greatest_hdop=0.5)) == []
    (ping,) = placer.pings(BEGAN_S + 11, antenna_offset_m=(0.0, 100.0, 0.0))
    assert 111e3 * (40.0 - ping.lat_deg) == pytest.approx(100.0, rel=0.01)  # sailing east, starboard is south


def test_they_are_rows_of_the_session_file_and_pings_again_when_it_is_opened(tmp_path):
    path = tmp_path / "deck.session"
    ranges = [DeckUnitRange(BEGAN_S + 5.0 + k, None if k == 2 else 1.0 + k, k % 2 == 0) for k in range(4)]
    with SessionFile(path) as file:
        file.add_settings({"turnaround_s": TURNAROUND_S})
        for second in range(20):
            file.add_fix(BEGAN_S + second + LATE_S, fix(second))
        for one in ranges:
            file.add_range(one.utc_s, one)
    recorded = read_session(path)
    assert recorded.ranges == tuple(ranges)
    pings, placer = pings_of_ranges(recorded, "deck", simulated=True)
    assert pings.simulated
    assert pings.number.tolist() == [1, 2, 4]
    assert pings.travel_time_s.tolist() == pytest.approx([0.5, 0.99, 1.99])
    assert (placer.no_reply, placer.unplaced) == (1, 0)
    assert not any(math.isnan(lat) for lat in pings.lat_deg)


def test_a_session_from_before_there_were_ranges_is_read_and_carried_on(tmp_path):
    path = tmp_path / "old.session"
    with SessionFile(path):
        pass
    old = sqlite3.connect(path)
    old.execute("DROP TABLE deck_range")
    old.close()
    assert read_session(path).ranges == ()
    with SessionFile(path) as file:
        file.add_range(1.0, DeckUnitRange(1.0, 2.0, True))
    assert read_session(path).ranges == (DeckUnitRange(1.0, 2.0, True),)
