"""Fixes without the bias that noisy ship positions give: squared ranges, instruments from the neighbours.

With d the horizontal offset ship minus beacon (noisy), z the height of the beacon above the hydrophone and
s = C T - c0 the range, q = |d|^2 - gx^2 - gy^2 + z^2 - s^2 + sigma^2 has mean exactly zero at the truth, straight
overhead too, however large the ship's errors gx east and gy north are. The weighted sum of w J q is brought to
zero, where neither w nor J holds the ping's own noise: both come from the neighbouring ship positions.

    fixes = fix_squared_range(ship, ranges, epochs, gps_rms_m=3, range_rms_m=0.43)
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from trackerlib.beacon.bent import DRAWS, follow_the_bend
from trackerlib.beacon.neighbours import smooth_track
from trackerlib.beacon.small_systems import root_of, scaled_solve, squares, whiten
from trackerlib.beacon.squared_sums import (
    COLUMNS,
    EAST,
    FAST,
    KNOWN,
    NORTH,
    ONE,
    RANGE,
    T_EAST,
    T_NORTH,
    TT,
    T,
    correlated_spread,
    instrument_sums,
    lay_out,
    radius_of,
    score,
    take_out_noise,
    take_out_shared,
    thinned,
)
from trackerlib.compiled import compiled, compiled_with, warms

NEIGHBOURS = 200  # on either side, at most
PASSES, STEPS = 50, 2  # with instruments renewed, and of Newton with instruments held
AT_REST = 1e-6  # square of the score in standard errors below which one more step ends the search
MOST_STUCK = 5  # times a step may have to be taken that does not improve matters
ENOUGH = 1e-4  # the same, below which a second step is no use before instruments are renewed
UNKNOWN_SHARE = 0.15  # of the depth: a standard error above which noise and not geometry makes an answer
KNOWN_SHARE = 0.03  # the same, below which there is no need to ask
BIASED_FROM, STRONGLY_BENT = 0.1, 1.0  # bends between which a bias of second order is worth taking out
STILL, MOVING = 4, 7  # unknowns: east, north, up and c0, then three velocities

FINE, FEW, HIDDEN, NO_PLACE, RULED, BENT = range(6)
WHY = (
    "",
    "fewer pings than the unknowns need",
    "the geometry does not show every unknown",
    "no place below the hydrophone fits",
    "with ship positions this noisy a beacon at most places below this track would be unknown by more than 15 % "
    "of its depth",
    "the places that fit lie on a curve that no ellipsoid describes",
)


@dataclass(frozen=True, eq=False)
class SquaredRangeFixes:
    """Fixes of B surveys: lengths in metres, velocities in m/s, unknowns in the order of `estimate`."""

    estimate: (
        np.ndarray
    )  # (B, P) east, north, up, c0 (C times the emission offset), then velocities if moving
    covariance: np.ndarray  # (B, P, P)
    why: np.ndarray  # (B,) index in WHY of the reason for which it did not converge
    iterations: np.ndarray  # (B,) passes over the pings

    @property
    def converged(self) -> np.ndarray:
        """Which (B,) reached a solution, below the hydrophone, whose every direction is seen."""
        return self.why == FINE


def refusals(why: np.ndarray) -> dict[str, int]:
    """How many fixes were refused, by reason, from their `SquaredRangeFixes.why`."""
    return {WHY[code]: int(np.sum(why == code)) for code in np.unique(why) if code != FINE}


def fix_squared_range(
    ship: np.ndarray,
    ranges: np.ndarray,
    epochs: np.ndarray,
    gps_rms_m: float | tuple[float, float],
    range_rms_m: float,
    *,
    moving: bool = False,
    neighbours: int = NEIGHBOURS,
    correlation_s: float = 0.0,
) -> SquaredRangeFixes:
    """Positions of still or steadily moving beacons, one a survey, unbiased whatever the ship's position noise.

    ship : (B, N, 3) positions of the hydrophone [m] east, north (both noisy), up (taken as known)
    ranges : (B, N) speed of sound times arrival time less emission number times interval [m]; one unknown
        constant a survey is estimated with the position
    epochs : (N,) emission times [s]; a moving beacon's position is that at epoch 0
    gps_rms_m : ship position error of each of east and north, or of the two apart
    range_rms_m : speed of sound times the error of one arrival time
    neighbours : pings on either side, at most, whose straight line stands for the ship's place; fewer are taken
        where the ship's noise does not hide that it turned
    correlation_s : in this time, in the unit of the epochs, the correlation of two position errors falls to 1/e;
        0 for errors independent from ping to ping. Needs epochs in order.

    Fewer pings than unknowns, or a geometry that hides one of them, is `converged` false.
    Raises ValueError for shapes that do not fit and for noise that is not positive.
    """
    ship, ranges = np.ascontiguousarray(ship, float), np.ascontiguousarray(ranges, float)
    epochs = np.ascontiguousarray(epochs, float)
    noise = _variances(gps_rms_m, range_rms_m)
    if (
        ship.ndim != 3
        or ship.shape[2] != 3
        or ranges.shape != ship.shape[:2]
        or epochs.shape != ranges.shape[1:]
    ):
        raise ValueError(
            f"found ship {ship.shape}, ranges {ranges.shape}, epochs {epochs.shape}; wanted (B, N, 3), (B, N), (N,)"
        )
    if not correlation_s >= 0:
        raise ValueError(f"found correlation_s {correlation_s:g}; wanted 0 or more")
    if correlation_s > 0 and (epochs[1:] < epochs[:-1]).any():
        raise ValueError("found epochs out of order; with correlated errors they must not fall")
    surveys, unknowns = len(ship), MOVING if moving else STILL
    estimate, covariance = np.empty((surveys, unknowns)), np.empty((surveys, unknowns, unknowns))
    why, passes = np.empty(surveys, np.int64), np.empty(surveys, np.int64)
    fix = _fix_all if surveys > 1 and numba.get_num_threads() > 1 else _fix_alone
    fix(
        ship, ranges, epochs, noise, neighbours, float(correlation_s), DRAWS[unknowns],
        estimate, covariance, why, passes,
    )  # fmt: skip
    return SquaredRangeFixes(estimate, covariance, why, passes)


def _variances(gps_rms_m, range_rms_m) -> np.ndarray:
    """Variances (3,) of ship position east, north and of a range."""
    east, north = (gps_rms_m, gps_rms_m) if isinstance(gps_rms_m, float) else np.broadcast_to(gps_rms_m, 2)
    if not (east >= 0 and north >= 0 and range_rms_m >= 0 and east + north + range_rms_m > 0):
        raise ValueError(
            f"found noise of {gps_rms_m} m and {range_rms_m} m; wanted none below and one above zero"
        )
    return np.array([east * east, north * north, range_rms_m * range_rms_m], float)


_fast = compiled_with(*FAST)


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _fix_all(ship, ranges, epochs, noise, neighbours, correlation, draws, estimate, covariance, why, passes):
    for k in numba.prange(len(ship)):
        why[k], passes[k] = _fix_one(
            ship[k], ranges[k], epochs, noise, neighbours, correlation, draws, estimate[k], covariance[k]
        )


@compiled
def _fix_alone(
    ship, ranges, epochs, noise, neighbours, correlation, draws, estimate, covariance, why, passes
):
    """The same without the threads' start, which takes longer than one fix."""
    for k in range(len(ship)):
        why[k], passes[k] = _fix_one(
            ship[k], ranges[k], epochs, noise, neighbours, correlation, draws, estimate[k], covariance[k]
        )


