"""What a hunt has heard, by one clock: arrivals of the receiver and positions of the GPS.

    arrivals, fixes = hunt_of(read_session(Path("hunt.session")))
    ship = ship_at_receptions(fixes, arrivals.arrival_s[arrivals.rank == 1])

The receiver's clock and the GPS's are tied by the host's, by which both were heard. A tie is no better than how
promptly they were asked, but it only moves the ship along its track; ranges rest on the receiver's clock alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.live.navigation_stream import Fix, fixes_of
from trackerlib.live.session_file import RecordedSession
from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.periods import Period, arrivals_of, receiver_start


def one_clock(
    periods: Sequence[Period], fixes: Sequence[tuple[float, Fix]], sample_interval_s: float
) -> tuple[Arrivals, NavigationFixes]:
    """Arrivals and positions, both in seconds of the receiver's clock since sampling began.

    fixes : when each was heard by the host's clock [s], and the position
    Neither can be heard before it is there, so the earliest of each tells best how late the host hears it.
    """
    began_s = receiver_start(periods, sample_interval_s) if periods else 0.0
    late_s = min((heard - fix.time_s for heard, fix in fixes), default=0.0)
    columns = fixes_of(fix for _, fix in fixes)
    by_receiver = columns.time_s + late_s - began_s
    return arrivals_of(periods, sample_interval_s), NavigationFixes(
        by_receiver, columns.lat_deg, columns.lon_deg, columns.hdop, columns.heading_rad
    )


def hunt_of(session: RecordedSession, run: int | None = None) -> tuple[Arrivals, NavigationFixes]:
    """Arrivals and positions of one run of a recorded session, the longest if none is named.

    A run is the time from one start of sampling to the next; between runs whole periods and their parts are lost.
    Raises ValueError for a run that is not there.
    """
    if run is None and session.runs:
        run = max(session.runs, key=lambda number: len(session.runs[number]))
    if run is not None and run not in session.runs:
        raise ValueError(f"found runs {sorted(session.runs)}; wanted run {run}")
    periods = session.runs.get(run, ())
    return one_clock(periods, session.fixes, session.settings.get("sample_interval_s", 1e-3))


def strongest(arrivals: Arrivals, least_level: float = 0.0) -> np.ndarray:
    """Rows of the strongest arrival of each period, of those at least as loud as a level (0 to 255)."""
    return np.flatnonzero((arrivals.rank == 1) & (arrivals.level >= least_level))
