"""A pass along a straight leg: hyperbola, interval, bearing line; two lines and more give a fix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from trackerlib.beacon.bearing_lines import fix_from_bearing_lines
from trackerlib.frames import LocalFrame
from trackerlib.receiver.hyperbola import BearingLine, Marks, fit_pass, straighten

FRAME = LocalFrame(36.6, -122.0)
BEACON = np.array([600.0, 0.0, -800.0])
SPEED_MPS = 5.0


def marks_of(
    rng, start, course_deg, pings=300, *, interval_s=2.0, sound_mps=1500.0, gps_m=3.0, jitter_s=4e-4
):
    """Marks of a leg from `start` (east, north); three in ten pings are missing."""
    number = np.arange(pings)
    course = np.radians(course_deg)
    ship = np.append(start, 0.0) + np.outer(
        SPEED_MPS * interval_s * number, [np.sin(course), np.cos(course), 0]
    )
    arrival_s = 0.3 + number * interval_s + np.linalg.norm(ship - BEACON, axis=1) / sound_mps
    arrival_s += rng.normal(0, jitter_s, pings)
    ship[:, :2] += rng.normal(0, gps_m, (pings, 2))
    kept = rng.random(pings) > 0.3
    lat, lon, _ = FRAME.to_geodetic(ship[kept])
    return Marks(number[kept], np.mod(arrival_s, 2.0)[kept], np.full(kept.sum(), jitter_s), lat, lon, 2.0)


def northward(rng, pings=300, **errors):
    return marks_of(rng, (0.0, -1500 + rng.uniform(-300, 300)), 0.0, pings, **errors)


@pytest.mark.parametrize(("sigma_interval_s", "pings"), [(0.0, 200), (np.inf, 300), (1e-6, 250)])
def test_stated_sigmas_of_a_pass_are_true(sigma_interval_s, pings):
    errors = []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        interval_s = 2.0 + rng.normal(0, min(sigma_interval_s, 1e-5))
        marks = northward(rng, pings, interval_s=interval_s, sound_mps=1500 + rng.normal(0, 2))
        found = fit_pass(marks, 1500.0, sigma_interval_s=sigma_interval_s)
        line = found.line
        along = FRAME.to_local(line.lat_deg, line.lon_deg, 0.0)[1] / line.sigma_along_m
        across = (line.distance_m - 1000) / line.sigma_m
        turned = (line.bearing_deg - 90) / line.sigma_bearing_deg
        ticked = (found.interval_s - interval_s) / found.sigma_interval_s if sigma_interval_s else 1.0
        errors.append((along, across, turned, ticked))
    assert np.sqrt(np.mean(np.square(errors), axis=0)) == pytest.approx(np.ones(4), abs=0.3)


def test_a_pass_without_errors_is_found_exactly():
    marks = marks_of(np.random.default_rng(0), (0.0, -1500.0), 0.0, gps_m=0.0, jitter_s=1e-9)
    found = fit_pass(marks, 1500.0, sigma_sound_speed_mps=0.0, sigma_interval_s=0.0)
    assert found.reason is None
    assert found.line.distance_m == pytest.approx(1000, abs=0.05)
    assert found.line.bearing_deg == pytest.approx(90, abs=1e-3)
    assert found.closest_emission == pytest.approx(150, abs=1e-2)
    assert np.abs(found.residual_s).max() < 1e-6
    turn = marks.emission[np.argmin(found.fitted_s)]
    assert abs(turn - 150) <= 3


def test_the_distance_leans_on_the_interval():
    """An interval known exactly sharpens the place along the track, and the distance of a short pass."""
    marks = northward(np.random.default_rng(3), 200)
    free, known = (fit_pass(marks, 1500.0, sigma_interval_s=sigma).line for sigma in (np.inf, 0.0))
    assert free.sigma_along_m > 2 * known.sigma_along_m
    assert free.sigma_m > 1.3 * known.sigma_m


@pytest.mark.parametrize(
    ("marks", "reason"),
    [
        (lambda rng: northward(rng, 6), "too few"),
        (lambda rng: marks_of(rng, (0.0, -3000.0), 0.0, 150), "not on the leg|hardly bent"),
        (lambda rng: marks_of(rng, (0.0, -60.0), 0.0, 12), "hardly bent|not on the leg"),
    ],
)
def test_a_pass_that_tells_nothing_says_why(marks, reason):
    found = fit_pass(marks(np.random.default_rng(5)), 1500.0)
    assert found.line is None
    assert any(word in found.reason for word in reason.split("|"))


def test_a_crooked_leg_is_refused():
    marks = northward(np.random.default_rng(6))
    bent = replace(
        marks, lon_deg=marks.lon_deg + np.where(marks.emission > 150, marks.emission - 150, 0) * 1e-4
    )
    assert "not straight" in fit_pass(bent, 1500.0).reason


def test_a_short_pass_has_a_line_without_a_distance():
    marks = marks_of(np.random.default_rng(1), (0.0, -100.0), 0.0, 20, gps_m=4.0)
    found = fit_pass(marks, 1500.0, sigma_interval_s=0.0)
    assert found.line is not None
    assert found.line.distance_m is None
    assert "no distance" in found.reason


def test_straighten_finds_the_interval_as_heard():
    number = np.arange(80)
    marks = Marks(
        number,
        np.mod(0.2 + 2.0004 * number, 2.0),
        np.full(80, 1e-3),
        np.full(80, 36.0),
        np.full(80, 5.0),
        2.0,
    )
    interval_s, sigma_s = straighten(marks)
    assert interval_s == pytest.approx(2.0004, abs=1e-9)
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(200):
        noisy = replace(marks, folded_s=np.mod(marks.folded_s + rng.normal(0, 1e-3, 80), 2.0))
        interval_s, sigma_s = straighten(noisy)
        errors.append((interval_s - 2.0004) / sigma_s)
    assert np.std(errors) == pytest.approx(1, abs=0.2)


def lines_of(rng, legs, **settings):
    sound_mps = 1500 + rng.normal(0, 2)
    marks = [marks_of(rng, start, course_deg, sound_mps=sound_mps) for start, course_deg in legs]
    return [fit_pass(each, 1500.0, **settings).line for each in marks]


CROSSED = (((0.0, -1500.0), 0.0), ((-900.0, 300.0), 90.0))


@pytest.mark.parametrize("distances", [True, False])
def test_two_lines_give_a_fix_with_a_true_ellipse(distances):
    inside = []
    for seed in range(40):
        lines = lines_of(np.random.default_rng(seed), CROSSED)
        if not distances:
            lines = [replace(line, distance_m=None, sigma_m=None, correlation=0.0) for line in lines]
        fix = fix_from_bearing_lines(lines)
        assert fix.converged, fix.reason
        error = FRAME.to_local(fix.lat_deg, fix.lon_deg, 0.0)[:2] - BEACON[:2]
        inside.append(error @ np.linalg.solve(fix.covariance, error) < stats.chi2.ppf(0.95, 2))
        if distances:
            assert abs(fix.depth_m - 800) < 4 * fix.sigma_depth_m
    assert 0.85 <= np.mean(inside) <= 1


def test_one_line_has_two_mirror_places():
    (line,) = lines_of(np.random.default_rng(1), CROSSED[:1])
    fix = fix_from_bearing_lines([line])
    assert not fix.converged
    assert "port from starboard" in fix.reason
    east = [FRAME.to_local(lat, lon, 0.0)[0] for lat, lon in fix.alternatives]
    assert sorted(east) == pytest.approx([-1000, 1000], abs=15)
    ends = line.ends(depth_m=800)
    assert sorted(FRAME.to_local(*ends.T, 0.0)[:, 0]) == pytest.approx([-600, 600], abs=25)


def test_lines_of_one_track_leave_the_mirror():
    lines = lines_of(np.random.default_rng(2), [CROSSED[0], ((0.0, 1500.0), 180.0)])
    fix = fix_from_bearing_lines(lines)
    assert not fix.converged
    assert "mirror" in fix.reason or "small an angle" in fix.reason


def test_lines_that_do_not_meet_say_so():
    lines = lines_of(np.random.default_rng(3), [*CROSSED, ((-700.0, -900.0), 45.0)])
    assert fix_from_bearing_lines(lines).converged
    moved = replace(lines[2], lat_deg=lines[2].lat_deg + 0.004)
    fix = fix_from_bearing_lines([lines[0], lines[1], moved])
    assert not fix.converged
    assert "do not meet" in fix.reason


def test_parallel_lines_without_distances_do_not_meet():
    line = BearingLine(36.6, -122.0, 90.0, 2.0, 0.1)
    fix = fix_from_bearing_lines([line, replace(line, lat_deg=36.601)])
    assert "parallel" in fix.reason
    assert "no bearing line" in fix_from_bearing_lines([]).reason


def test_bad_marks():
    marks = northward(np.random.default_rng(1))
    with pytest.raises(ValueError, match="columns of marks differ"):
        replace(marks, folded_s=marks.folded_s[1:])
    with pytest.raises(ValueError, match="sigma_s"):
        replace(marks, sigma_s=0 * marks.sigma_s)
    with pytest.raises(ValueError, match="more than the depth"):
        BearingLine(36.6, -122.0, 90.0, 2.0, 0.1, 500.0, 3.0).ends(depth_m=800)
