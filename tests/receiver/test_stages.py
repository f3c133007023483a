"""The stages of the report's receiver one by one, each against the plain way to do it."""

import csv
from itertools import pairwise

import numpy as np
import pytest

from trackerlib.receiver.carrier import (
    TUNED_STATE,
    make_carrier,
    mix_down,
    stage_pole,
    tune,
    value_starts,
    whole_values,
)
from trackerlib.receiver.front_end import (
    ATTENUATIONS_DB,
    AUTOMATIC,
    DB_PER_COUNT,
    GAIN_STATE,
    Attenuator,
    compress,
    next_step,
    starting_attenuation,
)
from trackerlib.receiver.maxima import CANDIDATE, SUM_STATE, judge, sum_levels


def envelope(sound, carrier_hz, rate_hz, interval_s, bandwidth_hz):
    """The kernels' envelope of a stream."""
    carrier = make_carrier(carrier_hz, rate_hz, interval_s, bandwidth_hz)
    starts = value_starts(
        0, whole_values(0, len(sound), carrier.samples_per_value), carrier.samples_per_value
    )
    iq, power = np.empty((len(starts) - 1, 2), np.float32), np.empty(len(starts) - 1)
    mix_down(sound.astype(np.float32), starts, carrier.cosine, carrier.sine, iq)
    tune(iq, starts, carrier.shortest, np.zeros(1, TUNED_STATE)[0], carrier.pole, power)
    return np.sqrt(power), starts


