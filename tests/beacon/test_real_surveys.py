"""Fixes of real surveys, against their published answers."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from trackerlib.beacon.fix import FixSettings, fix_beacon, fix_history
from trackerlib.beacon.observability import straight_track
from trackerlib.surveyfiles.profile_csv import read_profile_csv
from trackerlib.surveyfiles.survey import read_survey


def published(folder) -> dict:
    document = json.loads((folder / "published.json").read_text())
    return document.get("solution") or document["own_reference"]


def error_of(fix, answer) -> np.ndarray:
    """East, north, up [m] of a fix minus the published place."""
    return fix.position - fix.frame.to_local(answer["lat_deg"], answer["lon_deg"], -answer["depth_m"])


def assert_close(error, *, horizontal_m, depth_m):
    assert np.hypot(*error[:2]) < horizontal_m
    assert abs(error[2]) < depth_m


@pytest.fixture(scope="module")
def wc03(real_surveys):
    folder = real_surveys / "WC03"
    answer = published(folder)
    return (
        read_survey(folder / "survey.txt").pings,
        FixSettings(sound_speed_mps=answer["sound_speed_mps"]),
        answer,
    )


def test_wc03_agrees_with_its_published_answer(wc03):
    pings, settings, answer = wc03
    fix = fix_beacon(pings, settings)
    assert fix.converged
    assert_close(error_of(fix, answer), horizontal_m=3, depth_m=20)
    assert fix.rejected.tolist() == [13, 15]
    assert np.all(np.abs(error_of(fix, answer)) < 3 * fix.sigma)


@pytest.mark.parametrize("constant_s", [-3.5, 0.013, 137.25, 86_400.0])
def test_a_constant_in_every_time_moves_nothing(wc03, constant_s):
    pings, settings, _ = wc03
    moved = fix_beacon(replace(pings, travel_time_s=pings.travel_time_s + constant_s), settings)
    still = fix_beacon(pings, settings)
    assert np.linalg.norm(moved.position - still.position) < 1e-3
    assert moved.emission_offset_s - still.emission_offset_s == pytest.approx(constant_s, abs=1e-6)


def test_a_young_fix_of_wc03_is_refused_or_covers_the_truth(wc03):
    pings, settings, answer = wc03
    fixes = [fix for _, fix in fix_history(pings, settings, first=4)]
    assert not fixes[2].converged  # after six pings
    assert "6 usable pings" in fixes[2].reason
    believed = [fix for fix in fixes if fix.converged]
    assert len(believed) > 30
    for fix in believed:
        assert np.all(np.abs(error_of(fix, answer)) < 3 * fix.sigma)


def test_s05_agrees_with_its_reference(real_surveys):
    answer = published(real_surveys / "S05")
    reading = read_survey(real_surveys / "S05/survey.txt")
    fix = fix_beacon(reading.pings, FixSettings(sound_speed_mps=1500))
    assert reading.layout == "whoi"
    assert fix.converged
    assert_close(error_of(fix, answer), horizontal_m=3, depth_m=25)
    assert np.all(np.abs(error_of(fix, answer)) < 3 * fix.sigma)


def test_a_young_fix_of_s05_is_refused_or_covers_the_truth(real_surveys):
    answer = published(real_surveys / "S05")
    pings = read_survey(real_surveys / "S05/survey.txt").pings
    counts = [*range(10, 60, 7), *range(60, 245, 40)]
    fixes = [fix_beacon(pings.only(slice(0, n)), FixSettings(sound_speed_mps=1500)) for n in counts]
    assert sum(fix.converged for fix in fixes) >= 5
    for fix in fixes:
        if fix.converged:
            assert np.all(np.abs(error_of(fix, answer)) < 3 * fix.sigma)


@pytest.mark.parametrize("transponder", ["M11", "M12", "M13", "M14"])
def test_each_transponder_of_saga(real_surveys, transponder):
    folder = real_surveys / "SAGA.1903"
    place = json.loads((folder / "published.json").read_text())["transponders"][transponder]
    profile = read_profile_csv(folder / "soundspeed.csv")
    pings = read_survey(folder / "pings.csv", transponder=transponder).pings
    fix = fix_beacon(pings, FixSettings(profile=profile))
    error = fix.position - fix.frame.to_local(place["lat_deg"], place["lon_deg"], place["up_m"])
    assert fix.converged
    assert_close(error, horizontal_m=0.3, depth_m=2)
    assert np.all(np.abs(error) < 3 * fix.sigma)


def test_a_straight_line_gives_a_pair_of_mirror_solutions_and_no_fix(real_surveys):
    answer = published(real_surveys / "1AS16")
    pings = read_survey(real_surveys / "1AS16/pings.csv").pings
    fix = fix_beacon(pings, FixSettings(sound_speed_mps=answer["sound_speed_mps"]))
    assert not fix.converged
    assert fix.position is None
    assert "across-track and depth cannot be told apart" in fix.reason
    track = straight_track(fix.ship)
    place = fix.frame.to_local(answer["lat_deg"], answer["lon_deg"], -answer["depth_m"])
    assert fix.along_track_m == pytest.approx((place - fix.ship[0]) @ track.along, abs=10)
    assert fix.closest_slant_range_m == pytest.approx(-place[2], rel=0.05)
    sides = [
        np.sign((np.array([a.east_m, a.north_m, 0]) - fix.ship[0]) @ track.across) for a in fix.alternatives
    ]
    assert sorted(sides) == [-1, 1]
    directions = np.array([u.direction_enu for u in fix.unobservable])
    assert np.allclose(np.abs(directions @ track.across), [1, 0])


@pytest.mark.parametrize("seed", range(6))
def test_wc03_with_times_folded_and_a_third_of_its_pings_dropped(wc03, seed):
    pings, settings, answer = wc03
    kept = pings.only(np.random.default_rng(seed).random(len(pings)) > 0.3)
    folded = replace(kept, travel_time_s=np.mod(kept.travel_time_s, 2.0))
    fix = fix_beacon(folded, replace(settings, interval_s=2.0))
    assert fix.converged, fix.reason
    assert_close(error_of(fix, answer), horizontal_m=3, depth_m=25)


@pytest.mark.parametrize("transponder", ["M11", "M14"])
def test_told_noise_of_the_ship_moves_saga_by_millimetres(real_surveys, transponder):
    """Squared ranges along rays: at kilometres of range and a metre of noise there is little bias to remove."""
    folder = real_surveys / "SAGA.1903"
    profile = read_profile_csv(folder / "soundspeed.csv")
    pings = read_survey(folder / "pings.csv", transponder=transponder).pings
    untold = fix_beacon(pings, FixSettings(profile=profile))
    told = fix_beacon(pings, FixSettings(profile=profile, gps_rms_m=0.5))
    assert told.converged
    assert_close(told.position - untold.position, horizontal_m=0.3, depth_m=2)


def test_experiments_find_wc03_about_as_well(wc03):
    pings, settings, answer = wc03
    fix = fix_beacon(pings, replace(settings, method="pairs", spacing=6, step=1, gps_rms_m=2.0))
    assert fix.converged, fix.reason
    assert {13, 15} <= set(fix.rejected)  # false returns
    assert np.all(np.abs(error_of(fix, answer)) < 3 * fix.sigma)
