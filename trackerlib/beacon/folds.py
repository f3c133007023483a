"""Times that are known only up to whole intervals of the pinger, put back in order.

A chart recorder and the thesis's receiver give each arrival modulo the interval. The ship moves a small part of
an interval between neighbouring pings, so each ping is moved by whole intervals until it agrees with most of
those before it; after a fix, whatever lies more than half an interval from the fit is moved once more.
"""

from __future__ import annotations

import numpy as np

VOTERS = 9  # earlier pings that a ping is compared with


def unfold(time_s: np.ndarray, interval_s: float, ship: np.ndarray, speed_mps: float) -> np.ndarray:
    """Times (N,) [s] that follow one another without jumps of an interval.

    ship : (N, 3) [m]. Earlier pings from which the ship has moved half an interval of sound or more have no say.
    False returns are outvoted. All times may still be wrong by one common number of intervals.
    """
    unfolded = np.array(time_s, float)
    reach = speed_mps * interval_s / 2
    for k in range(1, len(unfolded)):
        earlier = slice(max(k - VOTERS, 0), k)
        near = np.linalg.norm(ship[earlier] - ship[k], axis=1) < reach
        voters = unfolded[earlier][near] if near.any() else unfolded[k - 1 : k]
        votes = np.rint((voters - unfolded[k]) / interval_s)
        values, counts = np.unique(votes, return_counts=True)
        unfolded[k] += interval_s * values[np.argmax(counts)]
    return unfolded


def refold(time_s: np.ndarray, residual_s: np.ndarray, interval_s: float) -> np.ndarray:
    """Times (N,) moved by whole intervals to where their residuals (N,) are least; NaN residuals move nothing."""
    return time_s - interval_s * np.nan_to_num(np.rint(residual_s / interval_s))
