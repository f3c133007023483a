"""The path that a ray takes through a sound-speed profile, for pictures."""

from __future__ import annotations

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile


def ray_path(
    profile: SoundSpeedProfile, ray_parameter: float, depth_from: float, depth_to: float
) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal range (N,) from its beginning and depth (N,) of a ray that does not turn between two depths.

    ray_parameter : [s per length], as `fit_rays` gives it
    Exact at every layer boundary: within a layer of one gradient the range is p (v1 + v2) dz / (s1 + s2), s being
    the sine of the elevation.
    """
    top, bottom = sorted((float(depth_from), float(depth_to)))
    inner = profile.depth[(profile.depth > top) & (profile.depth < bottom)]
    depth = np.concatenate([[top], inner, [bottom]])
    speed = profile.speed_at(depth)
    sine = np.sqrt(np.maximum(1.0 - (ray_parameter * speed) ** 2, 0.0))
    step = ray_parameter * (speed[1:] + speed[:-1]) * np.diff(depth) / np.maximum(sine[1:] + sine[:-1], 1e-12)
    along = np.concatenate([[0.0], np.cumsum(step)])
    return (along, depth) if depth_from <= depth_to else (along[-1] - along[::-1], depth[::-1])
