"""The report's receiver as a whole: times, blocks, periods, gain, paths."""

from dataclasses import replace

import numpy as np
import pytest
from sounds import DENSITY_V, heard, listen, pulses_at, sound_of

from trackerlib.acoustics.ambient_noise import LIMIT, ambient_noise_db, equivalent_noise_v
from trackerlib.receiver.front_end import Attenuator
from trackerlib.receiver.report_receiver import ReceiverSettings, ReportReceiver
from trackerlib.simulation.sound import joined_pulses

ONE = ReceiverSettings(maxima=1)


@pytest.mark.parametrize("sea_state", [1, 2, 3, 4, 5, 8, LIMIT])
def test_times_are_right_to_four_tenths_of_a_millisecond_in_every_sea(sea_state):
    density = equivalent_noise_v(ambient_noise_db(sea_state))
    settings = replace(ONE, interval_s=0.5)
    for snr_db, bound_ms in ((20, 0.4), (26, 0.2)):
        true = 0.1237 + 0.50031 * np.arange(119)
        pulses = pulses_at(true, snr_db, settings, density_v=density)
        arrivals = listen(sound_of(pulses, 60.0, density_v=density), settings)
        error_ms = 1e3 * (arrivals.arrival_s[:119] - true)
        assert np.sqrt(np.mean(error_ms**2)) < bound_ms, (sea_state, snr_db)
        assert abs(np.mean(error_ms)) < 0.1


@pytest.mark.parametrize(
    ("settings", "rate_hz", "bound_s"),
    [
        (ONE, 48_000.0, 1e-4),
        (replace(ONE, sample_interval_s=1.0005e-3), 48_000.0, 1.5e-4),
        (replace(ONE, carrier_hz=11_300.0), 44_100.0, 1.5e-4),
        (replace(ONE, carrier_hz=27_000.0, pulse_s=0.005, window_s=0.01), 96_000.0, 1e-4),
        (
            replace(ONE, carrier_hz=5_000.0),
            11_025.0,
            3e-4,
        ),  # so near half the rate that its mirror image beats
        (replace(ONE, pulse_s=0.02, sample_interval_s=0.5e-3), 48_000.0, 1e-4),
    ],
)
def test_the_delay_of_every_filter_is_taken_off(settings, rate_hz, bound_s):
    true = 0.2 + 2.00007 * np.arange(20)
    arrivals = listen(sound_of(pulses_at(true, 50, settings), 40.5, rate_hz), settings, rate_hz)
    assert np.abs(arrivals.arrival_s[:20] - true).max() < bound_s


@pytest.mark.parametrize(
    ("settings", "rate_hz"), [(ONE, 48_000.0), (replace(ONE, sample_interval_s=1.0005e-3), 44_100.0)]
)
def test_where_blocks_are_cut_does_not_change_one_bit(settings, rate_hz):
    rng = np.random.default_rng(5)
    sound = sound_of(pulses_at(0.3 + 2 * np.arange(5), 30), 10.0, rate_hz)
    levels, arrivals = heard(ReportReceiver(settings, rate_hz), sound)
    assert len(levels) == int(10.0 / settings.sample_interval_s)
    for pieces in (3, 40, 5000):
        cuts = np.sort(rng.integers(0, len(sound), pieces))
        other_levels, other = heard(ReportReceiver(settings, rate_hz), sound, cuts)
        assert np.array_equal(levels, other_levels)
        for name in ("period", "rank", "arrival_s", "level", "attenuation_db"):
            assert np.array_equal(getattr(arrivals, name), getattr(other, name)), name


@pytest.mark.parametrize("fold_s", [0.0002, 0.004, 0.011, 0.019, 1.98, 1.989, 1.9985])
def test_a_signal_at_the_end_or_start_of_a_period_is_heard_once_and_whole(fold_s):
    true = fold_s + 2.0 * np.arange(10)
    arrivals = listen(sound_of(pulses_at(true, 40), 21.0), ONE)
    strong = arrivals.level > arrivals.level.max() - 20
    assert np.array_equal(arrivals.period[strong], np.arange(10))
    assert np.abs(arrivals.arrival_s[strong] - true).max() < 2e-4


def test_a_strong_signal_near_the_end_keeps_the_one_before_it():
    # The controller overwrites its first maximum there, whatever it was.
    pulses = joined_pulses(pulses_at(0.5 + 2 * np.arange(5), 30), pulses_at(1.985 + 2 * np.arange(5), 40))
    arrivals = listen(sound_of(pulses, 12.0), ReceiverSettings())
    for period in range(5):
        mine = arrivals.arrival_s[arrivals.period == period]
        assert mine == pytest.approx([1.985 + 2 * period, 0.5 + 2 * period], abs=3e-4)


