"""Is one timing offset enough for a run, for a pair, for them all? Read (1990), (20)-(27).

components = components_of(table)
for run in runs_constant(table, variances_of(components)):
    print(run)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2
from scipy.stats import f as f_distribution

from trackerlib.timing.offsets import OffsetTable, indicator
from trackerlib.timing.variance_components import (
    VarianceComponents,
    fit_variance_components,
    profile_intervals,
)


@dataclass(frozen=True)
class Variances:
    """The three components of (21)-(22) [s^2], told or estimated."""

    day: float
    run: float
    residual: float
    freedom: float = np.inf  # degrees of freedom of the residual variance; infinite where it is told

    def __post_init__(self):
        if not (self.day >= 0 and self.run >= 0 and self.residual > 0 and self.freedom > 0):
            raise ValueError(
                f"found variances {self.day:g}, {self.run:g}, {self.residual:g}; wanted at least 0, 0 and above 0"
            )


@dataclass(frozen=True)
class Constancy:
    """A test that some effects are one and the same."""

    name: str  # of the run or pair
    mean_s: float  # (26)
    sigma_mean_s: float
    effects: int  # K, how many are compared
    distance: float  # (27); 0 for one effect
    p_value: float  # chi-square with K - 1 degrees of freedom; 1 for one effect
    p_value_estimated: (
        float | None
    )  # allowing for variances that are estimated; None where nothing else tells them

    @property
    def dof(self) -> int:
        """K - 1."""
        return self.effects - 1

    @property
    def distance_over_sd(self) -> float:
        """The last column of Table 4."""
        return self.distance / np.sqrt(2 * self.dof) if self.dof else 0.0


@dataclass(frozen=True, eq=False)
class PairEffects:
    """Offsets of every array pair with the days and runs allowed for (24), (25)."""

    pair: tuple[str, ...]
    effect_s: np.ndarray  # (K,)
    covariance_s2: np.ndarray  # (K, K)
    count: np.ndarray  # (K,) offsets of each
    coherence: tuple[Constancy, ...]  # of each pair: do its offsets over runs and days agree?
    all_alike: Constancy  # are the pairs' offsets one and the same?


def components_of(table: OffsetTable) -> VarianceComponents:
    """Components of days, runs and what is left, array pairs being fixed effects (20), (21).

    Raises ValueError where the table is too small to tell a variance.
    """
    return fit_variance_components(table.offset_s, indicator(table.pair)[0], _random(table))


def component_intervals(table: OffsetTable, components: VarianceComponents) -> np.ndarray:
    """95 % intervals (3, 2) [s^2] of day, run and residual; NaN where the pairs take one up."""
    return profile_intervals(table.offset_s, indicator(table.pair)[0], _random(table), components)


def _random(table: OffsetTable) -> dict[str, np.ndarray]:
    """Columns Z1 of days and Z2 of runs (21)."""
    runs = np.column_stack([rows.astype(float) for rows in table.runs.values()])
    return {"day": indicator(table.day)[0], "run": runs}


def estimated_variances(table: OffsetTable) -> Variances:
    """The components of a table as the tests take them. Raises ValueError as `components_of` does."""
    return variances_of(components_of(table))


def variances_of(components: VarianceComponents) -> Variances:
    """Estimated components as the tests take them."""
    day, run = components.variance
    return Variances(float(day), float(run), components.residual, components.freedom)


def covariance_of(table: OffsetTable, variances: Variances) -> np.ndarray:
    """Covariance (N, N) [s^2] of the offsets (23)."""
    day, run = _random(table).values()
    return variances.residual * np.eye(len(table)) + variances.day * day @ day.T + variances.run * run @ run.T


def runs_constant(table: OffsetTable, variances: Variances) -> tuple[Constancy, ...]:
    """Of each run: do its array pairs share one offset? Table 4 of the report."""
    return tuple(
        _with_others(_run_constant, table, rows, name, variances) for name, rows in table.runs.items()
    )


def _run_constant(table: OffsetTable, rows: np.ndarray, name: str, variances: Variances) -> Constancy:
    # Inside one run its day and itself are one constant.
    covariance = variances.residual * np.eye(int(rows.sum())) + (variances.day + variances.run)
    pairs, _ = indicator(table.pair[rows])
    return _same(name, *_effects(table.offset_s[rows], pairs, covariance))


def pair_effects(table: OffsetTable, variances: Variances) -> PairEffects:
    """Each pair's offset over all runs and days, and whether it hangs together.

    A pair is coherent where its offsets, days and runs allowed for, scatter no more than the residual does: the
    test of (27) with each of its offsets for an effect.
    """
    pairs, names = indicator(table.pair)
    effect, precision = _effects(table.offset_s, pairs, covariance_of(table, variances))
    alike = _same("all pairs", effect, precision)
    if not np.isinf(variances.freedom):
        alike = replace(alike, p_value_estimated=_f_tail(alike, variances.freedom))
    return PairEffects(
        pair=tuple(names),
        effect_s=effect,
        covariance_s2=np.linalg.inv(precision),
        count=pairs.sum(axis=0).astype(int),
        coherence=tuple(
            _with_others(_pair_coherent, table, table.pair.astype(str) == name, name, variances)
            for name in names
        ),
        all_alike=alike,
    )


def _pair_coherent(table: OffsetTable, rows: np.ndarray, name: str, variances: Variances) -> Constancy:
    """Whether the offsets of one pair, each with an effect of its own, share one effect."""
    others = indicator(table.pair[~rows])[0] if not rows.all() else np.zeros((0, 0))
    count = int(rows.sum())
    columns = np.zeros((len(table), count + others.shape[1]))
    columns[rows, :count] = np.eye(count)
    columns[~rows, count:] = others
    effect, precision = _effects(table.offset_s, columns, covariance_of(table, variances))
    own = np.linalg.inv(precision)[:count, :count]
    return _same(name, effect[:count], np.linalg.inv(own))


def _with_others(test, table: OffsetTable, rows: np.ndarray, name: str, variances: Variances) -> Constancy:
    """A test of some rows, and its p-value with variances that the other rows alone tell."""
    judged = test(table, rows, name, variances)
    if np.isinf(variances.freedom) or judged.dof < 1:
        return judged
    others = replace(
        table,
        **{column: getattr(table, column)[~rows] for column in ("day", "run", "pair", "offset_s")},
    )
    try:
        apart = estimated_variances(others)
    except ValueError:  # too few of them
        return replace(judged, p_value_estimated=None)
    return replace(judged, p_value_estimated=_f_tail(test(table, rows, name, apart), apart.freedom))


def _effects(offset, pairs, covariance) -> tuple[np.ndarray, np.ndarray]:
    """Generalised least-squares effects (24) and their precision V (25)."""
    weighed = np.linalg.solve(covariance, pairs)
    precision = pairs.T @ weighed
    return np.linalg.solve(precision, weighed.T @ offset), precision


def _same(name: str, effect: np.ndarray, precision: np.ndarray) -> Constancy:
    """Aitken's mean (26) and distance (27) of effects with a precision V."""
    total = precision.sum()
    mean = float(precision.sum(axis=0) @ effect / total)
    apart = effect - mean
    return _judged(name, mean, float(1 / total), len(effect), float(apart @ precision @ apart))


def _judged(name: str, mean: float, variance: float, effects: int, distance: float) -> Constancy:
    if effects < 2:
        return Constancy(name, mean, float(np.sqrt(variance)), effects, 0.0, 1.0, 1.0)
    p_value = float(chi2.sf(distance, effects - 1))
    return Constancy(name, mean, float(np.sqrt(variance)), effects, distance, p_value, p_value)


def _f_tail(test: Constancy, freedom: float) -> float:
    return float(f_distribution.sf(test.distance / test.dof, test.dof, freedom)) if test.dof else 1.0
