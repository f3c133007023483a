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
from itertools import pairwise

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.compiled import compiled, compiled_with, in_threads, warms

STEPS = 100  # ten times what the hardest ray found needs
DOUBTFUL = 6  # steps after which it is asked whether any direct ray reaches so far
ENOUGH = 1e-8  # relative step after which the next one would change nothing
SERIES_LIMIT = 0.03
_A_THREAD = 4000  # rays for which a thread of its own is worth its start
_WEIGHT, _BELOW, _SLOWNESS, _ROOT = range(4)  # rows of what is known of the layers between the two ends

# Sums may be taken in any order, so that several layers are worked on at once.
summing = compiled_with("reassoc", "contract", "nsz")


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
    # Copies, as views that cannot be written to would be a type of their own, for which kernels are compiled anew.
    given = [
        np.array(np.broadcast_to(a, shape), float).ravel()
        for a in (horizontal_range, target_depth, array_depth)
    ]
    depths = np.concatenate(given[1:])
    depths = depths[np.isfinite(depths)]
    if len(depths):
        profile = profile.extended(min(depths.min(), profile.depth[0]), max(depths.max(), profile.depth[-1]))
    out = np.full((6, given[0].size), np.nan)
    cuts = [*range(0, max(given[0].size - _A_THREAD // 2, 1), _A_THREAD), given[0].size]
    columns = (profile.depth, profile.speed, *given)
    in_threads(_fit_stretch, [(*columns, a, b, out) for a, b in pairwise(cuts)])
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


@summing
def _prepare(v, dz, count, fastest, layer):
    """Rows of layer from its ends and thickness: (v1 + v2) dz; vmax^2 - v^2 and 1/v at the count + 1 ends."""
    for k in range(count + 1):
        layer[_BELOW, k] = (fastest - v[k]) * (fastest + v[k])
        layer[_SLOWNESS, k] = 1.0 / v[k]
    for k in range(count):
        layer[_WEIGHT, k] = (v[k] + v[k + 1]) * dz[k]


@summing
def _range_and_slope(q, count, layer):
    """Horizontal range of the ray q, and its derivative by q, which needs no more than the range itself.

    With b = sqrt(1 + q^2 (vmax^2 - v^2)): range q sum w/(b1 + b2), derivative sum w/((b1 + b2) b1 b2).
    """
    weight, below, b = layer[_WEIGHT], layer[_BELOW], layer[_ROOT]
    for k in range(count + 1):
        b[k] = math.sqrt(1.0 + q * q * below[k])
    total, slope = 0.0, 0.0
    for k in range(count):
        product = b[k] * b[k + 1]
        width = weight[k] / ((b[k] + b[k + 1]) * product)
        total += width * product
        slope += width
    return q * total, slope


@compiled
def _greatest_range(count, layer):
    """Horizontal range that direct rays approach as they become level at the fastest depth."""
    total = 0.0
    for k in range(count):
        roots = math.sqrt(layer[_BELOW, k]) + math.sqrt(layer[_BELOW, k + 1])
        if roots == 0.0:
            return math.inf
        total += layer[_WEIGHT, k] / roots
    return total


@compiled
def _solve(wanted, count, layer):
    """The ray q whose horizontal range is the one wanted; NaN if no direct ray reaches so far."""
    q = 2.0 * wanted / np.sum(layer[_WEIGHT, :count])  # the range of this q is at most `wanted`
    for k in range(STEPS):
        found, slope = _range_and_slope(q, count, layer)
        step = (wanted - found) / slope
        if k == DOUBTFUL and not wanted < _greatest_range(count, layer):
            return math.nan
        q += step
        if step <= ENOUGH * q:  # the error left is the square of this
            break
    return q


@summing
def _time(q, count, layer, v, dz, scale):
    """Travel time of the ray q, and the greatest x, beyond which the series is not good enough."""
    slowness, below, b = layer[_SLOWNESS], layer[_BELOW], layer[_ROOT]
    for k in range(count + 1):
        b[k] = math.sqrt(1.0 + q * q * below[k])
    total, greatest = 0.0, 0.0
    for k in range(count):
        y = (slowness[k] + slowness[k + 1]) * scale / (b[k] + b[k + 1])
        x2 = ((v[k + 1] - v[k]) * y) ** 2
        series = 1.0 + x2 * (-1 / 6 + x2 * (3 / 40 + x2 * (-5 / 112 + x2 * 35 / 1152)))  # asinh(x)/x
        total += dz[k] * y * series
        greatest = max(greatest, x2)
    return total, math.sqrt(greatest)


@compiled
def _time_of_steep_layers(count, layer, v, dz, scale):
    """The same where a layer's speed changes much along the ray."""
    b, total = layer[_ROOT], 0.0
    for k in range(count):
        y = (layer[_SLOWNESS, k] + layer[_SLOWNESS, k + 1]) * scale / (b[k] + b[k + 1])
        x = (v[k + 1] - v[k]) * y
        x2 = x * x
        ratio = 1.0 - x2 / 6.0 + 0.075 * x2 * x2 if abs(x) < 1e-3 else math.asinh(x) / x
        total += dz[k] * y * ratio
    return total


@compiled
def _fit_stretch(depth, speed, horizontal_range, target_depth, array_depth, first, stop, out):
    """Rays `first` to `stop`, a column each of out (6, N): time, elevations, ray parameter, depth derivatives."""
    v, dz, layer = np.empty(len(depth) + 2), np.empty(len(depth) + 1), np.empty((4, len(depth) + 2))
    for i in range(first, stop):
        wanted, target, array = horizontal_range[i], target_depth[i], array_depth[i]
        if not (wanted >= 0.0 and math.isfinite(wanted) and math.isfinite(target) and math.isfinite(array)):
            continue
        top, bottom = min(target, array), max(target, array)
        count = _cut_layers(depth, speed, top, bottom, v, dz)
        if bottom - top <= 1e-9 * max(bottom, 1.0):
            if wanted == 0.0:
                out[:, i] = 0.0
            elif v[0] == _speed_below(depth, speed, bottom):  # level ray in water of one speed
                out[0, i], out[3, i] = wanted / v[0], 1.0 / v[0]
                out[1, i] = out[2, i] = out[4, i] = out[5, i] = 0.0
            continue
        fastest = v[0]
        for k in range(count):
            fastest = max(fastest, v[k + 1])
        _prepare(v, dz, count, fastest, layer)
        q = _solve(wanted, count, layer)
        if math.isnan(q):
            continue
        scale = math.sqrt(1.0 + q * q * fastest * fastest)
        time, greatest = _time(q, count, layer, v, dz, scale)
        if greatest > SERIES_LIMIT:
            time = _time_of_steep_layers(count, layer, v, dz, scale)
        p = q / scale
        up = 1.0 if target < array else -1.0
        at_target, at_array = (0, count) if target < array else (count, 0)
        v_target, v_array = v[at_target], v[at_array]
        s_target, s_array = layer[_ROOT, at_target] / scale, layer[_ROOT, at_array] / scale
        out[0, i] = time
        out[1, i] = up * math.atan2(s_target, p * v_target)
        out[2, i] = up * math.atan2(s_array, p * v_array)
        out[3, i] = p
        out[4, i] = -up * s_target / v_target
        out[5, i] = up * s_array / v_array


@compiled
def _speed_below(depth, speed, z):
    """Speed one node below z, at the last node one above: equal to that at z where the water has one speed."""
    below = np.searchsorted(depth, z, side="right")
    return speed[below] if below < len(depth) else speed[len(depth) - 2]


@warms
def _warm() -> None:
    fit_rays(SoundSpeedProfile.constant(1500.0, "m"), np.array([100.0]), 50.0, 0.0)
