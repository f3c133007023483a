"""Which way, and how far, each reported position moves when its clock is corrected.

Read (1990), equations (2) to (6). A position was found by following the ray from the array for the
transit time that was believed; with the time corrected by g it lies g farther along that ray.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.rays import fit_rays


@dataclass(frozen=True, eq=False)
class Stretch:
    """Movement of positions by one second of timing offset, and the rays behind it."""

    velocity: np.ndarray  # (T, 3) a(t) [length/s]: downrange, crossrange, z; NaN where no ray reaches
    travel_time: np.ndarray  # (T,) [s]
    elevation: np.ndarray  # (T,) [rad] of the ray at the target, positive up
    reached: np.ndarray  # (T,) whether a direct ray joins array and target


def stretch(track: np.ndarray, array_position: np.ndarray, profile: SoundSpeedProfile) -> Stretch:
    """How each position of a track (T, 3) moves for a second of offset, eq. (5).

    array_position : (3,) in the same frame, z up
    The elevation is that of the ray at the target. (TIMECOR returned the one at the array, which is
    another angle wherever the speed changes between the two.)
    """
    offset = track - array_position
    horizontal = np.hypot(offset[:, 0], offset[:, 1])
    depth = -track[:, 2]
    rays = fit_rays(profile, horizontal, depth, -float(array_position[2]))
    azimuth = np.arctan2(offset[:, 1], offset[:, 0])
    level = np.cos(rays.elevation_target)
    direction = np.column_stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(rays.elevation_target)]
    )
    speed = profile.speed_at(depth)
    return Stretch(speed[:, None] * direction, rays.travel_time, rays.elevation_target, rays.reached)
