"""Direct rays to 100,000 targets against a vectorised NumPy Newton iteration written for the comparison.

.venv/bin/python tests/benchmarks/bench_rays.py
"""

from __future__ import annotations

import time

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.rays import fit_rays

TARGETS = 100_000
BOUNDARY = np.arange(0.0, 1350.0, 25.0)
SUMMER = SoundSpeedProfile.from_layer_middles(
    BOUNDARY, 4880.0 - 35 * (1 - np.exp(-BOUNDARY / 80)) + 0.018 * BOUNDARY
).extended(0.0, 1350.0)
# Speed grows from the surface down, so that rays to far targets bend back up; to 12,000 ft.
DEEP = np.arange(0.0, 12_001.0, 250.0)
WINTER = SoundSpeedProfile(DEEP, 4790.0 + 0.0175 * DEEP + 8 * np.tanh((DEEP - 600) / 300))
CASES = (
    ("a range in summer, 1300 ft deep", SUMMER, 500, 4500, 700, 1300.0),
    ("winter, 12,000 ft deep", WINTER, 500, 12_000, 3000, 12_000.0),
)


def peer(profile, run, target, array, steps=12):
    """Travel times (N,) by Newton on the ray parameter, all targets at once, layers as columns."""
    depth, speed = profile.depth, profile.speed
    upper = np.clip(depth[:-1], target[:, None], array)
    lower = np.clip(depth[1:], target[:, None], array)
    v1, v2 = np.interp(upper, depth, speed), np.interp(lower, depth, speed)
    thick = lower - upper
    fastest = np.where(thick > 0, np.maximum(v1, v2), 0).max(axis=1)
    q = run / (array - target)
    for _ in range(steps):
        p = (q / np.sqrt(1 + q**2) / fastest)[:, None]
        s1, s2 = np.sqrt(1 - (p * v1) ** 2), np.sqrt(1 - (p * v2) ** 2)
        found = np.sum(p * (v1 + v2) * thick / (s1 + s2), axis=1)
        slope = np.sum((v1 + v2) * thick / (s1 + s2) / (s1 * s2), axis=1) / fastest / (1 + q**2) ** 1.5
        q = np.maximum(q + (run - found) / slope, 0.5 * q)
    p = (q / np.sqrt(1 + q**2) / fastest)[:, None]
    s1, s2 = np.sqrt(1 - (p * v1) ** 2), np.sqrt(1 - (p * v2) ** 2)
    y = (v1 + v2) / ((s1 + s2) * v1 * v2)
    x = (v2 - v1) * y
    return np.sum(thick * y * np.where(np.abs(x) > 1e-9, np.arcsinh(x) / np.where(x == 0, 1, x), 1), axis=1)


def bisection_finds(profile, run, target, array):
    """How many targets (N,) a direct ray reaches: the longest range, just short of a level ray, passes them."""
    depth, speed = profile.depth, profile.speed
    upper, lower = np.clip(depth[:-1], target[:, None], array), np.clip(depth[1:], target[:, None], array)
    v1, v2 = np.interp(upper, depth, speed), np.interp(lower, depth, speed)
    thick = lower - upper
    p = (1 - 1e-12) / np.where(thick > 0, np.maximum(v1, v2), 0).max(axis=1)[:, None]
    s1, s2 = (np.sqrt(np.maximum(1 - (p * v) ** 2, 0)) for v in (v1, v2))
    longest = np.sum(np.where(thick > 0, p * (v1 + v2) * thick / np.maximum(s1 + s2, 1e-9), 0), axis=1)
    return int(np.sum(longest >= run))


def timed(work, times):
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        found = work()
        seconds.append(time.perf_counter() - start)
    return found, min(seconds)


def main():
    rng = np.random.default_rng(1)
    fit_rays(SUMMER, np.ones(1), 20.0, 1300.0)
    for name, profile, nearest, farthest, deepest, array in CASES:
        run, target = rng.uniform(nearest, farthest, TARGETS), rng.uniform(20, deepest, TARGETS)
        rays, ours = timed(lambda: fit_rays(profile, run, target, array), 5)  # noqa: B023
        with np.errstate(invalid="ignore"):
            theirs_time, theirs = timed(lambda: peer(profile, run, target, array), 1)  # noqa: B023
        both = rays.reached & np.isfinite(theirs_time)
        worst = np.abs(rays.travel_time - theirs_time)[both].max()
        print(f"{name}: {TARGETS} rays; ours reach {rays.reached.sum()}, the peer {both.sum()}, bisection")
        print(
            f"  {bisection_finds(profile, run, target, array)}; largest difference from the peer {worst:.1e} s"
        )
        print(f"  fit_rays {TARGETS / ours:12,.0f} rays/s, NumPy Newton {TARGETS / theirs:12,.0f} rays/s")
        print(f"  ratio {theirs / ours:.1f}")


if __name__ == "__main__":
    main()
