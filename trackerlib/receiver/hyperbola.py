"""What one pass along a straight leg tells: a bearing line at right angles to the ship's track.

The range to a beacon along a straight leg is a hyperbola of the way made good, and so is its trace on paper. The
mark where the trace turns is the closest approach; how sharply it bends tells the distance. The clock of the
beacon tilts the trace: a distance leans on how well the interval is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from trackerlib.frames import LocalFrame, bearing_deg

FEWEST = 6  # marks of a pass
ENOUGH = 20  # marks whose residuals tell the size of their errors
CROOKED = 0.05  # of the leg's length: no part of a straight leg lies farther off its line
VAGUE = 1 / 3  # of itself: a standard error of the distance beyond which there is none
PLACES, DISTANCES = 31, 25  # of closest approaches from which a fit is begun


@dataclass(frozen=True)
class BearingLine:
    """The line on the map that a pass puts a beacon on: through the ship's closest point, across her track.

    A straight leg does not tell port from starboard, so the line goes to both sides.
    """

    lat_deg: float  # of the ship at closest approach
    lon_deg: float
    bearing_deg: float  # to starboard, from true north, 0 to 360; the other side is opposite
    sigma_along_m: float  # standard error of the line along the track, at the ship
    sigma_bearing_deg: float  # standard error of its direction
    distance_m: float | None = None  # slant distance at closest approach; None where the marks do not tell
    sigma_m: float | None = None  # standard error of distance_m
    correlation: float = 0.0  # between the errors along the track and in distance_m

    def ends(self, length_m: float | None = None, depth_m: float = 0.0) -> np.ndarray:
        """Latitude and longitude (2, 2) [degrees] of the line's ends, to starboard and to port.

        length_m : to each side; None draws the beacon's two mirror places at `depth_m` below the hydrophone
        Raises ValueError where there is neither a length nor a distance greater than the depth.
        """
        if length_m is None:
            if self.distance_m is None or not self.distance_m > depth_m:
                raise ValueError(
                    f"distance_m is {self.distance_m}; wanted more than the depth, {depth_m:g} m"
                )
            length_m = float(np.sqrt(self.distance_m**2 - depth_m**2))
        bearing = np.radians(self.bearing_deg + np.array([0.0, 180.0]))
        plane = length_m * np.stack([np.sin(bearing), np.cos(bearing), np.zeros(2)], axis=-1)
        lat, lon, _ = LocalFrame(self.lat_deg, self.lon_deg).to_geodetic(plane)
        return np.stack([lat, lon], axis=-1)


@dataclass(frozen=True, eq=False)
class Marks:
    """Marks of one pass on the paper, and where the ship was. Raises ValueError if columns differ in length."""

    emission: np.ndarray  # (N,) integers
    folded_s: np.ndarray  # (N,) time of receipt modulo interval_s; jumps of whole intervals do not matter
    sigma_s: np.ndarray  # (N,) standard error
    lat_deg: np.ndarray  # (N,) of the hydrophone at that time
    lon_deg: np.ndarray
    interval_s: float  # that the paper is folded at

    def __post_init__(self):
        columns = (self.emission, self.folded_s, self.sigma_s, self.lat_deg, self.lon_deg)
        if len({np.shape(column) for column in columns}) != 1 or np.ndim(self.emission) != 1:
            raise ValueError(f"columns of marks differ: {[np.shape(column) for column in columns]}")
        if not np.all(np.asarray(self.sigma_s) > 0):
            raise ValueError("sigma_s of a mark is not above 0")

    def unfolded_s(self) -> np.ndarray:
        """Time of receipt less emission times interval (N,), without jumps of an interval."""
        order = np.argsort(self.emission, kind="stable")
        unfolded = np.empty(len(order))
        unfolded[order] = np.unwrap(np.asarray(self.folded_s, float)[order], period=self.interval_s)
        return unfolded


def straighten(marks: Marks) -> tuple[float, float]:
    """Interval at which the trace stands upright, and its standard error [s].

    The median of the slopes between marks (Theil and Sen), which a few false marks do not turn. It is the interval
    as heard: while the range changes at 1 m/s it differs from the beacon's by 0.07 %. Raises ValueError for fewer
    than three marks.
    """
    if len(marks.emission) < 3:
        raise ValueError(f"{len(marks.emission)} marks have no slope to trust; wanted 3 at least")
    slope = stats.theilslopes(marks.unfolded_s(), marks.emission, alpha=0.95)
    sigma_s = (slope.high_slope - slope.low_slope) / 2 / stats.norm.ppf(0.975)
    return marks.interval_s + float(slope.slope), float(sigma_s)


@dataclass(frozen=True, eq=False)
class Pass:
    """A hyperbola through the marks of a pass, or the reason why there is none.

    Where the marks give a line but no distance, `reason` says so and the line has no distance.
    """

    line: BearingLine | None
    reason: str | None
    closest_emission: float | None = None  # at closest approach, with a fraction
    sigma_emission: float | None = None
    interval_s: float | None = None  # of the beacon, the ship's motion taken out
    sigma_interval_s: float | None = None
    fitted_s: np.ndarray | None = None  # (N,) the hyperbola at the marks, unfolded like `Marks.unfolded_s`
    residual_s: np.ndarray | None = None  # (N,)


@dataclass(frozen=True, eq=False)
class _Leg:
    """A straight line through the ship's positions."""

    frame: LocalFrame
    middle: np.ndarray  # (2,) east, north
    direction: np.ndarray  # (2,) the way she sailed
    along: np.ndarray  # (N,) [m]
    scatter_m: float  # rms of positions off the line
    farthest_m: float

    @property
    def sigma_bearing(self) -> float:
        """Standard error of its direction [rad]."""
        return float(self.scatter_m / (np.sqrt(len(self.along)) * self.along.std()))


