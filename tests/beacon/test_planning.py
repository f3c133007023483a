"""Forecasts of legs: what the fix states now, what simulation finds later."""

from __future__ import annotations

import json
from dataclasses import replace

import gpxpy
import numpy as np
import pytest

from trackerlib.beacon.error_budget import error_budget
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.paths import StraightPaths
from trackerlib.beacon.planning import (
    Leg,
    Plan,
    Survey,
    accuracy_map,
    candidate_legs,
    plan_next_leg,
    surveys_so_far,
    time_to_reach,
    worse_after,
)
from trackerlib.beacon.settings import FixSettings
from trackerlib.beacon.squared_range import fix_squared_range
from trackerlib.commands import main
from trackerlib.frames import LocalFrame
from trackerlib.rounding import rounded
from trackerlib.simulation.beacon_survey import Errors, sail, simulate_survey
from trackerlib.simulation.hexagon import SCENARIOS, sail_hexagon

BEACON = np.array([900.0, 1100.0, -1800.0])
FRAME = LocalFrame(43.0, -50.0)
SETTINGS = FixSettings(gps_rms_m=3.0, sample_interval_ms=1.0, sound_speed_sigma_mps=0.0)
LEGS = np.array([[0.0, 1200.0], [110.0, 1000.0]])


def survey(seed=0, legs=LEGS, gps_rms_m=3.0):
    track = sail(legs, np.zeros(2), 3.0, 4.0)
    rng = np.random.default_rng(seed)
    errors = Errors(gps_rms_m=gps_rms_m, time_rms_s=1e-3 / np.sqrt(12))
    return simulate_survey(
        track, BEACON, StraightPaths(1500.0), FRAME, rng, errors, emission_offset_s=0.2, interval_s=4.0
    )


CLOCK = {"interval_s": 4.0, "estimate_interval": True}
SPEED = {"sound_speed_sigma_mps": 5.0, "estimate_sound_speed": True}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"gps_rms_m": None},
        CLOCK,
        CLOCK | {"estimate_interval_drift": True},
        CLOCK | {"gps_rms_m": None, "motion": "vertical"},
        {"antenna_sigma_m": (8.0, 3.0)},
        {"gps_rms_m": None, "antenna_sigma_m": (8.0, 3.0)},
        SPEED,
        SPEED | CLOCK | {"gps_rms_m": None},
        SPEED | {"antenna_sigma_m": (8.0, 3.0)},
    ],
    ids=str,
)
@pytest.mark.parametrize("heading_known", [False, True])
def test_the_forecast_of_now_is_what_the_fix_states(changes, heading_known):
    how, pings = replace(SETTINGS, **changes), survey()
    if heading_known:
        pings = replace(pings, heading_rad=np.linspace(0.0, 2.0, len(pings)))
    fix = fix_beacon(pings, how)
    so_far = surveys_so_far(pings, fix, how)[0]
    assert np.sqrt(np.diag(so_far.now)) == pytest.approx(fix.present.sigma, rel=0.1)
    assert so_far.speed_now_mps == pytest.approx(fix.sigma_sound_speed_mps, rel=0.02)


@pytest.mark.parametrize("changes", [CLOCK, SPEED, {"antenna_sigma_m": (8.0, 3.0)}], ids=str)
def test_fixes_after_a_leg_state_what_was_forecast(changes):
    how, pings, bearing = replace(SETTINGS, **changes), survey(), 60.0
    base = surveys_so_far(pings, fix_beacon(pings, how), how)[0]
    way = np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
    told = replace(base, gps_rms_m=3.0, time_sigma_s=1e-3 / np.sqrt(12))
    start = base.ship[-1, :2]
    forecast = told.after(Leg(start, start + 1500 * way, 3.0))
    longer = np.vstack([LEGS, [bearing, 1500.0]])
    stated = [fix_beacon(survey(100 + seed, longer), how).sigma for seed in range(12)]
    assert forecast.sigma == pytest.approx(np.mean(stated, axis=0), rel=0.1)


