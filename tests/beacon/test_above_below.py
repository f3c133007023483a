"""A beacon above a deep hydrophone: told where the pings tell it, both places and words where they do not."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from surveys import BOX, FRAME, LINE, survey

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.live_survey import LiveSurvey
from trackerlib.beacon.settings import FixSettings
from trackerlib.commands import main
from trackerlib.exports.record import FixRecord
from trackerlib.simulation.beacon_survey import Errors

PLAIN = FixSettings(gps_rms_m=1.0, sample_interval_ms=1.7, sound_speed_sigma_mps=0.0)
DEEP_M = 1000.0  # of the hydrophone


def heard(depth_m, legs=BOX, gps_rms_m=1.0, lowered_m=0.0, seed=0):
    """Pings of a beacon at a depth; over the second half of the survey the hydrophone is lowered."""
    beacon, errors = (100.0, 50.0, -depth_m), Errors(gps_rms_m, 5e-4)
    first, second = (
        survey(legs, beacon, errors, seed=seed, hydrophone_depth_m=DEEP_M + more) for more in (0.0, lowered_m)
    )
    late = np.arange(len(first)) >= len(first) // 2
    columns = ("lat_deg", "lon_deg", "up_m", "travel_time_s")
    return replace(
        first, **{name: np.where(late, getattr(second, name), getattr(first, name)) for name in columns}
    )


@pytest.mark.parametrize("depth_m", [400.0, 1600.0])
@pytest.mark.parametrize(
    "how",
    [
        {},
        {"gps_rms_m": 10.0},  # whose bias the squared ranges take out
        {"gps_rms_m": 10.0, "motion": "vertical"},
        {"method": "pairs", "spacing": 5},
    ],
    ids=str,
)
def test_both_sides_of_a_level_track_are_told(depth_m, how):
    settings = replace(PLAIN, **how)
    fix = fix_beacon(heard(depth_m, gps_rms_m=settings.gps_rms_m), settings)
    assert not fix.converged
    assert "cannot tell above from below the hydrophone, 1000 m deep" in fix.reason
    assert "lower or raise the hydrophone by" in fix.reason
    told = sorted([fix.depth_m, *(other.depth_m for other in fix.alternatives)])
    assert len(told) == 2
    assert told == pytest.approx([400.0, 1600.0], abs=3 * fix.sigma[2])
    assert f"told {'above' if fix.depth_m < DEEP_M else 'below'} it" in fix.reason
    assert fix.notes == ()  # the reason says it


@pytest.mark.parametrize(
    ("how", "live"),
    [
        ({}, False),
        ({}, True),
        ({"gps_rms_m": 10.0}, False),
        ({"gps_rms_m": 10.0}, True),
        ({"method": "pairs", "spacing": 5}, False),
    ],
    ids=str,
)
def test_a_hydrophone_that_was_lowered_tells_the_side(how, live):
    settings = replace(PLAIN, **how)
    pings = heard(400.0, gps_rms_m=settings.gps_rms_m, lowered_m=60.0)
    fix = LiveSurvey(pings, settings).hear(pings, len(pings)) if live else fix_beacon(pings, settings)
    assert fix.converged, fix.reason
    assert fix.depth_m == pytest.approx(400.0, abs=3 * fix.sigma[2])
    assert fix.alternatives == ()
    (note,) = fix.notes
    assert "m above the hydrophone" in note
    assert "no place below it fits as well" in note
    assert f"Note: {note}" in FixRecord(fix).summary


@pytest.mark.parametrize("method", ["all-pings", "pairs"])
def test_a_search_region_above_the_hydrophone_leaves_one_place(method):
    fix = fix_beacon(heard(400.0), replace(PLAIN, method=method, spacing=5, max_depth_m=700.0))
    assert fix.converged, fix.reason
    assert fix.depth_m == pytest.approx(400.0, abs=3 * fix.sigma[2])
    assert "above the hydrophone" in fix.notes[0]


def test_the_sigma_of_a_beacon_above_the_hydrophone_is_true():
    settings, misses = replace(PLAIN, gps_rms_m=10.0), []
    for seed in range(20):
        fix = fix_beacon(heard(400.0, gps_rms_m=10.0, lowered_m=60.0, seed=[5, seed]), settings)
        assert fix.converged
        misses.append((fix.depth_m - 400.0) / fix.sigma[2])
    assert np.sqrt(np.mean(np.square(misses))) == pytest.approx(1.0, abs=3 / np.sqrt(2 * 20))
    assert abs(np.mean(misses)) < 3 / np.sqrt(20)


def test_a_hydrophone_near_the_surface_needs_no_words():
    fix = fix_beacon(survey(BOX, (100.0, 50.0, -2400.0), Errors(1.0, 5e-4), hydrophone_depth_m=6.0), PLAIN)
    assert fix.converged
    assert fix.notes == ()


def test_a_beacon_level_with_the_hydrophone_says_so():
    fix = fix_beacon(heard(990.0), PLAIN)
    assert any("about level with the hydrophone" in note for note in fix.notes)


def test_a_straight_level_track_says_that_above_fits_too():
    fix = fix_beacon(heard(400.0, LINE), PLAIN)
    assert fix.position is None
    assert any("above the hydrophone, 1000 m deep" in note for note in fix.notes)


def test_the_command_tells_it(tmp_path, capsys):
    path = tmp_path / "pings.csv"
    pings = heard(400.0, lowered_m=60.0)
    rows = zip(pings.lat_deg, pings.lon_deg, pings.travel_time_s, pings.up_m, strict=True)
    lines = (",".join(map(str, row)) for row in rows)
    path.write_text("\n".join(["lat_deg,lon_deg,oneway_s,up_m", *lines]))
    assert main(["fix", str(path), "--gps-rms-m", "1", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert len(answer["notes"]) == 1
    assert main(["fix", str(path), "--gps-rms-m", "1"]) == 0
    assert f"note      {answer['notes'][0]}" in capsys.readouterr().out
    assert FRAME.lat_deg == pytest.approx(answer["lat_deg"], abs=0.01)


@pytest.mark.parametrize("depth_m", [0.0, 8.0])
def test_a_beacon_at_the_surface_asks_for_a_deeper_hydrophone_which_tells(depth_m):
    beacon, errors = (400.0, 300.0, -depth_m), Errors(1.0, 5e-4)
    shallow, lowered = (survey(BOX, beacon, errors, seed=2, hydrophone_depth_m=deep) for deep in (4.0, 114.0))
    fix = fix_beacon(shallow, PLAIN)
    assert not fix.converged
    assert "about level with the hydrophone" in fix.reason
    assert "lower the hydrophone by 110 m" in fix.reason
    assert "sail" not in fix.reason
    late = np.arange(len(shallow)) >= len(shallow) // 2
    columns = ("lat_deg", "lon_deg", "up_m", "travel_time_s")
    both = {name: np.where(late, getattr(lowered, name), getattr(shallow, name)) for name in columns}
    told = fix_beacon(replace(shallow, **both), PLAIN)
    assert told.converged, told.reason
    assert told.depth_m == pytest.approx(depth_m, abs=3 * told.sigma[2])
