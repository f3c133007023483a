"""Trains found at a multiple of their pinger's interval, brought back to it.

Where many pings are missing, every second or third of them can look the better train; and where an echo takes the
place of its ping, such echoes can look like a train. Both leave arrivals at places that another train tells of.

Two trains of equal interval, one half of it apart, are one pinger if the one stands in the middles of the other: every
class of places between is filled beyond chance, within four sigma of the train's own scatter (the jitter at least; more
where echoes stand in for pings) and within two on average. Two pingers pass by an accident of one in T / (4 sigma),
1000 for 4 s and 1 ms, and only while their clocks and ranges keep it so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackerlib.receiver.chains import surprise

DIVISORS = (2, 3)
LEAST_SHARE = 0.25  # of the places between that must be filled
LEAST_SURPRISE = 10.0  # minus log probability that chance fills them
EQUAL = 1e-3  # relative difference of intervals that are the same
ECHO_S = 0.1  # at most, between a ping and an echo that takes its place
STAND_INS = 0.7  # of a train's arrivals where the other goes on, and they are one pinger's
LEAST_STAND_INS = 6  # to number the rest of such a train by


@dataclass(frozen=True, eq=False)
class Numbered:
    """Arrivals of one train."""

    emission: np.ndarray  # (N,) pings since the first, rising
    rows: np.ndarray  # (N,) of the arrivals, in order of time

    def interval_s(self, time_s: np.ndarray) -> float:
        """Mean interval."""
        return float((time_s[self.rows[-1]] - time_s[self.rows[0]]) / (self.emission[-1] - self.emission[0]))


def at_own_interval(
    trains: Sequence[Numbered], time_s: np.ndarray, shortest_s: float, jitter_s: float
) -> list[Numbered]:
    """The trains, each at the interval of its pinger, without those that others explain.

    time_s : (N,) of all arrivals, in order; jitter_s : standard error of an arrival
    """
    waiting = sorted(trains, key=lambda train: -len(train.rows))
    done: list[Numbered] = []
    while waiting:
        train = waiting.pop(0)
        interval_s = train.interval_s(time_s)
        others = [each for each in waiting if not _multiple(each.interval_s(time_s) / interval_s)]
        free = _loose(others + done, len(time_s))
        free[train.rows] = False
        for divisor in DIVISORS:
            if interval_s / divisor < shortest_s:
                continue
            whole = _divided(train, time_s, free, divisor, jitter_s)
            if whole is not None:
                waiting = [each for each in waiting if np.isin(each.rows, whole.rows).mean() < 0.5]
                waiting = [_without(each, whole.rows) for each in waiting]
                waiting.insert(0, whole)
                break
        else:
            done.append(train)
    done.sort(key=lambda train: -len(train.rows))
    kept: list[Numbered] = []
    for train in done:
        for k, other in enumerate(kept):
            whole = _with_stand_ins(train, other, time_s, jitter_s)
            if whole is not None:
                kept[k] = whole
                break
        else:
            kept.append(train)
    return kept


def _multiple(ratio: float) -> bool:
    return bool(ratio > 1 - EQUAL and abs(ratio - round(ratio)) < EQUAL * ratio)


def _loose(trains: Sequence[Numbered], count: int) -> np.ndarray:
    loose = np.ones(count, bool)
    for train in trains:
        loose[train.rows] = False
    return loose


def _without(train: Numbered, rows: np.ndarray) -> Numbered:
    keep = ~np.isin(train.rows, rows)
    return Numbered(train.emission[keep] - train.emission[keep][0], train.rows[keep])


def _divided(
    train: Numbered, time_s: np.ndarray, free: np.ndarray, divisor: int, jitter_s: float
) -> Numbered | None:
    """The train at its interval over `divisor`, with the free arrivals that stand between; None if too few do."""
    number = np.arange(divisor * train.emission[0] + 1, divisor * train.emission[-1])
    number = number[number % divisor != 0]
    expected_s = np.interp(number / divisor, train.emission, time_s[train.rows])
    rows = np.flatnonzero(free)
    if not len(rows):
        return None
    nearest = rows[_nearest(time_s[rows], expected_s)]
    departure_s = time_s[nearest] - expected_s
    sigma_s = max(_scatter(train, time_s), jitter_s)
    gate_s = min(4 * sigma_s, train.interval_s(time_s) / divisor / 8)
    chance = 1 - np.exp(-len(rows) * 2 * gate_s / (time_s[train.rows[-1]] - time_s[train.rows[0]]))
    filled = np.abs(departure_s) <= gate_s
    for place in range(1, divisor):
        mine = number % divisor == place
        found, tried = int(np.sum(filled & mine)), int(np.sum(mine))
        if found < LEAST_SHARE * tried or surprise(found, tried, chance) < LEAST_SURPRISE:
            return None
        if abs(departure_s[filled & mine].mean()) > 2 * sigma_s:
            return None
    emission = np.concatenate([divisor * train.emission, number[filled]])
    order = np.argsort(emission)
    emission = emission[order]
    return Numbered(emission - emission[0], np.concatenate([train.rows, nearest[filled]])[order])


def _scatter(train: Numbered, time_s: np.ndarray) -> float:
    """Standard deviation of an arrival from the line between its neighbours: more than jitter where echoes stand in."""
    here = time_s[train.rows]
    if len(here) < 3:
        return 0.0
    share = (train.emission[1:-1] - train.emission[:-2]) / (train.emission[2:] - train.emission[:-2])
    return float(np.std(here[1:-1] - here[:-2] - share * (here[2:] - here[:-2])))


def _nearest(time_s: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    """Place in time_s (N,), in order, of what is nearest to each."""
    after = np.clip(np.searchsorted(time_s, wanted_s), 0, len(time_s) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(time_s[before] - wanted_s) < np.abs(time_s[after] - wanted_s), before, after)


def _with_stand_ins(train: Numbered, other: Numbered, time_s: np.ndarray, jitter_s: float) -> Numbered | None:
    """The other train with what this one adds, if this one came in the place of pings that it misses.

    Those are the pings; or echoes of them, which add at its ends only, or the pings of a train of echoes: after a gap
    a follower may have gone from the one to the other, and what it left then made a train of its own. None if they
    are two pingers'.
    """
    number = np.arange(other.emission[0], other.emission[-1] + 1)
    expected_s = np.interp(number, other.emission, time_s[other.rows])
    here = time_s[train.rows]
    place = _nearest(expected_s, here)
    lag_s = np.abs(here - expected_s[place])
    echo = ~np.isin(number[place], other.emission) & (lag_s <= ECHO_S)
    before, after = here < expected_s[0] - ECHO_S, here > expected_s[-1] + ECHO_S
    if echo.sum() < STAND_INS * np.sum(~before & ~after):
        return None
    times = round(train.interval_s(time_s) / other.interval_s(time_s))
    begin = number[place[echo]] - times * train.emission[echo]
    if echo.sum() < LEAST_STAND_INS or np.ptp(begin) > 0:
        return other if echo.mean() >= STAND_INS else None
    adds = before | after | (echo & (lag_s <= 4 * jitter_s))
    emission = np.concatenate([other.emission, begin[0] + times * train.emission[adds]])
    order = np.argsort(emission)
    emission = emission[order]
    return Numbered(emission - emission[0], np.concatenate([other.rows, train.rows[adds]])[order])
