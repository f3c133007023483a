"""Direct rays against quadrature of the profile, against straight lines, and by what is always true."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.rays import NoDirectRay, fit_rays

# Both signs of gradient, a level of one speed, a sharp bend.
WINTER = SoundSpeedProfile(
    np.array([0.0, 60, 120, 200, 400, 700, 800, 1500, 2000, 3000]),
    np.array([1479.2, 1479.9, 1476.0, 1472.1, 1471.4, 1474.6, 1474.6, 1486.7, 1494.9, 1512.3]),
    unit="m",
)
DEPTHS = st.floats(0.0, 3000.0)


def by_quadrature(profile, ray_parameter, upper, lower):
    """Horizontal range and travel time of a ray of that parameter between two depths, by quadrature."""
    edges = [upper, *profile.depth[(profile.depth > upper) & (profile.depth < lower)], lower]

    def slowness(z):
        v = np.interp(z, profile.depth, profile.speed)
        return 1 / (v * np.sqrt(1 - (ray_parameter * v) ** 2))

    def run(z):
        v = np.interp(z, profile.depth, profile.speed)
        return ray_parameter * v / np.sqrt(1 - (ray_parameter * v) ** 2)

    def whole(f):
        return sum(quad(f, a, b, epsabs=1e-13, epsrel=1e-12)[0] for a, b in pairwise(edges))

    return whole(run), whole(slowness)


@pytest.mark.parametrize(
    ("horizontal", "target", "array"),
    [
        (1000.0, 2500.0, 10.0),
        (3500.0, 2500.0, 10.0),
        (800.0, 400.0, 2000.0),  # both on layer boundaries
        (800.0, 401.0, 1999.0),
        (50.0, 2000.0, 60.0),
        (0.5, 750.0, 710.0),  # inside one layer of one speed
        (2000.0, 3000.0, 0.0),
        (1200.0, 130.0, 900.0),
        (1.0, 1500.0, 0.0),
    ],
)
def test_travel_times_agree_with_quadrature(horizontal, target, array):
    ray = fit_rays(WINTER, horizontal, target, array)
    assert ray.reached
    run, time = by_quadrature(WINTER, float(ray.ray_parameter), min(target, array), max(target, array))
    assert run == pytest.approx(horizontal, abs=1e-6)
    assert float(ray.travel_time) == pytest.approx(time, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_random_rays_agree_with_quadrature(seed):
    rng = np.random.default_rng(seed)
    target, array = rng.uniform(0, 3000, 2)
    ray = fit_rays(WINTER, rng.uniform(0, 2 * abs(target - array)), target, array)
    if ray.reached:
        _, time = by_quadrature(WINTER, float(ray.ray_parameter), min(target, array), max(target, array))
        assert float(ray.travel_time) == pytest.approx(time, abs=1e-9)


def test_straight_up_takes_the_vertical_time():
    ray = fit_rays(WINTER, 0.0, 100.0, 2500.0)
    assert float(ray.travel_time) == pytest.approx(2400.0 / WINTER.harmonic_mean(100, 2500), rel=1e-13)
    assert float(ray.elevation_target) == pytest.approx(np.pi / 2)
    assert float(ray.ray_parameter) == 0


@pytest.mark.parametrize(
    ("target", "array", "sign"), [(300.0, 1300.0, 1), (1300.0, 300.0, -1), (700.0, 700.0, 0)]
)
def test_one_speed_makes_straight_lines(target, array, sign):
    water = SoundSpeedProfile.constant(4850.0)
    ray = fit_rays(water, 2000.0, target, array)
    slant = np.hypot(2000.0, target - array)
    assert float(ray.travel_time) == pytest.approx(slant / 4850.0, rel=1e-14)
    assert float(ray.elevation_target) == pytest.approx(sign * np.arctan2(abs(target - array), 2000.0))
    assert float(ray.elevation_array) == pytest.approx(float(ray.elevation_target))


def test_a_single_gradient_makes_a_circle():
    # In one gradient g the ray is an arc: t = arccosh(1 + g^2 d^2 / (2 v1 v2)) / g, d the chord.
    v1, v2, depth, run = 1450.0, 1500.0, 1000.0, 700.0
    g = (v2 - v1) / depth
    ray = fit_rays(SoundSpeedProfile(np.array([0.0, depth]), np.array([v1, v2]), "m"), run, depth, 0.0)
    expected = np.arccosh(1 + g**2 * (run**2 + depth**2) / (2 * v1 * v2)) / g
    assert float(ray.travel_time) == pytest.approx(expected, rel=1e-12)


@settings(max_examples=150, deadline=None)
@given(DEPTHS, DEPTHS, st.floats(0.0, 4000.0))
def test_there_and_back_take_the_same_time(target, array, run):
    there, back = fit_rays(WINTER, run, target, array), fit_rays(WINTER, run, array, target)
    assert bool(there.reached) == bool(back.reached)
    if there.reached:
        assert float(there.travel_time) == pytest.approx(float(back.travel_time), rel=1e-13, abs=1e-15)
        assert float(there.elevation_target) == pytest.approx(-float(back.elevation_array), abs=1e-9)


@settings(max_examples=150, deadline=None)
@given(DEPTHS, DEPTHS, st.floats(0.0, 4000.0))
def test_a_ray_takes_no_longer_than_the_straight_line_in_the_slowest_water(target, array, run):
    ray = fit_rays(WINTER, run, target, array)
    if ray.reached:
        slant = np.hypot(run, target - array)
        assert slant / 1512.3 - 1e-11 <= float(ray.travel_time) <= slant / 1471.4 + 1e-11


@pytest.mark.parametrize(("target", "array"), [(2500.0, 10.0), (130.0, 900.0), (1700.0, 20.0)])
def test_derivatives_agree_with_differences(target, array):
    run, h = 900.0, 1e-3

    def time(dr=0.0, dt=0.0, da=0.0):
        return float(fit_rays(WINTER, run + dr, target + dt, array + da).travel_time)

    ray = fit_rays(WINTER, run, target, array)
    assert float(ray.ray_parameter) == pytest.approx((time(dr=h) - time(dr=-h)) / (2 * h), abs=1e-9)
    assert float(ray.time_by_target_depth) == pytest.approx((time(dt=h) - time(dt=-h)) / (2 * h), abs=1e-9)
    assert float(ray.time_by_array_depth) == pytest.approx((time(da=h) - time(da=-h)) / (2 * h), abs=1e-9)


def test_snell_holds_at_both_ends():
    rays = fit_rays(WINTER, np.linspace(10, 3000, 40), 2200.0, 15.0)
    kept = rays.reached
    for elevation, depth in ((rays.elevation_target, 2200.0), (rays.elevation_array, 15.0)):
        assert np.cos(elevation[kept]) / WINTER.speed_at(depth) == pytest.approx(rays.ray_parameter[kept])


def test_shadow_is_reported_and_the_search_ends():
    # Speed falls steadily downwards: from near the surface no direct ray goes far at shallow depth.
    falling = SoundSpeedProfile(np.array([0.0, 300.0]), np.array([1520.0, 1480.0]), "m")
    rays = fit_rays(falling, np.array([100.0, 1500.0, 10_000.0]), 60.0, 5.0)
    assert rays.reached.tolist() == [True, False, False]
    assert np.isnan(rays.travel_time[1:]).all()
    with pytest.raises(NoDirectRay, match=r"2 of 3 targets \(numbers 1, 2\)"):
        rays.require_all()


def test_just_inside_the_shadow_boundary_a_ray_is_found():
    falling = SoundSpeedProfile(np.array([0.0, 300.0]), np.array([1520.0, 1480.0]), "m")
    run = np.linspace(600.0, 1200.0, 4001)
    reached = fit_rays(falling, run, 60.0, 5.0).reached
    edge = int(np.argmin(reached))
    assert reached[:edge].all()
    assert not reached[edge:].any()
    last = fit_rays(falling, run[edge - 1], 60.0, 5.0)
    assert abs(float(last.elevation_array)) < 0.02  # all but level where the water is fastest


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_numbers_that_are_none_reach_nothing(bad):
    assert not fit_rays(WINTER, np.array([bad]), 100.0, 50.0).reached[0]


def test_shapes_broadcast():
    rays = fit_rays(WINTER, np.ones((3, 4)), np.array([100.0, 200, 300, 400]), 50.0)
    assert rays.travel_time.shape == rays.reached.shape == (3, 4)
    assert fit_rays(WINTER, np.zeros((0,)), 100.0, 50.0).travel_time.shape == (0,)


def test_targets_below_the_table_use_the_profile_carried_on():
    deep = fit_rays(WINTER, 500.0, 4000.0, 10.0)
    longer = fit_rays(WINTER.extended(0, 4000), 500.0, 4000.0, 10.0)
    assert float(deep.travel_time) == float(longer.travel_time)


# to 12,000 ft in winter: every target that bisection finds, and the same ray

DEEP = np.arange(0.0, 12_001.0, 250.0)
WINTER_FT = SoundSpeedProfile(DEEP, 4790.0 + 0.0175 * DEEP + 8 * np.tanh((DEEP - 600) / 300))


def by_bisection(profile, run, target, array):
    """Ray parameter by bisection on the range, layer by layer; None where even a level ray falls short."""
    top, bottom = sorted((target, array))
    inner = profile.depth[(profile.depth > top) & (profile.depth < bottom)]
    depth = np.array([top, *inner, bottom])
    speed, thick = profile.speed_at(depth), np.diff(depth)

    def reach(p):
        s = np.sqrt(np.maximum(1 - (p * speed) ** 2, 0))
        return np.sum(p * (speed[:-1] + speed[1:]) * thick / np.maximum(s[:-1] + s[1:], 1e-300))

    low, high = 0.0, 1 / speed.max()
    if reach(high) < run:
        return None
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if reach(middle) < run else (low, middle)
    return low


@pytest.mark.parametrize("seed", range(4))
def test_all_targets_are_found_that_bisection_finds(seed):
    rng = np.random.default_rng(seed)
    size = 150
    array = rng.choice([50.0, 1300.0, 6000.0, 12_000.0], size)
    target, run = rng.uniform(0, 12_000, size), rng.uniform(0, 12_000, size)
    target[::3] = np.clip(array[::3] + rng.uniform(-500, 500, 50), 0, 12_000)  # far and level: some in shadow
    rays = fit_rays(WINTER_FT, run, target, array)
    found = [by_bisection(WINTER_FT, *one) for one in zip(run, target, array, strict=True)]
    assert rays.reached.tolist() == [p is not None for p in found]
    assert 20 < np.sum(rays.reached) < size
    assert rays.ray_parameter[rays.reached] == pytest.approx([p for p in found if p is not None], rel=1e-10)


def test_many_rays_in_threads_are_the_same_as_one_by_one():
    rng = np.random.default_rng(9)
    run, target = rng.uniform(0, 9000, 9500), rng.uniform(0, 3000, 9500)
    together = fit_rays(WINTER_FT, run, target, 6000.0)
    for k in (0, 3999, 4000, 7999, 8000, 9499):
        alone = fit_rays(WINTER_FT, run[k], target[k], 6000.0)
        assert np.array_equal(alone.travel_time, together.travel_time[k], equal_nan=True)
