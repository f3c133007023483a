"""The modern detector: times against brute force, sigmas, false alarms, blocks, echoes, bad input."""

from __future__ import annotations

import lucky
import numpy as np
import pytest
from recordings import CARRIER_HZ, PULSE_S, RATE_HZ, brute_force, recording

from trackerlib.receiver.arrivals import joined
from trackerlib.receiver.cells import MatchedFilter
from trackerlib.receiver.demodulation import fading_weight
from trackerlib.receiver.detection_curve import detection_curve
from trackerlib.receiver.echoes import direct
from trackerlib.receiver.matched import EXPECTED, NOISE_CELLS, NOISE_SHARE, ModernDetector, threshold


def listen(detector, samples, block=4800):
    heard = [detector.feed(samples[k : k + block]) for k in range(0, len(samples), block)]
    heard.append(detector.finish())
    return joined([each.arrivals for each in heard]), np.concatenate([each.levels for each in heard])


def detector(interval_s, **settings):
    return ModernDetector(RATE_HZ, CARRIER_HZ, PULSE_S, interval_s, **settings)


@pytest.mark.parametrize("snr_db", [0, 10, 14, 20, 30])
def test_times_are_as_good_as_brute_force(snr_db):
    """Root-mean-square error at most 1.1 times that of the most likely time of the same samples."""
    rng = np.random.default_rng(snr_db)
    interval_s, count = 0.4, 300
    middle_s = (np.arange(count) + 0.5) * interval_s
    begin_s = middle_s + rng.uniform(-0.05, 0.05, count)
    samples = recording(rng, begin_s, snr_db, count * interval_s)
    found, _ = listen(detector(interval_s, false_alarm=0.5, maxima=1), samples)
    assert np.array_equal(found.period, np.arange(count))
    best_s = brute_force(samples, middle_s - interval_s / 2, middle_s + interval_s / 2)
    ours, theirs = (np.sqrt(np.mean((time_s - begin_s) ** 2)) for time_s in (found.arrival_s, best_s))
    assert ours <= 1.1 * theirs
    if snr_db == 20:  # 19.2 and 26 are the variances of the mean and of the place of the greatest likelihood
        expected = np.sqrt(19.2) * PULSE_S / 4 / 10 ** (snr_db / 10)
        assert ours == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(
    ("snr_db", "false_alarm", "least_found"),
    [
        (0, 1e-2, 0.1),
        (5, 1e-2, 0.3),
        (10, 1e-2, 0.9),
        (10, 1e-6, 0.12),
        (12, 1e-6, 0.5),
        (14, 1e-6, 0.9),
        (20, 1e-6, 1),
        (30, 1e-6, 1),
    ],
)
def test_stated_sigma_is_true(snr_db, false_alarm, least_found):
    """1.96 sigma hold 93 to 98 % of the arrivals that are within a pulse of one, whatever its strength."""
    rng = np.random.default_rng(100 + snr_db)
    interval_s, count = 0.3, 1200 if least_found > 0.5 else 3000
    begin_s = (np.arange(count) + 0.5 + rng.uniform(-0.1, 0.1, count)) * interval_s
    samples = recording(rng, begin_s, snr_db, count * interval_s)
    found, _ = listen(detector(interval_s, maxima=1, false_alarm=false_alarm), samples)
    error = found.arrival_s - begin_s[found.period]
    true = np.abs(error) < PULSE_S
    assert true.sum() >= least_found * count
    share, luck = np.mean(np.abs(error[true]) < 1.96 * found.sigma_s[true]), 2.6 / np.sqrt(true.sum())
    if false_alarm == 1e-6:
        assert np.sum(~true) <= 2
        assert 0.93 <= share <= 0.97
    assert 0.93 - luck * np.sqrt(0.93 * 0.07) <= share <= 0.98 + luck * np.sqrt(0.98 * 0.02)
    if least_found == 1:
        assert np.median(found.snr_db) == pytest.approx(snr_db, abs=0.3)


