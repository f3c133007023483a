"""Simulated arrivals of a free-running pinger, heard by a ship that sails squares."""

from __future__ import annotations

import numpy as np
from surveys import FRAME

from trackerlib.beacon.pings import Pings

INTERVAL_S = 2.0  # as told; the pinger's own is off by some parts per million
SIDE_M = 1500.0
SPEED_MPS = 2.5
CORNERS = np.array([[-750.0, -750.0], [750.0, -750.0], [750.0, 750.0], [-750.0, 750.0]])
WAYS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
TIME_RMS_S = 3e-4


def ship_at(seconds):
    """Places (N, 3) on the surface of a curved sea."""
    along = (SPEED_MPS * seconds) % (4 * SIDE_M)
    side = (along // SIDE_M).astype(int)
    level = CORNERS[side] + WAYS[side] * (along % SIDE_M)[:, None]
    lat, lon, _ = FRAME.to_geodetic(np.column_stack([level, np.zeros(len(level))]))
    return FRAME.to_local(lat, lon, 0.0)


def stream(
    beacon, seed, *, velocity=(0.0, 0.0, 0.0), emissions=2400, ppm=0.0, ppm_per_hour=0.0, gps_rms_m=1.0,
    heard=0.7, extra=0.03,
):  # fmt: skip
    """Arrivals with some missed and some that are no ping; the beacon is at `beacon` when the first one leaves."""
    rng = np.random.default_rng(seed)
    k = np.arange(emissions)
    elapsed = INTERVAL_S * (k * (1 + ppm * 1e-6) + k**2 / 2 * ppm_per_hour * 1e-6 * INTERVAL_S / 3600)
    is_heard = rng.random(emissions) < heard
    is_heard[0] = True
    emitted = 7.3 + elapsed[is_heard]
    place = np.array(beacon) + elapsed[is_heard, None] * np.array(velocity)
    arrival = emitted.copy()
    for _ in range(6):
        arrival = emitted + np.linalg.norm(place - ship_at(arrival), axis=1) / 1500.0
    false = rng.uniform(arrival[0] + 1, arrival[-1], int(extra * len(arrival)))
    places = ship_at(np.concatenate([arrival, false]))
    arrival = np.concatenate([arrival + rng.normal(0, TIME_RMS_S, len(arrival)), false])
    order = np.argsort(arrival)
    places, arrival = places[order], arrival[order]
    places[:, :2] += rng.normal(0, gps_rms_m, (len(places), 2))
    lat, lon, _ = FRAME.to_geodetic(places)
    return Pings(
        np.arange(1, len(arrival) + 1), lat, lon, np.zeros(len(arrival)), arrival,
        np.full(len(arrival), np.datetime64("NaT", "ms")), clock_s=arrival, at_reception=True, simulated=True,
    )  # fmt: skip