def test_the_direct_path_is_chosen_before_two_echoes_thirty_milliseconds_later():
    true = 0.7 + 2.0 * np.arange(30)
    pulses = joined_pulses(
        pulses_at(true, 26),
        pulses_at(true + 0.030, 26, relative=0.6, seed=2),
        pulses_at(true + 0.034, 26, relative=0.35, seed=3),
    )
    arrivals = listen(sound_of(pulses, 61.0), ReceiverSettings())
    first = (arrivals.rank == 1) & (arrivals.period < 30)
    assert np.sqrt(np.mean((arrivals.arrival_s[first] - true) ** 2)) < 3e-4
    second = (arrivals.rank == 2) & (arrivals.period < 30)
    assert np.abs(arrivals.arrival_s[second] - true - 0.032).max() < 4e-3


def test_the_clock_of_the_report_slants_the_trace_by_a_millisecond_a_ping():
    # 2000 samples of 1.0005 ms are 2.001 s.
    settings = replace(ONE, sample_interval_s=1.0005e-3, interval_s=2.001)
    true = 0.4 + 2.0 * np.arange(20)
    arrivals = listen(sound_of(pulses_at(true, 40), 41.0), settings)
    fold = arrivals.arrival_s[:20] - 2.001 * arrivals.period[:20]
    assert np.diff(fold) == pytest.approx(-1e-3 * np.ones(19), abs=2e-4)


def test_the_gain_climbs_step_by_step_past_nine_decibels():
    sound = sound_of(pulses_at(0.5 + 2 * np.arange(10), 90), 20.0, density_v=3 * DENSITY_V)
    arrivals = listen(sound, ONE)
    assert list(dict.fromkeys(arrivals.attenuation_db)) == [0, 3, 9, 12, 18, 24, 30]
    fixed = replace(ONE, attenuator=Attenuator(automatic=False, start_db=18))
    assert set(listen(sound, fixed).attenuation_db) == {18}


def test_saturation_does_not_lose_the_arrival():
    true = 0.5 + 2 * np.arange(5)
    fixed = replace(ONE, attenuator=Attenuator(automatic=False))
    arrivals = listen(sound_of(pulses_at(true, 80), 11.0), fixed)
    assert arrivals.level[:5] == pytest.approx(np.full(5, 255))
    assert np.abs(arrivals.arrival_s[:5] - true).max() < 3e-3


def test_a_moving_ship_shifts_the_carrier_and_little_else():
    true = 0.5 + 2 * np.arange(20)
    for ratio in (1 - 5 / 1500, 1 + 5 / 1500):
        sound = sound_of(pulses_at(true, 40, carrier_hz=10_000 * ratio), 41.0)
        assert np.abs(listen(sound, ONE).arrival_s[:20] - true).max() < 2.5e-4


def test_a_pulse_that_the_end_cuts_off_is_left_out_and_a_whole_one_is_not():
    sound = sound_of(pulses_at([0.5, 2.5], 40), 2.5105)
    assert listen(sound, ONE).arrival_s == pytest.approx([0.5, 2.5], abs=5e-4)
    cut = listen(sound[: round(2.505 * 48_000)], ONE)
    assert cut.arrival_s[0] == pytest.approx(0.5, abs=2e-4)
    assert np.all(cut.arrival_s < 2.4955)


def test_silence_and_no_sound_at_all_give_nothing():
    assert len(listen(np.zeros(480_000, np.float32), ONE)) == 0
    assert len(listen(np.zeros(0, np.float32), ONE)) == 0
    assert len(listen(np.zeros(10, np.float32), ONE)) == 0


@pytest.mark.parametrize(
    "setting",
    [
        {"carrier_hz": 0.0},
        {"pulse_s": 0.0},
        {"interval_s": 0.05},
        {"window_s": 0.0},
        {"maxima": 0},
        {"sample_interval_s": 1.0},
        {"interval_s": float("nan")},
    ],
)
def test_settings_that_make_no_sense_are_named(setting):
    with pytest.raises(ValueError, match=next(iter(setting))):
        ReceiverSettings(**setting)


def test_a_rate_that_cannot_carry_the_carrier_is_refused():
    with pytest.raises(ValueError, match="16000 samples per second"):
        ReportReceiver(ONE, 16_000.0)


def test_integers_are_scaled_by_their_kind():
    sound = sound_of(pulses_at([0.3], 60), 3.0)
    whole = np.round(sound * 2**31).astype(np.int32)
    assert listen(whole, ONE).arrival_s == pytest.approx(listen(sound, ONE).arrival_s)


@pytest.mark.parametrize("odd", [np.nan, np.inf])
def test_samples_that_are_no_numbers_are_refused(odd):
    sound = np.zeros(4800)
    sound[100] = odd
    with pytest.raises(ValueError, match="not finite numbers"):
        ReportReceiver(ONE, 48_000.0).feed(sound)