@pytest.mark.parametrize(
    ("snr_db", "false_alarm"),
    [(0, 1e-6), (3, 1e-6), (6, 1e-6), (10, 1e-6), (0, 1e-4), (3, 1e-9), (8, 1e-9), (6, 1e-12)],
)
def test_stated_sigma_is_true_of_pulses_that_luck_lifts_over_the_threshold(snr_db, false_alarm):
    """Of one in five down to one in a million that pass; without a thought to luck 60 to 94 % are inside."""
    count, interval_s = 1000, 0.06
    apart = round((EXPECTED + 1) * interval_s * lucky.RATE_HZ)
    least = threshold(false_alarm, int(NOISE_SHARE * NOISE_CELLS))
    sound, begin, weight = lucky.passing_pulses(np.random.default_rng(20), snr_db, least, count, apart)
    settings = {"maxima": 1, "false_alarm": false_alarm}
    stream = ModernDetector(lucky.RATE_HZ, lucky.CARRIER_HZ, lucky.PULSE_S, interval_s, **settings)
    found, _ = listen(stream, sound)
    which = (found.arrival_s * lucky.RATE_HZ // apart).astype(int)
    error = found.arrival_s - begin[which] / lucky.RATE_HZ
    near = np.abs(error) < lucky.PULSE_S
    assert (
        near.sum() > 0.6 * count
    )  # with a pulse of 36 the noise, and so the threshold, is taken a little high
    weight = weight[which[near]]
    share = np.average(np.abs(error[near]) < 1.96 * found.sigma_s[near], weights=weight)
    luck = 2.6 * np.sqrt(weight @ weight) / weight.sum()
    assert 0.93 - luck * np.sqrt(0.93 * 0.07) <= share <= 0.98 + luck * np.sqrt(0.98 * 0.02)


def test_fading_weight_is_the_average_over_rayleigh_pulses():
    z = np.array([0.0, 1e-3, 0.019, 0.021, 0.5, 3, 14, 80])
    u = (np.arange(200_000) + 0.5) / 200_000
    average = [np.mean((1 - u) * np.exp(u * each)) for each in z]
    assert [fading_weight(each, 0.0) for each in z] == pytest.approx(average, rel=1e-6)


def test_false_alarms_are_as_stated_and_misses_as_theory_has_them():
    curve = detection_curve(
        MatchedFilter(8000, 2000, 0.01), [1e-1, 1e-2, 1e-3], [9, 12, 14], pulses=300, seed=1
    )
    assert curve.false_alarm_found == pytest.approx(curve.false_alarm, rel=0.15)
    # Theory leaves out the luck of the neighbouring windows, worth less than a decibel.
    better = detection_curve(MatchedFilter(8000, 2000, 0.01), curve.false_alarm, curve.snr_db + 1, pulses=1)
    noise = 3 * np.sqrt(curve.miss * (1 - curve.miss) / curve.pulses) + 0.005
    assert np.all(curve.miss_found <= curve.miss + noise)
    assert np.all(curve.miss_found >= better.miss - noise)
    assert np.all(np.diff(curve.miss) > 0)
    assert np.all(np.diff(curve.miss, axis=0) < 0)


def test_threshold_by_hand():
    assert threshold(1e-3, 10**7) == pytest.approx(np.log(1000), rel=1e-4)  # noise known: exponential
    assert threshold(0.25, 1) == pytest.approx(3)  # 1/(1 + T)


def test_noise_alone_gives_as_many_arrivals_as_stated():
    found, _ = listen(detector(2.0), recording(np.random.default_rng(5), [], 0, 120))
    assert len(found) <= 1  # 0.12 cells expected
    many, _ = listen(
        detector(2.0, false_alarm=1e-3, maxima=1000), recording(np.random.default_rng(6), [], 0, 120)
    )
    assert 30 < len(many) <= 120  # 120 cells, in clusters of one to a few


@pytest.mark.parametrize(
    ("rate_hz", "carrier_hz", "pulse_s"),
    [(48_000, 10_000, 0.01), (44_100, 9_973, 0.0073), (96_000, 12_000, 0.002)],
)
def test_blocks_change_no_bit(rate_hz, carrier_hz, pulse_s):
    rng = np.random.default_rng(7)
    begin_s = np.array([0.3, 0.33, 1.0, 1.7, 1.9995, 2.52, 3.1, 3.9, 4.4, 5.1])
    samples = recording(rng, begin_s, 18, 5.3, rate_hz, carrier_hz, pulse_s)
    cuts = np.sort(rng.integers(0, len(samples), 50))
    answers = []
    for pieces in ([samples], np.split(samples, cuts), np.split(samples, np.arange(777, len(samples), 777))):
        stream = ModernDetector(rate_hz, carrier_hz, pulse_s, 1.0)
        heard = [stream.feed(piece) for piece in pieces] + [stream.finish()]
        found = joined([each.arrivals for each in heard])
        answers.append([np.concatenate([each.levels for each in heard]), *vars(found).values()])
    for other in answers[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(answers[0], other, strict=True))
    found_s = np.sort(answers[0][3])
    assert len(answers[0][0]) == 5300
    assert found_s == pytest.approx(begin_s, abs=0.2 * pulse_s)


def test_whole_numbers_and_floats_give_the_same():
    rng = np.random.default_rng(8)
    samples = (recording(rng, [0.5, 1.5], 25, 2.5) * 2**15).round()
    small, _ = listen(detector(1.0), samples.astype(np.int16))
    large, _ = listen(detector(1.0), (samples * 2**16).astype(np.int32))
    real, _ = listen(detector(1.0), samples / 2**15)
    assert np.array_equal(small.arrival_s, large.arrival_s)
    assert small.arrival_s == pytest.approx(real.arrival_s, abs=1e-9)
    assert len(small) == 2


def test_the_direct_arrival_is_chosen_among_echoes():
    """10 ms, 10 kHz, 2 s; two paths that arrive 30 ms later, the second louder than the direct one."""
    rng = np.random.default_rng(9)
    begin_s = 0.7 + 2.0 * np.arange(10)
    every = np.concatenate([begin_s, begin_s + 0.030, begin_s + 0.055])
    snr_db = np.repeat([20.0, 16.0, 24.0], 10)
    found, _ = listen(detector(2.0), recording(rng, every, snr_db, 21))
    assert len(found) == 30
    straight = direct(found)
    assert found.arrival_s[straight] == pytest.approx(begin_s, abs=1e-3)
    assert np.all(found.rank[straight] == 2)


def test_levels_are_decibels_of_the_carrier():
    loud = recording(
        np.random.default_rng(10), [0.5], 60, 1.0, rms=1e-4
    )  # amplitude 1e-4 * 2 * sqrt(1e6 / 480)
    found, levels = listen(detector(1.0), loud)
    expected = 255 + 255 / 72 * 20 * np.log10(2e-4 * np.sqrt(1e6 / 480))
    assert found.level[0] == pytest.approx(expected, abs=1.5)
    assert levels[509] == pytest.approx(expected, abs=2)  # drawn when the pulse has ended
    assert levels.dtype == np.uint8
    assert np.median(levels) < 30


def test_a_pulse_that_an_end_cuts_is_not_told():
    samples = recording(np.random.default_rng(11), [0.5, 1.5], 30, 2.0)
    cut, _ = listen(detector(1.0), samples[round(0.504 * RATE_HZ) : round(1.506 * RATE_HZ)])
    assert len(cut) == 0
    whole, _ = listen(detector(1.0), samples[round(0.4999 * RATE_HZ) : round(1.5105 * RATE_HZ)])
    assert whole.arrival_s == pytest.approx([1e-4, 1.0001], abs=1e-4)


@pytest.mark.parametrize("samples", [np.zeros(96_000), np.full(96_000, 0.3), np.zeros(10), np.zeros(0)])
def test_silence_has_no_arrivals(samples):
    found, levels = listen(detector(1.0), samples)
    assert len(found) == 0
    assert len(levels) == len(samples) // 48


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rate_hz": 48_000.5}, "rate_hz is 48000.5"),
        ({"carrier_hz": 24_000}, "carrier_hz is 24000; 48000 samples a second carry"),
        ({"pulse_s": 1e-4}, "pulse_s is 0.0001; wanted 0.00067"),
        ({"interval_s": 0.01}, "interval_s is 0.01"),
        ({"false_alarm": 0}, "false_alarm is 0"),
        ({"maxima": 0}, "maxima is 0"),
    ],
)
def test_settings_that_make_no_sense(settings, message):
    usual = {"rate_hz": 48_000, "carrier_hz": 10_000, "pulse_s": 0.01, "interval_s": 2.0}
    with pytest.raises(ValueError, match=message):
        ModernDetector(**{**usual, **settings})


def test_samples_that_make_no_sense():
    with pytest.raises(ValueError, match="not finite"):
        detector(1.0).feed(np.full(4800, np.nan))
    with pytest.raises(ValueError, match=r"shape \(10, 2\); wanted one row"):
        detector(1.0).feed(np.zeros((10, 2)))


def test_doppler_of_a_ship_costs_level_and_not_time():
    rng = np.random.default_rng(12)
    begin_s = (np.arange(400) + rng.uniform(0.3, 0.7, 400)) * 0.4
    shifted = CARRIER_HZ * (1 + 5 / 1500)
    samples = recording(rng, begin_s, 22, 160, carrier_hz=shifted)
    found, _ = listen(detector(0.4, maxima=1), samples)
    error = found.arrival_s - begin_s
    assert abs(error.mean()) < 3.5 * error.std() / 20
    loss_db = -20 * np.log10(np.sinc((shifted - CARRIER_HZ) * PULSE_S))
    assert np.median(found.snr_db) == pytest.approx(22 - loss_db, abs=0.3)
