"""A track that bends, as a polynomial in point count whose degree a test chooses.

The report runs everything against straight lines, (28)-(37), and marks by hand the sets whose track is curved. Here
the degree goes up from the straight line's while one more lowers the residual more than chance would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from trackerlib.crossover.straight_line import MIN_POINTS, StraightLine, fit_straight_line

SIGNIFICANCE = 1e-3
MOST_DEGREES = 8


@dataclass(frozen=True, eq=False)
class SmoothTrack:
    """A polynomial of each coordinate in point count."""

    coefficients: np.ndarray  # (degree + 1, 3), highest power first
    middle_count: float
    half_span: float

    @property
    def degree(self) -> int:
        """Of the polynomial; 1 is a straight line at constant speed."""
        return len(self.coefficients) - 1

    def at(self, point_count) -> np.ndarray:
        """Positions (T, 3) at point counts (T,)."""
        share = (np.asarray(point_count, float) - self.middle_count) / self.half_span
        return np.vander(share, len(self.coefficients)) @ self.coefficients


def choose_degree(track: np.ndarray, point_count: np.ndarray, significance: float = SIGNIFICANCE) -> int:
    """The degree, from 1, beyond which neither of two more lowers the residual of a track (T, 3) significantly.

    An F test on the sum over the three axes, at each degree against the next two, so that a bend whose next power
    happens to vanish is not missed. Fewer than MIN_POINTS points are never more than a line.
    """
    points = len(track)
    if points < MIN_POINTS:
        return 1
    share, _, _ = _shares(point_count)
    most = min(MOST_DEGREES, points - 3)
    degree = 1
    while degree < most:
        here = _left(track, share, degree)
        higher = [
            more
            for more in range(degree + 1, min(degree + 2, most) + 1)
            if _chance(here, _left(track, share, more), more - degree, points - more - 1) < significance
        ]
        if not higher:
            break
        degree = higher[0]
    return degree


def is_curved(track: np.ndarray, point_count: np.ndarray, significance: float = SIGNIFICANCE) -> bool:
    """Whether a track (T, 3) bends: the test asks for more than a straight line at constant speed."""
    return choose_degree(track, point_count, significance) > 1


def fit_track(
    track: np.ndarray, point_count: np.ndarray, keep: np.ndarray | None = None, degree: int | None = None
) -> StraightLine | SmoothTrack:
    """The smooth course of a track (T, 3) from the points where `keep` is true.

    degree : of the polynomial; None: chosen by `choose_degree`; 1 is the report's straight line
    Raises ValueError with fewer than two different point counts.
    """
    keep = np.ones(len(track), bool) if keep is None else keep
    counts = np.asarray(point_count, float)[keep]
    degree = choose_degree(track[keep], counts) if degree is None else degree
    if degree == 1:
        return fit_straight_line(track, point_count, keep)
    share, middle, half = _shares(counts)
    basis = np.vander(share, degree + 1)
    return SmoothTrack(np.linalg.lstsq(basis, track[keep], rcond=None)[0], middle, half)


def degree_of(course: StraightLine | SmoothTrack) -> int:
    """Degree of a course: 1 for a straight line."""
    return course.degree if isinstance(course, SmoothTrack) else 1


def _shares(point_count) -> tuple[np.ndarray, float, float]:
    counts = np.asarray(point_count, float)
    middle = float(counts.max() + counts.min()) / 2
    half = max(float(np.ptp(counts)) / 2, 1e-9)
    return (counts - middle) / half, middle, half


def _left(track: np.ndarray, share: np.ndarray, degree: int) -> float:
    basis = np.vander(share, degree + 1)
    return float(np.sum((track - basis @ np.linalg.lstsq(basis, track, rcond=None)[0]) ** 2))


def _chance(here: float, there: float, more: int, freedom: int) -> float:
    """How often noise alone would lower the squares of three axes from `here` to `there` by `more` powers."""
    if freedom < 1:
        return 1.0
    ratio = (here - there) / (3 * more) / max(there / (3 * freedom), 1e-12)
    return float(stats.f.sf(ratio, 3 * more, 3 * freedom))
