"""Squared-range fixes: exact without noise, unchanged by what does not matter, refused where nothing can be seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from trackerlib.beacon.neighbours import smooth_track
from trackerlib.beacon.squared_range import fix_squared_range
from trackerlib.beacon.squared_sums import (
    BLOCK,
    COLUMNS,
    Track,
    fill_instruments,
    instrument_sums,
    lay_out,
    take_out_noise,
)
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, run_point, sail_hexagon


def survey(scenario, receptions=601):
    points = sail_hexagon(SCENARIOS[scenario], receptions)
    return points, points.ship[None].copy(), points.range_m[None] + 700.0


@pytest.mark.parametrize("scenario", [1, 2, 3, 4, 5, 6])
def test_without_noise_the_truth_comes_back(scenario):
    points, ship, ranges = survey(scenario)
    moving = points.scenario.moving
    fixes = fix_squared_range(ship, ranges, points.emitted_s, 1e-4, 1e-4, moving=moving)
    assert fixes.converged.all()
    keep = [0, 1, 2, 4, 5, 6] if moving else [0, 1, 2]
    assert fixes.estimate[0, keep] == pytest.approx(points.truth, abs=2e-3)
    assert fixes.estimate[0, 3] == pytest.approx(700.0, abs=2e-3)


def noisy(scenario, seed=3):
    points, ship, ranges = survey(scenario)
    rng = np.random.default_rng(seed)
    ship[..., :2] += rng.normal(0, 5, ship[..., :2].shape)
    return points, ship, ranges + rng.normal(0, 0.4, ranges.shape)


@pytest.mark.parametrize("scenario", [2, 5])
def test_a_shift_of_place_or_of_time_shifts_the_answer_and_nothing_else(scenario):
    points, ship, ranges = noisy(scenario)
    moving = points.scenario.moving
    one = fix_squared_range(ship, ranges, points.emitted_s, 5, 0.4, moving=moving)
    other = fix_squared_range(
        ship + np.array([3e3, -2e3, 40.0]),
        ranges + 5 * SOUND_SPEED_MPS,
        points.emitted_s,
        5,
        0.4,
        moving=moving,
    )
    moved = np.zeros(one.estimate.shape[1])
    moved[:4] = 3e3, -2e3, 40.0, 5 * SOUND_SPEED_MPS
    assert other.estimate[0] == pytest.approx(one.estimate[0] + moved, abs=1e-4)
    assert other.covariance[0] == pytest.approx(one.covariance[0], rel=1e-5, abs=1e-9)


def test_a_turn_of_the_axes_turns_the_answer():
    points, ship, ranges = noisy(1)
    turned = ship.copy()
    turned[..., 0], turned[..., 1] = -ship[..., 1], ship[..., 0]
    one, other = (fix_squared_range(s, ranges, points.emitted_s, 5, 0.4).estimate[0] for s in (ship, turned))
    assert other == pytest.approx([-one[1], one[0], one[2], one[3]], abs=1e-5)


def test_a_beacon_has_the_same_place_alone_and_among_others():
    points, ship, ranges = noisy(3)
    _, ship2, ranges2 = noisy(3, seed=4)
    alone = fix_squared_range(ship2, ranges2, points.emitted_s, 5, 0.4)
    both = fix_squared_range(
        np.concatenate([ship, ship2]), np.concatenate([ranges, ranges2]), points.emitted_s, 5, 0.4
    )
    assert np.array_equal(both.estimate[1], alone.estimate[0])


@pytest.mark.parametrize("scenario", [2, 5])
def test_where_buffers_lie_changes_no_bit(scenario):
    """Memory is dealt by chance; buffers that touch must not be taken for buffers that overlap."""
    points, ship, ranges = noisy(scenario)
    unknowns, noise = 7 if points.scenario.moving else 4, np.array([25.0, 25.0, 0.16])
    epochs = points.emitted_s
    smooth, _ = smooth_track(ship[0], epochs, noise, 200, 0.0)
    origin, theta = np.zeros(4), np.array([*points.truth[:3], 700.0, *points.truth[3:]])
    sums = np.empty((8 if unknowns == 7 else 4, COLUMNS))
    track = lay_out(ship[0], smooth, ranges[0], epochs, origin, 1.0, unknowns == 7, sums)

    def told(apart: int) -> bytes:
        """All that the sums come to with buffers, in this order, so many numbers apart."""
        parts = track.columns, track.instruments, track.weighted, track.told
        memory, placed, at = np.zeros(sum(len(part) + apart for part in parts)), [], 0
        for part in parts:
            placed.append(memory[at : at + len(part)])
            placed[-1][:] = part
            at += len(part) + apart
        columns, instruments, weighted, others = placed
        laid = Track(track.pings, track.highest, track.width, columns, others, instruments, weighted)
        found = b""
        for first in range(0, track.pings, BLOCK):
            fill_instruments(theta, laid, first, noise)
            found += instruments.tobytes() + weighted.tobytes()
        moments, spread = np.empty((unknowns, COLUMNS)), np.empty((unknowns, unknowns))
        instrument_sums(theta, laid, noise, moments, spread)
        found += moments.tobytes() + spread.tobytes()
        take_out_noise(theta, laid, noise, np.linalg.cholesky(spread), moments)
        return found + moments.tobytes()

    assert {told(apart) for apart in (0, 8, 100, 500)} == {told(20_000)}


def test_the_same_surveys_have_the_same_bits_whatever_else_is_in_memory():
    points, ship, ranges = survey(2)
    rng = np.random.default_rng(5)
    ship = ship + np.append(rng.normal(0, 3, (20, len(ship[0]), 2)), np.zeros((20, len(ship[0]), 1)), axis=2)
    ranges = ranges + rng.normal(0, 0.4, (20, len(ranges[0])))
    kept, found = [], set()
    for _ in range(60):
        kept.append(np.empty(rng.integers(1, 20_000)))
        fixes = fix_squared_range(ship.copy(), ranges.copy(), points.emitted_s.copy(), 3, 0.4)
        found.add(fixes.estimate.tobytes() + fixes.covariance.tobytes())
    assert len(found) == 1


def test_a_covariance_is_symmetric_and_positive():
    points, ship, ranges = noisy(6)
    fixes = fix_squared_range(ship, ranges, points.emitted_s, 5, 0.4, moving=True)
    assert fixes.covariance[0] == pytest.approx(fixes.covariance[0].T, rel=1e-8)
    assert (np.linalg.eigvalsh(fixes.covariance[0]) > 0).all()


@pytest.mark.parametrize(
    "ship",
    [
        np.zeros((1, 60, 3)),  # all at one place
        np.column_stack([np.linspace(0, 3000, 60), np.zeros((60, 2))])[None],  # exactly straight
        np.zeros((1, 4, 3)),  # too few
    ],
)
def test_what_cannot_be_seen_is_not_converged(ship):
    ranges = np.linalg.norm(ship - [500.0, 800.0, -2000.0], axis=2)
    fixes = fix_squared_range(ship, ranges, 2.0 * np.arange(ship.shape[1]), 3, 0.4)
    assert not fixes.converged.any()
    assert np.isnan(fixes.estimate).all()


def test_nan_is_not_converged():
    points, ship, ranges = noisy(1)
    ranges[0, 7] = np.nan
    assert not fix_squared_range(ship, ranges, points.emitted_s, 5, 0.4).converged.any()


def test_shapes_and_noise_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="wanted"):
        fix_squared_range(np.zeros((1, 9, 2)), np.zeros((1, 9)), np.zeros(9), 3, 0.4)
    with pytest.raises(ValueError, match="wanted"):
        fix_squared_range(np.zeros((1, 9, 3)), np.zeros((1, 9)), np.zeros(9), -3, 0.4)


def simulated(scenario, trials, gps_rms_m, correlation_s, seed):
    """Surveys whose ship positions err by each axis' own sigma, correlated by exp(-lag / correlation_s)."""
    points = sail_hexagon(SCENARIOS[scenario], 1126)
    rng = np.random.default_rng(seed)
    errors = rng.normal(size=(len(points.ship), trials, 2))
    if correlation_s:
        kept = np.exp(-(points.emitted_s[1] - points.emitted_s[0]) / correlation_s)
        for n in range(1, len(errors)):
            errors[n] = kept * errors[n - 1] + np.sqrt(1 - kept**2) * errors[n]
    ship = np.repeat(points.ship[None], trials, axis=0)
    ship[:, :, :2] += np.array(gps_rms_m) * errors.swapaxes(0, 1)
    return points, ship, points.range_m + rng.normal(0, 0.43, ship.shape[:2])


