"""From sound to emission numbers: two pingers in one simulated recording, one drifting and often missing."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.receiver.arrivals import joined
from trackerlib.receiver.detectors import DETECTORS, hear
from trackerlib.receiver.following import ping_rows
from trackerlib.receiver.intervals import separate
from trackerlib.receiver.matched import ModernDetector
from trackerlib.receiver.report_receiver import FULL_SCALE_V, ReceiverSettings
from trackerlib.simulation.sound import (
    Listener,
    Pinger,
    Sea,
    SimulatedSound,
    joined_pulses,
    noise_density_v,
    pulses_heard,
)

RATE_HZ, SECONDS, BLOCK = 48_000, 150.0, 4800
PINGERS = (
    Pinger(
        position_m=(0.0, 0.0, -1990.0), interval_s=2.0, first_emission_s=0.31, drift_ppm=20.0, missing=0.3
    ),
    Pinger(position_m=(600.0, 400.0, -1985.0), interval_s=2.5, first_emission_s=0.87),
)
# echoes come 13 and 27 ms behind; in a window of 20 ms a louder one takes the place of its ping
ECHO_S = 0.030


def simulated(seed, seconds=SECONDS):
    """What is heard of each pinger, and the sound."""
    rng = np.random.default_rng(seed)
    sea, ship = Sea(sea_state=3.0), Listener(start_m=(-250.0, -100.0, -10.0), velocity_mps=(2.0, 1.0, 0.0))
    heard = [pulses_heard(pinger, ship, sea, seconds, rng) for pinger in PINGERS]
    return heard, SimulatedSound(joined_pulses(*heard), noise_density_v(sea), RATE_HZ, FULL_SCALE_V, seed)


def blocks_of(sound, seconds=SECONDS):
    return (sound.read(BLOCK) for _ in range(round(seconds * RATE_HZ / BLOCK)))


def check(trains, arrival_s, heard, within_s, share):
    """One train a pinger, every number right but for a whole number at the start."""
    assert sorted(round(train.interval_s, 2) for train in trains) == [2.0, 2.5]
    for train in trains:
        pulses = heard[0] if round(train.interval_s, 2) == 2.0 else heard[1]
        firsts = pulses.path == 0
        true_s, number = pulses.arrival_s[firsts], pulses.emission[firsts]
        nearest = np.abs(true_s[:, None] - arrival_s[train.rows][None]).argmin(axis=0)
        assert np.abs(true_s[nearest] - arrival_s[train.rows]).max() < within_s
        assert len(set((number[nearest] - train.emission).tolist())) == 1
        assert len(train.rows) > share * len(true_s)


@pytest.mark.parametrize(
    ("name", "seed", "seconds"),
    [(name, seed, SECONDS) for name in DETECTORS for seed in (3, 5, 6, 7, 9, 11)]
    + [("modern", 12, 300.0), ("report", 27, 300.0)],  # followers go over to the echoes where the range turns
)
def test_every_emission_number_is_right_in_the_window_of_listen(name, seed, seconds):
    heard, sound = simulated(seed, seconds)
    settings = ReceiverSettings(interval_s=2.0)
    parts = hear(name, settings, RATE_HZ, blocks_of(sound, seconds), 0.1, FULL_SCALE_V)
    arrivals = joined([part.arrivals for part in parts])
    arrival_s = arrivals.arrival_s[ping_rows(arrivals)]
    check(separate(arrival_s), arrival_s, heard, ECHO_S, 0.4)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_window_of_one_pulse_keeps_the_direct_arrivals(seed):
    heard, sound = simulated(seed)
    detector = ModernDetector(RATE_HZ, 10_000.0, 0.010, 2.0, full_scale=FULL_SCALE_V)
    parts = [detector.feed(block).arrivals for block in blocks_of(sound)]
    arrivals = joined([*parts, detector.finish().arrivals])
    arrival_s = arrivals.arrival_s[ping_rows(arrivals)]
    check(separate(arrival_s), arrival_s, heard, 2e-3, 0.9)
