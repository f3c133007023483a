"""Trains of arrivals: intervals, drift, missed and extra pings, emission numbers, two pingers, noise."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.receiver.intervals import IntervalTracker, separate
from trackerlib.receiver.multiples import Numbered, at_own_interval


def heard(rng, interval_s, seconds, *, first_s, drift_ppm=0.0, missing=0.3, jitter_s=4e-4, range_m=None):
    """Arrival times and emission numbers of the pings that were heard."""
    number = np.arange(int((seconds - first_s) / interval_s))
    emitted = first_s + interval_s * number * (1 + drift_ppm * 1e-6 * (number / number[-1] - 1) / 2)
    arrival = emitted + rng.normal(0, jitter_s, len(number))
    if range_m is not None:
        arrival += range_m(emitted) / 1500
    kept = rng.random(len(number)) >= missing
    return arrival[kept], number[kept]


def passing(time_s):
    """Range of a ship that passes a beacon at 5 m/s, turns in a minute and comes back."""
    along = 5 * np.where(time_s < 530, time_s, 1060 - time_s)
    along = np.where(np.abs(time_s - 530) < 30, 5 * (515 - (time_s - 530) ** 2 / 60), along)
    return np.hypot(along - 1200, 700)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("range_m", [None, passing])
def test_every_emission_number_is_right(seed, range_m):
    """20 ppm drift, 30 % missing, a second pinger at 2.5 s, false alarms."""
    rng = np.random.default_rng(seed)
    one, one_number = heard(rng, 2.0, 1000, first_s=0.31, drift_ppm=20, range_m=range_m)
    two, two_number = heard(rng, 2.5, 1000, first_s=1.02, range_m=range_m)
    false = rng.uniform(0, 1000, 60)
    arrival = np.concatenate([one, two, false])
    source = np.repeat([0, 1, 2], [len(one), len(two), len(false)])
    number = np.concatenate([one_number, two_number, np.full(60, -1)])
    shuffled = rng.permutation(len(arrival))
    trains = separate(arrival[shuffled])
    assert [round(train.interval_s, 1) for train in trains] == [2.0, 2.5]
    for which, train in enumerate(trains):
        rows = shuffled[train.rows]
        mine = source[rows] == which
        assert np.sum(~mine) <= 2  # a false alarm that stood where a missed ping would have
        assert np.sum(source == which) - mine.sum() <= 2
        assert len(np.unique(number[rows][mine] - train.emission[mine])) == 1
        assert train.missed == train.emission[-1] + 1 - len(train.rows)
    assert 50 <= trains[0].extra <= 64


@pytest.mark.parametrize("off_s", [0.012, 0.3])
def test_two_pingers_of_one_interval_stay_two(off_s):
    """4 s each, and half of it apart but for `off_s`: more than the scatter of either."""
    rng = np.random.default_rng(1)
    one, _ = heard(rng, 4.0, 400, first_s=0.31, missing=0.1)
    two, _ = heard(rng, 4.0, 400, first_s=2.31 + off_s, missing=0.1)
    trains = separate(np.concatenate([one, two]))
    assert [round(train.interval_s, 2) for train in trains] == [4.0, 4.0]


@pytest.mark.parametrize("divisor", [2, 3])
@pytest.mark.parametrize("off_s", [0.0, 0.012])
def test_a_train_at_a_multiple_takes_what_stands_between_and_nothing_beside(divisor, off_s):
    rng = np.random.default_rng(1)
    arrival, number = heard(rng, 2.0, 300, first_s=0.31)
    arrival = np.where(number % divisor, arrival + off_s, arrival)
    found = np.flatnonzero(number % divisor == 0)
    few = Numbered((number[found] - number[found][0]) // divisor, found)
    (train,) = at_own_interval([few], arrival, 0.4, 1e-3)
    if off_s:
        assert train is few
    else:
        assert len(train.rows) > len(arrival) - 2 * divisor  # what comes before its first or after its last
        assert np.ptp(number[train.rows] - train.emission) == 0


@pytest.mark.parametrize("apart_s", [0.0133, 0.3])
def test_followers_that_changed_places_are_of_one_pinger_if_one_is_of_echoes(apart_s):
    """After a gap the one goes from the pings to their echoes, and what it leaves makes another of both."""
    rng = np.random.default_rng(1)
    number = np.flatnonzero(rng.random(150) > 0.3)
    late = rng.random(len(number)) < 0.4
    arrival = 0.31 + 2.0 * number + apart_s * late
    first = np.where(number < 60, ~late, late) & (number < 140)
    second = np.where(number < 60, late, ~late) & (number > 35)
    trains = [Numbered(number[mine] - number[mine][0], np.flatnonzero(mine)) for mine in (first, second)]
    found = at_own_interval(trains, arrival, 0.4, 1e-3)
    if apart_s > 0.1:
        assert [len(each.rows) for each in found] == sorted((len(each.rows) for each in trains), reverse=True)
        return
    (train,) = found
    assert np.ptp(number[train.rows] - train.emission) == 0
    assert np.all(np.diff(train.emission) > 0)
    assert train.emission[-1] >= 145
    assert len(train.rows) > max(len(each.rows) for each in trains)


def test_interval_and_drift_have_true_sigmas():
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        arrival, number = heard(rng, 2.0, 600, first_s=0.5, drift_ppm=20)
        (train,) = separate(arrival)
        middle = 2.0 * (1 + 20e-6 * ((number[0] + number[-1]) / 2 / 298 - 0.5))
        drift_ppm = 20 * (number[-1] - number[0]) / 298
        interval_error = (train.interval_s - middle) / train.sigma_interval_s
        errors.append((interval_error, (train.drift_ppm - drift_ppm) / train.sigma_drift_ppm))
    assert np.sqrt(np.mean(np.square(errors), axis=0)) == pytest.approx([1, 1], abs=0.25)


def test_a_stream_gives_the_same_answer_with_bounded_memory():
    rng = np.random.default_rng(4)
    one, _ = heard(rng, 2.0, 4000, first_s=0.31, range_m=passing)
    two, _ = heard(rng, 2.5, 4000, first_s=1.02, range_m=passing)
    arrival = np.sort(np.concatenate([one, two, rng.uniform(0, 4000, 400)]))
    tracker = IntervalTracker()
    known, kept = [], 0
    for part in np.split(arrival, np.sort(rng.integers(0, len(arrival), 300))):
        known += tracker.feed(part)
        kept = max(kept, len(tracker._loose))
        if part.size and part[-1] > 100:
            assert sorted(tracker.interval_s.values()) == pytest.approx([2.0, 2.5], rel=0.004)
    known += tracker.finish()
    assert kept <= 300
    trains = separate(arrival)
    for train in trains:
        rows = {each.row: each.emission for each in known if each.train == next_of(known, train.rows[0])}
        assert rows == dict(zip(train.rows.tolist(), train.emission.tolist(), strict=True))


@pytest.mark.parametrize("divisor", [2, 3])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_stream_brings_a_train_at_a_multiple_to_its_interval_as_a_batch_does(divisor, seed):
    """For 80 s only every second or third ping is loud enough; a second pinger at 2.5 s all the while."""
    rng = np.random.default_rng(seed)
    one, number = heard(rng, 2.0, 400, first_s=0.31, missing=0.2)
    one = one[(number % divisor == 0) | (number > 40)]
    two, _ = heard(rng, 2.5, 400, first_s=1.02)
    arrival = np.sort(np.concatenate([one, two]))
    tracker, last_word, intervals = IntervalTracker(), {}, []
    for time_s in arrival:
        last_word |= {each.row: (each.train, each.emission) for each in tracker.feed([time_s])}
        intervals.append(sorted(round(each, 1) for each in tracker.interval_s.values()))
    assert divisor == 3 or [2.5, 4.0] in intervals
    assert intervals[-1] == [2.0, 2.5]
    last_word |= {each.row: (each.train, each.emission) for each in tracker.finish()}
    told = {}
    for row, (train, emission) in sorted(last_word.items()):
        if train >= 0:
            told.setdefault(train, []).append((row, emission))
    batch = [list(zip(each.rows.tolist(), each.emission.tolist(), strict=True)) for each in separate(arrival)]
    assert sorted(told.values()) == sorted(batch)


def next_of(known, row):
    return next(each.train for each in known if each.row == row)


@pytest.mark.parametrize("per_second", [0.3, 2.0, 20.0])
def test_noise_has_no_train(per_second):
    arrival = np.random.default_rng(5).uniform(0, 1500 / per_second, 1500)
    assert separate(arrival) == ()


@pytest.mark.parametrize("arrival", [[], [1.0], [1.0, 3.0, 5.0], [np.nan, 2.0]])
def test_too_few_arrivals_have_no_train(arrival):
    assert separate(arrival) == ()


def test_a_long_gap_keeps_the_count():
    number = np.concatenate([np.arange(60), np.arange(110, 170)])
    (train,) = separate(0.4 + 2.0 * number + 1e-4 * number)
    assert np.array_equal(train.emission, number)
    assert train.missed == 50


def test_bad_input():
    with pytest.raises(ValueError, match="came after"):
        IntervalTracker().feed([2.0, 1.0])
    with pytest.raises(ValueError, match="shortest and the longest"):
        separate([1.0], interval_s=(3, 2))
    with pytest.raises(ValueError, match="jitter_s"):
        separate([1.0], jitter_s=0.1)
