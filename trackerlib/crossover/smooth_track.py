"""A track that bends, as a polynomial in point count whose degree a test chooses.

The report runs everything against straight lines, (28)-(37), and marks by hand the sets whose track is curved. Here
the degree goes up from the straight line's while one more lowers the residual more than chance would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from trackerlib.crossover.straight_line import StraightLine, fit_straight_line

SIGNIFICANCE = 1e-3
MOST_DEGREES = 8
LEAST_BENT = 6  # points of the shortest track that may bend
DECAYS = np.append(np.arange(10) / 10, 0.95)  # correlation of the noise from one count to the next
LEAST_VARIANCE = 1e-6  # squared lengths; positions are printed to 0.1


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

    Wilks's test on the three axes together, whose noise may differ and correlate, at each degree against the next
    two, so that a bend whose next power happens to vanish is not missed. The noise may hang together in time: the
    chance is the mean of those with each of DECAYS, by how likely the residual of the most flexible course makes it
    (strong ones less beforehand). Fewer than LEAST_BENT points are never more than a line.
    """
    points = len(track)
    if points < LEAST_BENT:
        return 1
    most = min(MOST_DEGREES, max(points // 3, 2))
    weight, squares = _by_decay(track, point_count, most)
    degree = 1
    while degree < most:
        powers = range(1, min(2, most - degree) + 1)
        higher = [
            degree + more
            for more in powers
            if weight @ _chance(squares[degree], squares[degree + more], more, points - degree - more - 1)
            < significance / len(powers)
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


def _by_decay(track: np.ndarray, point_count: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """How likely each of DECAYS is (G,), and the squares of the residual (most + 1, G, 3, 3) that each degree leaves.

    Noise whose neighbours correlate by a decay is made independent by differences; one triangle then holds the
    residuals of every degree. The likelihood is the restricted one about the highest degree.
    """
    share, _, _ = _shares(point_count)
    powers = most + 1
    columns = np.column_stack([np.vander(share, powers, increasing=True), track - track.mean(axis=0)])
    kept = DECAYS[:, None] ** np.diff(np.asarray(point_count, float))
    fresh = np.maximum(1 - kept**2, 1e-12)
    later = (columns[1:] - kept[:, :, None] * columns[:-1]) / np.sqrt(fresh)[:, :, None]
    white = np.concatenate([np.broadcast_to(columns[:1], (len(DECAYS), *columns[:1].shape)), later], axis=1)
    triangle = np.asarray(np.linalg.qr(white, mode="r"))
    left = triangle[:, :, powers:]
    floor = LEAST_VARIANCE * len(track) * np.eye(3)
    squares = np.stack([np.swapaxes(left[:, k:], 1, 2) @ left[:, k:] + floor for k in range(1, powers + 1)])
    seen = np.log(np.abs(np.einsum("gkk->gk", triangle[:, :powers, :powers]))).sum(axis=1)
    freedom = len(track) - powers
    likelihood = -1.5 * np.log(fresh).sum(axis=1) - 3 * seen - freedom / 2 * _log_det(squares[most])
    weight = (1 - DECAYS) * np.exp(likelihood - likelihood.max())
    return weight / weight.sum(), squares


def _log_det(squares: np.ndarray) -> np.ndarray:
    return np.linalg.slogdet(squares)[1]


def _chance(here: np.ndarray, there: np.ndarray, more: int, freedom: int) -> np.ndarray:
    """How often noise alone would lower squares (G, 3, 3) from `here` to `there` by one or two more powers."""
    left = np.exp((_log_det(there) - _log_det(here)) / more)
    ratio = (1 - left) / left * (freedom - 2) / 3
    return fdtrc(3 * more, more * (freedom - 2), np.maximum(ratio, 0.0))