def test_a_leg_tells_the_speed_of_sound_and_the_spread_of_fixes_is_what_was_forecast():
    """By trials of an estimator that the forecast has no part in; 3000 of them know a spread to 1.3 %."""
    how, prior, time_rms = replace(SETTINGS, **SPEED), 5.0, 1e-3 / np.sqrt(12)
    pings = survey()
    base = surveys_so_far(pings, fix_beacon(pings, how), how)[0]
    told = replace(base, beacon=BEACON, gps_rms_m=3.0, time_sigma_s=time_rms, widened=1.0, lost=None)
    start = base.ship[-1, :2]
    leg = Leg(start, start + np.array([2780.0, 1120.0]), 5.0)
    expected = np.arange(4.0, leg.duration_s, 4.0)[:, None]
    ship = np.vstack(
        [base.ship, np.c_[leg.start + expected / leg.duration_s * (leg.end - leg.start), 0 * expected]]
    )
    after = told.after(leg)
    estimates = fit_with_speed(ship, 3.0, time_rms, prior, trials=3000)
    spread = np.cov(estimates.T)
    assert after.speed_sigma_mps < 0.5 * told.speed_now_mps
    assert np.sqrt(spread[3, 3]) == pytest.approx(after.speed_sigma_mps, rel=0.05)
    axes = np.linalg.eigh(after.covariance)[1]
    ratio = np.diag(axes.T @ spread[:3, :3] @ axes) / np.diag(axes.T @ after.covariance @ axes)
    assert np.sqrt(ratio) == pytest.approx(1.0, abs=0.05)
    fixed = replace(told, speed_fitted=False).after(leg)  # a speed that no leg tells anything of
    assert after.sigma[2] < 0.6 * fixed.sigma[2]


def fit_with_speed(ship, gps_rms_m, time_rms_s, prior_mps, trials):
    """East, north, up and speed of sound (trials, 4) by Gauss-Newton steps, the speed held by a prior that errs too."""
    rng = np.random.default_rng(4)
    exact = np.linalg.norm(ship - BEACON, axis=1)
    slope = (BEACON - ship) / exact[:, None]
    noisy = rng.normal(0, time_rms_s, (trials, len(ship))) + exact / 1500.0
    noisy += gps_rms_m * rng.normal(size=noisy.shape) * np.linalg.norm(slope[:, :2], axis=1) / 1500.0
    weight = 1 / (time_rms_s**2 + (gps_rms_m / 1500.0) ** 2 * np.sum(slope[:, :2] ** 2, axis=1))
    said = 1500.0 + prior_mps * rng.normal(size=trials)
    state = np.tile([*BEACON, 1500.0, 0.0], (trials, 1))
    for _ in range(4):
        offset = state[:, None, :3] - ship
        distance = np.linalg.norm(offset, axis=2)
        speed = state[:, 3, None]
        rows = np.concatenate(
            [
                offset / (distance * speed)[..., None],
                -(distance / speed**2)[..., None],
                np.ones((*distance.shape, 1)),
            ],
            2,
        )
        left = np.einsum("tni,n,tnj->tij", rows, weight, rows, optimize=True)
        right = np.einsum(
            "tni,n,tn->ti", rows, weight, noisy - distance / speed - state[:, 4, None], optimize=True
        )
        left[:, 3, 3] += 1 / prior_mps**2
        right[:, 3] += (said - state[:, 3]) / prior_mps**2
        state = state + np.linalg.solve(left, right[..., None])[..., 0]
    return state[:, :4]


def test_the_words_tell_what_a_leg_tells_of_the_speed_of_sound():
    pings = survey()
    for changes, told in (({}, False), ({"sound_speed_sigma_mps": 20.0}, False), (SPEED, True)):
        how = replace(SETTINGS, **changes)
        plan = plan_next_leg(pings, fix_beacon(pings, how), how, budget_s=3600.0)
        assert (plan.best.speed_sigma_mps < 0.9 * plan.speed_sigma_mps) is told
        assert ("speed of sound" in plan.words) is told
    assert f"falls from 5.0 to {rounded(plan.best.speed_sigma_mps)} m/s" in plan.words


