"""Trains of a pinger's arrivals: its interval, found and followed, and the emission that each arrival came from.

An arrival comes n intervals after another plus what the range changed in between. A ship at 5 m/s changes it by
3.3 ms a second, so an interval looks up to a third of a percent longer or shorter, smoothly. Chains of evenly
spaced arrivals that chance cannot make start a train; a Kalman filter on the next arrival and the interval
follows it over gaps. Arrivals folded at the interval need this: a fold is worth the interval times the speed of
sound.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from trackerlib.receiver.chains import best_chain
from trackerlib.receiver.multiples import Numbered, at_own_interval

LEAST_SHARE = 0.4  # of its pings that a train must show to be found
LEAST_SURPRISE = 40.0  # minus log probability that chance makes a chain: takes about a dozen pings
BEND = 2e-4  # greatest change of the interval looked for, relative, a second: a turn, or a pass at 85 m
PATIENCE = 60  # pings missed in a row after which a train has ended
REVIEW = 8  # pings heard, after which is looked anew whether trains are at their pingers' intervals


@dataclass(frozen=True)
class Assigned:
    """One arrival put in its place; the last word on an arrival counts."""

    row: int  # of the arrival, counted from the first one told
    train: int  # from 0 in the order found; -1 if it is in none after all
    emission: int  # pings since the train's first; -1 in none


@dataclass(frozen=True, eq=False)
class Train:
    """Arrivals of one pinger."""

    interval_s: float  # in the middle of the train, as heard: the ship's motion is in it
    sigma_interval_s: float
    drift_ppm: float  # change of the interval from the first emission to the last
    sigma_drift_ppm: float
    emission: np.ndarray  # (N,) pings since the train's first, integers
    rows: np.ndarray  # (N,) which of the arrivals told
    missed: int  # pings between the first and the last that were not heard
    extra: int  # arrivals between its first and its last that are in no train


@dataclass
class _Follower:
    """Kalman filter on the time of the next ping and the interval."""

    number: int
    emission: int  # of the next ping
    state: np.ndarray  # (2,) its time, the interval
    covariance: np.ndarray
    jitter_s: float
    heard: deque[tuple[int, int, float]]  # emission, row and time of the last pings
    gap: int = 0  # pings missed since the last one heard
    candidates: list[tuple[float, int, float]] = field(default_factory=list)  # distance, row, time

    @property
    def half_width_s(self) -> float:
        spread = np.sqrt(self.covariance[0, 0] + self.jitter_s**2)
        return float(min(4 * spread, self.state[1] / 8))

    def step(self) -> None:
        """On to the next ping."""
        turn = np.array([[1.0, 1.0], [0.0, 1.0]])
        bend = BEND / 2 * self.state[1] ** 2  # the greatest change is two sigma
        self.state = turn @ self.state
        self.covariance = turn @ self.covariance @ turn.T + bend**2 * np.array([[0.25, 0.5], [0.5, 1.0]])
        self.emission += 1

    def correct(self, departure_s: float) -> None:
        """Takes in how much later than expected the ping came."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + self.jitter_s**2)
        self.state = self.state + gain * departure_s
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])


