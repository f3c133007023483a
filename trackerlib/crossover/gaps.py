"""How far apart two arrays put one vehicle, in a few numbers that wild positions do not move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.straight_line import fit_straight_line

SIGMA_OF_MAD = 1.4826  # standard deviation of a normal law over its median absolute deviation
FAR_SPREADS = 8.0
HEADING_COUNTS = 4


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


def course_of(track: np.ndarray, point_count: np.ndarray) -> np.ndarray:
    """Horizontal unit vector (2,) along which a track (T, 3) goes; downrange where it goes nowhere."""
    if len(np.unique(point_count)) < 2:
        return np.array([1.0, 0.0])
    line = fit_straight_line(track, point_count)
    course = line.direction[:2] * np.sign(line.speed)
    length = np.hypot(*course)
    return course / length if length > 1e-9 else np.array([1.0, 0.0])


def distance_along(position: np.ndarray, centre: np.ndarray, course: np.ndarray) -> np.ndarray:
    """Horizontal distance (T,) of positions (T, 3) from a centre (3,) along a course (2,)."""
    return (position - centre)[:, :2] @ course


def heading_of(track: np.ndarray, point_count: np.ndarray, counts: int = HEADING_COUNTS) -> np.ndarray:
    """Heading (T,) [rad] of a track (T, 3), from the downrange axis towards crossrange.

    Of the chord over so many point counts either side, so that noise does not turn it; NaN for a single point.
    """
    if len(point_count) < 2:
        return np.full(len(point_count), np.nan)
    early = np.searchsorted(point_count, point_count - counts)
    late = np.searchsorted(point_count, point_count + counts, side="right") - 1
    # A point with no other so near takes its neighbour.
    alone = early == late
    early, late = (
        np.where(alone & (early > 0), early - 1, early),
        np.where(alone & (early == 0), late + 1, late),
    )
    chord = track[late] - track[early]
    return np.arctan2(chord[:, 1], chord[:, 0])
