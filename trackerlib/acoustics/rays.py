"""Rays through isogradient layers: the direct ray that joins an array to a target.

With p the ray parameter, s = sqrt(1 - p^2 v^2) the sine of the elevation where the speed is v, and a
layer of thickness dz between speeds v1 and v2 (Read 1990, TGEN; here without dividing by the gradient):

    horizontal range  p (v1 + v2) dz / (s1 + s2)
    travel time       dz y asinh(x)/x,  y = (v1 + v2) / ((s1 + s2) v1 v2),  x = (v2 - v1) y

The unknown is q = p / sqrt(1 - p^2 vmax^2), the tangent at the fastest level. Range is an increasing,
concave function of q, so Newton from the left never overshoots and always ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.compiled import compiled, warms

STEPS = 100  # ten times what the hardest ray found needs


class NoDirectRay(ValueError):
    """Refraction leaves targets in shadow; the message lists which."""


@dataclass(frozen=True, eq=False)
class EigenRays:
    """Direct rays from arrays to targets; NaN where there is none."""

    reached: np.ndarray  # (...) whether a ray without turning point joins the two
    travel_time: np.ndarray  # [s]
    elevation_target: np.ndarray  # [rad] of the ray going from array to target, positive up, at the target
    elevation_array: np.ndarray  # [rad] the same at the array
    ray_parameter: np.ndarray  # [s per length] travel time by horizontal range
    time_by_target_depth: np.ndarray  # [s per length]
    time_by_array_depth: np.ndarray  # [s per length]

    def require_all(self) -> EigenRays:
        """These rays. Raises NoDirectRay, listing the targets in shadow, if any is missing."""
        missing = np.flatnonzero(~self.reached.ravel())
        if len(missing):
            listed = ", ".join(map(str, missing[:10])) + (", ..." if len(missing) > 10 else "")
            raise NoDirectRay(
                f"no direct ray reaches {len(missing)} of {self.reached.size} targets (numbers {listed})"
            )
        return self


def fit_rays(profile: SoundSpeedProfile, horizontal_range, target_depth, array_depth) -> EigenRays:
    """Direct rays that join targets to arrays: elevations at both ends, travel time, derivatives.

    horizontal_range, target_depth, array_depth : broadcast against each other, the profile's length
        unit, depths positive down; the profile is carried on beyond its ends where they ask for it
    Where refraction bends every direct ray away (shadow), `reached` is False and the rest NaN.
    """
    shape = np.broadcast_shapes(np.shape(horizontal_range), np.shape(target_depth), np.shape(array_depth))
    given = [
        np.ascontiguousarray(np.broadcast_to(np.asarray(a, float), shape)).ravel()
        for a in (horizontal_range, target_depth, array_depth)
    ]
    depths = np.concatenate(given[1:])
    depths = depths[np.isfinite(depths)]
    if len(depths):
        profile = profile.extended(min(depths.min(), profile.depth[0]), max(depths.max(), profile.depth[-1]))
    out = np.full((6, given[0].size), np.nan)
    _fit_all(profile.depth, profile.speed, given[0], given[1], given[2], out)
    return EigenRays(np.isfinite(out[0]).reshape(shape), *(row.reshape(shape) for row in out))


@compiled
def _speed(depth, speed, z, k):
    """Speed at z in the layer between nodes k and k + 1."""
    return speed[k] + (speed[k + 1] - speed[k]) * (z - depth[k]) / (depth[k + 1] - depth[k])


@compiled
def _cut_layers(depth, speed, top, bottom, v, dz):
    """Fills speeds v (M + 1) at and thicknesses dz (M) between top, the nodes inside, and bottom; gives M."""
    k = min(max(np.searchsorted(depth, top, side="right") - 1, 0), len(depth) - 2)
    v[0] = _speed(depth, speed, top, k)
    count, upper = 0, top
    while k < len(depth) - 2 and depth[k + 1] < bottom:
        dz[count], v[count + 1] = depth[k + 1] - upper, speed[k + 1]
        upper = depth[k + 1]
        count, k = count + 1, k + 1
    dz[count], v[count + 1] = bottom - upper, _speed(depth, speed, bottom, k)
    return count + 1


@compiled
def _range_and_slope(q, v, dz, count, fastest):
    """Horizontal range of the ray q, and its derivative by q."""
    total, slope = 0.0, 0.0
    a1 = (fastest - v[0]) * (fastest + v[0])
    big1 = math.sqrt(1.0 + q * q * a1)
    for k in range(count):
        a2 = (fastest - v[k + 1]) * (fastest + v[k + 1])
        big2 = math.sqrt(1.0 + q * q * a2)
        width = (v[k] + v[k + 1]) * dz[k] / (big1 + big2)
        total += q * width
        slope += width * (1.0 - q * q * (a1 / big1 + a2 / big2) / (big1 + big2))
        a1, big1 = a2, big2
    return total, slope


@compiled
def _greatest_range(v, dz, count, fastest):
    """Horizontal range that direct rays approach as they become level at the fastest depth."""
    total = 0.0
    for k in range(count):
        s1 = math.sqrt((fastest - v[k]) * (fastest + v[k]))
        s2 = math.sqrt((fastest - v[k + 1]) * (fastest + v[k + 1]))
        if s1 + s2 == 0.0:
            return math.inf
        total += (v[k] + v[k + 1]) * dz[k] / (s1 + s2)
    return total


@compiled
def _solve(wanted, v, dz, count, fastest):
    """The ray q whose horizontal range is the one wanted, which some direct ray reaches."""
    straight = 0.0
    for k in range(count):
        straight += 0.5 * (v[k] + v[k + 1]) * dz[k]
    q = wanted / straight  # the range of this q is at most `wanted`
    for _ in range(STEPS):
        found, slope = _range_and_slope(q, v, dz, count, fastest)
        step = (wanted - found) / slope
        q += step
        if step <= 1e-15 * q:
            break
    return q


@compiled
def _time(q, v, dz, count, fastest):
    """Travel time of the ray q."""
    scale = math.sqrt(1.0 + q * q * fastest * fastest)
    total = 0.0
    big1 = math.sqrt(1.0 + q * q * (fastest - v[0]) * (fastest + v[0]))
    for k in range(count):
        big2 = math.sqrt(1.0 + q * q * (fastest - v[k + 1]) * (fastest + v[k + 1]))
        y = (v[k] + v[k + 1]) * scale / ((big1 + big2) * v[k] * v[k + 1])
        x = (v[k + 1] - v[k]) * y
        x2 = x * x
        ratio = 1.0 - x2 / 6.0 + 0.075 * x2 * x2 if abs(x) < 1e-3 else math.asinh(x) / x
        total += dz[k] * y * ratio
        big1 = big2
    return total


@compiled
def _fit_all(depth, speed, horizontal_range, target_depth, array_depth, out):
    """One ray a column of out (6, N): time, both elevations, ray parameter, both depth derivatives."""
    v, dz = np.empty(len(depth) + 2), np.empty(len(depth) + 1)
    for i in range(len(horizontal_range)):
        wanted, target, array = horizontal_range[i], target_depth[i], array_depth[i]
        if not (wanted >= 0.0 and math.isfinite(wanted) and math.isfinite(target) and math.isfinite(array)):
            continue
        top, bottom = min(target, array), max(target, array)
        count = _cut_layers(depth, speed, top, bottom, v, dz)
        fastest = v[0]
        for k in range(count):
            fastest = max(fastest, v[k + 1])
        if bottom - top <= 1e-9 * max(bottom, 1.0):
            if wanted == 0.0:
                out[:, i] = 0.0
            elif v[0] == _speed_below(depth, speed, bottom):  # level ray in water of one speed
                out[0, i], out[3, i] = wanted / v[0], 1.0 / v[0]
                out[1, i] = out[2, i] = out[4, i] = out[5, i] = 0.0
            continue
        if wanted >= _greatest_range(v, dz, count, fastest):
            continue
        q = _solve(wanted, v, dz, count, fastest)
        p = q / math.sqrt(1.0 + q * q * fastest * fastest)
        v_target, v_array = (v[0], v[count]) if target < array else (v[count], v[0])
        scale = math.sqrt(1.0 + q * q * fastest * fastest)
        s_target = math.sqrt(1.0 + q * q * (fastest - v_target) * (fastest + v_target)) / scale
        s_array = math.sqrt(1.0 + q * q * (fastest - v_array) * (fastest + v_array)) / scale
        up = 1.0 if target < array else -1.0
        out[0, i] = _time(q, v, dz, count, fastest)
        out[1, i] = up * math.atan2(s_target, p * v_target)
        out[2, i] = up * math.atan2(s_array, p * v_array)
        out[3, i] = p
        out[4, i] = -up * s_target / v_target
        out[5, i] = up * s_array / v_array


@compiled
def _speed_below(depth, speed, z):
    """Speed one node below z: equal to that at z where the water there has one speed."""
    return speed[min(np.searchsorted(depth, z, side="right"), len(depth) - 1)]


@warms
def _warm() -> None:
    fit_rays(SoundSpeedProfile.constant(1500.0, "m"), np.array([100.0]), 50.0, 0.0)
