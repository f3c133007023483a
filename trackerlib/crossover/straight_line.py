"""A track as a straight line run at constant speed, by principal components.

Read (1990), equations (28) to (37).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