@compiled
def _fix_one(ship, ranges, epochs, noise, neighbours, correlation, draws, estimate, covariance):
    """One fix, from the start with motion and, if that leads nowhere, from the one without; why not, passes made."""
    unknowns = len(estimate)
    estimate[:] = np.nan
    if len(ship) <= unknowns:
        covariance[:] = np.nan
        return FEW, 0
    smooth, shared = smooth_track(ship, epochs, noise, neighbours, correlation)
    origin = _origin(ship, ranges)
    span, sums = _starting_sums(epochs, unknowns)
    track = lay_out(ship, smooth, ranges, epochs, origin, span, unknowns == MOVING, sums)
    why, passes, theta = HIDDEN, 0, np.empty(unknowns)
    for moving in (True, False):
        if (moving and unknowns == STILL) or not _start(sums, span, moving, theta):
            continue
        height = theta[2]
        why, more = _descend(theta, track, shared, epochs, noise, correlation, draws, covariance)
        passes += more
        if why == FINE:
            estimate[:] = theta
            estimate[:4] += origin
            return FINE, passes
        if why == NO_PLACE and not _tells_enough(-height, track, noise, unknowns):
            why = RULED
    covariance[:] = np.nan
    return why, passes


@_fast
def _origin(ship, ranges):
    """Mean place of the ship and mean range (4,): sums about it lose no digits."""
    origin, flat = np.zeros(4), ship.reshape(ship.size)
    east = north = up = distance = 0.0
    for n in range(len(ship)):
        east += flat[3 * n]
        north += flat[3 * n + 1]
        up += flat[3 * n + 2]
        distance += ranges[n]
    origin[0], origin[1], origin[2], origin[3] = east, north, up, distance
    return origin / len(ship)


