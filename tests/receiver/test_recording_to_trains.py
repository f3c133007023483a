"""From sound to emission numbers: two pingers in one simulated recording, one drifting and often missing."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.receiver.arrivals import joined
from trackerlib.receiver.echoes import direct
from trackerlib.receiver.intervals import separate
from trackerlib.receiver.matched import ModernDetector
from trackerlib.receiver.report_receiver import FULL_SCALE_V
from trackerlib.simulation.sound import (
    Listener,
    Pinger,
    Sea,
    SimulatedSound,
    joined_pulses,
    noise_density_v,
    pulses_heard,
)

RATE_HZ, SECONDS = 48_000.0, 150.0
PINGERS = (
    Pinger(
        position_m=(0.0, 0.0, -1990.0), interval_s=2.0, first_emission_s=0.31, drift_ppm=20.0, missing=0.3
    ),
    Pinger(position_m=(600.0, 400.0, -1985.0), interval_s=2.5, first_emission_s=0.87),
)


@pytest.mark.parametrize("seed", [1, 2])
def test_every_emission_number_is_right(seed):
    rng = np.random.default_rng(seed)
    sea, ship = Sea(sea_state=3.0), Listener(start_m=(-250.0, -100.0, -10.0), velocity_mps=(2.0, 1.0, 0.0))
    heard = [pulses_heard(pinger, ship, sea, SECONDS, rng) for pinger in PINGERS]
    sound = SimulatedSound(joined_pulses(*heard), noise_density_v(sea), RATE_HZ, FULL_SCALE_V, seed)
    detector = ModernDetector(RATE_HZ, 10_000.0, 0.010, 2.0, full_scale=FULL_SCALE_V)
    blocks = [detector.feed(sound.read(4800)).arrivals for _ in range(round(SECONDS * 10))]
    arrivals = joined([*blocks, detector.finish().arrivals])
    arrival_s = np.sort(arrivals.arrival_s[direct(arrivals)])
    trains = separate(arrival_s)

    assert sorted(round(train.interval_s, 2) for train in trains) == [2.0, 2.5]
    for train in trains:
        pulses = heard[0] if round(train.interval_s, 2) == 2.0 else heard[1]
        firsts = pulses.path == 0
        true_s, number = pulses.arrival_s[firsts], pulses.emission[firsts]
        nearest = np.abs(true_s[:, None] - arrival_s[train.rows][None]).argmin(axis=0)
        assert np.abs(true_s[nearest] - arrival_s[train.rows]).max() < 2e-3
        assert (
            len(set((number[nearest] - train.emission).tolist())) == 1
        )  # right but for a whole number at the start
        assert len(train.rows) > 0.9 * len(true_s)
