"""Errors of the ship's position that are not white and round: two axes apart, slow ones, the antenna's offset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from surveys import BOX, ELBOW, FRAME, error_of, survey

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.paths import StraightPaths
from trackerlib.beacon.settings import FixSettings
from trackerlib.beacon.uncertainty import AntennaErrors
from trackerlib.simulation.beacon_survey import Errors, simulate_survey

BEACON = (100.0, 50.0, -1500.0)
INTERVAL_S = 20.0
TELL = FixSettings(sound_speed_sigma_mps=0.0, sample_interval_ms=0.5)


def moved(pings, metres):
    """The pings with the ship's logged places moved by metres (N, 2) east, north."""
    places = FRAME.to_local(pings.lat_deg, pings.lon_deg, pings.up_m)
    places[:, :2] += metres
    lat, lon, _ = FRAME.to_geodetic(places)
    return replace(pings, lat_deg=lat, lon_deg=lon)


def slow(count, rms_m, correlation_s, rng):
    kept = np.exp(-INTERVAL_S / correlation_s)
    noise = rng.normal(0, rms_m, (count, 2))
    for k in range(1, count):
        noise[k] = kept * noise[k - 1] + np.sqrt(1 - kept**2) * noise[k]
    return noise


def inside(errors, legs, settings, trials, make):
    """How often the truth lies inside the 95 % ellipsoid and inside each interval, and the mean in sigmas."""
    ellipsoid, each, scaled = 0, np.zeros(3), []
    for seed in range(trials):
        pings = make(survey(legs, BEACON, errors, seed=[3, seed]), np.random.default_rng([4, seed]))
        fix = fix_beacon(pings, settings)
        error = error_of(fix, BEACON)
        ellipsoid += error @ np.linalg.solve(fix.uncertainty.covariance, error) < stats.chi2.ppf(0.95, 3)
        each += np.abs(error) < 1.96 * fix.sigma
        scaled.append(error / fix.sigma)
    return ellipsoid, each, np.mean(scaled, axis=0)


def test_each_axis_has_its_own_error():
    errors = Errors(time_step_s=5e-4)
    rms = np.array([1.0, 6.0])
    trials = 40
    ellipsoid, each, mean = inside(
        errors, BOX, replace(TELL, gps_rms_m=(1.0, 6.0)), trials,
        lambda p, rng: moved(p, rms * rng.normal(size=(len(p), 2))),
    )  # fmt: skip
    low, high = stats.binom.ppf([0.0005, 0.9995], trials, 0.95)
    assert low <= ellipsoid <= high
    assert ((low <= each) & (each <= high)).all()
    assert (np.abs(mean) < 3.5 / np.sqrt(trials)).all()


@pytest.mark.parametrize("correlation_s", [60.0, 600.0])
def test_slow_errors_that_are_told_are_covered(correlation_s):
    trials, rms = 40, 3.0
    settings = replace(TELL, gps_rms_m=rms, gps_correlation_s=correlation_s)
    ellipsoid, each, _ = inside(
        Errors(time_step_s=5e-4), ELBOW, settings, trials,
        lambda p, rng: moved(p, slow(len(p), rms, correlation_s, rng)),
    )  # fmt: skip
    low = stats.binom.ppf(0.001, trials, 0.95)
    assert (each >= low).all(), each
    assert ellipsoid >= low
    white, _, _ = inside(
        Errors(time_step_s=5e-4), ELBOW, replace(TELL, gps_rms_m=rms), trials,
        lambda p, rng: moved(p, slow(len(p), rms, correlation_s, rng)),
    )  # fmt: skip
    assert white < ellipsoid  # taking them for white would be false


def headings(pings):
    """The course made good, which the simulated ship's bow follows."""
    places = FRAME.to_local(pings.lat_deg, pings.lon_deg, pings.up_m)
    step = np.diff(places[:, :2], axis=0, append=places[-1:, :2] + places[-1:, :2] - places[-2:-1, :2])
    return np.arctan2(step[:, 0], step[:, 1])


