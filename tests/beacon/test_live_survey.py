"""The live estimator fed from a growing table: each ping once, the batch's layout, its answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.live_survey import LiveSurvey
from trackerlib.beacon.paths import StraightPaths
from trackerlib.beacon.pings import Ping, PingLog
from trackerlib.beacon.settings import FixSettings
from trackerlib.frames import LocalFrame
from trackerlib.simulation.beacon_survey import Errors, sail, simulate_survey
from trackerlib.surveyfiles.survey import read_survey

SETTINGS = FixSettings(gps_rms_m=2.0)


FRAME, TRUTH = LocalFrame(35.0, 20.0), np.array([900.0, 400.0, -1600.0])


def sailed(step_m, gps_rms_m, seed):
    """Three legs of a triangle, a ping every so many metres."""
    legs = np.array([[10.0, 1500.0], [130.0, 1500.0], [250.0, 1500.0]])
    track = sail(legs, np.zeros(2), 2.5, step_m / 2.5)
    errors = Errors(gps_rms_m=gps_rms_m, time_rms_s=0.0003)
    return simulate_survey(track, TRUTH, StraightPaths(1500.0), FRAME, np.random.default_rng(seed), errors)


@pytest.fixture(scope="module")
def pings():
    return sailed(7.5, 2.0, 3)


def in_steps(pings, settings, steps):
    survey = LiveSurvey(pings.only(slice(0, 1)), settings)
    for count in steps:
        fix = survey.hear(pings.only(slice(0, count)), count)
    return fix


def test_the_answer_is_the_batch_s_however_the_pings_come(pings):
    whole = fix_beacon(pings, SETTINGS)
    count = len(pings)
    for steps in ((count,), (*range(3, count, 7), count)):
        fix = in_steps(pings, SETTINGS, steps)
        assert fix.converged
        assert np.array_equal(fix.number, pings.number)
        assert (np.abs(fix.position - whole.position) < 0.3 * whole.sigma).all()
        assert np.nanmedian(np.abs(fix.residual_s - whole.residual_s)) < 0.3 * whole.uncertainty.rms_s


@pytest.mark.parametrize(("step_m", "gps_rms_m"), [(25.0, 2.0), (25.0, 10.0), (100.0, 3.0), (200.0, 3.0)])
def test_pings_far_apart_have_the_batch_s_answer_too(step_m, gps_rms_m):
    settings = FixSettings(gps_rms_m=gps_rms_m, sample_interval_ms=1.0, sound_speed_sigma_mps=0.0)
    for seed in range(4):
        survey = sailed(step_m, gps_rms_m, seed)
        whole, fix = fix_beacon(survey, settings), in_steps(survey, settings, (len(survey),))
        assert (np.abs(fix.position - whole.position) < 0.5 * whole.sigma).all()
        assert fix.sigma == pytest.approx(whole.sigma, rel=0.2)


def test_a_first_fix_that_was_believed_wrongly_is_given_up():
    """Times said to be exact make the first dozen pings look sure of a wrong place."""
    settings = FixSettings(gps_rms_m=10.0, sound_speed_sigma_mps=0.0)
    survey = sailed(25.0, 10.0, 11)
    early = in_steps(survey, settings, (20,))
    assert not early.converged
    fix = in_steps(survey, settings, (len(survey),))
    assert fix.converged
    assert (np.abs(FRAME.to_local(*fix.frame.to_geodetic(fix.position)) - TRUTH) < 4 * fix.sigma).all()


def test_a_real_survey_of_49_pings_has_the_batch_s_answer(real_surveys):
    survey = read_survey(real_surveys / "WC03" / "survey.txt").pings
    for gps_rms_m in (None, 2.0):
        settings = FixSettings(gps_rms_m=gps_rms_m, sound_speed_mps=1507.0)
        whole, fix = fix_beacon(survey, settings), in_steps(survey, settings, (*range(3, 49, 7), 49))
        assert fix.converged, fix.reason
        assert (np.abs(fix.position - whole.position) < 0.1 * whole.sigma).all()


def test_where_the_ship_s_error_is_not_known_it_is_as_wide_as_the_batch(pings):
    settings = FixSettings()
    whole, fix = fix_beacon(pings, settings), in_steps(pings, settings, (len(pings),))
    assert fix.sigma == pytest.approx(whole.sigma, rel=0.15)
    assert fix.sigma[2] > 2 * in_steps(pings, replace(settings, gps_rms_m=2.0), (len(pings),)).sigma[2]
    assert (np.abs(fix.position - whole.position) < 0.3 * whole.sigma).all()


def test_a_moving_beacon_is_no_surer_than_in_the_batch(pings):
    settings = FixSettings(motion="free")
    whole, fix = fix_beacon(pings, settings), in_steps(pings, settings, (len(pings),))
    assert (fix.sigma > 0.85 * whole.sigma).all()
    assert (np.abs(fix.position - whole.position) < fix.sigma).all()


def test_a_ping_left_out_or_without_a_time_has_a_row_and_no_say(pings):
    wrong = pings.travel_time_s.copy()
    wrong[[4, 50]] += 0.3
    wrong[7] = np.nan
    settings = replace(SETTINGS, left_out=frozenset({int(pings.number[4]), int(pings.number[50])}))
    fix = in_steps(replace(pings, travel_time_s=wrong), settings, (100, len(pings)))
    assert not fix.used[[4, 7, 50]].any()
    assert fix.used.sum() > len(pings) - 10
    assert np.isnan(fix.residual_s[[4, 7, 50]]).all()
    assert fix.converged


def test_early_pings_are_refused_in_words(pings):
    fix = in_steps(pings, SETTINGS, (5,))
    assert not fix.converged
    assert fix.reason
    assert len(fix.number) == 5
    for count in (200, 230):  # no pair of legs yet: what the last try said stands for the first of them
        fix = in_steps(pings, SETTINGS, (count,))
        assert not fix.converged
        assert len(fix.number) == len(fix.residual_s) == count
        assert np.isnan(fix.residual_s[-1])


def test_a_log_keeps_the_newest_and_the_answer_remembers_the_rest(pings):
    log = PingLog("line", simulated=True, most=80)
    survey = None
    for k in range(len(pings)):
        log.add(
            Ping(int(pings.number[k]), pings.lat_deg[k], pings.lon_deg[k], pings.travel_time_s[k],
                 float(pings.instant_s[k]), pings.up_m[k])
        )  # fmt: skip
        if k % 10 == 9 or k == len(pings) - 1:
            survey = survey or LiveSurvey(log.pings(), SETTINGS)
            fix = survey.hear(log.pings(), log.count)
    assert log.count == len(pings) > 80
    assert len(fix.number) == 80
    assert fix.number[-1] == pings.number[-1]
    assert fix.simulated
    whole = fix_beacon(pings, SETTINGS)
    assert (np.abs(fix.position - whole.position) < 0.3 * whole.sigma).all()
