"""Sound of a hunt with known truth: a ship that passes a beacon on two legs, as her hydrophone hears it.

    hunt = simulate_hunt_sound(seed=1)
    hunt.sound.read(48_000), hunt.fixes, hunt.truth

Everything made here is simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.frames import LocalFrame
from trackerlib.receiver.report_receiver import FULL_SCALE_V
from trackerlib.simulation.beacon_levels import ORIGIN_DEG
from trackerlib.simulation.sound import (
    Listener,
    Pinger,
    Pulses,
    Sea,
    SimulatedSound,
    joined_pulses,
    noise_density_v,
    pulses_heard,
)

LEG_M = 2500.0
ABEAM_M = (500.0, 400.0)  # horizontal distance of the beacon at closest approach, of each leg
BEACON_M = (0.0, 0.0, -800.0)
HYDROPHONE_M = 30.0  # below the surface: deep enough for the surface's echo to stand apart
OTHER_M = (900.0, -300.0, -790.0)  # of a second pinger, which interferes
BEFORE = 3  # emissions before a leg begins that may be heard on it


@dataclass(frozen=True, eq=False)
class HuntSound:
    """Sound, ship and truth of one simulated hunt."""

    pulses: Pulses  # that are in the sound, every path of them
    density_v: float
    rate_hz: int
    seed: int
    seconds: float
    fixes: NavigationFixes  # of the ship, by the clock of the sound
    truth: dict  # where the beacon is: lat_deg, lon_deg, depth_m
    pinger: Pinger
    sound_speed_mps: float
    gps_rms_m: float
    hydrophone_depth_m: float
    name: str

    def open(self) -> SimulatedSound:
        """The sound from its beginning; always the same."""
        return SimulatedSound(self.pulses, self.density_v, self.rate_hz, FULL_SCALE_V, self.seed)


def simulate_hunt_sound(
    seed: int = 0,
    *,
    sea_state: float | str = 3.0,
    speed_mps: float = 5.0,
    rate_hz: int = 48_000,
    gps_rms_m: float = 3.0,
    missing: float = 0.05,
    pinger: Pinger | None = None,
    others: Sequence[Pinger] = (),
) -> HuntSound:
    """A hunt of two legs at right speed, the second a turn from the end of the first.

    sea_state : of acoustics.ambient_noise.SCALE, or "limit"; ValueError outside of it
    missing : share of the pings that are not sent; pinger : what else it is like, its place aside
    others : pingers that interfere, where they say they are; their pulses stand behind those of the pinger
    """
    rng = np.random.default_rng(seed)
    pinger = replace(
        pinger or Pinger(first_emission_s=float(rng.uniform(0, 2))), position_m=BEACON_M, missing=missing
    )
    sea = Sea(sea_state=sea_state)
    starts, headings, leg_s = *_legs(), LEG_M / speed_mps
    parts = []
    for each in (pinger, *others):
        for k, (start, heading) in enumerate(zip(starts, headings, strict=True)):
            listener = Listener((*start, -HYDROPHONE_M), (*(speed_mps * heading), 0.0))
            parts.append(_leg_heard(each, listener, sea, k * leg_s, leg_s, rng))
    frame = LocalFrame(*ORIGIN_DEG)
    return HuntSound(
        joined_pulses(*parts),
        noise_density_v(sea, speed_mps),
        rate_hz,
        seed,
        2 * leg_s,
        _gps(frame, starts, headings, speed_mps, leg_s, gps_rms_m, rng),
        {
            "simulated": True,
            "lat_deg": ORIGIN_DEG[0],
            "lon_deg": ORIGIN_DEG[1],
            "depth_m": -BEACON_M[2],
        },
        pinger,
        sea.sound_speed_mps,
        gps_rms_m,
        HYDROPHONE_M,
        f"simulated hunt {seed}, sea state {sea_state if isinstance(sea_state, str) else format(sea_state, 'g')}"
        + "".join(f", and a pinger every {other.interval_s:g} s" for other in others),
    )


def second_pinger(interval_s: float = 2.5) -> Pinger:
    """One that interferes: the same carrier and pulse as the usual pinger's, another place and interval."""
    return Pinger(position_m=OTHER_M, interval_s=interval_s, first_emission_s=0.37 * interval_s)


def _leg_heard(
    pinger: Pinger, listener: Listener, sea: Sea, begins_s: float, leg_s: float, rng: np.random.Generator
) -> Pulses:
    """What is heard of a pinger on a leg that begins at a time of the hunt, by the hunt's clock."""
    first = (pinger.first_emission_s - begins_s) % pinger.interval_s - BEFORE * pinger.interval_s
    return _later(pulses_heard(replace(pinger, first_emission_s=first), listener, sea, leg_s, rng), begins_s)


def _legs() -> tuple[np.ndarray, np.ndarray]:
    """Where each leg begins (2, 2) and its unit vector (2, 2): north, then back past the beacon."""
    start = np.array([-ABEAM_M[0], -LEG_M / 2])
    turn = start + np.array([0.0, LEG_M])
    towards, off = np.arctan2(*-turn), np.arcsin(ABEAM_M[1] / np.linalg.norm(turn))
    bearing = towards - off
    return np.array([start, turn]), np.array([[0.0, 1.0], [np.sin(bearing), np.cos(bearing)]])


def _later(pulses: Pulses, seconds: float) -> Pulses:
    columns = {f.name: getattr(pulses, f.name) for f in fields(Pulses)}
    return Pulses(**(columns | {"arrival_s": pulses.arrival_s + seconds}))


def _gps(frame, starts, headings, speed_mps, leg_s, gps_rms_m, rng) -> NavigationFixes:
    time_s = np.arange(0.0, 2 * leg_s + 1.0)
    leg = np.minimum(time_s // leg_s, 1).astype(int)
    place = starts[leg] + speed_mps * (time_s - leg * leg_s)[:, None] * headings[leg]
    place = np.column_stack([place + rng.normal(0, gps_rms_m, place.shape), np.zeros(len(time_s))])
    lat, lon, _ = frame.to_geodetic(place)
    return NavigationFixes(time_s, lat, lon, np.ones(len(time_s)))