@pytest.mark.parametrize("known", [True, False])
def test_an_antenna_offset_is_covered(known):
    trials, sigma = 40, 4.0

    def offset(pings, rng):
        bow = headings(pings)
        ahead, abeam = rng.normal(0, sigma, 2)
        metres = np.column_stack([
            ahead * np.sin(bow) + abeam * np.cos(bow), ahead * np.cos(bow) - abeam * np.sin(bow)
        ])  # fmt: skip
        return replace(moved(pings, metres), heading_rad=bow if known else None)

    settings = replace(TELL, gps_rms_m=0.5, antenna_sigma_m=(sigma, 0.0))
    ellipsoid, each, _ = inside(Errors(0.5, time_step_s=5e-4), ELBOW, settings, trials, offset)
    low, high = stats.binom.ppf([0.0005, 0.9995], trials, 0.95)
    assert (each >= low).all(), each
    assert ellipsoid >= low
    if known:
        assert (each <= high).all()


def test_headings_that_are_not_known_make_it_wider_whatever_they_are():
    rng = np.random.default_rng(2)
    slope, gain = rng.normal(size=(40, 3)), rng.normal(size=(40, 4))
    widest = AntennaErrors(2.0, 1.0, None).moved_by(slope, gain)
    for _ in range(50):
        known = AntennaErrors(2.0, 1.0, rng.uniform(0, 2 * np.pi, 40)).moved_by(slope, gain)
        assert np.linalg.eigvalsh(widest - known).min() > -1e-9 * np.trace(widest)
    aligned = AntennaErrors(2.0, 0.0, np.arctan2(slope[:, 0], slope[:, 1])).moved_by(
        slope, np.abs(gain[:, :1])
    )
    assert aligned[0, 0] == pytest.approx(
        AntennaErrors(2.0, 0.0, None).moved_by(slope, np.abs(gain[:, :1]))[0, 0]
    )


def bow(sideways_m, gps_rms_m, seed):
    """A track of 3 km that bends to one side and back, past a beacon 900 m beside it."""
    along = np.linspace(-1500.0, 1500.0, 120)
    track = np.column_stack([along, sideways_m * (1 - (along / 1500) ** 2)])
    errors = Errors(gps_rms_m=gps_rms_m, time_rms_s=5e-4)
    return simulate_survey(
        track, np.array([200.0, 900.0, -1200.0]), StraightPaths(1500.0), FRAME, np.random.default_rng([6, seed]),
        errors, emission_offset_s=0.3,
    )  # fmt: skip


@pytest.mark.parametrize("told", [True, False])
def test_a_bend_that_noise_hides_gives_no_fix(told):
    """The bias of noisy ship positions is then hundreds of metres, of which no residual tells."""
    settings = FixSettings(gps_rms_m=3.0 if told else None)
    reasons = [fix_beacon(bow(60.0, 3.0, seed), settings).reason for seed in range(6)]
    assert all(reason is not None for reason in reasons), reasons
    assert sum("of its standard errors" in reason for reason in reasons) >= 2, reasons
    assert all("turn" in reason for reason in reasons), reasons
    exact = fix_beacon(bow(60.0, 0.05, 0), FixSettings(gps_rms_m=0.05 if told else None))
    assert exact.reason is None or "of its standard errors" not in exact.reason


@pytest.mark.parametrize("told", [True, False])
def test_a_short_leg_across_a_long_one_is_enough(told):
    """Pings right above a place count for much there; the search must not end at such a place for that."""
    beacon = (100.0, 600.0, -1500.0)
    for seed in range(4):
        pings = survey(((75, 3000), (345, 300)), beacon, Errors(gps_rms_m=2.0, time_rms_s=5e-4), seed=seed)
        fix = fix_beacon(pings, FixSettings(gps_rms_m=2.0 if told else None))
        assert fix.converged, fix.reason
        error = error_of(fix, beacon)
        assert error @ np.linalg.solve(fix.uncertainty.covariance, error) < stats.chi2.ppf(0.999, 3)
