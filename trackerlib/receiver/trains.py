"""What every arrival of a stream is: direct or not, of which pinger's train, and of which emission."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.following import ping_rows
from trackerlib.receiver.intervals import Train, separate
from trackerlib.receiver.late_echoes import LateEcho, late_echoes

SHORTEST_S, LONGEST_S = 0.4, 20.0  # intervals of pingers looked for, and what the one told asks beyond
JITTER_S = 1e-3


@dataclass(frozen=True, eq=False)
class SortedArrivals:
    """The trains of a stream, the longest first, and the place of every arrival (N,) among them."""

    trains: tuple[Train, ...]  # their rows are of the direct arrivals
    echoes: tuple[LateEcho | None, ...]  # of which train each one is an echo
    direct: (
        np.ndarray
    )  # (N,) whether it came straight from a pinger, as far as is known; not an echo, nor too faint
    train: np.ndarray  # (N,) integers from 1, 0 for none
    emission: np.ndarray  # (N,) pings since its train's first, integers; -1 for none


def sort_arrivals(arrivals: Arrivals, interval_s: float) -> SortedArrivals:
    """Arrivals put in trains; interval_s : of the pinger that was listened for."""
    shortest_s = min(SHORTEST_S, interval_s / 2)
    jitter_s = min(JITTER_S, shortest_s / 20)
    rows = ping_rows(arrivals)
    times = arrivals.arrival_s[rows]
    trains = separate(times, (shortest_s, max(LONGEST_S, 2 * interval_s)), jitter_s)
    direct = np.zeros(len(arrivals), bool)
    direct[rows] = True
    number, emission = np.zeros(len(arrivals), int), np.full(len(arrivals), -1)
    for k, train in enumerate(trains, 1):
        number[rows[train.rows]] = k
        emission[rows[train.rows]] = train.emission
    return SortedArrivals(trains, late_echoes(trains, times, jitter_s), direct, number, emission)
