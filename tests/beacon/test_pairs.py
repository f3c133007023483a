"""Experiments of the thesis: against its own iteration written out plainly, against ODRPACK, and at their limits."""

from __future__ import annotations

import numpy as np
import odrpack
import pytest
from plain_deming import deming_fixes, least_squares_at

from trackerlib.beacon.pairs import START, SearchBox, experiments, fix_pairs
from trackerlib.compiled import in_threads
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S, sail_hexagon

RANGE_RMS_M = SOUND_SPEED_MPS * TIME_RMS_S


def survey(scenario, count, spacing, gps_rms_m, trials, speed_mps=5.0, seed=3):
    """Chained experiments of simulated surveys: ship (B, R, 3), ranges (B, R), epochs (R,), pairs (N, 2)."""
    every = np.arange(0, count * spacing + 1, spacing)
    points = sail_hexagon(SCENARIOS[scenario], count * spacing + 1, speed_mps)
    rng = np.random.default_rng(seed)
    ship = np.repeat(points.ship[every][None], trials, axis=0)
    ship[:, :, :2] += rng.normal(0, gps_rms_m, (trials, len(every), 2))
    ranges = points.range_m[every] + rng.normal(0, RANGE_RMS_M, ship.shape[:2])
    return ship, ranges + 700.0, points.emitted_s[every], experiments(count, 1)


def constraint(measured, theta, epochs1, epochs2):
    """g (N,), its slopes a (N, 6) in the measurements and b (N, P) in the beacon: (2-19), (2-61), (3-18)."""
    x1, y1, s1, x2, y2, s2 = measured.T
    place = theta[:3]
    speed = theta[3:] if len(theta) == 6 else np.zeros(3)
    dx1, dy1, dz1 = (v - place[k] - epochs1 * speed[k] for k, v in enumerate((x1, y1, 0.0)))
    dx2, dy2, dz2 = (v - place[k] - epochs2 * speed[k] for k, v in enumerate((x2, y2, 0.0)))
    d1, d2 = np.sqrt(dx1**2 + dy1**2 + dz1**2), np.sqrt(dx2**2 + dy2**2 + dz2**2)
    one = np.ones_like(d1)
    a = np.column_stack([dx1 / d1, dy1 / d1, -one, -dx2 / d2, -dy2 / d2, one])
    u1, u2 = np.column_stack([dx1, dy1, dz1]) / d1[:, None], np.column_stack([dx2, dy2, dz2]) / d2[:, None]
    b = u2 - u1
    if len(theta) == 6:
        b = np.hstack([b, epochs2[:, None] * u2 - epochs1[:, None] * u1])
    return d1 - d2 - (s1 - s2), a, b


def deming(ship, ranges, epochs, pairs, gps_rms_m, theta, steps=1000):
    """The thesis's iteration (2-60)-(2-71): beacon, its covariance and the least sum of squares, or None."""
    i, j = pairs.T
    logged = np.column_stack([ship[i, :2], ranges[i], ship[j, :2], ranges[j]])
    variance = np.array([gps_rms_m**2, gps_rms_m**2, RANGE_RMS_M**2] * 2)
    measured, theta = logged.copy(), np.array(theta, float)
    g, a, b = constraint(measured, theta, epochs[i], epochs[j])
    for _ in range(steps):
        e = measured - logged
        c = (a**2 * variance).sum(axis=1)
        before = (g**2 / c).sum()
        ae = (a * e).sum(axis=1)
        normal = (b / c[:, None]).T @ b
        move = np.linalg.solve(normal, ((ae - g) / c) @ b)
        lam = (b @ move - ae + g) / c
        correction = -e - lam[:, None] * variance * a
        share = 1.0
        while share > 1e-6:
            here, there = theta + share * move, measured + share * correction
            g, a, b = constraint(there, here, epochs[i], epochs[j])
            if (g**2 / (a**2 * variance).sum(axis=1)).sum() < before or before < 1e-3:
                break
            share /= 2
        theta, measured = here, there
        if np.sqrt(move @ normal @ move) < 1e-4:
            return theta, np.linalg.inv(normal), ((logged - measured) ** 2 / variance).sum()
    return None


@pytest.mark.parametrize(
    ("scenario", "count", "spacing", "gps_rms_m"),
    [(1, 25, 45, 3.0), (2, 25, 45, 25.0), (3, 50, 60, 25.0), (4, 30, 60, 3.0), (6, 50, 60, 25.0)],
)
def test_the_answer_is_where_the_thesis_iteration_rests(scenario, count, spacing, gps_rms_m):
    ship, ranges, epochs, pairs = survey(scenario, count, spacing, gps_rms_m, 8)
    moving = scenario > 3
    fixes = fix_pairs(ship, ranges, epochs, pairs, gps_rms_m, RANGE_RMS_M, moving=moving)
    assert fixes.converged.all()
    compared = 0
    for k in range(8):
        start = SCENARIOS[scenario].position + (SCENARIOS[scenario].velocity if moving else ())
        rest = deming(ship[k], ranges[k], epochs, pairs, gps_rms_m, start)
        if rest is None:
            continue
        compared += 1
        sigma = np.sqrt(np.diag(rest[1]))
        assert np.abs((fixes.estimate[k] - rest[0]) / sigma).max() < 0.02
        assert fixes.misfit[k] == pytest.approx(rest[2], rel=1e-3)
        assert np.sqrt(np.diag(fixes.covariance[k])) == pytest.approx(sigma, rel=0.02)
    assert compared >= 4


