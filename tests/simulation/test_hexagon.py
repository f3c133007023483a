"""The thesis's scenarios: geometry by hand, the bound against a longer derivation, and what the estimator reaches."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.simulation.hexagon import (
    SCENARIOS,
    SOUND_SPEED_MPS,
    TIME_RMS_S,
    position_bound,
    run_trials,
    sail_hexagon,
)

RANGE_RMS_M = SOUND_SPEED_MPS * TIME_RMS_S


def test_the_ship_starts_at_its_vertex_and_sails_east():
    points = sail_hexagon(SCENARIOS[1], 3, speed_mps=5.0)
    corner = np.array([-500.0, -500 * np.sqrt(3)])
    first = np.hypot(np.linalg.norm(corner), 2000) / 1500
    assert points.received_s[0] == pytest.approx(first, abs=5e-3)
    assert points.ship[0, :2] - corner == pytest.approx([5 * points.received_s[0], 0], abs=1e-6)


def test_every_ping_arrives_when_sound_has_travelled():
    points = sail_hexagon(SCENARIOS[6], 700)
    assert points.received_s - points.emitted_s == pytest.approx(points.range_m / SOUND_SPEED_MPS, abs=1e-11)


def test_the_ship_passes_over_beacon_2_on_its_fourth_leg():
    """Section 4.3: at 1 m/s after about 40 experiments of spacing 45."""
    points = sail_hexagon(SCENARIOS[2], 45 * 45, speed_mps=1.0)
    away = np.hypot(*(points.ship - points.beacon)[:, :2].T)
    assert away.min() < 1.0
    assert 3000 < points.received_s[away.argmin()] < 4000


@pytest.mark.parametrize("scenario", [3, 6])
def test_the_bound_is_that_of_all_unknowns_ship_positions_included(scenario):
    """Information of beacon, emission time and every true ship position, from times and from logged positions."""
    points, gps = sail_hexagon(SCENARIOS[scenario], 90, speed_mps=20.0), 4.0
    direction = (points.beacon - points.ship) / points.range_m[:, None]
    count, beacon = len(direction), 6 if points.scenario.moving else 3
    times = np.zeros((count, beacon + 1 + 2 * count))
    times[:, :3], times[:, beacon] = direction, 1.0
    if points.scenario.moving:
        times[:, 3:6] = direction * points.emitted_s[:, None]
    for n in range(count):
        times[n, beacon + 1 + 2 * n : beacon + 3 + 2 * n] = -direction[n, :2]
    information = times.T @ times / RANGE_RMS_M**2
    logged = np.arange(beacon + 1, beacon + 1 + 2 * count)
    information[logged, logged] += 1 / gps**2
    wanted = np.sqrt(np.diag(np.linalg.inv(information)))[:beacon]
    assert position_bound(points, gps, RANGE_RMS_M) == pytest.approx(wanted, rel=1e-6)


def test_the_bound_of_what_cannot_be_seen_is_infinite():
    assert np.isinf(position_bound(sail_hexagon(SCENARIOS[1], 3), 3.0, 0.4)).all()
    assert np.isinf(position_bound(sail_hexagon(SCENARIOS[1], 200, speed_mps=0.0), 3.0, 0.4)).all()


@pytest.mark.parametrize("gps_rms_m", [3.0, 25.0])
@pytest.mark.parametrize("scenario", [1, 2, 3, 4, 5, 6])
def test_the_bound_is_reached_and_the_stated_ellipsoid_is_true(scenario, gps_rms_m):
    """1000 trials: a ratio is known to 0.022, a coverage of 0.95 to 0.007, a mean to 0.032; three of each are allowed.

    Over 10,000 trials the ratios are 0.99 to 1.03, the coverage 0.947 to 0.954 and the bias below 0.04 of the error.
    """
    trials = run_trials(sail_hexagon(SCENARIOS[scenario], 25 * 45 + 1), gps_rms_m, 1000, seed=11)
    assert trials.converged.all()
    assert (trials.rmse / trials.bound < 1.03 + 3 * 0.022).all()
    assert (trials.rmse / trials.bound > 1 - 3 * 0.022).all()
    assert trials.coverage == pytest.approx(0.95, abs=0.005 + 3 * 0.007)
    assert (np.abs(trials.bias) < (0.04 + 3 * 0.032) * trials.rmse).all()


@pytest.mark.parametrize("gps_rms_m", [3.0, 25.0])
@pytest.mark.parametrize("scenario", [1, 2, 3])
def test_still_beacons_are_at_the_bound_with_the_ship_at_1_mps_too(scenario, gps_rms_m):
    """600 trials: a ratio is known to 0.029, a coverage to 0.009; three of each are allowed."""
    trials = run_trials(
        sail_hexagon(SCENARIOS[scenario], 25 * 45 + 1, speed_mps=1.0), gps_rms_m, 600, seed=12
    )
    assert trials.converged.all()
    assert (trials.rmse / trials.bound < 1.05 + 3 * 0.029).all()
    assert (trials.rmse / trials.bound > 1 - 3 * 0.029).all()
    assert trials.coverage == pytest.approx(0.95, abs=0.01 + 3 * 0.009)


def test_the_same_seed_gives_the_same_trials_and_another_gives_others():
    points = sail_hexagon(SCENARIOS[2], 200)
    one, same, other = (run_trials(points, 3.0, 5, seed).estimate for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_calls_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="receptions"):
        sail_hexagon(SCENARIOS[1], 0)
    with pytest.raises(ValueError, match="speed"):
        sail_hexagon(SCENARIOS[1], 10, speed_mps=1600.0)
    with pytest.raises(ValueError, match="trials"):
        run_trials(sail_hexagon(SCENARIOS[1], 10), 3.0, 0, 1)