class IntervalTracker:
    """Puts arrivals in their trains as they come, with memory for the last few hundred only.

    interval_s : shortest and longest interval looked for; jitter_s : standard error of an arrival
    joins : whether a train found at a multiple of its pinger's interval, or of echoes beside another, gives way to one
        at that interval (`at_own_interval`): a new train, which tells anew the place of what is remembered
    Arrivals must come in order of time. Echoes make trains of their own: leave them out first (`echoes.direct`).
    """

    def __init__(
        self,
        interval_s: tuple[float, float] = (0.4, 20.0),
        jitter_s: float = 1e-3,
        memory: int = 300,
        joins: bool = True,
    ):
        if not 0 < interval_s[0] < interval_s[1]:
            raise ValueError(f"interval_s is {interval_s}; wanted the shortest and the longest, above 0")
        if not 0 < jitter_s < interval_s[0] / 16:
            raise ValueError(
                f"jitter_s is {jitter_s:g}; wanted above 0 and below a 16th of the shortest interval"
            )
        self._range, self._jitter_s, self._memory, self._joins = interval_s, jitter_s, memory, joins
        self._unreviewed = 0  # pings heard since the last review
        self._followers: list[_Follower] = []
        self._loose: list[tuple[float, int]] = []  # time and row of arrivals in no train
        self._told, self._found, self._last_s = 0, 0, -np.inf

    @property
    def interval_s(self) -> dict[int, float]:
        """The interval as last heard of every train that still goes on."""
        return {each.number: float(each.state[1]) for each in self._followers}

    def feed(self, arrival_s: Iterable[float]) -> tuple[Assigned, ...]:
        """What became known with these arrivals [s]. Raises ValueError for one that is out of order."""
        known: list[Assigned] = []
        for time_s in arrival_s:
            if not time_s >= self._last_s:
                raise ValueError(
                    f"an arrival at {time_s:g} s came after one at {self._last_s:g} s; sort them"
                )
            self._last_s = float(time_s)
            known += self._settle(self._last_s)
            self._loose.append((self._last_s, self._told))
            if not self._offer(self._last_s, self._told):
                known += self._acquire()
            self._told += 1
            if self._joins and self._unreviewed >= REVIEW:
                known += self._review()
            del self._loose[: -self._memory]
        return tuple(known)

    def finish(self) -> tuple[Assigned, ...]:
        """What the end of the stream makes known."""
        known = [each for follower in self._followers for each in self._commit(follower)]
        if self._joins:
            known += self._review()
            known += [each for follower in self._followers for each in self._commit(follower)]
        self._followers = []
        return tuple(known)

    def _offer(self, time_s: float, row: int) -> bool:
        """Notes an arrival with the train that expects one nearest to it."""
        waiting = [
            (abs(time_s - each.state[0]) / each.half_width_s, each.number, each) for each in self._followers
        ]
        nearest = min(waiting, default=(np.inf, 0, None))
        if nearest[0] > 1:
            return False
        nearest[2].candidates.append((time_s - nearest[2].state[0], row, time_s))
        return True

    def _settle(self, now_s: float) -> list[Assigned]:
        """Closes the pings that can no longer come."""
        known: list[Assigned] = []
        for follower in self._followers:
            while follower.state[0] + follower.half_width_s < now_s and follower.gap <= PATIENCE:
                known += self._commit(follower)
                follower.step()
        self._followers = [each for each in self._followers if each.gap <= PATIENCE]
        return known

    def _commit(self, follower: _Follower) -> list[Assigned]:
        """Takes the nearest candidate for the ping that is due."""
        if not follower.candidates:
            follower.gap += 1
            return []
        departure_s, row, time_s = min(follower.candidates, key=lambda each: abs(each[0]))
        follower.candidates = []
        follower.heard.append((follower.emission, row, time_s))
        self._unreviewed += 1
        follower.gap = 0
        follower.correct(departure_s)
        self._loose = [each for each in self._loose if each[1] != row]
        return [Assigned(row, follower.number, follower.emission)]

    def _acquire(self) -> list[Assigned]:
        """Starts a train if the newest arrival ends a chain that chance cannot have made."""
        time_s = np.array([each[0] for each in self._loose])
        members = np.empty(len(time_s), np.int64)
        surprise = best_chain(time_s, *self._range, self._jitter_s, BEND, LEAST_SHARE, members)
        if surprise < LEAST_SURPRISE:
            return []
        steps = int(members.max())
        inside = np.flatnonzero(members >= 0)
        rows = [self._loose[k][1] for k in inside]
        return self._start(time_s[inside], steps - members[inside], rows)

    def _start(self, time_s: np.ndarray, emission: np.ndarray, rows: list[int]) -> list[Assigned]:
        """Adds a follower that has already heard these arrivals; they are in no other train then."""
        slope = (time_s[-1] - time_s[0]) / (emission[-1] - emission[0])
        covariance = np.diag([self._jitter_s**2, (0.004 * slope) ** 2])
        heard = deque(zip(emission.tolist(), rows, time_s.tolist(), strict=True), self._memory)
        follower = _Follower(self._found, 0, np.array([time_s[0], slope]), covariance, self._jitter_s, heard)
        for each_s, number in zip(time_s, emission, strict=True):
            while follower.emission < number:
                follower.step()
            follower.correct(each_s - follower.state[0])
        follower.step()
        self._found += 1
        self._followers.append(follower)
        taken = set(rows)
        self._loose = [each for each in self._loose if each[1] not in taken]
        return [Assigned(row, follower.number, number) for number, row, _ in heard]

    def _review(self) -> list[Assigned]:
        """Brings what is remembered of the trains to their pingers' intervals."""
        self._unreviewed = 0
        of = {each.number: each for each in self._followers if len(each.heard) > 2}
        if not of:
            return []
        heard = [(row, time_s) for each in self._followers for _, row, time_s in each.heard]
        rows, time_s = np.array(sorted([*heard, *((row, time_s) for time_s, row in self._loose)])).T
        trains = {}
        for number, follower in of.items():
            emission, mine, _ = np.array(follower.heard).T
            trains[number] = Numbered((emission - emission[0]).astype(int), np.searchsorted(rows, mine))
        fresh = []
        for whole in at_own_interval(list(trains.values()), time_s, self._range[0], self._jitter_s):
            same = [number for number, train in trains.items() if np.array_equal(train.rows, whole.rows)]
            if same:
                del of[same[0]]
            else:
                fresh.append(whole)
        self._followers = [each for each in self._followers if each.number not in of]
        left = [(time, row) for each in of.values() for _, row, time in each.heard]
        known = [Assigned(row, -1, -1) for _, row in left]
        for whole in fresh:
            mine = rows[whole.rows].astype(int).tolist()
            self._loose = sorted({*self._loose, *(each for each in left if each[1] > mine[-1])})
            known += self._start(time_s[whole.rows], whole.emission, mine)
            known += self._catch_up(self._followers[-1])
        return known

    def _catch_up(self, follower: _Follower) -> list[Assigned]:
        """Lets a follower that was started late hear what came after its last ping."""
        known: list[Assigned] = []
        taken = {row for each in self._followers for _, row, _ in each.candidates}
        for time_s, row in [each for each in self._loose if each[0] > follower.heard[-1][2]]:
            while follower.state[0] + follower.half_width_s < time_s:
                known += self._commit(follower)
                follower.step()
            departure_s = time_s - follower.state[0]
            if row not in taken and abs(departure_s) <= follower.half_width_s:
                follower.candidates.append((departure_s, row, time_s))
        return known


