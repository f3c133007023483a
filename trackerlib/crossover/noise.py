"""Noise of a crossover set about smooth courses: covariances, M, and how it repeats in time.

Read (1990), equations (38) to (41).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.crossover.smooth_track import degree_of, fit_track
from trackerlib.crossover.straight_line import MIN_POINTS

LAGS = 27  # point counts, as in the report's Figures


@dataclass(frozen=True, eq=False)
class ResidualNoise:
    """Residual covariances of two versions of a track, (3, 3) each, in squared lengths."""

    first: np.ndarray  # D_x
    second: np.ndarray  # D_y
    cross: np.ndarray  # D_xy
    residual_x: np.ndarray  # (T, 3)
    residual_y: np.ndarray  # (T, 3)
    points: int
    degree: int = 1  # of the courses: 1 is a straight line at constant speed

    @property
    def cross_correlation(self) -> np.ndarray:
        """Correlation (3, 3) of each axis of the first track with each of the second.

        Element (i, j) is D_xy(i, j) over the deviations of x on axis i and y on axis j. Table C.1 prints it the
        other way round, see `gap_of_printed`.
        """
        size = np.sqrt(np.outer(np.diag(self.first), np.diag(self.second)))
        return self.cross / np.maximum(size, 1e-300)

    @property
    def gap(self) -> np.ndarray:
        """M (3, 3): covariance of the noise of X - Y, eq. (39)."""
        return self.first + self.second - self.cross - self.cross.T


def gap_of_printed(first: np.ndarray, second: np.ndarray, printed: np.ndarray) -> np.ndarray:
    """M (3, 3) from D_x, D_y and the correlations R_xy as Table C.1 of the report prints them.

    Its text has D_xy(i, j) over sqrt(D_x(i, i) D_y(j, j)); its program, and so its table, over
    sqrt(D_x(j, j) D_y(i, i)). Three printed values above 1 in size are right by the second.
    """
    cross = printed * np.sqrt(np.outer(np.diag(second), np.diag(first)))
    return first + second - cross - cross.T


def residual_noise(
    x: np.ndarray,
    y: np.ndarray,
    point_count: np.ndarray,
    keep: np.ndarray | None = None,
    degree: int | None = 1,
) -> ResidualNoise:
    """Covariances of two tracks (T, 3) about their own smooth courses, eqs. (38)-(39).

    keep : (T,) which points count; the same for both tracks
    degree : of the courses; 1 is the report's straight line, None the higher of what each track asks for
    Divided by T less the numbers a course takes from each axis, where the report divides by T: with few points
    its variances come out too small.
    Raises ValueError with fewer than MIN_POINTS points.
    """
    keep = np.ones(len(x), bool) if keep is None else keep
    points = int(keep.sum())
    if points < MIN_POINTS:
        raise ValueError(f"noise needs {MIN_POINTS} points or more, got {points}")
    if degree is None:
        degree = max(degree_of(fit_track(track, point_count, keep)) for track in (x, y))
    residual_x, residual_y = (
        track - fit_track(track, point_count, keep, degree).at(point_count) for track in (x, y)
    )
    kept_x, kept_y = residual_x[keep], residual_y[keep]
    freedom = points - (degree + 1)
    return ResidualNoise(
        first=kept_x.T @ kept_x / freedom,
        second=kept_y.T @ kept_y / freedom,
        cross=kept_x.T @ kept_y / freedom,
        residual_x=residual_x,
        residual_y=residual_y,
        points=points,
        degree=degree,
    )


def displacement(residual: np.ndarray) -> np.ndarray:
    """Length (T,) of each residual (T, 3), d(t) of eq. (40)."""
    return np.linalg.norm(residual, axis=1)


@dataclass(frozen=True, eq=False)
class Autocorrelation:
    """How a series repeats itself, by lag in point counts."""

    lag: np.ndarray  # (L,) from 0
    value: np.ndarray  # (L,) R(h)/R(0) of eq. (41); NaN where no two points are that far apart
    pairs: np.ndarray  # (L,) how many two points are
    band: np.ndarray  # (L,) what white noise stays within, either side of zero, 95 times in 100


def autocorrelation(series: np.ndarray, point_count: np.ndarray, lags: int = LAGS) -> Autocorrelation:
    """Autocorrelation of a series (T,) by lag in point counts, R(h)/R(0) of eq. (41), with a band.

    Gaps are allowed: the products at a lag are those of points that many counts apart, however many rows
    lie between (the report's program correlates rows and calls them point counts).
    """
    counts = np.asarray(point_count, np.int64)
    deviation = series - series.mean()
    total = float(deviation @ deviation)
    value, pairs = np.full(lags + 1, np.nan), np.zeros(lags + 1, int)
    for lag in range(lags + 1):
        late = np.searchsorted(counts, counts + lag)
        early = np.flatnonzero(
            (late < len(counts)) & (counts[np.minimum(late, len(counts) - 1)] == counts + lag)
        )
        pairs[lag] = len(early)
        if len(early):
            value[lag] = deviation[early] @ deviation[late[early]]
    # White noise: a sum of as many products, each of variance R(0)^2, over T R(0).
    band = 1.96 * np.sqrt(pairs) / max(len(series), 1)
    return Autocorrelation(np.arange(lags + 1), value / total if total > 0 else value, pairs, band)
