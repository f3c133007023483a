"""A track as a straight line run at constant speed, by principal components.

Read (1990), equations (28) to (37).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

MIN_POINTS = 5


@dataclass(frozen=True, eq=False)
class StraightLine:
    """Where a vehicle would have been on a straight line at constant speed."""

    centre: np.ndarray  # (3,) mean of the points fitted, eq. (28)
    direction: np.ndarray  # (3,) unit vector along the largest principal component, eq. (32)
    along: float  # mean of the first component, a of eq. (35), zero by construction
    speed: float  # length per point count, b of eq. (35)
    mean_count: float

    def at(self, point_count) -> np.ndarray:
        """Positions (T, 3) at point counts (T,), eqs. (35)-(37)."""
        elapsed = np.asarray(point_count, float) - self.mean_count
        return self.centre + np.outer(self.along + self.speed * elapsed, self.direction)


def fit_straight_line(
    track: np.ndarray, point_count: np.ndarray, keep: np.ndarray | None = None
) -> StraightLine:
    """The straight line at constant speed of a track (T, 3), from the points where `keep` (T,) is true.

    Raises ValueError with fewer than two different point counts.
    """
    keep = np.ones(len(track), bool) if keep is None else keep
    points, counts = track[keep], np.asarray(point_count, float)[keep]
    if len(np.unique(counts)) < 2:
        raise ValueError(f"a straight line needs two point counts, got {len(np.unique(counts))}")
    centre = points.mean(axis=0)
    deviations = points - centre
    direction = np.linalg.svd(deviations, full_matrices=False)[2][0]
    elapsed = counts - counts.mean()
    component = deviations @ direction
    speed = float(elapsed @ component / (elapsed @ elapsed))
    return StraightLine(centre, direction, float(component.mean()), speed, float(counts.mean()))


def is_curved(track: np.ndarray, point_count: np.ndarray, significance: float = 1e-3) -> bool:
    """Whether a track (T, 3) bends: a parabola fits it better than a line, at this significance.

    An F test on the sum over the three axes; fewer than MIN_POINTS points never count as curved.
    """
    points = len(track)
    if points < MIN_POINTS:
        return False
    elapsed = np.asarray(point_count, float) - np.mean(point_count)
    elapsed = elapsed / max(np.abs(elapsed).max(), 1e-9)
    left = [
        float(np.sum((track - basis @ np.linalg.lstsq(basis, track, rcond=None)[0]) ** 2))
        for basis in (np.vander(elapsed, 2), np.vander(elapsed, 3))
    ]
    freedom = 3 * (points - 3)
    ratio = (left[0] - left[1]) / 3 / max(left[1] / freedom, 1e-12)
    return bool(stats.f.sf(ratio, 3, freedom) < significance)
