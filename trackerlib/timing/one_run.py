"""Do the offsets of one run agree within their own sigmas, and which array stands in the way?

    verdict = judge_run(sets, [fit_timing(one, survey, profile) for one in sets])
    print(verdict.simplest)

Beside the report's test (20)-(27), which takes its variances from many runs, one run alone can be judged by what each
offset says of itself: Aitken's mean (26) and distance (27) with the stated variances for V. Where three arrays see a
point count at once, their three sets hold two gaps, and the offsets are not independent: V has their covariances too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.stats import chi2

from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.timing.correction import TimingCorrection

MOST_LIKELY = 0.05  # p-value from which offsets pass for one
OWN = 0.1  # least eigenvalue of the offsets' correlation at which a sum of them says anything that others do not


@dataclass(frozen=True)
class Agreement:
    """One offset, or an offset and a drift, for all sets of a run."""

    left_out: int | None  # array whose sets take no part
    offsets: int
    offset_s: float  # at the mean point count of the sets
    sigma_offset_s: float
    drift_s_per_count: float  # zero where none is allowed
    sigma_drift_s_per_count: float
    mean_count: float
    distance: float
    dof: int
    p_value: float

    @property
    def agree(self) -> bool:
        """Whether the scatter is one that the sigmas allow."""
        return self.p_value >= MOST_LIKELY

    @property
    def scatter(self) -> float:
        """By how much the offsets scatter more than their sigmas say."""
        return float(np.sqrt(self.distance / self.dof)) if self.dof else 0.0


def offsets_agree(
    offset_s: np.ndarray,
    sigma_s: np.ndarray,
    point_count: np.ndarray,
    drift: bool = False,
    left_out: int | None = None,
    correlation: np.ndarray | None = None,
) -> Agreement:
    """Whether offsets (N,), known to sigma_s (N,) at point counts (N,), are one, or with `drift` a straight line.

    correlation : (N, N) of the offsets' errors, of `offsets_correlation`; None: independent
    Raises ValueError with fewer than two offsets.
    """
    offset, weight = np.asarray(offset_s, float), 1 / np.asarray(sigma_s, float) ** 2
    if len(offset) < 2:
        raise ValueError(f"{len(offset)} offsets cannot be compared; wanted two or more")
    middle = float(np.average(point_count, weights=weight))
    values, vectors = np.linalg.eigh(np.eye(len(offset)) if correlation is None else correlation)
    whiten = (vectors / np.sqrt(np.maximum(values, OWN)))[:, values >= OWN].T * np.sqrt(weight)
    columns = whiten @ np.column_stack([np.ones(len(offset)), point_count - middle])[:, : 1 + drift]
    covariance = np.linalg.pinv(columns.T @ columns)
    found = covariance @ (columns.T @ (whiten @ offset))
    apart = whiten @ offset - columns @ found
    distance, dof = float(apart @ apart), len(apart) - int(np.linalg.matrix_rank(columns))
    sigma = np.sqrt(np.diag(covariance))
    return Agreement(
        left_out=left_out,
        offsets=len(offset),
        offset_s=float(found[0]),
        sigma_offset_s=float(sigma[0]),
        drift_s_per_count=float(found[1]) if drift else 0.0,
        sigma_drift_s_per_count=float(sigma[1]) if drift else 0.0,
        mean_count=middle,
        distance=distance,
        dof=dof,
        p_value=float(chi2.sf(distance, dof)) if dof else 1.0,
    )


def without_each_array(
    pairs: Sequence[tuple[int, int]],
    offset_s: np.ndarray,
    sigma_s: np.ndarray,
    point_count: np.ndarray,
    drift: bool = False,
    correlation: np.ndarray | None = None,
) -> tuple[Agreement, ...]:
    """The same with the sets of one array after the other left out, the best agreement first."""
    table = np.asarray(pairs)
    found = []
    for number in np.unique(table):
        rest = ~np.any(table == number, axis=1)
        if rest.sum() > 1 + drift:
            left = None if correlation is None else correlation[np.ix_(rest, rest)]
            table_left = offset_s[rest], sigma_s[rest], point_count[rest]
            found.append(offsets_agree(*table_left, drift, int(number), left))
    return tuple(sorted(found, key=lambda one: one.scatter))


def offsets_correlation(pairs: Sequence[tuple[int, int]], fits: Sequence[TimingCorrection]) -> np.ndarray:
    """Correlation (N, N) of the errors of the offsets of array pairs that share an array at some point counts.

    Both sets hold that array's noise there, which is taken for half of each set's M. Each fit has an M.
    """
    correlation = np.eye(len(pairs))
    for (i, one), (j, other) in combinations(enumerate(pairs), 2):
        for number in set(one) & set(other):
            _, k, m = np.intersect1d(fits[i].point_count, fits[j].point_count, return_indices=True)
            sign = 1.0 if (number == one[0]) == (number == other[0]) else -1.0
            shared = sign * (fits[i].noise + fits[j].noise) / 4
            common = np.sum(fits[i].gain[k] @ shared * fits[j].gain[m])
            size = [np.sqrt(np.sum(fit.gain @ fit.noise * fit.gain)) for fit in (fits[i], fits[j])]
            correlation[i, j] = correlation[j, i] = common / max(size[0] * size[1], 1e-300)
    return correlation


@dataclass(frozen=True, eq=False)
class RunVerdict:
    """Whether one offset serves all sets of a run, and if not, what would."""

    whole: Agreement
    drifting: Agreement  # with a drift of the clock allowed
    without: tuple[Agreement, ...]  # one array after the other left out, the best first
    without_drifting: tuple[Agreement, ...]

    @property
    def simplest(self) -> Agreement | None:
        """The first of these that the sigmas allow, None where none does."""
        tried = (self.whole, self.drifting, *self.without[:1], *self.without_drifting[:1])
        return next((one for one in tried if one.agree), None)


def judge_run(sets: Sequence[CrossoverSet], fits: Sequence[TimingCorrection | None]) -> RunVerdict:
    """The verdict on a run from the corrections of its sets; those without a sigma take no part.

    Raises ValueError with fewer than three offsets.
    """
    known = [
        (one, fit) for one, fit in zip(sets, fits, strict=True) if fit is not None and fit.sigma_offset_s
    ]
    if len(known) < 3:
        raise ValueError(f"{len(known)} sets have an offset with a sigma; wanted three or more")
    pairs = [one.pair for one, _ in known]
    correlation = offsets_correlation(pairs, [fit for _, fit in known])
    offset, sigma, count = np.array([(fit.offset_s, fit.sigma_offset_s, fit.t0) for _, fit in known]).T
    return RunVerdict(
        whole=offsets_agree(offset, sigma, count, correlation=correlation),
        drifting=offsets_agree(offset, sigma, count, drift=True, correlation=correlation),
        without=without_each_array(pairs, offset, sigma, count, correlation=correlation),
        without_drifting=without_each_array(pairs, offset, sigma, count, True, correlation),
    )
