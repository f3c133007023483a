"""One pinger followed through the arrivals as they come: which of them are its pings, and of which emission.

    follower = PingFollower(interval_s=2.0, threshold=120)
    for ping in follower.feed(arrivals): ping.emission, ping.arrival_s

Arrivals folded at the interval need the number of the emission before they are ranges; what is no train of evenly
spaced arrivals is never a ping.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.echoes import direct
from trackerlib.receiver.front_end import DB_PER_COUNT
from trackerlib.receiver.intervals import IntervalTracker

WITHIN = 0.01  # of the interval told: a ship at 5 m/s changes it by a third of that
JITTER_S = 1e-3
FAINTER_DB = 9.0  # than the strongest of its period, and an arrival is an echo by way of the bottom, or noise
LOST = 8  # intervals without a ping, after which another train may be the same pinger on another course


@dataclass(frozen=True)
class FollowedPing:
    """An arrival put in its place."""

    emission: int  # pings since the first one followed
    arrival_s: float

    def travel_s(self, interval_s: float) -> float:
        """Travel time plus a constant, the same for all pings."""
        return self.arrival_s - self.emission * interval_s


class PingFollower:
    """Follows the train that was found first, and after it has ended the next one.

    interval_s : about which it is looked for; threshold : level (0 to 255) below which an arrival does not count
    """

    def __init__(self, interval_s: float, threshold: float = 0.0):
        self.interval_s, self.threshold = interval_s, threshold
        jitter_s = min(JITTER_S, interval_s / 20)
        within = (interval_s * (1 - WITHIN), interval_s * (1 + WITHIN))
        self._tracker = IntervalTracker(within, jitter_s, joins=False)  # no multiple of it is looked for
        self._times: list[float] = []  # told to the tracker, by row
        self._train, self._base = -1, 0  # followed, and emission number of its first ping
        self._last: FollowedPing | None = None

    def feed(self, arrivals: Arrivals) -> list[FollowedPing]:
        """The pings that became known with these arrivals, in order; those of a period belong together."""
        times = np.sort(arrivals.arrival_s[ping_rows(arrivals, self.threshold)])
        if self._times:
            times = times[times >= self._times[-1]]
        self._times += times.tolist()
        found = [self._placed(each) for each in self._tracker.feed(times)]
        return [ping for ping in found if ping is not None]

    def _placed(self, assigned) -> FollowedPing | None:
        time_s = self._times[assigned.row]
        if assigned.train != self._train:
            if assigned.train < self._train or not self._lost():
                return None
            self._train, self._base = assigned.train, 0
            if self._last is not None:  # the new train goes on with the old one's numbers
                gap = (time_s - self._last.arrival_s) / self.interval_s
                self._base = self._last.emission + max(round(gap), 1) - assigned.emission
        ping = FollowedPing(self._base + assigned.emission, time_s)
        if self._last is not None and ping.emission <= self._last.emission:
            return None
        self._last = ping
        return ping

    def _lost(self) -> bool:
        """Whether the train followed has ended, or has been silent for long."""
        if self._last is None or self._train not in self._tracker.interval_s:
            return True
        return self._times[-1] - self._last.arrival_s > LOST * self.interval_s


def ping_rows(arrivals: Arrivals, threshold: float = 0.0) -> np.ndarray:
    """Rows of the arrivals that may be pings: loud enough, not far below their period's strongest, and no echoes."""
    if not len(arrivals):
        return np.empty(0, int)
    periods, row = np.unique(arrivals.period, return_inverse=True)
    strongest = np.zeros(len(periods))
    np.maximum.at(strongest, row, arrivals.level)
    loud = (arrivals.level >= threshold) & (arrivals.level > strongest[row] - FAINTER_DB / DB_PER_COUNT)
    rows = np.flatnonzero(loud)
    kept = Arrivals(*(getattr(arrivals, each.name)[rows] for each in fields(Arrivals)))
    return rows[direct(kept)]
