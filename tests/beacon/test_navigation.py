"""The ship at each reception: interpolated where two good fixes stand close by, refused with its reason elsewhere."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trackerlib.beacon.navigation import NavigationFixes, PositionLimits, ship_at_receptions
from trackerlib.commands import main
from trackerlib.frames import LocalFrame
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S, sail_hexagon

FRAME = LocalFrame(54.0, 10.0)


def fixes_on(seconds, east, north, hdop=1.0, heading_deg=None):
    lat, lon, _ = FRAME.to_geodetic(np.column_stack([east, north, np.zeros(len(seconds))]))
    heading = None if heading_deg is None else np.radians(np.broadcast_to(heading_deg, np.shape(seconds)))
    return NavigationFixes(
        np.asarray(seconds, float), lat, lon, np.broadcast_to(hdop, np.shape(seconds)), heading
    )


def sailing_east(seconds, **more):
    seconds = np.asarray(seconds, float)
    return fixes_on(seconds, 4.0 * seconds, np.zeros_like(seconds), **more)


def local(ship):
    return FRAME.to_local(ship.lat_deg, ship.lon_deg, 0.0)[:, :2]


def test_between_two_fixes_the_ship_is_where_it_sailed():
    ship = ship_at_receptions(sailing_east(np.arange(10)), [0.0, 2.25, 8.9, 10.5])
    assert ship.accepted.all()
    assert local(ship) == pytest.approx(np.array([[0, 0], [9, 0], [35.6, 0], [42, 0]]), abs=1e-3)


@pytest.mark.parametrize(
    ("seconds", "hdop", "arrival", "why"),
    [
        ([0, 1, 9, 10], 1.0, 4.0, "gap of more than 4 s"),
        ([0, 1, 2, 3], 1.0, 6.0, "older than 2 s"),
        ([3, 4, 5, 6], 1.0, 1.0, "no position yet"),
        ([0, 1, 2, 3], 10.0, 1.5, "HDOP of 10 or more"),
        ([0.0], 1.0, 0.0, "fewer than two"),
        ([0, 1, 2, 3], 1.0, np.nan, "no time of arrival"),
    ],
)
def test_what_cannot_be_placed_is_refused_with_its_reason(seconds, hdop, arrival, why):
    ship = ship_at_receptions(sailing_east(seconds, hdop=hdop), [arrival])
    assert not ship.accepted[0]
    ((reason, count),) = ship.refused
    assert why in reason
    assert count == 1
    assert np.isnan(ship.lat_deg[0])


def test_a_gap_is_bridged_only_if_the_limits_say_so():
    fixes = sailing_east([0, 1, 9, 10])
    wide = PositionLimits(greatest_age_s=5.0)
    assert ship_at_receptions(fixes, [4.0], wide).accepted[0]


def test_no_position_is_never_null_island():
    fixes = sailing_east(np.arange(6.0))
    lat, lon = fixes.lat_deg.copy(), fixes.lon_deg.copy()
    lat[2] = lon[2] = 0.0
    lat[3] = np.nan
    ship = ship_at_receptions(NavigationFixes(fixes.time_s, lat, lon, fixes.hdop), [2.5])
    assert dict(ship.fixes_refused)["no position"] == 2
    assert local(ship) == pytest.approx(np.array([[10.0, 0.0]]), abs=1e-3)


@pytest.mark.parametrize(("heading", "moved"), [(None, (10.0, -2.0)), (0.0, (2.0, 10.0)), (350.0, None)])
def test_the_antenna_offset_turns_with_the_ship(heading, moved):
    """10 m forward and 2 m to starboard; without a heading, along the course made good (east)."""
    fixes = sailing_east(np.arange(10), heading_deg=heading)
    ship = ship_at_receptions(fixes, [5.0], antenna_offset_m=(10.0, 2.0, 30.0))
    if moved is None:
        angle = np.radians(350)
        moved = 10 * np.array([np.sin(angle), np.cos(angle)]) + 2 * np.array([np.cos(angle), -np.sin(angle)])
    assert local(ship)[0] - [20.0, 0.0] == pytest.approx(np.array(moved), abs=1e-3)


def test_a_ship_at_rest_without_heading_does_not_know_where_its_hydrophone_is():
    still = fixes_on(np.arange(6.0), np.zeros(6), np.zeros(6))
    ship = ship_at_receptions(still, [2.5], antenna_offset_m=(3.0, 4.0, 0.0), offset_sigma_m=0.5)
    assert ship.sigma_m[0] == pytest.approx(5.5)
    assert "neither" in ship.turned[0][0]


def test_a_whole_hunt_from_two_streams(tmp_path, capsys):
    points = sail_hexagon(SCENARIOS[2], 900)
    rng = np.random.default_rng(3)
    arrivals = points.received_s + 17.3 + rng.normal(0, TIME_RMS_S, 900)
    heard = rng.random(900) > 0.3
    seconds = np.arange(0.0, arrivals[-1] + 2)
    track = np.column_stack([np.interp(seconds - 17.3, points.received_s, points.ship[:, k]) for k in (0, 1)])
    lat, lon, _ = FRAME.to_geodetic(np.column_stack([track + rng.normal(0, 2, track.shape), 0 * seconds]))
    rows = [
        f"{t:.3f},{a:.8f},{o:.8f},{12 if 300 < t < 330 else 1}"
        for t, a, o in zip(seconds, lat, lon, strict=True)
    ]
    (tmp_path / "nav.csv").write_text(
        "time_s,lat_deg,lon_deg,hdop\n" + "\n".join(rows) + "\n60,,,1\nx,1,2,1\n"
    )
    (tmp_path / "arrivals.csv").write_text(
        "# simulated\narrival_s\n" + "\n".join(f"{t:.6f}" for t in arrivals[heard])
    )
    argv = ["fix", str(tmp_path / "arrivals.csv"), "--navigation", str(tmp_path / "nav.csv"), "--json"]
    assert main(argv) == 2
    assert "--interval-s" in capsys.readouterr().err
    assert main([*argv, "--interval-s", "2", "--gps-rms-m", "2", "--sample-interval-ms", "1"]) == 0
    out, err = capsys.readouterr()
    answer = json.loads(out)
    assert "HDOP of 10 or more" in err
    assert f"line {len(rows) + 3}" in err
    assert answer["converged"]
    assert answer["simulated"]
    assert answer["used"] > 500
    truth_lat, truth_lon, _ = FRAME.to_geodetic(np.array(SCENARIOS[2].position))
    place = FRAME.to_local(answer["lat_deg"], answer["lon_deg"], -answer["depth_m"])
    error = place - FRAME.to_local(truth_lat, truth_lon, SCENARIOS[2].position[2])
    assert np.abs(error[:2]).max() < 4 * max(answer["sigma_east_m"], answer["sigma_north_m"])
    assert abs(error[2]) < 4 * answer["sigma_depth_m"]
    assert answer["sound_speed_mps"] == SOUND_SPEED_MPS


@pytest.mark.parametrize(
    "limits", [{"greatest_hdop": 0.0}, {"greatest_age_s": -1.0}, {"greatest_gap_s": 1e9}]
)
def test_limits_that_make_no_sense_are_named(limits):
    with pytest.raises(ValueError, match=next(iter(limits))):
        PositionLimits(**limits)
