"""Noise of a crossover set about straight lines: covariances, M, and how it repeats in time.

Read (1990), equations (38) to (41).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.crossover.straight_line import MIN_POINTS, fit_straight_line

FITTED = 2  # numbers a straight line at constant speed takes from each axis: place and speed


@dataclass(frozen=True, eq=False)
class ResidualNoise:
    """Residual covariances of two versions of a track, (3, 3) each, in squared lengths."""

    first: np.ndarray  # D_x
    second: np.ndarray  # D_y
    cross: np.ndarray  # D_xy
    residual_x: np.ndarray  # (T, 3)
    residual_y: np.ndarray  # (T, 3)
    points: int

    @property
    def gap(self) -> np.ndarray:
        """M (3, 3): covariance of the noise of X - Y, eq. (39)."""
        return self.first + self.second - self.cross - self.cross.T


def residual_noise(
    x: np.ndarray, y: np.ndarray, point_count: np.ndarray, keep: np.ndarray | None = None
) -> ResidualNoise:
    """Covariances of two tracks (T, 3) about their own straight lines, eqs. (38)-(39).

    keep : (T,) which points count; the same for both tracks
    Divided by T - 2, for the place and speed a line takes from each axis, where the report divides by T:
    with few points its variances come out too small.
    Raises ValueError with fewer than MIN_POINTS points.
    """
    keep = np.ones(len(x), bool) if keep is None else keep
    points = int(keep.sum())
    if points < MIN_POINTS:
        raise ValueError(f"noise needs {MIN_POINTS} points or more, got {points}")
    residual_x = x - fit_straight_line(x, point_count, keep).at(point_count)
    residual_y = y - fit_straight_line(y, point_count, keep).at(point_count)
    kept_x, kept_y = residual_x[keep], residual_y[keep]
    freedom = points - FITTED
    return ResidualNoise(
        first=kept_x.T @ kept_x / freedom,
        second=kept_y.T @ kept_y / freedom,
        cross=kept_x.T @ kept_y / freedom,
        residual_x=residual_x,
        residual_y=residual_y,
        points=points,
    )


def displacement(residual: np.ndarray) -> np.ndarray:
    """Length (T,) of each residual (T, 3), d(t) of eq. (40)."""
    return np.linalg.norm(residual, axis=1)


def autocorrelation(series: np.ndarray, point_count: np.ndarray, lags: int = 27) -> np.ndarray:
    """Autocorrelation (lags + 1,) of a series (T,) by lag in point counts, R(h)/R(0) of eq. (41).

    Gaps are allowed: the products at a lag are those of points that many counts apart, however many rows
    lie between (the report's program correlates rows and calls them point counts). NaN where no two
    points are that far apart.
    """
    counts = np.asarray(point_count)
    deviation = series - series.mean()
    place = {int(count): k for k, count in enumerate(counts)}
    out = np.full(lags + 1, np.nan)
    for lag in range(lags + 1):
        pairs = [(k, place[int(count) + lag]) for k, count in enumerate(counts) if int(count) + lag in place]
        if pairs:
            early, late = np.array(pairs).T
            out[lag] = np.sum(deviation[early] * deviation[late]) / len(series)
    return out / out[0] if out[0] > 0 else out
