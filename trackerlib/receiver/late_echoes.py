"""Trains that are echoes: a path long enough makes a train of its own, at the same interval and a constant lag.

`echoes.direct` takes out the echoes of the first tenth of a second; these come later. A second pinger of the same
nominal interval has a clock of its own: at 20 ppm it slides 2 ms in 100 s, which no constant lag does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackerlib.receiver.intervals import Train

LEAST_SHARED = 10  # pings heard both ways, to tell
LEAST_SHARE = 0.5  # of the later train's pings
CONSTANT = 2.0  # times the jitter: greatest change of the lag from end to end


@dataclass(frozen=True)
class LateEcho:
    """A train that another one explains."""

    of: int  # which train
    lag_s: float
    sigma_lag_s: float


def late_echoes(
    trains: Sequence[Train], arrival_s: np.ndarray, jitter_s: float = 1e-3, latest_s: float = 1.0
) -> tuple[LateEcho | None, ...]:
    """Of each train, whose echo it is, or None.

    arrival_s : (N,) that the trains' rows are of; jitter_s : standard error of an arrival
    latest_s : greatest lag; it is below half the interval too, for beyond it which came first cannot be told
    """
    times = [np.sort(np.asarray(arrival_s)[train.rows]) for train in trains]
    found: list[LateEcho | None] = [None] * len(trains)
    for later, train in enumerate(trains):
        for earlier in range(len(trains)):
            if earlier == later or found[earlier] is not None:
                continue
            lag_s = _constant_lag(times[earlier], times[later], min(latest_s, train.interval_s / 2), jitter_s)
            if lag_s is not None and (found[later] is None or lag_s[0] < found[later].lag_s):
                found[later] = LateEcho(earlier, *lag_s)
    return tuple(found)


def _constant_lag(
    earlier_s: np.ndarray, later_s: np.ndarray, latest_s: float, jitter_s: float
) -> tuple[float, float] | None:
    """Mean lag of the later arrivals behind the earlier ones, and its sigma; None if it is not the same for all."""
    place = np.searchsorted(earlier_s, later_s) - 1
    lag = later_s - earlier_s[np.maximum(place, 0)]
    shared = (place >= 0) & (lag < latest_s)
    count = int(shared.sum())
    if count < max(LEAST_SHARED, LEAST_SHARE * len(later_s)):
        return None
    lag, when = lag[shared], later_s[shared]
    slope, middle = np.polyfit(when - when.mean(), lag, 1)
    scatter = float(np.median(np.abs(lag - middle)))
    if abs(slope) * np.ptp(when) > CONSTANT * jitter_s or scatter > CONSTANT * jitter_s:
        return None
    return float(middle), float(lag.std() / np.sqrt(count))
