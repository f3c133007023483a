"""How long sound takes from each place of the ship to a beacon, and how that changes as the beacon moves.

Positions are east, north, up [m] in a `LocalFrame`; depths are below the curved sea surface.
Both kinds answer `times(beacon, ship, depth)` with travel times and their gradients for many
candidate positions at once, which is what a search from many starts needs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.rays import fit_rays

EARTH_RADIUS_M = 6_371_000.0  # good to 3 cm in the drop of the sea surface at 10 km


def depth_below_surface(position: np.ndarray) -> np.ndarray:
    """Depth [m] below the curved sea surface of local positions (..., 3), for use inside a fit."""
    return -position[..., 2] - (position[..., 0] ** 2 + position[..., 1] ** 2) / (2 * EARTH_RADIUS_M)


class Paths(Protocol):
    """Travel times from ship to beacon for one picture of the water."""

    def times(self, beacon: np.ndarray, ship: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Travel times (S, N) [s] to beacons (S, 3) from ships (N, 3), and gradients (S, N, 3) [s/m].

        Beacons that move are (S, N, 3), one place a ping. The gradient is by the beacon's position. NaN where
        no direct path exists.
        """

    def mean_speed(self, beacon_depth: float) -> float:
        """Mean speed of sound [m/s] on the way down to that depth."""


@dataclass(frozen=True)
class StraightPaths:
    """Straight paths at one speed of sound."""

    speed_mps: float

    def times(self, beacon, ship):
        offset = _each(beacon) - ship
        slant_range = np.sqrt(np.einsum("snk,snk->sn", offset, offset))
        gradient = offset / (np.maximum(slant_range, 1e-9) * self.speed_mps)[..., None]
        return slant_range / self.speed_mps, gradient

    def mean_speed(self, beacon_depth):
        return self.speed_mps


@dataclass(frozen=True, eq=False)
class RayPaths:
    """Rays bent by a sound-speed profile (depth in metres, positive down)."""

    profile: SoundSpeedProfile

    def times(self, beacon, ship):
        beacon = _each(beacon)
        offset = beacon - ship
        ship_depth = np.maximum(depth_below_surface(ship), 0.0)
        beacon_depth = np.maximum(depth_below_surface(beacon), 0.0)
        fall = beacon_depth - ship_depth
        # The chord keeps the slant range exact on the curved earth; the rest of it is horizontal.
        square = np.einsum("snk,snk->sn", offset, offset) - fall**2
        horizontal = np.sqrt(np.maximum(square, 0.0))
        rays = fit_rays(self.profile, horizontal, np.broadcast_to(beacon_depth, fall.shape), ship_depth)
        # Depth of the beacon by its position: down, and outward because the surface curves away.
        by_depth = -np.concatenate([beacon[..., :2] / EARTH_RADIUS_M, np.ones_like(beacon[..., :1])], axis=-1)
        along = (offset - fall[..., None] * by_depth) / np.maximum(horizontal, 1e-6)[..., None]
        gradient = rays.ray_parameter[..., None] * along + rays.time_by_target_depth[..., None] * by_depth
        return rays.travel_time, gradient

    def mean_speed(self, beacon_depth):
        return float(self.profile.harmonic_mean(0.0, beacon_depth))


def _each(beacon: np.ndarray) -> np.ndarray:
    """Beacons with an axis for the pings: (S, 1, 3) if still, (S, N, 3) if moving."""
    return beacon[:, None, :] if beacon.ndim == 2 else beacon


def paths_through(
    sound_speed_mps: float, profile: SoundSpeedProfile | None, max_depth_m: float
) -> StraightPaths | RayPaths:
    """Paths at one speed, or through a profile if there is one, extended to cover the search region."""
    if profile is None:
        return StraightPaths(sound_speed_mps)
    return RayPaths(profile.extended(0.0, max_depth_m))