def test_a_leg_knows_the_antenna_s_error_by_its_heading():
    pings = survey()
    how = replace(SETTINGS, antenna_sigma_m=(8.0, 0.0))
    leg = Leg(np.array([900.0, 800.0]), np.array([900.0, 1800.0]), 3.0)
    unknown, known = (
        surveys_so_far(one, fix_beacon(one, how), how)[0].after(leg)
        for one in (pings, replace(pings, heading_rad=np.zeros(len(pings))))
    )
    assert known.rms_m < 0.8 * unknown.rms_m


def test_the_spread_of_whole_fixes_after_a_leg_is_the_forecast():
    pings, bearing = survey(), 60.0
    fix = fix_beacon(pings, SETTINGS)
    base = surveys_so_far(pings, fix, SETTINGS)[0]
    start = fix.ship[-1, :2]
    true_end = LEGS[:, 1] @ np.c_[np.sin(np.radians(LEGS[:, 0])), np.cos(np.radians(LEGS[:, 0]))]
    way = np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
    told = replace(base, ship=base.ship, gps_rms_m=3.0, time_sigma_s=1e-3 / np.sqrt(12), beacon=fix.position)
    forecast = told.after(Leg(start, start + 1500 * way, 3.0))
    longer = np.vstack([LEGS, [bearing, 1500.0]])
    assert np.linalg.norm(start - true_end) < 30
    places = []
    for seed in range(120):
        later = survey(100 + seed, longer)
        done = fix_beacon(later, SETTINGS)
        assert done.converged
        place = done.frame.to_geodetic(done.position)
        places.append(FRAME.to_local(*place))
    ratio = np.sqrt(np.var(places, axis=0) / np.diag(forecast.covariance))
    assert np.abs(ratio - 1).max() < 0.2  # 10 %, and 120 trials know a spread to 6.5 %


def correlated(rng, shape, interval_s, correlation_s):
    """Standard normal errors (pings, ...), correlated by exp(-lag / correlation_s), or independent."""
    errors = rng.normal(size=shape)
    if correlation_s:
        kept = np.exp(-interval_s / correlation_s)
        for n in range(1, len(errors)):
            errors[n] = kept * errors[n - 1] + np.sqrt(1 - kept**2) * errors[n]
    return errors