@compiled
def linear_start(ship, smooth, ranges, epochs, moving):
    """Unknowns from the equations that are linear in position, velocity, c0 and the remaining squares.

    |r|^2 - (C T)^2 = 2 r p + 2 t r v - 2 C T c0 - K0 (- K1 t - K2 t^2), with instruments of the neighbours.
    K0 = |p|^2 - c0^2, K1 = 2 p v, K2 = v^2; heights are counted from the hydrophone's mean height.
    """
    origin, theta = _origin(ship, ranges), np.zeros(MOVING if moving else STILL)
    span, sums = _starting_sums(epochs, len(theta))
    lay_out(ship, smooth, ranges, epochs, origin, span, moving, sums)
    fine = _start(sums, span, moving, theta)
    theta[:4] += origin
    return theta, fine


@compiled
def _starting_sums(epochs, unknowns):
    """What instants of a start are counted in, and a place for its sums."""
    span = 1.0
    if unknowns == STILL:
        return span, np.empty((4, COLUMNS))
    for n in range(len(epochs)):
        span = max(span, abs(epochs[n]))
    return span, np.empty((8, COLUMNS))


@compiled
def _start(sums, span, moving, theta):
    """Fills theta (P,) with the same less the origin, with or without motion; whether all is seen."""
    theta[:] = 0.0
    size = 8 if moving else 4
    normal, solved = np.empty((size, size)), np.empty((size, 1))
    for i in range(size):
        m = sums[i]
        solved[i, 0] = m[KNOWN]
        normal[i, 0], normal[i, 1], normal[i, 2], normal[i, 3] = (
            2 * m[EAST],
            2 * m[NORTH],
            -2 * m[RANGE],
            -m[ONE],
        )
        if moving:
            normal[i, 4], normal[i, 5] = 2 * m[T_EAST] / span, 2 * m[T_NORTH] / span
            normal[i, 6], normal[i, 7] = -m[T] / span, -m[TT] / span**2
    if not scaled_solve(normal, solved):
        return False
    p0, p1, c0 = solved[0, 0], solved[1, 0], solved[2, 0]
    depth = np.sqrt(max(solved[3, 0] + c0 * c0 - p0 * p0 - p1 * p1, 100.0))
    theta[0], theta[1], theta[2], theta[3] = p0, p1, -depth, c0
    if moving:
        theta[4], theta[5] = solved[4, 0] / span, solved[5, 0] / span
        theta[6] = -(solved[6, 0] / span / 2 - p0 * theta[4] - p1 * theta[5]) / depth
        if not abs(theta[6]) < 5.0:
            theta[6] = 0.0
    return True


@compiled
def _descend(theta, track, shared, epochs, noise, correlation, draws, covariance):
    """Renews instruments and solves for theta (P,), in place, until both are at rest; why not, and passes made."""
    unknowns = len(theta)
    moments = np.empty((unknowns, COLUMNS))
    spread, root = np.empty((unknowns, unknowns)), np.empty((unknowns, unknowns))
    work = _room(unknowns)
    stuck = 0
    for step in range(1, PASSES + 1):
        instrument_sums(theta, track, noise, moments, spread)
        if correlation > 0:
            take_out_shared(theta, track, shared, noise, moments)
        if not root_of(spread, root):
            return HIDDEN, step
        at_rest = _score_size(moments, root, theta, work) < AT_REST
        if not _improve(moments, root, track.highest, theta, work):
            stuck += 1
            if stuck > MOST_STUCK:
                return NO_PLACE, step
        if at_rest:
            sure = _error_from(spread, 1.0) < KNOWN_SHARE * -theta[2]
            if not sure and not _tells_enough(-theta[2], track, noise, unknowns):
                return RULED, step
            bend = _stated(theta, track, epochs, noise, correlation, draws, moments, spread, covariance)
            if not bend < np.inf:
                return BENT, step
            if BIASED_FROM < bend < STRONGLY_BENT and not correlation > 0:
                take_out_noise(theta, track, noise, root, moments)
                _improve(moments, root, track.highest, theta, work)
            return FINE, step
    return NO_PLACE, PASSES