def coverage(fixes, points):
    keep = np.array([0, 1, 2, 4, 5, 6] if points.scenario.moving else [0, 1, 2])
    errors = fixes.estimate[:, keep] - points.truth
    whitened = np.linalg.solve(fixes.covariance[:, keep][:, :, keep], errors[..., None])[..., 0]
    return np.mean(np.sum(errors * whitened, axis=1) < chi2.ppf(0.95, len(keep)))


@pytest.mark.parametrize("scenario", [3, 5])
def test_each_axis_has_its_own_sigma(scenario):
    """The wrong way round, the same errors are not covered: 600 trials know a coverage to 0.009."""
    points, ship, ranges = simulated(scenario, 600, (2.0, 9.0), 0.0, seed=4)
    how = {"moving": points.scenario.moving}
    told = fix_squared_range(ship, ranges, points.emitted_s, (2.0, 9.0), 0.43, **how)
    turned = fix_squared_range(ship, ranges, points.emitted_s, (9.0, 2.0), 0.43, **how)
    assert told.converged.all()
    assert coverage(told, points) == pytest.approx(0.95, abs=0.027)
    assert abs(coverage(turned, points) - 0.95) > 0.03
    errors = told.estimate[:, :3] - points.truth[:3]
    assert (np.abs(errors.mean(axis=0)) < 4 / np.sqrt(600) * errors.std(axis=0)).all()