@pytest.mark.parametrize(
    ("legs", "velocity", "gps_rms_m", "correlation_s"),
    [
        ([[0, 1200], [110, 1000], [60, 1500]], None, (3.0, 3.0), None),
        ([[0, 1500], [200, 2200]], None, (2.0, 8.0), None),
        ([[40, 2600], [160, 800]], None, (10.0, 10.0), None),  # the first leg over the beacon
        ([[0, 1500], [120, 1500], [240, 1500]], None, (3.0, 3.0), 60.0),
        ([[0, 2000], [120, 2000], [240, 2000]], (0.3, -0.2, 0.1), (3.0, 3.0), None),
        ([[90, 2500], [330, 2500], [200, 1500]], (-0.2, 0.1, -0.1), (3.0, 3.0), None),
        ([[0, 2500], [270, 1500], [130, 2500]], (0.0, 0.0, 0.3), (2.0, 8.0), None),
    ],
)
def test_the_spread_of_many_fixes_is_what_was_forecast(legs, velocity, gps_rms_m, correlation_s):
    """Place at the last ping over 2500 trials, each of which knows a spread to 1.4 %; a forecast may be 10 % off."""
    interval, time_rms = 4.0, 1e-3 / np.sqrt(12)
    track = sail(np.array(legs, float), np.zeros(2), 3.0, interval)
    ship = np.column_stack([track, np.zeros(len(track))])
    elapsed = interval * np.arange(len(ship))
    drift = np.zeros(3) if velocity is None else np.array(velocity)
    told = Survey(
        ship=ship,
        elapsed_s=elapsed,
        beacon=BEACON,
        velocity=drift,
        motion_kind="still" if velocity is None else "free",
        paths=StraightPaths(1500.0),
        time_sigma_s=time_rms,
        gps_rms_m=np.array(gps_rms_m),
        speed_sigma_mps=0.0,
        widened=1.0,
        interval_s=interval,
        clock_terms=1,
        gps_correlation_s=correlation_s,
    )
    forecast = told.forecast(ship, elapsed, elapsed[-1])
    trials, rng = 2500, np.random.default_rng(8)
    noisy = np.repeat(ship[None], trials, axis=0)
    noisy[:, :, :2] += gps_rms_m * correlated(rng, (len(ship), trials, 2), interval, correlation_s).swapaxes(
        0, 1
    )
    ranges = np.linalg.norm(ship - BEACON - elapsed[:, None] * drift, axis=1)
    ranges = ranges + 1500.0 * rng.normal(0, time_rms, (trials, len(ship)))
    fixes = fix_squared_range(
        noisy, ranges, elapsed - elapsed[-1], gps_rms_m, 1500 * time_rms,
        moving=velocity is not None, correlation_s=correlation_s or 0.0,
    )  # fmt: skip
    assert fixes.converged.all()
    spread = np.cov(fixes.estimate[:, :3].T)
    axes = np.linalg.eigh(forecast)[1]
    ratio = np.sqrt(np.diag(axes.T @ spread @ axes) / np.diag(axes.T @ forecast @ axes))
    assert (
        np.abs(ratio - 1).max() < 0.1 - 2 * 0.014
    )  # surely within a tenth along every axis of the ellipsoid
    wrong = replace(told, gps_rms_m=1.3 * np.array(gps_rms_m)).forecast(ship, elapsed, elapsed[-1])
    assert np.sqrt(np.trace(spread) / np.trace(wrong)) < 0.9


def test_a_leg_over_the_beacon_is_always_among_the_candidates_and_the_best_comes_first():
    pings = survey()
    fix = fix_beacon(pings, SETTINGS)
    plan = plan_next_leg(pings, fix, SETTINGS, budget_s=1200.0)
    assert plan.over_beacon is not None
    errors = [forecast.rms_m for forecast in plan.forecasts]
    assert errors == sorted(errors)
    assert plan.best.rms_m < np.sqrt(np.trace(plan.now))
    leg = plan.over_beacon.leg
    (along_x, along_y), (x, y) = leg.end - leg.start, fix.position[:2] - leg.start
    assert abs(along_x * y - along_y * x) / leg.length_m < 1
    assert all(forecast.leg.duration_s <= 1200.0 + 1e-6 for forecast in plan.forecasts)


@pytest.mark.parametrize("velocity", [(0.8, -0.6, 0.0), (-1.5, 0.7, 0.2), (0.0, 0.0, 0.5)])
def test_a_leg_over_a_moving_beacon_meets_it(velocity):
    pings = survey()
    fix = fix_beacon(pings, SETTINGS)
    base = surveys_so_far(pings, fix, SETTINGS)[0]
    moving = replace(base, motion_kind="free", velocity=np.array(velocity), lost=None)
    over = [leg for leg in candidate_legs(moving, 1800.0, 4.0) if leg.over_beacon]
    assert over
    for leg in over:
        seconds = np.arange(0.0, leg.duration_s, 0.05)[:, None]
        ship = leg.start + seconds / leg.duration_s * (leg.end - leg.start)
        there = moving.beacon[:2] + (moving.last_s + seconds) * moving.velocity[:2]
        assert np.linalg.norm(ship - there, axis=1).min() < 1
    fast = replace(moving, velocity=5.0 * (moving.beacon - [*over[0].start, 0.0]) / 1000)
    assert not any(leg.over_beacon for leg in candidate_legs(fast, 1800.0, 1.0))


