"""Surveys of a beacon with a known truth: a ship that sails legs and hears every ping.

Everything made here is labelled simulated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.paths import Paths
from trackerlib.beacon.pings import Pings
from trackerlib.frames import LocalFrame


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors that a simulated survey suffers, all of them independent from ping to ping."""

    gps_rms_m: float = 0.0  # of each of east and north
    time_rms_s: float = 0.0
    time_step_s: float = 0.0  # logged times are rounded to this
    false_returns: int = 0  # pings whose time is wrong by 0.05 to 1 s


def sail(legs: np.ndarray, start: np.ndarray, speed_mps: float, interval_s: float) -> np.ndarray:
    """Places (N, 2) [m] every `interval_s` along straight legs.

    legs : (L, 2) course [degrees from north] and length [m] of each leg
    """
    course = np.radians(legs[:, 0])
    turns = np.concatenate(
        [[start], start + np.cumsum(legs[:, 1:] * np.c_[np.sin(course), np.cos(course)], axis=0)]
    )
    along = np.concatenate([[0.0], np.cumsum(legs[:, 1])])
    sailed = np.arange(0.0, along[-1], speed_mps * interval_s)
    return np.stack([np.interp(sailed, along, turns[:, k]) for k in (0, 1)], axis=1)


def simulate_survey(
    track: np.ndarray,
    beacon: np.ndarray,
    paths: Paths,
    frame: LocalFrame,
    rng: np.random.Generator,
    errors: Errors | None = None,
    *,
    emission_offset_s: float = 0.0,
    hydrophone_depth_m: float = 0.0,
    start_utc: str = "2026-06-01T08:00:00",
    interval_s: float = 2.0,
) -> Pings:
    """Pings of a beacon (east, north, up) heard along a track (N, 2) [m], as a ship would log them."""
    errors = errors or Errors()
    count = len(track)
    lat, lon, _ = frame.to_geodetic(np.column_stack([track, np.zeros(count)]))
    ship = frame.to_local(lat, lon, -hydrophone_depth_m)
    time = paths.times(beacon[None], ship)[0][0] + emission_offset_s + rng.normal(0, errors.time_rms_s, count)
    false = rng.choice(count, errors.false_returns, replace=False)
    time[false] += rng.choice([-1, 1], len(false)) * rng.uniform(0.05, 1.0, len(false))
    if errors.time_step_s:
        time = np.rint(time / errors.time_step_s) * errors.time_step_s
    logged = ship + np.column_stack([rng.normal(0, errors.gps_rms_m, (count, 2)), np.zeros(count)])
    lat, lon, _ = frame.to_geodetic(logged)
    elapsed_ms = np.rint(np.arange(count) * interval_s * 1e3).astype("timedelta64[ms]")
    return Pings(
        number=np.arange(1, count + 1),
        lat_deg=lat,
        lon_deg=lon,
        up_m=np.full(count, -hydrophone_depth_m),
        travel_time_s=time,
        utc=np.datetime64(start_utc, "ms") + elapsed_ms,
        time_step_s=errors.time_step_s,
        source="simulated survey",
        simulated=True,
    )
