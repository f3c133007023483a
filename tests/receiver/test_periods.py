"""Buffers that carry no number are counted right, or not at all."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trackerlib.receiver.periods import (
    Period,
    PeriodCounter,
    arrivals_of,
    measured_sample_interval,
    receiver_start,
)
from trackerlib.receiver.sail import Maximum


def polled(seed, periods=400, period_s=2.0, poll_s=0.25, stalls=0.0, lost=0.0):
    """Numbers that a counter gives and those that are true, of buffers polled by a host that stalls now and then."""
    rng = np.random.default_rng(seed)
    counter = PeriodCounter(period_s)
    ready_0 = rng.uniform(0, period_s)
    now, fetched, given, truth = 0.0, -1, [], []
    first = None
    while now < periods * period_s:
        now += poll_s * rng.uniform(0.5, 1.5)
        if rng.random() < stalls:
            now += rng.exponential(3.0)
        before = now
        newest = math.floor((now - ready_0) / period_s)
        now += rng.uniform(0.001, 0.02)
        if newest <= fetched or newest < 0:
            counter.not_ready(before)
            continue
        fetched = newest
        if rng.random() < lost:
            counter.lost(now)
            continue
        number = counter.number(before, now)
        first = newest if first is None else first
        if number is not None:
            given.append(number)
            truth.append(newest - first)
    return given, truth


@pytest.mark.parametrize("seed", range(8))
def test_a_steady_host_counts_every_period(seed):
    given, truth = polled(seed)
    assert given == truth
    assert len(given) >= 398


@pytest.mark.parametrize("seed", range(8))
def test_a_host_that_stalls_and_loses_buffers_is_never_wrong(seed):
    given, truth = polled(seed, stalls=0.1, lost=0.1)
    assert given == truth
    assert len(given) > 100


@pytest.mark.parametrize("factor", [0.9995, 1.0005])
def test_a_clock_that_runs_wrong_by_half_a_part_in_a_thousand_is_followed(factor):
    rng = np.random.default_rng(1)
    counter = PeriodCounter(2.0)
    for k in range(3000):
        ready = 2.0 * factor * k
        counter.not_ready(ready - rng.uniform(0.01, 0.2))
        late = ready + rng.uniform(0, 0.2)
        assert counter.number(late, late + 0.01) == k


def test_what_may_be_of_two_periods_is_left_out():
    counter = PeriodCounter(2.0)
    counter.number(10.0, 10.1)
    counter.not_ready(11.9)
    counter.number(12.05, 12.1)
    assert counter.number(13.9, 16.2) is None  # the host was away while the next one took its place
    counter.not_ready(16.4)
    assert counter.number(18.3, 18.31) == 4


def test_arrivals_are_on_the_receiver_s_clock():
    periods = [
        Period(0, 102.0, (Maximum(2200, 110), Maximum(1100, 1500)), 3.0, 2000),
        Period(2, 106.1, (Maximum(2750, 5),), math.nan, 2000),
    ]
    arrivals = arrivals_of(periods, 1.0005e-3)
    assert arrivals.period.tolist() == [0, 0, 2]
    assert arrivals.rank.tolist() == [1, 2, 1]
    assert arrivals.arrival_s == pytest.approx(1.0005e-3 * np.array([100, 1490, 3995]))
    assert arrivals.level.tolist() == [200, 100, 250]
    assert arrivals.attenuation_db[:2].tolist() == [3, 3]
    assert math.isnan(arrivals.attenuation_db[2])
    assert receiver_start(periods, 1e-3) == pytest.approx(100.0)
    assert len(arrivals_of([], 1e-3)) == 0


def test_the_sample_interval_shows_in_when_buffers_come():
    rng = np.random.default_rng(2)
    heard = 2.001 * np.arange(1, 601) + rng.uniform(0, 0.2, 600)
    periods = [Period(k, float(when), (), 0.0, 2000) for k, when in enumerate(heard)]
    interval, sigma = measured_sample_interval(periods)
    assert abs(interval - 1.0005e-3) < 4 * sigma
    assert sigma < 2e-8
    assert math.isnan(measured_sample_interval(periods[:2])[0])
