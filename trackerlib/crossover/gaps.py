"""How far apart two arrays put one vehicle, in a few numbers that wild positions do not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.straight_line import StraightLine

SIGMA_OF_MAD = 1.4826  # standard deviation of a normal law over its median absolute deviation
FAR_SPREADS = 8.0


@dataclass(frozen=True, eq=False)
class GapSummary:
    """Gap between the two versions of a track, downrange, crossrange and vertical."""

    median: np.ndarray  # (3,) ft, first array's version minus the second's
    spread: np.ndarray  # (3,) ft, standard deviation of one point about it, from the median deviation
    far: np.ndarray  # (T,) true where a component is more than FAR_SPREADS spreads from the median
    points: int


def summarise_gap(crossover: CrossoverSet) -> GapSummary:
    """Median and spread of the gap of a set of one point or more; the spread of one point is NaN."""
    gap = crossover.gap
    median = np.median(gap, axis=0)
    deviation = np.abs(gap - median)
    spread = SIGMA_OF_MAD * np.median(deviation, axis=0)
    if crossover.points < 2:
        spread = np.full(3, np.nan)
    far = np.any(deviation > FAR_SPREADS * np.maximum(spread, 1.0), axis=1)
    return GapSummary(median, spread, far, crossover.points)


def distance_along(line: StraightLine, position: np.ndarray) -> np.ndarray:
    """Horizontal distance (T,) of positions (T, 3) along a line's course, from its centre, growing with time."""
    course = line.direction[:2] * np.sign(line.speed or 1.0)
    length = np.hypot(*course)
    course = course / length if length > 1e-9 else np.array([1.0, 0.0])
    return (position - line.centre)[:, :2] @ course
