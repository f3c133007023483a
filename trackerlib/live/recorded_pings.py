"""Pings of a recording: the arrivals of one pinger, numbered by emission, where the ship was when she heard them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes, PositionLimits, ShipPositions, ship_at_receptions
from trackerlib.beacon.pings import Pings
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


def placed_pings(
    trace: Trace,
    interval_s: float,
    fixes: NavigationFixes,
    *,
    limits: PositionLimits | None = None,
    began_s: float | None = None,
    hydrophone_depth_m: float = 0.0,
    source: str = "",
    simulated: bool = False,
) -> tuple[Pings, ShipPositions]:
    """Pings of the arrivals for which there is a position, and where the ship was at all of them.

    fixes : by the clock of the stream; began_s : that clock's zero [s since 1970], None if it is not known
    """
    ship = ship_at_receptions(fixes, trace.arrival_s, limits or PositionLimits())
    keep = ship.accepted
    count, arrival_s = int(keep.sum()), trace.arrival_s[keep]
    unknown = np.full(count, np.datetime64("NaT", "ms"))
    pings = Pings(
        trace.emission[keep] + 1,
        ship.lat_deg[keep],
        ship.lon_deg[keep],
        np.full(count, -hydrophone_depth_m),
        trace.travel_s[keep],
        unknown if began_s is None else utc_at(began_s, arrival_s),
        clock_s=trace.emission[keep] * interval_s,
        source=source,
        simulated=simulated,
    )
    return pings, ship


def utc_at(began_s: float, time_s) -> np.ndarray:
    """UTC (N,), to the millisecond, of times of a stream that began at `began_s` [s since 1970]."""
    return np.rint(1e3 * (began_s + np.asarray(time_s))).astype("int64").astype("datetime64[ms]")
