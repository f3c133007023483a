"""Intervals by profile likelihood and bootstrap: the ellipse where it is right, honest where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from surveys import BOX, FRAME, survey

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.intervals import (
    PLACE,
    bootstrap_intervals,
    bootstrap_positions,
    interval_words,
    profile_intervals,
    profile_likelihood,
)
from trackerlib.beacon.settings import FixSettings
from trackerlib.simulation.beacon_survey import Errors

PLAIN = FixSettings(gps_rms_m=1.0, sound_speed_sigma_mps=0.0, sample_interval_ms=1.7)
# A track with a slight bend hardly tells to which side the beacon lies: with true travel times it may be anywhere on
# an arc, whose highest point the ellipse does not know.
BENT, TIME_RMS_S = ((75, 1500), (95, 350)), 3e-3
BEACON = np.array([100.0, 250.0, -1500.0])
KNOWN = replace(PLAIN, emission_known=True, sample_interval_ms=1e3 * TIME_RMS_S * 12**0.5)


def bent(seed):
    pings = survey(
        BENT, BEACON, Errors(1.0, TIME_RMS_S), seed=[2, seed], start=(-900.0, -200.0), interval_s=30.0
    )
    return replace(pings, travel_time_s=pings.travel_time_s - 0.8)


def test_coverage_is_honest_on_either_side_of_a_bent_valley():
    trials, below, above, ellipse, warned = 80, np.zeros(3), np.zeros(3), np.zeros(2), 0
    for seed in range(trials):
        pings = bent(seed)
        fix = fix_beacon(pings, KNOWN)
        intervals = profile_intervals(pings, fix, KNOWN)
        truth = fix.frame.to_local(*(float(value) for value in FRAME.to_geodetic(BEACON))) * [1, 1, -1]
        below += [truth[k] < intervals[name].low_m for k, name in enumerate(PLACE)]
        above += [truth[k] > intervals[name].high_m for k, name in enumerate(PLACE)]
        miss = (truth[2] - fix.depth_m) / fix.sigma[2]
        ellipse += [miss < -1.96, miss > 1.96]
        warned += interval_words(fix, intervals) is not None
    low, high = stats.binom.ppf([0.0005, 0.9995], trials, 0.05)
    assert ((low <= below + above) & (below + above <= high)).all(), (below, above)
    assert max(below.max(), above.max()) <= stats.binom.ppf(0.9995, trials, 0.025)
    assert warned > 0.9 * trials
    assert abs(below[2] - above[2]) < abs(ellipse[0] - ellipse[1])  # the ellipse misses on one side


def test_where_the_valley_is_a_parabola_they_are_the_ellipse():
    pings = survey(BOX, (100.0, 50.0, -2400.0), Errors(1.0, 5e-4))
    fix = fix_beacon(pings, PLAIN)
    for find in (profile_intervals, bootstrap_intervals):
        intervals = find(pings, fix, PLAIN)
        for k, name in enumerate(PLACE):
            half = (intervals[name].high_m - intervals[name].low_m) / 2
            assert half == pytest.approx(1.96 * fix.sigma[k], rel=0.15)
    assert interval_words(fix, profile_intervals(pings, fix, PLAIN)) is None


def test_bootstrap_sees_the_bend_too():
    pings = bent(1)
    fix = fix_beacon(pings, KNOWN)
    profile = profile_likelihood(pings, fix, KNOWN, "depth")
    drawn = bootstrap_intervals(pings, fix, KNOWN)["depth"]
    assert fix.depth_m - profile.low_m > 1.5 * (profile.high_m - fix.depth_m)
    assert fix.depth_m - drawn.low_m > 1.2 * (drawn.high_m - fix.depth_m)


def test_blocks_carry_the_correlation_of_residuals():
    rng = np.random.default_rng(3)
    pings = survey(BOX, (100.0, 50.0, -2400.0), interval_s=5.0)
    noise = rng.normal(0, 1e-3, len(pings))
    for k in range(1, len(noise)):
        noise[k] += 0.8 * noise[k - 1]
    pings = replace(pings, travel_time_s=pings.travel_time_s + noise)
    settings = replace(PLAIN, gps_rms_m=0.0)
    fix = fix_beacon(pings, settings)
    spread = np.std(bootstrap_positions(pings, fix, settings), axis=0)
    assert spread == pytest.approx(fix.sigma, rel=0.35)
    white = replace(
        fix, uncertainty=replace(fix.uncertainty, correlation=type(fix.uncertainty.correlation)())
    )
    assert (np.std(bootstrap_positions(pings, white, settings), axis=0) < 0.7 * spread).all()


def test_what_makes_no_sense_is_named():
    pings = survey(BOX, (100.0, 50.0, -2400.0), Errors(1.0, 5e-4))
    fix = fix_beacon(pings, PLAIN)
    with pytest.raises(ValueError, match="component"):
        profile_likelihood(pings, fix, PLAIN, "up")
    with pytest.raises(ValueError, match="no place"):
        profile_likelihood(pings, fix_beacon(pings.only(slice(0, 3)), PLAIN), PLAIN)
    with pytest.raises(ValueError, match="pairs"):
        bootstrap_intervals(pings, fix, replace(PLAIN, method="pairs"))
