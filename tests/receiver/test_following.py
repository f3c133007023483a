"""One pinger followed through simulated sound with known truth."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.detectors import DETECTORS, hear
from trackerlib.receiver.following import PingFollower, ping_rows
from trackerlib.receiver.report_receiver import ReceiverSettings
from trackerlib.simulation.hunt_sound import simulate_hunt_sound


def arrivals(time_s, level):
    time_s = np.asarray(time_s, float)
    order = np.argsort(time_s)
    time_s, level = time_s[order], np.asarray(level, float)[order]
    unknown = np.full(len(time_s), np.nan)
    return Arrivals(
        (time_s // 2).astype(int), np.ones(len(time_s), int), time_s, level, unknown, unknown, unknown
    )


@pytest.mark.parametrize("detector", DETECTORS)
def test_every_ping_of_a_hunt_has_its_number_over_a_turn_of_the_ship(detector):
    hunt = simulate_hunt_sound(4, missing=0.1)
    sound, follower, pings = hunt.open(), PingFollower(2.0, threshold=100), []
    blocks = (sound.read(480_000) for _ in range(int(hunt.seconds / 10)))
    for heard in hear(detector, ReceiverSettings(), hunt.rate_hz, blocks, 10.0, full_scale=0.1):
        pings += follower.feed(heard.arrivals)
    direct = hunt.pulses.path == 0
    true_s = np.sort(hunt.pulses.arrival_s[direct])
    time_s = np.array([ping.arrival_s for ping in pings])
    emission = np.array([ping.emission for ping in pings])
    off = np.abs(time_s[:, None] - true_s).min(axis=1)
    assert len(pings) > 0.95 * len(true_s)
    assert np.quantile(off, 0.98) < 1e-3
    # Travel times are smooth: no number is off by one.
    assert np.abs(np.diff(time_s - 2.0 * emission)).max() < 0.2


def test_noise_is_no_ping():
    rng = np.random.default_rng(0)
    assert PingFollower(2.0).feed(arrivals(rng.uniform(0, 400, 400), rng.uniform(100, 200, 400))) == []


def test_echoes_and_what_is_far_fainter_are_no_pings():
    heard = arrivals([0.5, 0.53, 1.4, 2.5], [180, 200, 120, 90])
    assert ping_rows(heard).tolist() == [0, 3]
    assert ping_rows(heard, threshold=100).tolist() == [0]
    assert len(ping_rows(arrivals([], []))) == 0


def test_numbers_go_on_over_a_long_silence():
    time_s = 0.3 + 2.0 * np.r_[0:40, 200:240]
    pings = PingFollower(2.0).feed(arrivals(time_s, np.full(80, 150.0)))
    numbers = [ping.emission for ping in pings]
    assert numbers[0] == 0
    assert numbers[-1] >= 238
    assert all(ping.travel_s(2.0) == pytest.approx(0.3, abs=1e-3) for ping in pings)
