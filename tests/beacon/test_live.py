"""Pings one at a time: the answer of all at once, early refusals, bounded work."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon import live as live_module
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.live import LiveFix
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.settings import FixSettings
from trackerlib.frames import LocalFrame
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S, sail_hexagon

FRAME = LocalFrame(30.0, 140.0)


def heard(scenario, receptions, seed=2, false=0):
    points = sail_hexagon(SCENARIOS[scenario], receptions)
    rng = np.random.default_rng(seed)
    ship = points.ship.copy()
    ship[:, :2] += rng.normal(0, 3, (receptions, 2))
    time = points.range_m / SOUND_SPEED_MPS + rng.normal(0, TIME_RMS_S, receptions) + 0.25
    wild = rng.choice(receptions, false, replace=False)
    time[wild] += rng.uniform(0.05, 1.0, false)
    return points, ship, time


def play(live, points, ship, time):
    for k in range(len(time)):
        live.add(k + 1, ship[k], points.emitted_s[k], time[k])
    return live.fix()


def batch(points, ship, time, settings):
    lat, lon, up = FRAME.to_geodetic(ship)
    count = len(time)
    pings = Pings(
        np.arange(1, count + 1), lat, lon, up, time, np.full(count, np.datetime64("NaT", "ms")),
        clock_s=points.emitted_s,
    )  # fmt: skip
    fix = fix_beacon(pings, settings)
    return FRAME.to_local(*fix.frame.to_geodetic(fix.position)), fix


@pytest.mark.parametrize(("scenario", "motion"), [(1, "still"), (2, "still"), (4, "free"), (6, "free")])
@pytest.mark.parametrize("false", [0, 20])
def test_the_answer_is_that_of_all_pings_at_once(scenario, motion, false):
    settings = FixSettings(gps_rms_m=3.0, motion=motion, sample_interval_ms=1.0, sound_speed_sigma_mps=0.0)
    survey = heard(scenario, 1126, false=false)
    fix = play(LiveFix(FRAME, settings), *survey)
    place, whole = batch(*survey, settings)
    assert fix.converged
    assert np.abs(fix.position - place).max() < 0.25 * whole.sigma.max()
    assert (np.abs(fix.position - place) < 0.3 * whole.sigma).all()
    assert fix.sigma == pytest.approx(whole.sigma, rel=0.15)
    if motion == "free":
        assert fix.velocity == pytest.approx(whole.velocity, abs=0.3 * whole.uncertainty.sigma[3:].max())


def test_rays_are_followed():
    profile = SoundSpeedProfile(
        np.array([0.0, 200.0, 1000.0, 6000.0]), np.array([1520.0, 1500.0, 1485.0, 1550.0])
    )
    settings = FixSettings(gps_rms_m=3.0, profile=profile, sample_interval_ms=1.0)
    survey = heard(3, 900)
    fix = play(LiveFix(FRAME, settings), *survey)
    place, whole = batch(*survey, settings)
    assert (np.abs(fix.position - place) < 0.3 * whole.sigma).all()


def test_early_fixes_are_refused_and_no_believed_one_is_wrong():
    settings = FixSettings(gps_rms_m=3.0, sample_interval_ms=1.0, sound_speed_sigma_mps=0.0)
    points, ship, time = heard(2, 900)
    live = LiveFix(FRAME, settings)
    verdicts = []
    for k in range(900):
        live.add(k + 1, ship[k], points.emitted_s[k], time[k])
        if k % 30 == 5:
            fix = live.fix()
            verdicts.append(fix.converged)
            if fix.converged:
                error = FRAME.to_local(*fix.frame.to_geodetic(fix.position)) - SCENARIOS[2].position
                assert (np.abs(error) < 4.5 * fix.sigma).all()
            else:
                assert fix.reason
    assert not any(verdicts[:4])  # one straight leg tells nothing of the side
    assert verdicts[-1]


def test_memory_is_bounded_and_the_sums_remember(monkeypatch):
    monkeypatch.setattr(live_module, "KEPT", 512)
    settings = FixSettings(gps_rms_m=3.0, sample_interval_ms=1.0, sound_speed_sigma_mps=0.0)
    survey = heard(2, 1126)
    live = LiveFix(FRAME, settings)
    fix = play(live, *survey)
    assert len(fix.number) == 512
    place, whole = batch(*survey, settings)
    assert (np.abs(fix.position - place) < 1.0 * whole.sigma).all()  # instruments of its first half


def test_what_is_not_a_number_is_left_out():
    settings = FixSettings(gps_rms_m=3.0)
    live = LiveFix(FRAME, settings)
    live.add(1, [0.0, 0.0, 0.0], 0.0, np.nan)
    live.add(2, [np.inf, 0.0, 0.0], 0.0, 1.0)
    assert live.count == 0


@pytest.mark.parametrize("wrong", [{"motion": "vertical"}, {"emission_known": True}, {"interval_s": 2.0}])
def test_what_it_cannot_serve_is_refused(wrong):
    with pytest.raises(ValueError, match="live fix"):
        LiveFix(FRAME, FixSettings(**wrong))