@pytest.mark.parametrize(
    ("rate_hz", "interval_s", "carrier_hz"), [(48_000, 1e-3, 10_000), (44_100, 1.0005e-3, 9_731.5)]
)
def test_the_envelope_is_that_of_a_mixed_and_twice_tuned_carrier(rate_hz, interval_s, carrier_hz):
    sound = np.random.default_rng(1).standard_normal(rate_hz // 4)
    found, starts = envelope(sound, carrier_hz, rate_hz, interval_s, 120.0)
    mixed = 2 * sound * np.exp(-2j * np.pi * carrier_hz / rate_hz * np.arange(len(sound)))
    value = np.array([mixed[a:b].mean() for a, b in pairwise(starts)])
    pole, first, second, plain = stage_pole(120.0, interval_s), 0, 0, []
    for each in value:
        first = pole * first + (1 - pole) * each
        second = pole * second + (1 - pole) * first
        plain.append(abs(second))
    assert found == pytest.approx(np.array(plain), rel=1e-4, abs=1e-6)


def test_the_tuned_response_is_three_decibels_down_at_the_edges_of_its_band():
    n = np.arange(48_000)
    for offset_hz, expected in ((0, 0.0), (60, -3.0), (-60, -3.0)):
        sound = np.cos(2 * np.pi * (10_000 + offset_hz) * n / 48_000)
        found, _ = envelope(sound, 10_000, 48_000, 1e-3, 120.0)
        assert 20 * np.log10(found[500:].mean()) == pytest.approx(expected, abs=0.08)


def levels_of(power, attenuator=AUTOMATIC, period=100.0, gain_db=80.0):
    levels, attenuations = np.empty(len(power), np.uint8), np.empty(len(power))
    state = np.zeros(1, GAIN_STATE)
    state["step"] = attenuator.step
    compress(power, 0, state[0], attenuator.automatic, gain_db, period, levels, attenuations)
    return levels, attenuations


def test_levels_are_logarithms_cut_to_eight_bits():
    decibels = np.linspace(-100, 20, 500)
    levels, _ = levels_of(10 ** (decibels / 10), Attenuator(automatic=False, start_db=12))
    plain = np.clip(np.floor((decibels + 80 - 12) / DB_PER_COUNT + 0.5), 0, 255)
    assert np.array_equal(levels, plain)
    assert levels.min() == 0
    assert levels.max() == 255
    assert pytest.approx(0.2825, abs=1e-4) == DB_PER_COUNT


def test_steps_of_the_gain_are_those_of_table_5_2_with_the_missing_one(shared):
    with (shared / "seed-data/seed002_table5_2_attenuators.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [-int(row["attenuation_dB"]) for row in rows] == list(ATTENUATIONS_DB)
    for step, row in enumerate(rows):
        more, less = -int(row["agc_next_more_attenuation_dB"]), -int(row["agc_next_less_attenuation_dB"])
        if ATTENUATIONS_DB[step] == 9:
            assert more == 0  # the original's slip
            more = 12
        assert ATTENUATIONS_DB[next_step(step, 0xE8)] == more
        assert ATTENUATIONS_DB[next_step(step, 0x40)] == less
        assert next_step(step, 0xE7) == next_step(step, 0x41) == step


def test_the_gain_is_set_once_a_period_of_any_length():
    _, attenuations = levels_of(np.full(1000, 1e3), period=100.3)
    changes = np.flatnonzero(np.diff(attenuations)) + 1
    assert changes.tolist() == [101, 201, 301, 402, 502, 602]
    _, attenuations = levels_of(np.full(700, 1e-9), Attenuator(start_db=30))
    assert attenuations[::100].tolist() == [30, 24, 18, 12, 9, 3, 0]


def test_the_gain_to_start_with_just_keeps_below_the_upper_threshold():
    for decibels in np.arange(-60.0, 40.0, 3.7):
        power = np.full(10, 10 ** (decibels / 10))
        at_thirty, _ = levels_of(power, Attenuator(automatic=False, start_db=30))
        start = starting_attenuation(int(at_thirty.max()))
        chosen, _ = levels_of(power, Attenuator(automatic=False, start_db=start))
        assert chosen.max() < 0xE8 or start == 30
        if start:
            less = ATTENUATIONS_DB[ATTENUATIONS_DB.index(start) - 1]
            louder, _ = levels_of(power, Attenuator(automatic=False, start_db=less))
            assert louder.max() >= 0xE8 - 1


def candidates_of(levels, taps, attenuations=None):
    levels = np.asarray(levels, np.uint8)
    attenuations = np.zeros(len(levels)) if attenuations is None else np.asarray(attenuations, float)
    candidates = np.zeros(len(levels) // 2 + 2, CANDIDATE)
    found = sum_levels(
        levels, attenuations, 0, np.zeros(1, SUM_STATE)[0], np.zeros(taps, np.int64), candidates, 0
    )
    return candidates[:found]


def test_local_maxima_of_the_sum_are_those_of_a_convolution():
    levels = np.random.default_rng(2).integers(0, 256, 5000)
    candidates = candidates_of(levels, 11)
    total = np.convolve(levels, np.ones(11, int))[:5000]
    peak = np.flatnonzero((total[1:-1] > total[:-2]) & (total[1:-1] > total[2:])) + 1
    a, b, c = total[peak - 1], total[peak], total[peak + 1]
    vertex = peak + 0.5 * (a - c) / (a - 2 * b + c)
    single = np.isin(np.round(candidates["place"]), peak)
    assert np.isin(vertex, candidates["place"]).mean() > 0.99
    assert candidates["total"][single].max() == 256 * b.max()
    assert len(candidates) >= len(peak)


def test_a_plateau_counts_once_in_its_middle():
    candidates = candidates_of([0, 0, 5, 5, 5, 5, 0, 0], 1)
    assert candidates["place"].tolist() == [3.5]
    assert candidates["level"].tolist() == [5]


def test_a_step_of_the_gain_within_a_signal_does_not_move_its_maximum():
    shape = np.round(150 * np.exp(-0.5 * ((np.arange(80) - 40) / 8) ** 2)) + 60
    counts = 9 / DB_PER_COUNT
    stepped, attenuations = shape.copy(), np.zeros(80)
    stepped[38:] -= counts
    attenuations[38:] = 9.0
    whole = candidates_of(shape, 11)
    split = candidates_of(np.round(stepped), 11, attenuations)
    best, other = whole[np.argmax(whole["total"])], split[np.argmax(split["total"])]
    assert other["place"] == pytest.approx(best["place"], abs=0.1)
    assert other["total"] == pytest.approx(best["total"], rel=1e-3)


def plain_rule(places, totals, low, high, window, count):
    """Largest first; none within a window of a larger."""
    order = sorted(range(len(places)), key=lambda k: (-totals[k], -k))
    kept, chosen = [], []
    for k in order:
        if all(abs(places[k] - places[other]) > window for other in kept):
            kept.append(k)
            if low <= places[k] < high:
                chosen.append(k)
    return chosen[:count]


@pytest.mark.parametrize("seed", range(20))
def test_the_window_rule_keeps_the_largest_of_every_neighbourhood(seed):
    rng = np.random.default_rng(seed)
    candidates = np.zeros(60, CANDIDATE)
    candidates["place"] = np.sort(rng.uniform(-40, 340, 60))
    candidates["total"] = rng.integers(0, 30, 60)  # ties, too
    chosen = np.empty(5, np.int64)
    count = judge(candidates, 60, 0.0, 300.0, 20.0, chosen)
    expected = plain_rule(candidates["place"], candidates["total"], 0.0, 300.0, 20.0, 5)
    assert chosen[:count].tolist() == expected


@pytest.mark.parametrize("db", [-3, 1, 10, 31])
def test_an_attenuation_that_the_receiver_lacks_is_refused(db):
    with pytest.raises(ValueError, match=f"start_db is {db}; wanted one of 0, 3, 9, 12, 18, 24, 30"):
        Attenuator(start_db=db)
