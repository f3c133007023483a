"""Which arrivals came straight from the beacon: the first of each cluster, not the loudest."""

from __future__ import annotations

import numpy as np

from trackerlib.receiver.arrivals import Arrivals

COUNTS_TO_DB = 72 / 255  # of a level on paper, where a detector tells no signal-to-noise ratio


def direct(arrivals: Arrivals, spread_s: float = 0.1, within_db: float = 15.0) -> np.ndarray:
    """Whether each arrival (N,) came the direct way; the others are echoes by way of surface or bottom.

    An arrival is an echo if another came at most `spread_s` before it that was at most `within_db` weaker: echoes
    may be louder than the direct arrival, but never come first. What is far weaker than the next is a false alarm
    or a precursor, and does not make an echo of it.
    """
    strength_db = np.where(np.isnan(arrivals.snr_db), arrivals.level * COUNTS_TO_DB, arrivals.snr_db)
    order = np.argsort(arrivals.arrival_s, kind="stable")
    time_s, strength_db = arrivals.arrival_s[order], strength_db[order]
    first = np.searchsorted(time_s, time_s - spread_s)
    straight = np.empty(len(order), bool)
    for k, place in enumerate(order):
        straight[place] = not np.any(strength_db[first[k] : k] >= strength_db[k] - within_db)
    return straight
