"""Simulated hunts with a second pinger that interferes."""

from types import SimpleNamespace

import numpy as np
import pytest

from dashboards.tabs.chart_inputs import Inputs
from trackerlib.receiver.arrivals import joined
from trackerlib.receiver.detectors import hear
from trackerlib.receiver.report_receiver import FULL_SCALE_V, ReceiverSettings
from trackerlib.receiver.trains import sort_arrivals
from trackerlib.simulation.hunt_sound import second_pinger, simulate_hunt_sound

RATE_HZ, SECONDS = 24_000, 120


def test_a_second_pinger_is_added_and_changes_nothing_of_the_first():
    alone = simulate_hunt_sound(1, rate_hz=RATE_HZ)
    both = simulate_hunt_sound(1, rate_hz=RATE_HZ, others=[second_pinger(2.5)])
    count = len(alone.pulses)
    assert np.array_equal(both.pulses.arrival_s[:count], alone.pulses.arrival_s)
    added = both.pulses.arrival_s[count:][both.pulses.path[count:] == 0]
    assert len(added) == pytest.approx(both.seconds / 2.5, abs=3)
    turn = np.abs(np.diff(added) - 2.5) > 0.01  # a ship at 5 m/s changes it by 8 ms
    assert turn.sum() <= 1
    assert both.name.endswith("and a pinger every 2.5 s")


def test_it_is_heard_as_a_train_of_its_own():
    hunt = simulate_hunt_sound(1, rate_hz=RATE_HZ, others=[second_pinger(2.5)])
    sound = hunt.open()
    blocks = (sound.read(RATE_HZ // 10) for _ in range(10 * SECONDS))
    settings = ReceiverSettings(maxima=4)
    heard = hear("modern", settings, RATE_HZ, blocks, 0.1, FULL_SCALE_V)
    found = sort_arrivals(joined([part.arrivals for part in heard]), 2.0)
    assert sorted(round(train.interval_s, 1) for train in found.trains) == [2.0, 2.5]
    assert all(len(train.rows) > 0.8 * SECONDS / train.interval_s for train in found.trains)


@pytest.mark.parametrize(("interval_s", "ends"), [(0.0, "sea state 3"), (2.5, "a pinger every 2.5 s")])
def test_the_chart_simulates_it_if_asked(interval_s, ends):
    value = SimpleNamespace
    controls = value(seed=value(value=1), sea_state=value(value=3.0), second=value(value=interval_s))
    works = []
    jobs = value(start=lambda name, work, done: works.append(work))
    Inputs._simulate(value(controls_=controls, session=value(jobs=jobs)))
    assert works[0](None).name.endswith(ends)
