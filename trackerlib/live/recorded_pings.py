"""Pings of a recording: the arrivals of one pinger, numbered by emission, where the ship was when she heard them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes, Receptions
from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.following import PingFollower


@dataclass(frozen=True, eq=False)
class Trace:
    """Arrivals of one pinger, on the clock of their stream."""

    emission: np.ndarray  # (N,) integers: pings since any of them
    arrival_s: np.ndarray  # (N,)
    travel_s: np.ndarray  # (N,) travel time plus a constant, the same for all


def followed_trace(arrivals: Arrivals, interval_s: float, threshold: float = 0.0) -> Trace:
    """The pinger of about that interval, followed through all arrivals; empty where there is none."""
    followed = PingFollower(interval_s, threshold).feed(arrivals)
    emission = np.array([ping.emission for ping in followed], int)
    arrival_s = np.array([ping.arrival_s for ping in followed], float)
    return Trace(emission, arrival_s, arrival_s - emission * interval_s)


def receptions_of(
    trace: Trace,
    interval_s: float,
    fixes: NavigationFixes,
    *,
    began_s: float | None = None,
    source: str = "",
    simulated: bool = False,
) -> Receptions:
    """The arrivals of a trace with the ship's positions beside them.

    fixes : by the clock of the stream; began_s : that clock's zero [s since 1970], None if it is not known
    """
    return Receptions(
        trace.emission + 1,
        trace.arrival_s,
        fixes,
        trace.travel_s,
        trace.emission * interval_s,
        None if began_s is None else utc_at(began_s, trace.arrival_s),
        source,
        simulated,
    )


def utc_at(began_s: float, time_s) -> np.ndarray:
    """UTC (N,), to the millisecond, of times of a stream that began at `began_s` [s since 1970]."""
    return np.rint(1e3 * (began_s + np.asarray(time_s))).astype("int64").astype("datetime64[ms]")