def by_deming(ship, ranges, epochs, pairs, gps_rms_m, moving):
    """Beacons (B, P) of 3000 steps of the thesis's iteration from its start, and which of them rest (B,)."""
    unknowns = 6 if moving else 3
    variance = np.array([gps_rms_m**2, gps_rms_m**2, RANGE_RMS_M**2])
    start, limits = np.append(START, np.zeros(unknowns - 3)), SearchBox().limits(unknowns)
    quarters = np.array_split(np.arange(len(ship)), 4)
    parts = in_threads(
        deming_fixes,
        [(ship[k], ranges[k], epochs, pairs, variance, limits, start, 3000) for k in quarters],
    )
    theirs, rests = (np.concatenate(part) for part in zip(*parts, strict=True))
    return theirs, rests


def beside_deming(told, gps_rms_m, moving):
    """Which of Deming's rest (B,), ours converging there, and how far their sums of squares are above ours."""
    ship, ranges, epochs, pairs = told
    theirs, rests = by_deming(*told, gps_rms_m, moving)
    fixes = fix_pairs(*told, gps_rms_m, RANGE_RMS_M, moving=moving)
    assert fixes.converged[rests].all()
    variance = np.array([gps_rms_m**2, gps_rms_m**2, RANGE_RMS_M**2])
    same = ship[rests], ranges[rests], epochs, pairs, variance
    least, found = least_squares_at(theirs[rests], *same), least_squares_at(fixes.estimate[rests], *same)
    assert found == pytest.approx(fixes.misfit[rests], rel=1e-5)
    return rests, least - found


@pytest.mark.parametrize("gps_rms_m", [3.0, 25.0])
def test_it_converges_wherever_three_thousand_steps_of_deming_do(gps_rms_m):
    """From the thesis's start, 50 experiments; 25 m of GPS for moving beacons, of which only some rest at all."""
    for scenario in SCENARIOS if gps_rms_m > 3 else (1, 2, 3):
        rests, gained = beside_deming(survey(scenario, 50, 45, gps_rms_m, 100), gps_rms_m, scenario > 3)
        assert rests.mean() > 0.8, scenario
        assert (gained >= -1e-4).all(), scenario


@pytest.mark.parametrize(("scenario", "lower"), [(2, 0.01), (3, 0.05), (4, 0.4), (5, 0.2), (6, 0.05)])
def test_a_slow_ship_leaves_several_minima_and_ours_is_hardly_ever_higher(scenario, lower):
    """The ship at 1 m/s, 25 m of GPS, 50 experiments: one to six minima a survey, of which Deming finds any.

    Ours was higher in 4 of 1061 that the starts were not chosen by; a narrow valley can hide from every start.
    """
    rests, gained = beside_deming(survey(scenario, 50, 45, 25.0, 60, speed_mps=1.0), 25.0, scenario > 3)
    assert rests.mean() > 0.5
    assert np.sum(gained < -1e-4) <= 1
    assert (gained > 0.01).mean() > lower


@pytest.mark.parametrize("scenario", [2, 4, 5])
def test_few_experiments_lose_little_of_what_deming_finds(scenario):
    """30 experiments 10 apart, 25 m of GPS: hardly to be told, and fewer starts are spent on them."""
    told = survey(scenario, 30, 10, 25.0, 60)
    theirs, rests = by_deming(*told, 25.0, scenario > 3)
    fixes = fix_pairs(*told, 25.0, RANGE_RMS_M, moving=scenario > 3)
    ship, ranges, epochs, pairs = told
    same = ship[rests], ranges[rests], epochs, pairs, np.array([625.0, 625.0, RANGE_RMS_M**2])
    least, found = least_squares_at(theirs[rests], *same), least_squares_at(fixes.estimate[rests], *same)
    assert rests.sum() > 30
    assert (fixes.converged[rests] & (found <= least + 1e-4)).mean() > 0.9