def _leg(marks: Marks) -> _Leg:
    frame = LocalFrame(float(np.mean(marks.lat_deg)), float(np.mean(marks.lon_deg)))
    plane = frame.to_local(marks.lat_deg, marks.lon_deg, 0.0)[:, :2]
    middle = plane.mean(axis=0)
    direction = np.linalg.svd(plane - middle, full_matrices=False)[2][0]
    along = (plane - middle) @ direction
    if np.polyfit(marks.emission, along, 1)[0] < 0:
        direction, along = -direction, -along
    across = (plane - middle) @ np.array([-direction[1], direction[0]])
    scatter_m = float(np.sqrt(across @ across / (len(across) - 2)))
    return _Leg(frame, middle, direction, along, scatter_m, float(np.abs(across).max()))


def fit_pass(
    marks: Marks,
    sound_speed_mps: float,
    *,
    sigma_sound_speed_mps: float = 2.0,
    sigma_interval_s: float = np.inf,
) -> Pass:
    """The hyperbola through the marks of a straight leg, and the bearing line it gives.

    t_i = t0 + i (T - fold) + sqrt(R^2 + (s_i - s0)^2) / C, s the way along the leg: unknown are t0, T, s0, R and C.
    sigma_interval_s : how well `marks.interval_s` is known to be the beacon's; 0 is exactly, inf is not at all
    The ship's scatter off her line stands for the error of her positions, in all directions.
    """
    if len(marks.emission) < FEWEST:
        return Pass(None, f"{len(marks.emission)} marks are too few for a hyperbola; mark {FEWEST} at least")
    leg = _leg(marks)
    length_m = float(np.ptp(leg.along))
    if not leg.farthest_m < CROOKED * length_m:
        return Pass(None, f"the leg is not straight: {leg.farthest_m:.0f} m off a line {length_m:.0f} m long")
    hyperbola = _Hyperbola(marks, leg, sound_speed_mps, sigma_sound_speed_mps, sigma_interval_s)
    solution = optimize.least_squares(hyperbola.weighted, hyperbola.begin(), x_scale="jac", method="trf")
    return _told(marks, leg, hyperbola, solution)


