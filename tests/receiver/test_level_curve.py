"""Misses and false alarms of the report's chain against its levels."""

import numpy as np
import pytest
from sounds import DENSITY_V, listen, pulses_at, sound_of

from trackerlib.receiver.front_end import DB_PER_COUNT, Attenuator
from trackerlib.receiver.level_curve import level_curve
from trackerlib.receiver.report_receiver import ReceiverSettings

RATE_HZ, PERIODS = 24_000, 150
SETTINGS = ReceiverSettings(interval_s=0.5, maxima=1, attenuator=Attenuator(False, 0))


@pytest.fixture(scope="module")
def curve():
    return level_curve(SETTINGS, RATE_HZ, [9.0, 12.0, 15.0, 25.0], periods=PERIODS, seed=1)


def test_a_higher_threshold_misses_more_and_alarms_less(curve):
    assert curve.level.tolist() == list(range(256))
    assert (curve.false_alarm[0], curve.false_alarm[255]) == (1.0, 0.0)
    assert np.all(np.diff(curve.false_alarm) <= 0)
    assert np.all(np.diff(curve.miss) >= 0)
    assert np.all(curve.miss[:, 255] == 1)
    # At the level where one period in a hundred of noise alarms, a loud pulse is never missed, a faint one often.
    at = np.argmax(curve.false_alarm <= 0.01)
    assert curve.miss[3, at] == 0
    assert curve.miss[0, at] > curve.miss[1, at] > curve.miss[2, at]
    assert curve.miss[0, at] > 0.4


def test_false_alarms_are_those_of_other_noise_through_the_receiver(curve):
    """Simulated sea noise of its own seed, heard by the receiver that `listen` uses."""
    found = listen(sound_of(pulses_at([0.1]), 0.5 * PERIODS, RATE_HZ, seed=7), SETTINGS, RATE_HZ)
    level = found.level[found.period > 0]
    share = np.mean(level[:, None] >= curve.level, axis=0)
    noise = 4 * np.sqrt(np.maximum(share * (1 - share), 0.01) * 2 / PERIODS)
    assert np.all(np.abs(curve.false_alarm - share) < noise)


def test_misses_are_those_of_other_pulses_through_the_receiver(curve):
    true_s = 0.5 * np.arange(PERIODS) + np.random.default_rng(3).uniform(0.15, 0.35, PERIODS)
    snr_db = 12.0 - 10 * np.log10(SETTINGS.tuned_bandwidth_hz * SETTINGS.pulse_s)  # in the tuned band
    sound = sound_of(pulses_at(true_s, snr_db, SETTINGS), 0.5 * PERIODS, RATE_HZ, DENSITY_V, seed=8)
    found = listen(sound, SETTINGS, RATE_HZ)
    near = np.abs(found.arrival_s - true_s[found.period]) < SETTINGS.pulse_s
    level = np.full(PERIODS, -1.0)
    level[found.period[near]] = found.level[near]
    share = np.mean(level[:, None] < curve.level, axis=0)
    noise = 4 * np.sqrt(np.maximum(share * (1 - share), 0.01) * 2 / PERIODS)
    assert np.all(np.abs(curve.miss[1] - share) < noise)


def test_attenuation_moves_the_levels(curve):
    less = level_curve(
        ReceiverSettings(interval_s=0.5, attenuator=Attenuator(False, 3)), RATE_HZ, [25.0], periods=20
    )
    half = [np.argmax(each >= 0.5) for each in (curve.miss[3], less.miss[0])]
    assert half[0] - half[1] == pytest.approx(3 / DB_PER_COUNT, abs=2.5)