def test_where_it_rests_is_the_lowest_place_around():
    """No false rest of a damped step: the squares rise on every side of it, and every sigma is told."""
    ship, ranges, epochs, pairs = survey(6, 30, 10, 25.0, 100)
    fixes = fix_pairs(ship, ranges, epochs, pairs, 25.0, RANGE_RMS_M, moving=True)
    kept = fixes.converged
    assert 30 < kept.sum() < 90
    variance = np.array([625.0, 625.0, RANGE_RMS_M**2])
    told = ship[kept], ranges[kept], epochs, pairs, variance
    here = least_squares_at(fixes.estimate[kept], *told)
    sigma = np.sqrt(np.diagonal(fixes.covariance[kept], axis1=1, axis2=2))
    assert (sigma[:, 2] < 1e5).all()
    for k in range(6):
        along = fixes.covariance[kept][:, k] / sigma[:, k, None]  # likeliest where the unknown is a sigma off
        for side in (-0.01, 0.01):
            assert (least_squares_at(fixes.estimate[kept] + side * along, *told) > here - 1e-5).all()


def test_an_independent_program_finds_the_same_place():
    ship, ranges, epochs, pairs = survey(3, 25, 45, 25.0, 1)
    fix = fix_pairs(ship, ranges, epochs, pairs, 25.0, RANGE_RMS_M)
    i, j = pairs.T
    logged = np.vstack([ship[0, i, :2].T, ranges[0, i], ship[0, j, :2].T, ranges[0, j]])

    def implicit(x, beta):
        d1 = np.sqrt((x[0] - beta[0]) ** 2 + (x[1] - beta[1]) ** 2 + beta[2] ** 2)
        d2 = np.sqrt((x[3] - beta[0]) ** 2 + (x[4] - beta[1]) ** 2 + beta[2] ** 2)
        return d1 - d2 - (x[2] - x[5])

    weight = np.array([1 / 25.0**2, 1 / 25.0**2, 1 / RANGE_RMS_M**2] * 2)
    peer = odrpack.odr_fit(
        implicit, logged, np.zeros(len(i)), np.array([-1000.0, 1000.0, -2000.0]),
        weight_x=weight, task="implicit-ODR", maxit=2000,
    )  # fmt: skip
    assert peer.success
    assert fix.estimate[0] == pytest.approx(peer.beta, rel=2e-3)


def test_a_wide_valley_is_left_for_the_right_one():
    """From the thesis's start a fifth of these run to the surface."""
    ship, ranges, epochs, pairs = survey(2, 25, 45, 3.0, 500)
    fixes = fix_pairs(ship, ranges, epochs, pairs, 3.0, RANGE_RMS_M)
    assert fixes.converged.all()
    assert (np.abs(fixes.estimate[:, 2] + 2000) < 300).all()


def test_no_start_is_needed_and_none_changes_the_answer():
    ship, ranges, epochs, pairs = survey(4, 40, 60, 3.0, 50)
    one = fix_pairs(ship, ranges, epochs, pairs, 3.0, RANGE_RMS_M, moving=True)
    other = fix_pairs(
        ship, ranges, epochs, pairs, 3.0, RANGE_RMS_M, moving=True, start=(3000.0, -3000.0, -500.0)
    )
    assert one.converged.all()
    assert other.estimate == pytest.approx(one.estimate, abs=1e-3)


def test_more_experiments_than_a_block_holds():
    ship, ranges, epochs, pairs = survey(2, 150, 15, 3.0, 20)
    fixes = fix_pairs(ship, ranges, epochs, pairs, 3.0, RANGE_RMS_M)
    assert fixes.converged.all()
    assert fixes.misfit.mean() == pytest.approx(147, rel=0.15)
    assert np.abs(fixes.estimate.mean(axis=0) - [0, 866, -2000]).max() < 30


def test_a_place_outside_the_search_box_is_not_converged():
    ship, ranges, epochs, pairs = survey(3, 25, 45, 3.0, 5)
    fixes = fix_pairs(ship, ranges, epochs, pairs, 3.0, RANGE_RMS_M, box=SearchBox(range_m=800.0))
    assert not fixes.converged.any()


def test_too_little_is_not_converged_and_nonsense_is_refused():
    ship, ranges, epochs, pairs = survey(1, 3, 45, 3.0, 2)
    fixes = fix_pairs(ship, ranges, epochs, pairs, 3.0, RANGE_RMS_M)
    assert not fixes.converged.any()
    assert np.isnan(fixes.estimate).all()
    ship, lost, epochs, pairs = survey(1, 25, 45, 3.0, 2)
    lost[0, 1] = np.nan
    assert list(fix_pairs(ship, lost, epochs, pairs, 3.0, RANGE_RMS_M).converged) == [False, True]
    with pytest.raises(ValueError, match="numbers of receptions"):
        fix_pairs(ship, lost, epochs, pairs + 20, 3.0, 0.4)
    with pytest.raises(ValueError, match="noise"):
        fix_pairs(ship, lost, epochs, pairs, 0.0, 0.0)
    with pytest.raises(ValueError, match="spacing"):
        experiments(5, 0)
    with pytest.raises(ValueError, match="depth_m"):
        SearchBox(depth_m=0)


def test_experiments_chain_unless_told_to_step():
    assert experiments(3, 45).tolist() == [[0, 45], [45, 90], [90, 135]]
    assert experiments(6, 45, step=15)[-1].tolist() == [75, 120]