class _Hyperbola:
    """Weighted residuals for t0, T - fold, s0, R and what C differs from the speed told."""

    def __init__(self, marks: Marks, leg: _Leg, speed: float, sigma_speed: float, sigma_interval: float):
        self.time_s = marks.unfolded_s()
        self.emission = marks.emission - np.mean(marks.emission)
        self.along, self.speed = leg.along, speed
        self.sigma_s = np.hypot(marks.sigma_s, leg.scatter_m / speed)
        self.prior = np.array([1 / max(sigma_interval, 1e-15), 1 / max(sigma_speed, 1e-9)])

    def time(self, unknown: np.ndarray) -> np.ndarray:
        start, slope, place, distance, slower = unknown
        return start + slope * self.emission + np.hypot(distance, self.along - place) / (self.speed + slower)

    def weighted(self, unknown: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [(self.time_s - self.time(unknown)) / self.sigma_s, unknown[[1, 4]] * self.prior]
        )

    def begin(self) -> np.ndarray:
        """The best of a grid of places and distances, the rest by linear least squares."""
        reach = np.ptp(self.along)
        grid = np.meshgrid(
            np.linspace(self.along.min(), self.along.max(), PLACES),
            np.geomspace(0.02 * reach, 5 * reach, DISTANCES),
        )
        place, distance = (each.ravel() for each in grid)
        travel_s = np.hypot(distance[:, None], self.along - place[:, None]) / self.speed
        rest = np.pad((self.time_s - travel_s) / self.sigma_s, ((0, 0), (0, 1)))  # nought for the interval
        columns = np.stack([np.ones_like(self.emission), self.emission], axis=-1) / self.sigma_s[:, None]
        basis, triangle = np.linalg.qr(np.vstack([columns, [0.0, self.prior[0]]]))
        linear = rest @ basis
        best = np.argmin(np.sum(rest**2, axis=1) - np.sum(linear**2, axis=1))
        return np.array([*np.linalg.solve(triangle, linear[best]), place[best], distance[best], 0.0])


def _covariance(solution: optimize.OptimizeResult, marks: int) -> np.ndarray:
    """Of the unknowns: noise as large as the residuals say, and what was known before.

    Errors of the ship's position count in full in `sigma_s`, but only their share towards the beacon, which is
    unknown, moves a mark; so the residuals set the scale where there are enough of them.
    """
    scale = max(np.sum(solution.fun[:marks] ** 2) / (marks - 4), 1e-9)
    if marks < ENOUGH:
        scale = max(scale, 1.0)
    jacobian = solution.jac / np.append(np.full(marks, np.sqrt(scale)), [1.0, 1.0])[:, None]
    information = jacobian.T @ jacobian
    unit = np.sqrt(np.diag(information))
    return np.linalg.pinv(information / np.outer(unit, unit)) / np.outer(unit, unit)


def _told(marks: Marks, leg: _Leg, hyperbola: _Hyperbola, solution: optimize.OptimizeResult) -> Pass:
    _, slope, place, distance, _ = solution.x
    distance = abs(distance)
    covariance = _covariance(solution, len(leg.along))
    sigma = np.sqrt(np.diag(covariance))
    if not leg.along.min() < place < leg.along.max():
        return Pass(None, "closest approach is not on the leg: sail on until the trace has turned")
    if not sigma[2] < np.ptp(leg.along) / 4:
        return Pass(None, f"the trace is hardly bent: closest approach is known to {sigma[2]:.0f} m only")
    known = sigma[3] < VAGUE * distance
    east, north = leg.middle + place * leg.direction
    lat, lon, _ = leg.frame.to_geodetic(np.array([east, north, 0.0]))
    line = BearingLine(
        float(lat),
        float(lon),
        (bearing_deg(*leg.direction) + 90) % 360,
        float(sigma[2]),
        float(np.degrees(leg.sigma_bearing)),
        float(distance) if known else None,
        float(sigma[3]) if known else None,
        float(covariance[2, 3] / sigma[2] / sigma[3] * np.sign(solution.x[3])) if known else 0.0,
    )
    a_ping = abs(np.polyfit(marks.emission, leg.along, 1)[0])
    order = np.argsort(leg.along)
    fitted_s = hyperbola.time(solution.x)
    return Pass(
        line,
        None if known else f"no distance: {distance:.0f} m has a standard error of {sigma[3]:.0f} m",
        float(np.interp(place, leg.along[order], np.asarray(marks.emission, float)[order])),
        float(sigma[2] / a_ping),
        marks.interval_s + float(slope),
        float(sigma[1]),
        fitted_s,
        hyperbola.time_s - fitted_s,
    )