def test_after_a_straight_line_the_plan_leaves_the_line():
    pings = survey(legs=np.array([[0.0, 2500.0]]))
    fix = fix_beacon(pings, SETTINGS)
    assert fix.position is None
    plan = plan_next_leg(pings, fix, SETTINGS, budget_s=900.0)
    assert abs(np.sin(np.radians(plan.best.leg.bearing_deg))) > 0.3
    assert plan.best.rms_m < 60


def test_time_to_reach_agrees_with_the_plan():
    pings = survey()
    fix = fix_beacon(pings, SETTINGS)
    base = surveys_so_far(pings, fix, SETTINGS)
    wanted = 0.5 * np.sqrt(np.trace(plan_next_leg(pings, fix, SETTINGS).now))
    seconds = time_to_reach(base, wanted, 5.0)
    plan = plan_next_leg(pings, fix, SETTINGS, budget_s=seconds)
    assert plan.best.rms_m == pytest.approx(wanted, rel=0.1)
    assert time_to_reach(base, 1e-4, 5.0) is None


def test_the_map_is_best_beyond_the_beacon_and_no_place_is_worse_than_now_when_speed_is_known():
    pings = survey()
    fix = fix_beacon(pings, SETTINGS)
    base = surveys_so_far(pings, fix, SETTINGS)[0]
    east, north, error = accuracy_map([base], 3000.0, 5.0, cells=9)
    now = np.sqrt(np.trace(base.forecast(base.ship, base.elapsed_s, float(base.elapsed_s[-1]))))
    assert error.shape == (len(north), len(east)) == (9, 9)
    assert error.max() < now * 1.01


def test_the_map_tells_the_worst_of_all_places_that_fit():
    pings = survey(legs=LEGS[:1])  # a straight leg: two mirror places
    fix = fix_beacon(pings, SETTINGS)
    both = surveys_so_far(pings, fix, SETTINGS)
    assert len(both) == 2
    east, north, error = accuracy_map(both, 2000.0, 5.0, cells=5)
    for place in (one.beacon for one in both):
        assert east[0] <= place[0] - 2000 < place[0] + 2000 <= east[-1] + 1e-6
        assert north[0] <= place[1] - 2000 < place[1] + 2000 <= north[-1] + 1e-6
    each = np.array(
        [
            [[one.after(Leg(one.ship[-1, :2], np.array([x, y]), 5.0)).rms_m for x in east] for y in north]
            for one in both
        ]
    )
    assert error == pytest.approx(each.max(axis=0))
    assert (each.argmax(axis=0) == 0).any()
    assert (each.argmax(axis=0) == 1).any()


