"""Surveys that cannot give a fix: refused in words that say what is wrong, never a crash or a plausible number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.paths import StraightPaths
from trackerlib.beacon.settings import FixSettings
from trackerlib.frames import LocalFrame
from trackerlib.simulation.beacon_survey import Errors, sail, simulate_survey

FRAME = LocalFrame(40.0, -60.0)
BEACON = np.array([400.0, 300.0, -1500.0])
BOX = np.array([[0.0, 1500.0], [90.0, 1500.0], [180.0, 1500.0]])


def survey(track, beacon=BEACON, **more):
    errors = Errors(gps_rms_m=2.0, time_rms_s=0.0005)
    paths, rng = StraightPaths(1500.0), np.random.default_rng(1)
    return simulate_survey(track, beacon, paths, FRAME, rng, errors, emission_offset_s=0.3, **more)


def boxed(**more):
    return survey(sail(BOX, np.zeros(2), 2.5, 10.0), **more)


ANGLE = np.linspace(0, 2 * np.pi, 200)
SURVEYS = {
    "one place": (lambda: survey(np.zeros((100, 2))), "one place|the ship covered|greatest depth"),
    "a straight line": (
        lambda: survey(sail(np.array([[20.0, 3000.0]]), np.zeros(2), 2.5, 10.0)),
        "straight line",
    ),
    "a circle round the beacon": (
        lambda: survey(BEACON[:2] + 1000 * np.c_[np.sin(ANGLE), np.cos(ANGLE)]),
        "greatest depth|the ship covered",
    ),
    "milliseconds": (lambda: scaled(1e3), "check their unit"),
    "microseconds": (lambda: scaled(1e6), "check their unit"),
    "two-way times": (lambda: scaled(2.0), "the ship covered|flatter|edge"),
    "times in reverse order": (lambda: reversed_times(), "check the times"),
    "one ping": (lambda: boxed().only(slice(0, 1)), "1 usable pings"),
    "no ping": (lambda: boxed().only(slice(0, 0)), "0 usable pings"),
    "nothing but NaN": (lambda: scaled(np.nan), "0 usable pings"),
}


def scaled(factor):
    pings = boxed()
    return replace(pings, travel_time_s=pings.travel_time_s * factor)


def reversed_times():
    """Places forwards, times backwards, on a track that is not its own mirror."""
    pings = survey(sail(np.array([[0.0, 2500.0], [70.0, 800.0], [200.0, 1200.0]]), np.zeros(2), 2.5, 10.0))
    return replace(pings, travel_time_s=pings.travel_time_s[::-1].copy())


@pytest.mark.parametrize("motion", ["still", "free"])
@pytest.mark.parametrize("gps_rms_m", [None, 2.0])
@pytest.mark.parametrize("name", SURVEYS)
def test_it_is_refused_with_its_reason(name, gps_rms_m, motion):
    make, reason = SURVEYS[name]
    fix = fix_beacon(make(), FixSettings(gps_rms_m=gps_rms_m, motion=motion))
    assert not fix.converged
    assert any(word in fix.reason for word in reason.split("|")), fix.reason


@pytest.mark.parametrize("gps_rms_m", [None, 2.0])
def test_some_missing_times_are_left_out(gps_rms_m):
    pings = boxed()
    time = pings.travel_time_s.copy()
    time[::7] = np.nan
    fix = fix_beacon(replace(pings, travel_time_s=time), FixSettings(gps_rms_m=gps_rms_m))
    assert fix.converged
    assert not fix.used[::7].any()


def test_a_first_ping_without_a_place_is_left_out():
    pings = boxed()
    lat = pings.lat_deg.copy()
    lat[0] = np.nan
    fix = fix_beacon(replace(pings, lat_deg=lat), FixSettings(gps_rms_m=2.0))
    assert fix.converged
    assert not fix.used[0]
    assert (fix.frame.lat_deg, fix.frame.lon_deg) == (pings.lat_deg[1], pings.lon_deg[1])
    nowhere = fix_beacon(replace(pings, lat_deg=np.full(len(lat), np.nan)), FixSettings())
    assert "0 usable pings" in nowhere.reason


def test_pings_in_reverse_order_are_the_same_survey():
    pings = boxed()
    settings = FixSettings(gps_rms_m=2.0)
    backwards = fix_beacon(pings.only(slice(None, None, -1)), settings)
    place = FRAME.to_local(*backwards.frame.to_geodetic(backwards.position))
    assert np.abs(place - BEACON).max() < 4 * backwards.sigma.max()


@pytest.mark.parametrize("speed_mps", [0.0, 340.0, np.nan])
def test_a_speed_that_is_not_of_water_is_named(speed_mps):
    with pytest.raises(ValueError, match="sound_speed_mps"):
        FixSettings(sound_speed_mps=speed_mps)


def test_a_beacon_above_the_surface_is_found_as_its_mirror_below_it():
    """Times do not tell above from below: the mirror below the surface is the same fit."""
    beacon = np.array([400.0, 300.0, 200.0])
    fix = fix_beacon(boxed(beacon=beacon), FixSettings(gps_rms_m=2.0))
    assert fix.converged
    place = FRAME.to_local(*fix.frame.to_geodetic(fix.position))
    assert (np.abs(place - beacon * [1, 1, -1]) < 3 * fix.sigma).all()


def test_a_hundred_thousand_pings_are_no_trouble():
    angle = np.arange(100_000) / 1e4
    track = np.c_[2000 * np.sin(angle), 1500 * np.cos(0.7 * angle)]
    fix = fix_beacon(survey(track, interval_s=0.1), FixSettings(gps_rms_m=2.0))
    assert fix.converged
    place = FRAME.to_local(*fix.frame.to_geodetic(fix.position))
    assert (np.abs(place - BEACON) < 4 * fix.sigma).all()


def test_a_circle_round_the_beacon_says_to_sail_across_it():
    circle = SURVEYS["a circle round the beacon"][0]()
    assert "as on a circle round the beacon" in fix_beacon(circle, FixSettings()).reason
    across = survey(
        np.vstack([
            BEACON[:2] + 1000 * np.c_[np.sin(ANGLE), np.cos(ANGLE)],
            BEACON[:2] + np.c_[np.zeros(40), np.linspace(1000, -1000, 40)],
        ])
    )  # fmt: skip
    fix = fix_beacon(across, FixSettings(gps_rms_m=2.0))
    assert fix.converged, fix.reason
    assert abs(fix.depth_m - 1500) < 4 * fix.sigma[2]