def separate(
    arrival_s, interval_s: tuple[float, float] = (0.4, 20.0), jitter_s: float = 1e-3
) -> tuple[Train, ...]:
    """The trains among arrivals (N,) [s, any order], the longest first; none if chance could have made them all.

    interval_s : shortest and longest interval looked for; jitter_s : standard error of an arrival
    The answer is that of an IntervalTracker that heard the arrivals one by one, but that trains are brought to their
    pingers' intervals by all arrivals at once, not by those that it remembers.
    """
    arrival_s = np.asarray(arrival_s, float)
    order = np.argsort(arrival_s, kind="stable")
    order = order[np.isfinite(arrival_s[order])]
    tracker = IntervalTracker(interval_s, jitter_s, joins=False)
    known = [*tracker.feed(arrival_s[order]), *tracker.finish()]
    found = []
    for number in sorted({each.train for each in known}):
        mine = sorted((each.emission, each.row) for each in known if each.train == number)
        found.append(Numbered(*np.array(mine).T))
    found = at_own_interval(found, arrival_s[order], interval_s[0], jitter_s)
    loose = np.ones(len(order), bool)
    for each in found:
        loose[each.rows] = False
    trains = []
    for each in found:
        extra = int(loose[each.rows[0] : each.rows[-1]].sum())
        trains.append(_train(arrival_s[order[each.rows]], each.emission, order[each.rows], extra))
    return tuple(sorted(trains, key=lambda train: -len(train.rows)))


def _train(time_s: np.ndarray, emission: np.ndarray, rows: np.ndarray, extra: int) -> Train:
    """Interval and drift of assigned arrivals, by a parabola through them.

    Sigmas take the residuals' scatter and lag-one correlation: what the ship does is smooth.
    """
    half = emission[-1] / 2
    place = (emission - half) / half
    design = np.stack([np.ones_like(place), place, place**2], axis=-1)
    coefficients, *_ = np.linalg.lstsq(design, time_s - time_s[0], rcond=None)
    residual = time_s - time_s[0] - design @ coefficients
    scatter = residual @ residual
    lag = min(max(residual[1:] @ residual[:-1] / scatter, 0.0), 0.99) if scatter > 0 else 0.0
    variance = scatter / max(len(time_s) - 3, 1) * (1 + lag) / (1 - lag)
    sigma = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    interval_s = coefficients[1] / half
    to_ppm = 4e6 / half / interval_s  # the slope 2 c place / half grows by 4 c / half from end to end
    return Train(
        float(interval_s),
        float(sigma[1] / half),
        float(coefficients[2] * to_ppm),
        float(sigma[2] * to_ppm),
        emission,
        rows,
        int(emission[-1] - emission[0] + 1 - len(emission)),
        extra,
    )