@pytest.mark.parametrize("scenario", [1, 3, 4])
def test_errors_correlated_in_time_are_stated_as_they_are(scenario):
    """White noise treatment claims a quarter of the true sigma, and is biased where depth rests on small changes."""
    points, ship, ranges = simulated(scenario, 600, (3.0, 3.0), 30.0, seed=5)
    how = {"moving": points.scenario.moving}
    told = fix_squared_range(ship, ranges, points.emitted_s, 3.0, 0.43, correlation_s=30.0, **how)
    white = fix_squared_range(ship, ranges, points.emitted_s, 3.0, 0.43, **how)
    assert told.converged.all()
    assert coverage(told, points) == pytest.approx(0.95, abs=0.027)
    assert coverage(white, points) < 0.15
    errors = told.estimate[:, :3] - points.truth[:3]
    assert (np.abs(errors.mean(axis=0)) < 0.2 * errors.std(axis=0)).all()
    biased = white.estimate[:, 2] - points.truth[2]
    assert (abs(biased.mean()) > 0.25 * biased.std()) == (scenario == 1)


def test_correlated_errors_need_instants_in_order():
    points, ship, ranges = noisy(1)
    with pytest.raises(ValueError, match="order"):
        fix_squared_range(ship, ranges, points.emitted_s[::-1], 5, 0.4, correlation_s=9.0)


def test_an_ellipsoid_of_a_bent_valley_still_holds_the_truth():
    """Slow ship, moving beacon: the places that fit lie on a curve 20 standard errors off straight."""
    study = run_point(4, 25, 45, 3.0, trials=400, seed=5, method="all-pings", speed_mps=1.0)
    assert study.converged.mean() > 0.995
    assert 0.925 < study.coverage < 0.98  # four standard errors about 0.955


@pytest.mark.parametrize("scenario", [4, 5, 6])
def test_noise_that_rules_the_geometry_is_refused_whatever_the_draw(scenario):
    """The bound is 70 to 500 m: a fix now and then that claims less would be one that is lucky in its claim only."""
    study = run_point(scenario, 25, 45, 25.0, trials=100, seed=5, method="all-pings", speed_mps=1.0)
    assert not study.converged.any()
    assert sum(study.refused_why.values()) == 100


@pytest.mark.parametrize("gps_rms_m", [3.0, 25.0])
def test_the_ship_s_place_is_told_by_its_leg_and_not_by_the_ping_itself(gps_rms_m):
    """On a leg of a hundred pings it is known to a fifth of one position's error, at corners to about two."""
    points = sail_hexagon(SCENARIOS[1], 1126)
    rng = np.random.default_rng(2)
    noise = np.full(3, gps_rms_m**2)
    errors, own = [], []
    for _ in range(40):
        error = rng.normal(0, gps_rms_m, (len(points.ship), 2))
        ship = points.ship + np.column_stack([error, np.zeros(len(error))])
        smooth, shared = smooth_track(ship, points.emitted_s, noise, 200, 0.0)
        errors.append(smooth - points.ship[:, :2])
        own.append(error)
        assert not shared.any()
    size = np.sqrt(np.mean(np.square(errors), axis=(0, 2))) / gps_rms_m
    assert np.median(size) < 0.2
    assert np.quantile(size, 0.97) < 2
    along = np.mean(np.multiply(errors, own)) / gps_rms_m**2
    assert abs(along) < 4 * np.sqrt(np.mean(size**2)) / np.sqrt(np.size(own))
