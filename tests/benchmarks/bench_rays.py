"""Direct rays to 100,000 targets against a vectorised NumPy Newton iteration written for the comparison.

.venv/bin/python tests/benchmarks/bench_rays.py
"""

from __future__ import annotations

import time

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.rays import fit_rays
from trackerlib.compiled import warm

TARGETS = 100_000
BOUNDARY = np.arange(0.0, 1350.0, 25.0)
PROFILE = SoundSpeedProfile.from_layer_middles(
    BOUNDARY, 4880.0 - 35 * (1 - np.exp(-BOUNDARY / 80)) + 0.018 * BOUNDARY
).extended(0.0, 1350.0)


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


def main():
    warm()
    rng = np.random.default_rng(1)
    run, target = rng.uniform(500, 4500, TARGETS), rng.uniform(20, 700, TARGETS)
    start = time.perf_counter()
    rays = fit_rays(PROFILE, run, target, 1300.0)
    ours = time.perf_counter() - start
    start = time.perf_counter()
    with np.errstate(invalid="ignore"):
        theirs_time = peer(PROFILE, run, target, 1300.0)
    theirs = time.perf_counter() - start
    both = rays.reached & np.isfinite(theirs_time)
    worst = np.abs(rays.travel_time - theirs_time)[both].max()
    print(f"{TARGETS} rays; ours reach {rays.reached.sum()}, the peer {np.isfinite(theirs_time).sum()}")
    print(f"fit_rays        {TARGETS / ours:12,.0f} rays/s")
    print(f"NumPy Newton    {TARGETS / theirs:12,.0f} rays/s   largest difference {worst:.1e} s")
    print(f"ratio {theirs / ours:.1f}")


if __name__ == "__main__":
    main()