def test_the_command_writes_the_map(data, tmp_path, capsys):
    path = tmp_path / "map.csv"
    assert main(["plan", str(data / "beacon-demo/survey.csv"), "--map", str(path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    text = path.read_text()
    assert "SIMULATED" in text.splitlines()[0]
    header, *rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    assert header == ["lat_deg", "lon_deg", "east_m", "north_m", "expected_error_m"]
    lat, lon, east, north, error = np.array(rows, float).T
    assert len(rows) == 25 * 25
    assert error.min() < answer["now_rms_m"]
    assert np.ptp(lat) * 111_000 == pytest.approx(np.ptp(north), rel=0.01)
    assert np.ptp(lon) * 111_320 * np.cos(np.radians(lat.mean())) == pytest.approx(np.ptp(east), rel=0.01)
    assert main(["plan", str(data / "beacon-demo/survey.csv"), "--map", str(tmp_path / "no/map.csv")]) == 2
    assert "map.csv" in capsys.readouterr().err


def test_a_moving_beacon_s_present_place_gets_worse_again_when_the_ship_sails_away():
    """The thesis, 3.6 and 4.4.1: the projected position can get worse with a longer collection."""
    pings = survey()
    fix = fix_beacon(pings, SETTINGS)
    base = surveys_so_far(pings, fix, SETTINGS)[0]
    points = sail_hexagon(SCENARIOS[5], 600)
    moving = replace(
        base,
        ship=points.ship,
        elapsed_s=2.0 * np.arange(len(points.ship)),
        motion_kind="free",
        lost=None,
        beacon=np.array(SCENARIOS[5].position),
        velocity=np.array([0.5, -0.5, 0.0]),
    )
    start = points.ship[-1, :2]
    away = start - (moving.beacon + moving.last_s * moving.velocity)[:2]
    leg = Leg(start, start + 2500 * away / np.linalg.norm(away), 3.0)
    seconds = worse_after([moving], leg)
    assert seconds is not None
    assert seconds < 3 * leg.duration_s

    def after(duration_s):
        part = replace(leg, end=start + duration_s / leg.duration_s * (leg.end - start))
        return moving.after(part).rms_m

    assert after(seconds) < min(after(seconds / 2), after(2 * seconds))
    assert after(seconds) < 0.8 * after(3 * seconds)
    words = Plan((moving.after(leg),), moving.now, seconds).words
    assert f"less sure after {seconds / 60:.0f} min" in words
    still = replace(moving, motion_kind="still", velocity=np.zeros(3), lost=None)
    assert worse_after([still], leg) is None


@pytest.mark.parametrize("changes", [{}, {"gps_rms_m": None}, {"antenna_sigma_m": (8.0, 3.0)}], ids=str)
def test_the_shares_of_an_error_budget_make_up_the_sigma(changes):
    pings = survey()
    how = replace(SETTINGS, sound_speed_sigma_mps=2.0, **changes)
    fix = fix_beacon(pings, how)
    budget = error_budget(pings, fix, how)
    total = np.sqrt(sum(np.square(part) for part in (budget.ship_position, budget.time, budget.sound_speed)))
    assert total == pytest.approx(fix.sigma, rel=1e-6)
    alone = fix_beacon(survey(gps_rms_m=0.0), replace(how, gps_rms_m=0.0, antenna_sigma_m=(0.0, 0.0)))
    by_time = np.sqrt(np.diag(alone.uncertainty.noise_covariance)[:3])
    assert budget.time == pytest.approx(by_time, rel=0.5)  # of a fix of errors of time alone
    assert np.less(budget.time, budget.ship_position).all()  # 3 m against 0.3 ms


@pytest.mark.parametrize(("name", "value"), [("budget_s", 1.0), ("speed_mps", 0.0)])
def test_what_makes_no_sense_is_named(name, value):
    pings = survey()
    fix = fix_beacon(pings, SETTINGS)
    with pytest.raises(ValueError, match=name):
        plan_next_leg(pings, fix, SETTINGS, **{name: value})


def test_the_command_writes_a_route(data, tmp_path, capsys):
    route = tmp_path / "leg.gpx"
    demo = str(data / "beacon-demo/survey.csv")
    assert main(["plan", demo, "--wanted-m", "12", "--route", str(route), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    points = gpxpy.parse(route.read_text()).routes[0].points
    assert points[1].latitude == pytest.approx(answer["best"]["end_lat_deg"], abs=1e-8)
    assert answer["seconds_to_wanted"] > 0
    assert "SIMULATED" in route.read_text()
    assert answer["worse_after_s"] is None  # it lies still


def test_an_accuracy_out_of_reach_is_said_and_a_refusal_has_its_name_once(data, tmp_path, capsys):
    demo = str(data / "beacon-demo/survey.csv")
    assert main(["plan", demo, "--wanted-m", "0.001"]) == 0
    assert "0.001 m within a day" in capsys.readouterr().out
    one = tmp_path / "one.csv"
    one.write_text("ping,lat_deg,lon_deg,oneway_s\n1,10,20,2.5\n")
    assert main(["plan", str(one)]) == 2
    assert capsys.readouterr().err.count("plan:") == 1
