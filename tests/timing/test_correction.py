"""Timing offset and drift: by hand, always true, printed values, and with known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.simulation.crossover_runs import ClockTruth, simulate_crossover
from trackerlib.timing.correction import corrected_tracks, estimate_timing
from trackerlib.timing.stretch import Stretch, stretch

PROFILE = SoundSpeedProfile.from_layer_middles(
    np.arange(0.0, 1350.0, 25.0), 4880.0 - 30 * (1 - np.exp(-np.arange(54) / 4)) + 0.45 * np.arange(54)
)
LEFT, RIGHT = np.array([20_000.0, 0.0, -1300.0]), np.array([27_000.0, -200.0, -1310.0])
# Tracks between the two arrays: along their line, across it, and bending.
COUNTS = np.arange(1, 61)
ALONG = np.column_stack([22_000 + 50.0 * COUNTS, 900 + 2.0 * COUNTS, np.full(60, -400.0)])
ACROSS = np.column_stack([23_600 + 3.0 * COUNTS, -1800 + 60.0 * COUNTS, -300 - 2.0 * COUNTS])
BENDING = np.column_stack([22_300 + 40.0 * COUNTS, 600 + 0.6 * (COUNTS - 30.0) ** 2, np.full(60, -60.0)])
GEOMETRIES = {"along": ALONG, "across": ACROSS, "bending": BENDING}


def stretches_of(velocity_x, velocity_y):
    ones = np.ones(len(velocity_x))
    return tuple(Stretch(np.asarray(v, float), ones, ones, ones > 0) for v in (velocity_x, velocity_y))


def pair_of(gap, counts, base=None):
    gap = np.asarray(gap, float)
    base = np.zeros_like(gap) if base is None else base
    return CrossoverSet((1, 2), np.asarray(counts), base + gap, base)


def fit(crossover, left=LEFT, right=RIGHT):
    return estimate_timing(
        crossover, stretch(crossover.x, left, PROFILE), stretch(crossover.y, right, PROFILE)
    )


def test_two_counts_by_hand():
    # a - b = (2, 0, 0) and X - Y = (-6, 0, 0) at both: offset = 2 x 6 x 2 / (2 x 4) = 3, drift 0
    found = estimate_timing(
        pair_of([[-6, 0, 0]] * 2, [10, 12]), *stretches_of([[2, 0, 0]] * 2, [[0, 0, 0]] * 2)
    )
    assert (found.offset_s, found.drift_s_per_count, found.t0) == (3, 0, 11)
    assert found.sigma_offset_s is None
    assert "2 points are too few" in found.reason


def test_drift_by_hand():
    # c = (1, 0, 0); gaps -1, -2, -3 at counts 0, 1, 2: offset 2 at t0 = 1, drift 1 a count.
    found = estimate_timing(
        pair_of([[-1, 0, 0], [-2, 0, 0], [-3, 0, 0]], [0, 1, 2]),
        *stretches_of([[1, 0, 0]] * 3, [[0, 0, 0]] * 3),
    )
    assert (found.offset_s, found.drift_s_per_count, found.t0) == pytest.approx((2, 1, 1))
    assert found.rms_after == pytest.approx(0)


def test_t0_is_the_mean_count_weighted_by_the_directions():
    # |c|^2 = 1 and 9 at counts 0 and 10: t0 = 9 (eq. 9)
    found = estimate_timing(
        pair_of([[0, 0, 0]] * 2, [0, 10]), *stretches_of([[1, 0, 0], [3, 0, 0]], [[0, 0, 0]] * 2)
    )
    assert found.t0 == 9


@pytest.mark.parametrize("seed", range(10))
def test_offset_and_drift_are_the_least_squares_solution(seed):
    rng = np.random.default_rng(seed)
    c, gap, counts = (
        rng.normal(size=(40, 3)),
        rng.normal(size=(40, 3)),
        np.sort(rng.choice(900, 40, replace=False)),
    )
    found = estimate_timing(pair_of(gap, counts), *stretches_of(c, np.zeros((40, 3))))
    keep = ~found.excluded
    basis = np.column_stack([c[keep].ravel(), ((counts[keep] - found.t0)[:, None] * c[keep]).ravel()])
    direct = -np.linalg.lstsq(basis, gap[keep].ravel(), rcond=None)[0]
    assert [found.offset_s, found.drift_s_per_count] == pytest.approx(direct)


@pytest.mark.parametrize("seed", range(10))
def test_what_remains_is_orthogonal_to_the_directions(seed):
    rng = np.random.default_rng(seed)
    crossover = simulate_crossover(ALONG, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(2e-3), rng)
    first, second = stretch(crossover.x, LEFT, PROFILE), stretch(crossover.y, RIGHT, PROFILE)
    found = estimate_timing(crossover, first, second)
    keep = ~found.excluded
    c, left = (first.velocity - second.velocity)[keep], found.residual[keep]
    t = crossover.point_count[keep] - found.t0
    size = np.abs(c * left).sum()
    assert abs(np.sum(c * left)) < 1e-9 * size  # eq. (13)
    assert abs(np.sum(t[:, None] * c * left)) < 1e-8 * size
    assert abs(np.sum(t * np.sum(c * c, axis=1))) < 1e-6 * np.sum(c * c)


@pytest.mark.parametrize("seed", range(8))
def test_offset_ignores_how_the_range_axes_are_turned(seed):
    rng = np.random.default_rng(seed)
    crossover = simulate_crossover(ACROSS, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(-1.5e-3), rng)
    turn = Rotation.from_euler("z", rng.uniform(0, 360), degrees=True).as_matrix()
    turned = replace(crossover, x=crossover.x @ turn.T, y=crossover.y @ turn.T)
    assert fit(turned, turn @ LEFT, turn @ RIGHT).offset_s == pytest.approx(fit(crossover).offset_s, abs=1e-7)


def test_changing_the_arrays_over_changes_nothing():
    crossover = simulate_crossover(
        ALONG, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(1e-3), np.random.default_rng(1)
    )
    other = replace(crossover, x=crossover.y, y=crossover.x)
    assert fit(other, RIGHT, LEFT).offset_s == pytest.approx(fit(crossover).offset_s)
    assert fit(other, RIGHT, LEFT).sigma_offset_s == pytest.approx(fit(crossover).sigma_offset_s)


def test_two_identical_tracks_have_no_offset():
    crossover = CrossoverSet((1, 2), COUNTS, ALONG, ALONG)
    found = fit(crossover)
    assert found.offset_s == 0
    assert found.rms_before == found.rms_after == 0


@pytest.mark.parametrize("name", GEOMETRIES)
def test_without_noise_the_truth_comes_back(name):
    truth = ClockTruth(3e-3, 2e-6, 30.0)
    crossover = simulate_crossover(
        GEOMETRIES[name], COUNTS, (LEFT, RIGHT), PROFILE, truth, np.random.default_rng(0), noise_ft=0.0
    )
    found = fit(crossover)
    # Stretching is along the ray of the reported place, not of the true one: 15 ft away, a millionth.
    assert found.offset_s == pytest.approx(truth.at(found.t0), abs=2e-6)
    assert found.rms_after < 0.2


@pytest.mark.parametrize("correlation", [0.0, 0.2])
def test_stated_sigmas_are_true(correlation):
    """Bias below 0.002 ms and 95 % intervals that hold 94 to 96 %, of noise that hangs together in time too.

    The report's formula alone holds 88 % of the latter; tests/benchmarks/study_timing_coverage.py has more runs.
    """
    truth, runs, inside = ClockTruth(2.5e-3, 1e-6, 30.0), 250, np.zeros(2)
    for k, track in enumerate(GEOMETRIES.values()):
        error, before = np.zeros((runs, 2)), inside.copy()
        for seed in range(runs):
            rng = np.random.default_rng([seed, k, 7])
            crossover = simulate_crossover(
                track, COUNTS, (LEFT, RIGHT), PROFILE, truth, rng, 1.5, 0.4, correlation
            )
            found = fit(crossover)
            sigma = np.array([found.sigma_offset_s, found.sigma_drift_s_per_count])
            error[seed] = (
                found.offset_s - truth.at(found.t0), found.drift_s_per_count - truth.drift_s_per_count
            )  # fmt: skip
            inside += np.abs(error[seed]) < 1.96 * sigma
        bias, standard_error = error[:, 0].mean(), error[:, 0].std() / np.sqrt(runs)
        assert abs(bias) < 2e-6 + 2 * standard_error
        low, high = stats.binom.ppf([0.0005, 0.9995], runs, 0.95)
        assert np.all((low <= inside - before) & (inside - before <= high)), (inside - before) / runs
    tried = runs * len(GEOMETRIES)
    low, high = stats.binom.ppf(0.001, tried, 0.94), stats.binom.ppf(0.999, tried, 0.96)
    assert np.all((low <= inside) & (inside <= high)), inside / tried


def test_outliers_are_left_out_of_the_offset_and_of_the_noise_and_listed():
    rng = np.random.default_rng(4)
    crossover = simulate_crossover(ALONG, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(2e-3), rng)
    clean = fit(crossover)
    wild = crossover.x.copy()
    wild[[7, 33]] += [[300.0, -80.0, 20.0], [0.0, 60.0, 0.0]]
    found = fit(replace(crossover, x=wild))
    assert np.flatnonzero(found.excluded).tolist() == [7, 33]
    assert found.points == 58
    assert found.offset_s == pytest.approx(clean.offset_s, abs=3 * clean.sigma_offset_s)
    assert np.trace(found.noise) < 2 * np.trace(clean.noise)


@pytest.mark.parametrize("points", [1, 2, 4])
def test_too_few_points_have_no_sigma_and_say_so(points):
    crossover = simulate_crossover(
        ALONG, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(2e-3), np.random.default_rng(4)
    )
    found = fit(crossover.only(np.arange(60) < points))
    assert found.sigma_offset_s is None
    assert f"{points} point" in found.reason
    assert "too few for a sigma" in found.reason
    assert np.isfinite(found.offset_s)


def test_a_bend_is_noticed():
    rng = np.random.default_rng(2)
    for track, bends in ((ALONG, False), (BENDING, True)):
        crossover = simulate_crossover(track, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(1e-3), rng)
        assert fit(crossover).curved is bends


def test_correcting_brings_the_tracks_together():
    crossover = simulate_crossover(
        ALONG, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(3e-3), np.random.default_rng(5)
    )
    first, second = stretch(crossover.x, LEFT, PROFILE), stretch(crossover.y, RIGHT, PROFILE)
    found = estimate_timing(crossover, first, second)
    x, y = corrected_tracks(crossover, first, second, found.offset_s, found.drift_s_per_count, found.t0)
    assert np.allclose(x - y, found.residual)
    assert found.rms_after < 0.5 * found.rms_before
    assert np.abs(x - ALONG).mean() < np.abs(crossover.x - ALONG).mean()


def test_it_prints_as_a_report_would():
    crossover = simulate_crossover(
        ALONG, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(3e-3), np.random.default_rng(5)
    )
    assert str(fit(crossover)).startswith("offset 3.0")
    assert "(T = 60)" in str(fit(crossover))


def test_the_direction_of_stretch_is_the_rays_at_the_target():
    """Straight up, and in water of one speed, the ray is the line from the array."""
    water = SoundSpeedProfile.constant(4850.0)
    found = stretch(np.array([[20_000.0, 0.0, -300.0], [21_000.0, 1000.0, -300.0]]), LEFT, water)
    assert found.velocity[0] == pytest.approx([0, 0, 4850.0])
    line = np.array([1000.0, 1000.0, 1000.0]) / np.sqrt(3)
    assert found.velocity[1] == pytest.approx(4850.0 * line / np.linalg.norm(line))


def test_the_elevation_differs_between_target_and_array_in_real_water():
    found = stretch(ALONG, LEFT, PROFILE)
    offset = ALONG - LEFT
    straight = np.arctan2(offset[:, 2], np.hypot(offset[:, 0], offset[:, 1]))
    assert np.abs(found.elevation - straight).max() > 1e-3


def simulated(seed: int, track=ALONG, offset_s: float = 3e-3, noise_ft: float = 1.0) -> CrossoverSet:
    return simulate_crossover(
        track, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(offset_s), np.random.default_rng(seed), noise_ft
    )


def fitted(crossover, **options):
    return estimate_timing(
        crossover, stretch(crossover.x, LEFT, PROFILE), stretch(crossover.y, RIGHT, PROFILE), **options
    )


def test_q_is_the_mean_squared_gap():
    crossover = simulated(1)
    found = fitted(crossover, outliers="in")
    c = stretch(crossover.x, LEFT, PROFILE).velocity - stretch(crossover.y, RIGHT, PROFILE).velocity
    for offset, drift in ((0.0, 0.0), (4e-3, 1e-5)):
        g = offset + drift * (COUNTS - found.t0)
        direct = np.mean(np.sum((crossover.gap + g[:, None] * c) ** 2, axis=1))
        assert found.q_surface(np.array([offset]), np.array([drift]))[0, 0] == pytest.approx(direct)


def test_q_of_a_joint_fit_is_the_mean_squared_gap_too_though_not_its_least():
    crossover = simulated(1)
    found = fitted(replace(crossover, x=crossover.x + np.array([0, 0, 3.0])), outliers="in", method="joint")
    c = stretch(crossover.x, LEFT, PROFILE).velocity - stretch(crossover.y, RIGHT, PROFILE).velocity
    for offset, drift in ((0.0, 0.0), (4e-3, 1e-5)):
        g = offset - found.offset_s + (drift - found.drift_s_per_count) * (COUNTS - found.t0)
        direct = np.mean(np.sum((found.residual + g[:, None] * c) ** 2, axis=1))
        assert found.q_surface(np.array([offset]), np.array([drift]))[0, 0] == pytest.approx(direct, rel=1e-3)


def test_clean_sets_of_few_points_lose_none():
    lost = [
        fit(simulated(seed).only(np.linspace(0, 59, points).astype(int))).excluded.any()
        for points in (6, 8, 10, 15)
        for seed in range(60)
    ]
    assert np.mean(lost) < 0.035


def test_a_joint_fit_of_few_points_says_how_little_they_tell_of_the_weights():
    score = []
    for points in (6, 12, 14):
        for seed in range(60):
            one = simulated(seed).only(np.linspace(0, 59, points).astype(int))
            noise = np.random.default_rng(1000 + seed).normal(0, 4, (points, 1)) * [1.0, 1.0, 0.2]
            found = fitted(replace(one, x=one.x + noise), method="joint")
            assert found.settled
            score.append((found.offset_s - 3e-3) / found.sigma_offset_s)
    assert np.mean(np.abs(score) < 1.96) > 0.93


def test_few_points_without_a_separation_show_none():
    flagged = [
        fit(simulated(seed).only(np.linspace(0, 59, points).astype(int))).separated != ()
        for points in (6, 8)
        for seed in range(100)
    ]
    assert np.mean(flagged) < 0.03


def test_an_offset_is_no_bend():
    # Close by an array the stretch turns with the bearing: a straight track looks bent until it is corrected.
    beside = np.column_stack([20_000 + 50.0 * (COUNTS - 30), np.full(60, 300.0), np.full(60, -900.0)])
    bent = [fit(simulated(seed, beside, 15e-3)).curved for seed in range(30)]
    assert np.mean(bent) < 0.1


def test_a_joint_fit_is_surer_where_noise_has_a_direction_and_as_true():
    errors, sigmas = [], []
    for seed in range(60):
        one = simulated(seed)
        noise = np.random.default_rng(1000 + seed).normal(0, 6, (60, 1)) * [1.0, 1.0, 0.0]
        noisy = replace(one, x=one.x + noise)
        both = [fitted(noisy, method=method) for method in ("report", "joint")]
        errors.append([fit.offset_s - 3e-3 for fit in both])
        sigmas.append([fit.sigma_offset_s for fit in both])
        assert both[1].settled
    spread, stated = np.std(errors, axis=0), np.mean(sigmas, axis=0)
    assert spread[1] < 0.8 * spread[0]
    assert stated == pytest.approx(spread, rel=0.25)
    assert np.mean(np.abs(np.array(errors) / sigmas) < 1.96) > 0.88


def test_outliers_may_count_for_the_offset_alone_as_the_report_let_them():
    crossover = simulated(2)
    wild = crossover.x.copy()
    wild[20] += [80.0, -60.0, 40.0]
    crossover = replace(crossover, x=wild)
    out, noise, inside = (fitted(crossover, outliers=way) for way in ("out", "noise", "in"))
    assert (out.points, out.noise_points) == (59, 59)
    assert (noise.points, noise.noise_points) == (60, 59)
    assert (inside.points, inside.noise_points) == (60, 60)
    assert abs(out.offset_s - 3e-3) < abs(noise.offset_s - 3e-3)
    assert np.trace(inside.noise) > 3 * np.trace(out.noise)
    with pytest.raises(ValueError, match="wanted one of"):
        fitted(crossover, outliers="some")


def test_a_few_points_have_a_sigma_of_equal_noise_only():
    errors = []
    for seed in range(300):
        few = simulated(seed).only(np.array([5, 20, 40, 55]))
        found = fitted(few)
        assert found.sigma_offset_s is None
        assert found.noise is None
        errors.append((found.offset_s - 3e-3) / found.isotropic_sigma_offset_s)
    assert np.mean(np.abs(errors) < 1.96) == pytest.approx(0.95, abs=0.03)


def test_a_separation_that_timing_cannot_close_is_flagged():
    crossover = simulated(3)
    assert fitted(crossover).separated == ()
    assert fitted(replace(crossover, x=crossover.x + np.array([0.0, 0.0, 4.0]))).separated == ("vertical",)


def test_points_left_out_by_hand_count_for_nothing():
    truth = ClockTruth(2.5e-3)
    seen = simulate_crossover(ALONG, COUNTS, (LEFT, RIGHT), PROFILE, truth, np.random.default_rng(3))
    both = stretch(seen.x, LEFT, PROFILE), stretch(seen.y, RIGHT, PROFILE)
    left_out = np.isin(COUNTS, [3, 4, 50])
    with_mask = estimate_timing(seen, *both, left_out=left_out)
    rest = seen.only(~left_out)
    bare = estimate_timing(rest, stretch(rest.x, LEFT, PROFILE), stretch(rest.y, RIGHT, PROFILE))
    assert with_mask.offset_s == pytest.approx(bare.offset_s, rel=1e-12)
    assert with_mask.sigma_offset_s == pytest.approx(bare.sigma_offset_s, rel=1e-9)
    assert with_mask.excluded[left_out].all()


def test_all_points_left_out_is_said_in_words():
    seen = simulate_crossover(
        ALONG, COUNTS, (LEFT, RIGHT), PROFILE, ClockTruth(0.0), np.random.default_rng(3)
    )
    both = stretch(seen.x, LEFT, PROFILE), stretch(seen.y, RIGHT, PROFILE)
    nothing = estimate_timing(seen, *both, left_out=np.ones(60, bool))
    assert nothing.points == 0
    assert nothing.sigma_offset_s is None
    assert "no point is left" in nothing.reason
