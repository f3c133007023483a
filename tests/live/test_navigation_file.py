"""Positions from a file beside a recording: NMEA logs and CSV, dates, refusals, files that are no use."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from trackerlib.beacon.navigation import NavigationFixes, ship_at_receptions
from trackerlib.live.navigation_file import outside_words, read_navigation_file
from trackerlib.simulation.hunt_files import nmea_lines, sentence
from trackerlib.textfiles import InputError

BEGAN_S = datetime(2024, 4, 30, 23, 59, 58, 250_000, UTC).timestamp()  # midnight comes soon
TIME_S = np.arange(-3.25, 60.0)  # a GPS tells of whole seconds
FIXES = NavigationFixes(TIME_S, -33.5 + 1e-5 * TIME_S, 151.25 - 1e-5 * TIME_S, np.full(len(TIME_S), 1.2))


def read(lines, began_s=BEGAN_S):
    return read_navigation_file(lines, "gps.nmea", began_s)


def same_places(fixes):
    assert fixes.time_s == pytest.approx(FIXES.time_s, abs=1e-5)
    assert fixes.lat_deg == pytest.approx(FIXES.lat_deg, abs=1e-6)
    assert fixes.lon_deg == pytest.approx(FIXES.lon_deg, abs=1e-6)
    assert fixes.hdop == pytest.approx(FIXES.hdop)


def test_an_nmea_log_is_read_over_midnight_each_position_once():
    log = read(["# SIMULATED", *nmea_lines(FIXES, BEGAN_S)])
    same_places(log.fixes)
    assert (log.layout, log.simulated, log.bad_records) == ("NMEA 0183", True, ())


def test_a_log_without_dates_takes_them_from_the_recording():
    same_places(read([line for line in nmea_lines(FIXES, BEGAN_S) if "GGA" in line]).fixes)


def test_a_loggers_own_time_before_the_sentence_is_passed_over():
    same_places(read([f"2024-04-30T23:59:58Z {line}" for line in nmea_lines(FIXES, BEGAN_S)]).fixes)


def test_a_csv_tells_utc_or_seconds_of_the_recording():
    utc = [f"2024-05-01T00:00:{s:02d}.5Z,-33.5,151.25,1.1" for s in range(3)]
    log = read(["utc,lat_deg,lon_deg,hdop", *utc])
    assert log.fixes.time_s == pytest.approx([2.25, 3.25, 4.25])
    log = read(["time_s,lat_deg,lon_deg", "0,-33.5,151.25", "1,-33.5,151.25"], None)
    assert list(log.fixes.time_s) == [0, 1]


def test_an_hdop_that_is_too_large_is_not_got_round_by_the_sentence_without_one():
    hdop = np.where((TIME_S > 20) & (TIME_S < 30), 12.0, 1.0)
    fixes = NavigationFixes(TIME_S, FIXES.lat_deg, FIXES.lon_deg, hdop)
    ship = ship_at_receptions(read(nmea_lines(fixes, BEGAN_S)).fixes, np.array([10.3, 25.1, 62.9]))
    assert list(ship.accepted) == [True, False, False]
    assert dict(ship.refused) == {"HDOP of 10 or more": 1, "older than 2 s": 1}
    assert dict(ship.fixes_refused) == {"HDOP of 10 or more": 10}


def test_lines_that_give_no_position_are_told_by_their_number():
    lines = nmea_lines(FIXES, BEGAN_S)
    lines[3] = lines[3][:-1] + "?"
    lines[5:5] = ["garbage", sentence("GPGGA,000000.00,,,,,0,00,,,M,,M,,")]
    log = read(lines)
    assert [record.line for record in log.bad_records] == [4, 6, 7]
    assert "wanted a sentence of NMEA" in log.bad_records[1].why
    assert "no fix" in log.bad_records[2].why


@pytest.mark.parametrize(
    ("lines", "began_s", "words"),
    [
        (["$GPGGA,1,2*00"], BEGAN_S, "found 0 positions, wanted at least two; line 1: .*checksum"),
        (nmea_lines(FIXES, BEGAN_S), None, "needs the time at which the recording began"),
        (["utc,lat_deg,lon_deg", "2024-05-01T00:00:00Z,1,2"], None, "needs the time"),
        (
            ["utc,lat_deg,lon_deg", "yesterday,1,2"],
            BEGAN_S,
            "at least two; line 2: utc is 'yesterday'; wanted ISO",
        ),
        (
            ["utc,lat,lon", "1,2,3"],
            BEGAN_S,
            "line 1: found columns 'utc, lat, lon'; wanted utc, lat_deg, lon_deg",
        ),
        (["some words"], BEGAN_S, "line 1: found columns 'some words'; wanted time_s, lat_deg, lon_deg"),
    ],
)
def test_files_that_are_no_use(lines, began_s, words):
    with pytest.raises(InputError, match=f"gps.nmea.*{words}"):
        read(lines, began_s)


def test_positions_of_another_time_are_told():
    assert outside_words(FIXES, 60.0) == ""
    late = NavigationFixes(TIME_S + 7200, FIXES.lat_deg, FIXES.lon_deg, FIXES.hdop)
    assert outside_words(late, 600.0) == (
        "no position is of the time of the recording: the nearest is 1:49:57 after its end"
    )