@compiled
def _stated(theta, track, epochs, noise, correlation, draws, moments, spread, covariance):
    """Fills the covariance (P, P) at a solution; the bend."""
    unknowns = len(theta)
    own, bends = np.empty((unknowns, unknowns)), np.empty((unknowns, 3 if unknowns == MOVING else 1))
    score(moments, theta, np.empty(unknowns), own)
    if correlation > 0:
        correlated_spread(theta, track, epochs, noise, correlation, spread)
    bends[:, 0] = moments[:, ONE]
    if unknowns == MOVING:
        bends[:, 1], bends[:, 2] = moments[:, T], moments[:, TT]
    return follow_the_bend(own, spread, bends, draws, covariance)


@compiled
def _tells_enough(depth, track, noise, unknowns):
    """Whether such a survey can tell a beacon of this depth: asked of places about the track, not of the answer.

    An answer that is far off can claim to be good, so it is not asked. What counts is the median standard error at
    five places: below the track's mean and to either side of it. A part of the pings, evenly taken, tells it.
    """
    few = thinned(track)
    share = few.pings / track.pings
    depth = max(depth, radius_of(few))
    moments, spread = np.empty((unknowns, COLUMNS)), np.empty((unknowns, unknowns))
    other, good = np.empty(unknowns), 0
    for place in range(5):
        other[:] = 0.0
        other[2] = -depth
        if place > 0:
            other[place % 2] = depth / 2 if place > 2 else -depth / 2
        instrument_sums(other, few, noise, moments, spread)
        good += _error_from(spread, share) < UNKNOWN_SHARE * depth
        if good > 2 or good + 4 - place < 3:  # the others cannot change it
            break
    return good > 2


@compiled
def _error_from(information, share):
    """Standard error of the position in space from an information matrix (P, P); infinite where it hides one.

    share : of all pings, that the matrix is made of
    """
    root, inverse = np.empty(information.shape), np.eye(len(information))
    if not root_of(information, root):
        return np.inf
    whiten(root, inverse)
    return np.sqrt(share * squares(inverse[:, :3]))


@compiled
def _room(unknowns):
    """Scratch for `_improve`: a score (P, 1), its matrix (P, P), the score in standard errors, and a step."""
    return (
        np.empty((unknowns, 1)),
        np.empty((unknowns, unknowns)),
        np.empty((unknowns, 1)),
        np.empty((unknowns, 1)),
        np.empty(unknowns),
    )


@compiled
def _score_size(moments, root, theta, work):
    """Square of the score in standard errors; fills the score and its matrix."""
    value, own, white = work[0], work[1], work[2]
    score(moments, theta, value[:, 0], own)
    white[:] = value
    whiten(root, white)
    return squares(white)


@compiled
def _improve(moments, root, highest, theta, work):
    """A few Newton steps, in place, towards zero score, halved while its size grows; whether any was found."""
    value, own, _, move, trial = work
    size = _score_size(moments, root, theta, work)
    for step in range(STEPS):
        move[:] = value
        if not scaled_solve(own, move):
            return step > 0
        share = 1.0
        while share > 1e-4:
            for k in range(len(theta)):
                trial[k] = theta[k] - share * move[k, 0]
            if trial[2] < highest:
                found = _score_size(moments, root, trial, work)
                if found <= size * (1 + 1e-6) + 1e-14:
                    break
            share /= 2
        if share <= 1e-4:  # no better place with these instruments: others may show one, half way along
            if step == 0 and theta[2] - move[2, 0] / 2 < highest:
                for k in range(len(theta)):
                    theta[k] -= move[k, 0] / 2
            return step > 0
        theta[:] = trial
        if size < ENOUGH:
            break
        size = found
    return True


@warms
def _warm() -> None:
    rng = np.random.default_rng(1)
    ship = np.zeros((2, 30, 3))
    ship[:, :, :2] = 100 * rng.normal(size=(2, 30, 2))
    ranges = np.linalg.norm(ship - [10.0, 0.0, -200.0], axis=2)
    for moving in (False, True):
        for count in (1, 2):
            fix_squared_range(ship[:count], ranges[:count], np.arange(30.0), 1.0, 1.0, moving=moving)
