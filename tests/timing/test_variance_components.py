"""REML against a direct search of the same likelihood, at the zero boundary too."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from trackerlib.timing.offsets import indicator
from trackerlib.timing.variance_components import (
    fit_variance_components,
    profile_intervals,
    restricted_log_likelihood,
)

RUN_SIZES = (7, 2, 10, 14, 8, 7, 8, 13)  # of the report's Table 1


def layout(seed: int):
    """A made-up unbalanced table: fixed pair columns, day and run columns."""
    rng = np.random.default_rng(seed)
    run = np.repeat(np.arange(8), RUN_SIZES)
    pairs = indicator(rng.integers(0, 11, len(run)))[0]
    return rng, pairs, {"day": indicator(run // 2)[0], "run": indicator(run)[0]}


def made_up(seed: int, day: float, run: float, residual: float = 0.25):
    """Offsets of such a table with these true variances."""
    rng, pairs, random = layout(seed)
    offset = pairs @ rng.normal(2, 1, pairs.shape[1]) + rng.normal(0, np.sqrt(residual), len(pairs))
    for columns, variance in zip(random.values(), (day, run), strict=True):
        offset = offset + columns @ rng.normal(0, np.sqrt(variance), columns.shape[1])
    return offset, pairs, random


def dense_likelihood(theta, offset, fixed, random) -> float:
    """The restricted log-likelihood from its definition, with the whole covariance (A.2), (A.3)."""
    covariance = theta[-1] * np.eye(len(offset))
    for columns, variance in zip(random.values(), theta[:-1], strict=True):
        covariance += variance * columns @ columns.T
    weighed = np.linalg.solve(covariance, fixed)
    information = fixed.T @ weighed
    apart = offset - fixed @ np.linalg.solve(information, weighed.T @ offset)
    return -0.5 * (
        np.linalg.slogdet(covariance)[1]
        + np.linalg.slogdet(information)[1]
        + apart @ np.linalg.solve(covariance, apart)
    )


def searched(offset, fixed, random) -> np.ndarray:
    """The best of many starts of a general minimiser, each component also held at zero."""
    best, lowest = None, np.inf
    for held in ((), (0,), (1,), (0, 1)):
        free = [p for p in range(3) if p not in held]

        def misfit(logs, free=free):
            theta = np.zeros(3)
            theta[free] = np.exp(logs)
            return -dense_likelihood(theta, offset, fixed, random)

        for start in (0.1, 1.0):
            found = minimize(
                misfit,
                np.log(np.full(len(free), start)),
                method="Nelder-Mead",
                options={"fatol": 1e-13, "xatol": 1e-9},
            )
            if found.fun < lowest - 1e-9:
                best, lowest = np.zeros(3), found.fun
                best[free] = np.exp(found.x)
    return best


@pytest.mark.parametrize(
    ("seed", "day", "run"), [(1, 0.36, 0.72), (2, 0.0, 0.7), (3, 0.4, 0.0), (4, 0.0, 0.0), (10, 0.2, 0.1)]
)
def test_components_are_those_of_a_direct_search(seed, day, run):
    offset, pairs, random = made_up(seed, day, run)
    fit = fit_variance_components(offset, pairs, random)
    direct = searched(offset, pairs, random)
    assert fit.converged
    assert [*fit.variance, fit.residual] == pytest.approx(direct, rel=1e-6, abs=1e-6)
    assert fit.at_boundary == tuple(
        name for name, value in zip(("day", "run"), direct, strict=False) if value < 1e-6
    )


def test_some_made_up_tables_do_have_a_component_at_zero():
    zeros = [fit_variance_components(*made_up(seed, 0.0, 0.7)).at_boundary for seed in range(12)]
    assert ("day",) in zeros
    assert () in zeros


@pytest.mark.parametrize("seed", range(4))
def test_likelihood_differs_from_its_definition_by_a_constant(seed):
    data = made_up(seed, 0.3, 0.5)
    apart = [
        restricted_log_likelihood(*data, theta) - dense_likelihood(np.array(theta), *data)
        for theta in ([0.3, 0.5, 0.25], [0.0, 1.0, 0.5], [2.0, 0.0, 0.1])
    ]
    assert np.ptp(apart) < 1e-9


def test_estimates_are_unbiased_and_intervals_hold():
    truth = np.array([0.36, 0.72, 0.25])
    found, inside = [], []
    for seed in range(150):
        offset, pairs, random = made_up(seed, *truth)
        fit = fit_variance_components(offset, pairs, random)
        found.append([*fit.variance, fit.residual])
        if seed < 8:
            low, high = profile_intervals(offset, pairs, random, fit).T
            inside.append((low <= truth) & (truth <= high))
    spread = np.std(found, axis=0) / np.sqrt(len(found))
    bias = np.mean(found, axis=0) - truth
    assert np.all(np.abs(bias[1:]) < 3 * spread[1:])
    assert 0 <= bias[0] + 3 * spread[0] < 0.3  # cut off at zero, so a little high
    assert np.mean(inside) > 0.8


@pytest.mark.parametrize("far", [1.0, 30.0, 1000.0])
def test_an_interval_is_found_for_a_residual_that_is_small_beside_the_runs(far):
    rng = np.random.default_rng(5)
    run = np.repeat([0, 1], 20)
    offset = far * run + rng.normal(0, 0.1, 40)
    fixed, random = np.ones((40, 1)), {"run": indicator(run)[0]}
    intervals = profile_intervals(offset, fixed, random, fit_variance_components(offset, fixed, random))
    assert 0.004 < intervals[1, 0] < 0.01 < intervals[1, 1] < 0.03
    assert intervals[0, 0] < far**2 / 2 < intervals[0, 1]


def test_stated_degrees_of_freedom_give_the_spread_of_the_residual_variance():
    fits = [fit_variance_components(*made_up(seed, 0.36, 0.72)) for seed in range(300)]
    spread = np.std([fit.residual for fit in fits]) / np.mean([fit.residual for fit in fits])
    stated = np.sqrt(2 / np.mean([fit.freedom for fit in fits]))
    assert spread == pytest.approx(stated, rel=0.12)


def test_one_effect_alone_agrees_with_the_analysis_of_variance():
    # Three groups of two: means 1, 3, 8, each pair 1 apart. Within 0.5; between 2 x 13 = 26; component 12.75.
    offset = np.array([0.5, 1.5, 2.5, 3.5, 7.5, 8.5])
    groups = np.kron(np.eye(3), np.ones((2, 1)))
    fit = fit_variance_components(offset, np.ones((6, 1)), {"group": groups})
    assert fit.residual == pytest.approx(0.5)
    assert fit.variance == pytest.approx([12.75])
    assert fit.freedom == pytest.approx(3)


def test_an_effect_that_the_fixed_ones_take_up_is_not_estimable():
    offset, _, random = made_up(1, 0.3, 0.5)
    fit = fit_variance_components(offset, random["run"], random)
    assert fit.not_estimable == ("day", "run")
    assert list(fit.variance) == [0, 0]


def test_a_table_that_leaves_nothing_is_refused_in_words():
    with pytest.raises(ValueError, match="leave nothing to tell a variance from"):
        fit_variance_components(np.arange(3.0), np.eye(3), {"day": np.ones((3, 1))})
    with pytest.raises(ValueError, match="fit every offset exactly"):
        fit_variance_components(np.ones(4), np.ones((4, 1)), {"day": np.eye(4)})
    run = indicator(np.repeat([0, 1, 2], 2))[0]
    with pytest.raises(ValueError, match="no variance is left for the residual"):
        fit_variance_components(run @ [3.0, 4.0, 5.0], np.ones((6, 1)), {"run": run})
