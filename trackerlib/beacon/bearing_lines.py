"""A fix from bearing lines: each pass puts the beacon on a line across the ship's track, two or more put it on a place.

Figures 1-1 and 1-2 of Wojcik (1993): the operators' way before the computer. A line alone leaves two mirror places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import optimize, stats

from trackerlib.beacon.uncertainty import Ellipse, ellipse95
from trackerlib.frames import LocalFrame
from trackerlib.receiver.hyperbola import BearingLine

DEEPEST_M = 12_000.0
RIVAL = stats.chi2.ppf(
    0.99, 2
)  # chi-square above the best place's within which another place is not ruled out
UNLIKELY = 1e-3  # probability of lines that lie as badly, below which they are not believed to meet
STEEP = 0.7  # of the slant distance: depth and horizontal distance that descents begin with
SAME_M = 1.0  # descents that end closer found one place


@dataclass(frozen=True, eq=False)
class BearingFix:
    """Where the lines meet, how sure that is, or why it cannot be said."""

    converged: bool
    reason: str | None
    lat_deg: float | None = None
    lon_deg: float | None = None
    covariance: np.ndarray | None = None  # (2, 2) east, north [m^2]
    depth_m: float | None = None  # below the hydrophone, where the lines have distances
    sigma_depth_m: float | None = None
    chi_square: float | None = None
    degrees_of_freedom: int | None = None
    alternatives: tuple[
        tuple[float, float], ...
    ] = ()  # lat, lon of places that cannot be told from one another

    @property
    def ellipse(self) -> Ellipse | None:
        """95 % ellipse on the map."""
        return None if self.covariance is None else ellipse95(self.covariance)


def fix_from_bearing_lines(lines: Sequence[BearingLine]) -> BearingFix:
    """The place that fits the lines and, where all have one, their distances; or the reason why there is none.

    Least squares on how far the place lies before or behind each line, and on its slant distances, whose common
    unknown is the depth. Mirror places that fit about as well are told as `alternatives`.
    """
    if not lines:
        return BearingFix(False, "there is no bearing line; sail past the beacon on a straight leg")
    problem = _Problem(lines)
    if len(lines) == 1:
        mirror = tuple(problem.geodetic(place) for place in problem.mirrors()) if problem.slant else ()
        return BearingFix(
            False,
            "one line does not tell port from starboard; cross it with another leg",
            alternatives=mirror,
        )
    places = problem.places()
    if not places:
        return BearingFix(False, "the lines are parallel and do not meet; sail a leg across the others")
    best = places[0]
    chi_square = 2 * best.cost
    freedom = len(lines) * (2 if problem.slant else 1) - len(best.x)
    if freedom > 0 and stats.chi2.sf(chi_square, freedom) < UNLIKELY:
        return BearingFix(
            False,
            f"the lines do not meet: chi-square {chi_square:.0f} of {freedom}; one is wrong, or the beacon moved",
            chi_square=chi_square,
            degrees_of_freedom=freedom,
        )
    rivals = [place for place in places if 2 * place.cost < chi_square + RIVAL]
    if len(rivals) > 1:
        return BearingFix(
            False,
            "mirror places fit about as well; cross the lines with another leg",
            alternatives=tuple(problem.geodetic(place.x) for place in rivals),
        )
    return problem.told(best, chi_square, freedom)


class _Problem:
    """Places as east and north, in a frame among the lines, and the square of the depth if all have distances.

    The square, not the depth, is nearly linear in the distances: a beacon near the surface is no special case.
    """

    def __init__(self, lines: Sequence[BearingLine]):
        self.frame = LocalFrame(
            float(np.mean([line.lat_deg for line in lines])), float(np.mean([line.lon_deg for line in lines]))
        )
        self.ship = np.array([self.frame.to_local(each.lat_deg, each.lon_deg, 0.0)[:2] for each in lines])
        bearing = np.radians([line.bearing_deg for line in lines])
        self.across = np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)  # to starboard
        self.ahead = np.stack([-np.cos(bearing), np.sin(bearing)], axis=-1)
        self.sigma_along = np.array([line.sigma_along_m for line in lines])
        self.sigma_bearing = np.radians([line.sigma_bearing_deg for line in lines])
        self.slant = all(line.distance_m is not None for line in lines)
        if self.slant:
            self.distance = np.array([line.distance_m for line in lines])
            self.sigma_m = np.array([line.sigma_m for line in lines])
            self.correlation = np.array([line.correlation for line in lines])

    def residual(self, place: np.ndarray) -> np.ndarray:
        """What is left of each line, over its standard error; those of one line made independent."""
        offset = place[:2] - self.ship
        along = np.einsum("ij,ij->i", offset, self.ahead)
        across = np.einsum("ij,ij->i", offset, self.across)
        sigma = np.hypot(self.sigma_along, across * self.sigma_bearing)
        behind = along / sigma
        if not self.slant:
            return behind
        beyond = (
            np.sqrt(np.maximum(np.sum(offset**2, axis=1) + place[2], 1.0)) - self.distance
        ) / self.sigma_m
        shared = self.correlation * self.sigma_along / sigma
        return np.concatenate([behind, (beyond - shared * behind) / np.sqrt(1 - shared**2)])

    def mirrors(self, share: float = 1.0) -> np.ndarray:
        """Ends (2 L, 2) of the lines at a share of their distances, to starboard and to port."""
        reach = share * self.distance[:, None] * self.across
        return np.concatenate([self.ship + reach, self.ship - reach])

    def crossings(self) -> list[np.ndarray]:
        """Where the lines cross, each with each."""
        found = []
        for a, b in combinations(range(len(self.ship)), 2):
            matrix = np.stack([self.ahead[a], self.ahead[b]])
            if abs(np.linalg.det(matrix)) > 1e-6:
                target = np.einsum("ij,ij->i", matrix, self.ship[[a, b]])
                found.append(np.linalg.solve(matrix, target))
        return found

    def places(self) -> list[optimize.OptimizeResult]:
        """The different places where a descent ends, the best first."""
        starts = self.crossings()
        if self.slant:
            starts = [
                np.append(s, (STEEP * self.distance.mean()) ** 2) for s in [*starts, *self.mirrors(STEEP)]
            ]
        found: list[optimize.OptimizeResult] = []
        for start in starts:
            place = optimize.least_squares(self.residual, start, x_scale="jac")
            if all(np.linalg.norm(place.x[:2] - other.x[:2]) > SAME_M for other in found):
                found.append(place)
        return sorted(found, key=lambda place: place.cost)

    def told(self, place: optimize.OptimizeResult, chi_square: float, freedom: int) -> BearingFix:
        """The fix at a place, unless its ellipse is of the size of the survey."""
        information = place.jac.T @ place.jac
        if self.slant:
            information[2, 2] += DEEPEST_M**-4
        covariance = np.linalg.pinv(information, hermitian=True)
        semi_major_m = ellipse95(covariance[:2, :2]).semi_major_m
        reach_m = float(np.linalg.norm(self.ship - place.x[:2], axis=1).max())
        if not semi_major_m < reach_m / 2:
            why = f"the lines cross at too small an angle: the place is known to {semi_major_m:.0f} m only"
            return BearingFix(False, why, alternatives=(self.geodetic(place.x),))
        lat_deg, lon_deg = self.geodetic(place.x)
        return BearingFix(
            True,
            None,
            lat_deg,
            lon_deg,
            covariance[:2, :2],
            *(self.depth(place.x[2], covariance[2, 2]) if self.slant else (None, None)),
            float(chi_square),
            freedom,
        )

    @staticmethod
    def depth(square: float, variance: float) -> tuple[float, float]:
        """Depth and its standard error from the square of the depth and that square's variance."""
        depth_m = float(np.sqrt(max(square, 0.0)))
        return depth_m, float(np.sqrt(depth_m**2 + np.sqrt(variance))) - depth_m

    def geodetic(self, place: np.ndarray) -> tuple[float, float]:
        """Latitude and longitude of a place."""
        lat, lon, _ = self.frame.to_geodetic(np.array([place[0], place[1], 0.0]))
        return float(lat), float(lon)
