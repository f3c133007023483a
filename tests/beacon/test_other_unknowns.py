"""Speed of sound, interval and drift estimated with the place: unbiased, and inside what is stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from streams import INTERVAL_S, TIME_RMS_S, stream
from surveys import BOX, error_of, survey

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon.choice import compare_models, usual_models
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.settings import FixSettings
from trackerlib.simulation.beacon_survey import Errors

SHALLOW, DEEP = (100.0, 50.0, -800.0), (100.0, 50.0, -2400.0)
WIDE = ((20, 4500), (110, 4500), (200, 4500), (290, 4500), (65, 6300))
STEP_MS = 1.0
ERRORS = Errors(gps_rms_m=1.0, time_step_s=STEP_MS * 1e-3)
PRIOR = FixSettings(gps_rms_m=1.0, sound_speed_sigma_mps=5.0)
FITTED = replace(PRIOR, estimate_sound_speed=True)


def wide(seed, speed_mps):
    return survey(
        WIDE, SHALLOW, ERRORS, seed=[2, seed], speed_mps=speed_mps, start=(-3000.0, -1500.0), interval_s=60.0
    )


def honest(inside, trials):
    low, high = stats.binom.ppf([0.0005, 0.9995], trials, 0.95)
    return np.all((low <= inside) & (inside <= high))


def test_without_errors_place_and_speed_are_exact():
    pings = survey(WIDE, SHALLOW, speed_mps=1507.0, start=(-3000.0, -1500.0), interval_s=60.0)
    fix = fix_beacon(pings, replace(FITTED, gps_rms_m=None))
    # The prior still pulls by noise over its own sigma, and noise there is none but the floor.
    assert fix.sound_speed_mps == pytest.approx(1507.0, abs=0.01)
    assert np.abs(error_of(fix, SHALLOW)).max() < 0.02


def test_the_fitted_speed_and_place_are_inside_what_is_stated():
    trials, inside, errors, sigmas, ellipsoid = 60, 0, [], [], 0
    for seed in range(trials):
        speed = 1500 + np.random.default_rng([1, seed]).normal(0, 5.0)
        fix = fix_beacon(wide(seed, speed), FITTED)
        assert fix.converged, fix.reason
        errors.append([*error_of(fix, SHALLOW), fix.sound_speed_mps - speed])
        sigmas.append([*fix.sigma, fix.sigma_sound_speed_mps])
        error = np.array(errors[-1][:3])
        ellipsoid += error @ np.linalg.solve(fix.uncertainty.covariance, error) < stats.chi2.ppf(0.95, 3)
        inside += np.abs(errors[-1]) < 1.96 * np.array(sigmas[-1])
    assert honest(inside, trials), inside
    assert honest(ellipsoid, trials)
    mean, spread = np.mean(errors, axis=0), np.std(errors, axis=0)
    assert (np.abs(mean) < 3.5 * spread / np.sqrt(trials)).all()
    assert np.mean(sigmas, axis=0) == pytest.approx(spread, rel=0.25)
    assert np.mean(sigmas, axis=0)[3] < 1.0  # of 5 told: these pings do tell


def test_it_is_narrower_only_where_the_pings_tell():
    told, fitted = fix_beacon(wide(1, 1502.0), PRIOR), fix_beacon(wide(1, 1502.0), FITTED)
    assert fitted.sigma[2] < 0.3 * told.sigma[2]
    assert told.sigma_sound_speed_mps == 5.0
    narrow = survey(BOX, DEEP, ERRORS, speed_mps=1502.0)
    told, fitted = fix_beacon(narrow, PRIOR), fix_beacon(narrow, FITTED)
    assert fitted.sigma[2] == pytest.approx(told.sigma[2], rel=0.05)
    assert fitted.sigma_sound_speed_mps == pytest.approx(5.0, rel=0.05)


def test_a_profile_is_scaled():
    profile = SoundSpeedProfile(np.array([0.0, 300.0, 1000.0]), np.array([1510.0, 1490.0, 1485.0]))
    straight = fix_beacon(wide(2, 1500.0), replace(FITTED, profile=profile, sound_speed_sigma_mps=10.0))
    assert abs(straight.sound_speed_mps - 1500.0) < 4 * straight.sigma_sound_speed_mps
    assert straight.sigma_sound_speed_mps < 2


def test_the_choice_of_models_knows_the_fitted_speed():
    scores = compare_models(wide(3, 1510.0), usual_models(replace(PRIOR, sample_interval_ms=STEP_MS)))
    by_name = {score.name: score for score in scores}
    fitted = by_name["lies still, speed of sound fitted"]
    assert fitted.parameters == by_name["lies still"].parameters + 1
    assert fitted.aicc < by_name["lies still"].aicc - 20
    assert fitted.held_out_s < 0.8 * by_name["lies still"].held_out_s


def settings(**more):
    return FixSettings(
        gps_rms_m=1.0, sound_speed_sigma_mps=0.0, interval_s=INTERVAL_S, sample_interval_ms=1e3 * TIME_RMS_S * 12**0.5,
        **more,
    )  # fmt: skip


@pytest.mark.parametrize("ppm_per_hour", [0.0, 3.0])
def test_interval_and_drift_are_inside_what_is_stated(ppm_per_hour):
    place, ppm, trials = (200.0, -150.0, -1500.0), 20.0, 30
    drifting = bool(ppm_per_hour)
    how = settings(estimate_interval=True, estimate_interval_drift=drifting)
    errors, sigmas = [], []
    for seed in range(trials):
        pings = stream(place, seed, ppm=ppm, ppm_per_hour=ppm_per_hour, emissions=1200)
        fix = fix_beacon(pings, how)
        assert fix.converged, fix.reason
        said = fix.emission
        error = [*error_of(fix, place), 1e6 * (said.interval_s / INTERVAL_S - 1) - ppm]
        sigma = [*fix.sigma, 1e6 * said.sigma_interval_s / INTERVAL_S]
        if drifting:
            error.append(said.drift_ppm_per_hour - ppm_per_hour)
            sigma.append(said.sigma_drift_ppm_per_hour)
        errors.append(error)
        sigmas.append(sigma)
    assert honest((np.abs(errors) < 1.96 * np.array(sigmas)).sum(axis=0), trials)
    spread = np.std(errors, axis=0)
    assert (np.abs(np.mean(errors, axis=0)) < 3.5 * spread / np.sqrt(trials)).all()
    assert np.mean(sigmas, axis=0) == pytest.approx(spread, rel=0.4)


def test_an_interval_taken_as_true_is_refused_or_far_off():
    pings = stream((200.0, -150.0, -1500.0), 1, ppm=20.0)
    fix = fix_beacon(pings, settings())
    assert not fix.converged
    assert "interval" in fix.reason


def test_whole_intervals_are_counted_over_hours_of_a_wrong_interval():
    pings = stream((200.0, -150.0, -1500.0), 4, ppm=-35.0, emissions=7200, heard=0.2)
    fix = fix_beacon(pings, settings(estimate_interval=True))
    assert fix.converged, fix.reason
    assert np.abs(error_of(fix, (200.0, -150.0, -1500.0)) / fix.sigma).max() < 4
    assert 1e6 * (fix.emission.interval_s / INTERVAL_S - 1) == pytest.approx(-35.0, abs=0.1)


@pytest.mark.parametrize("motion", ["free", "horizontal"])
def test_a_moving_beacon_is_where_it_was_when_it_emitted(motion):
    """Receptions come a second after emissions, in which the beacon moves 0.8 m: 8 standard errors."""
    place, velocity, trials = (200.0, -150.0, -1500.0), (0.6, -0.5, 0.0), 12
    errors, inside = [], 0
    for seed in range(trials):
        fix = fix_beacon(
            stream(place, seed, velocity=velocity, emissions=1200, gps_rms_m=0.3, heard=0.9),
            replace(settings(motion=motion), gps_rms_m=0.3),
        )
        assert fix.converged, fix.reason
        errors.append([*error_of(fix, place), *(fix.velocity - velocity)])
        inside += (np.abs(errors[-1][:2]) < 1.96 * fix.sigma[:2]).sum()
    bias = np.mean(errors, axis=0)[:5]
    assert (np.abs(bias) < 3.5 * np.std(errors, axis=0)[:5] / np.sqrt(trials)).all(), bias
    assert inside >= stats.binom.ppf(0.001, 2 * trials, 0.95)
    assert np.abs(bias[:2]).max() < 0.25


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"estimate_interval": True}, "interval_s"),
        ({"estimate_interval_drift": True, "interval_s": 2.0}, "estimate_interval"),
        ({"estimate_sound_speed": True, "sound_speed_sigma_mps": 0.0}, "sound_speed_sigma_mps"),
        ({"estimate_sound_speed": True, "method": "pairs"}, "estimate_sound_speed"),
        ({"gps_correlation_s": 30.0}, "gps_rms_m"),
        ({"gps_rms_m": (1.0, -1.0)}, "gps_rms_m"),
        ({"gps_rms_m": (1.0, 2.0), "method": "pairs"}, "two values"),
        ({"antenna_sigma_m": (1.0, np.nan)}, "antenna_sigma_m"),
    ],
)
def test_settings_that_contradict_each_other_are_named(more, named):
    with pytest.raises(ValueError, match=named):
        FixSettings(**more)


def test_every_unknown_needs_a_ping_more():
    pings = stream((200.0, -150.0, -1500.0), 1).only(slice(0, 8))
    assert (
        "fewer than 9"
        in fix_beacon(pings, settings(estimate_interval=True, estimate_interval_drift=True)).reason
    )
