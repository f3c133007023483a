"""Fixes without the bias that noisy ship positions give: squared ranges, instruments from the neighbours.

With d the horizontal offset ship minus beacon (noisy), z the height of the beacon above the hydrophone and
s = C T - c0 the range, q = |d|^2 - 2 g^2 + z^2 - s^2 + sigma^2 has mean exactly zero at the truth, straight
overhead too, however large g is. The weighted sum of w J q is brought to zero, where neither w nor J holds the
ping's own noise: both come from a straight line through the neighbouring ship positions.

    fixes = fix_squared_range(ship, ranges, epochs, gps_rms_m=3, range_rms_m=0.43)
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from trackerlib.beacon.bent import DRAWS, follow_the_bend
from trackerlib.compiled import compiled, warms

NEIGHBOURS = 10  # on either side
STEPS = 50
LEAST_PIVOT = 1e-12  # of a scaled system that determines its unknowns
STILL, MOVING = 4, 7  # unknowns: east, north, up and c0, then three velocities


@dataclass(frozen=True, eq=False)
class SquaredRangeFixes:
    """Fixes of B surveys: lengths in metres, velocities in m/s, unknowns in the order of `estimate`."""

    estimate: (
        np.ndarray
    )  # (B, P) east, north, up, c0 (C times the emission offset), then velocities if moving
    covariance: np.ndarray  # (B, P, P)
    converged: np.ndarray  # (B,) reached a solution, below the hydrophone, whose every direction is seen
    iterations: np.ndarray  # (B,)


def fix_squared_range(
    ship: np.ndarray,
    ranges: np.ndarray,
    epochs: np.ndarray,
    gps_rms_m: float,
    range_rms_m: float,
    *,
    moving: bool = False,
    neighbours: int = NEIGHBOURS,
) -> SquaredRangeFixes:
    """Positions of still or steadily moving beacons, one a survey, unbiased whatever the ship's position noise.

    ship : (B, N, 3) positions of the hydrophone [m] east, north (both noisy), up (taken as known)
    ranges : (B, N) speed of sound times arrival time less emission number times interval [m]; one unknown
        constant a survey is estimated with the position
    epochs : (N,) emission times [s]; a moving beacon's position is that at epoch 0
    gps_rms_m : ship position error, each of east and north, independent from ping to ping
    range_rms_m : speed of sound times the error of one arrival time
    neighbours : pings on either side whose straight line stands for the ship's place

    Fewer pings than unknowns, or a geometry that hides one of them, is `converged` false.
    Raises ValueError for shapes that do not fit and for noise that is not positive.
    """
    ship, ranges = np.ascontiguousarray(ship, float), np.ascontiguousarray(ranges, float)
    epochs = np.ascontiguousarray(epochs, float)
    if (
        ship.ndim != 3
        or ship.shape[2] != 3
        or ranges.shape != ship.shape[:2]
        or epochs.shape != ranges.shape[1:]
    ):
        raise ValueError(
            f"found ship {ship.shape}, ranges {ranges.shape}, epochs {epochs.shape}; wanted (B, N, 3), (B, N), (N,)"
        )
    if not gps_rms_m >= 0 or not range_rms_m >= 0 or gps_rms_m + range_rms_m <= 0:
        raise ValueError(f"found noise of {gps_rms_m} m and {range_rms_m} m; wanted at least one above zero")
    surveys, unknowns = len(ship), MOVING if moving else STILL
    estimate = np.full((surveys, unknowns), np.nan)
    covariance = np.full((surveys, unknowns, unknowns), np.nan)
    iterations = np.zeros(surveys, np.int64)
    if ship.shape[1] > unknowns:
        _fix_all(
            ship, ranges, epochs, float(gps_rms_m) ** 2, float(range_rms_m) ** 2, neighbours,
            DRAWS[unknowns], estimate, covariance, iterations,
        )  # fmt: skip
    return SquaredRangeFixes(estimate, covariance, iterations > 0, iterations)


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _fix_all(
    ship, ranges, epochs, gps_variance, range_variance, neighbours, draws, estimate, covariance, iterations
):
    for k in numba.prange(len(ship)):
        smooth = _smooth(ship[k], epochs, neighbours)
        iterations[k] = _fix_one(
            ship[k],
            smooth,
            ranges[k],
            epochs,
            gps_variance,
            range_variance,
            draws,
            estimate[k],
            covariance[k],
        )


@compiled
def _smooth(ship, epochs, neighbours):
    """Ship's places (N, 2) on a straight line through each ping's neighbours, the ping itself left out."""
    count = len(ship)
    smooth = np.empty((count, 2))
    middle = epochs[count // 2]
    x0, y0 = ship[count // 2, 0], ship[count // 2, 1]  # sums about the middle lose no digits
    n = first = 0
    st = stt = sx = sy = stx = sty = 0.0
    last = -1
    for k in range(count):
        while last < min(k + neighbours, count - 1):
            last += 1
            t, x, y = epochs[last] - middle, ship[last, 0] - x0, ship[last, 1] - y0
            n += 1
            st, stt, sx, sy, stx, sty = st + t, stt + t * t, sx + x, sy + y, stx + t * x, sty + t * y
        while first < k - neighbours:
            t, x, y = epochs[first] - middle, ship[first, 0] - x0, ship[first, 1] - y0
            n -= 1
            st, stt, sx, sy, stx, sty = st - t, stt - t * t, sx - x, sy - y, stx - t * x, sty - t * y
            first += 1
        t, x, y = epochs[k] - middle, ship[k, 0] - x0, ship[k, 1] - y0
        others = n - 1
        t1, tt = st - t, stt - t * t
        x1, y1, tx, ty = sx - x, sy - y, stx - t * x, sty - t * y
        spread = others * tt - t1 * t1
        if others > 1 and spread > 1e-9 * others * (tt + 1e-9):
            smooth[k, 0] = (x1 * (tt - t * t1) + tx * (others * t - t1)) / spread + x0
            smooth[k, 1] = (y1 * (tt - t * t1) + ty * (others * t - t1)) / spread + y0
        else:
            smooth[k, 0], smooth[k, 1] = x1 / max(others, 1) + x0, y1 / max(others, 1) + y0
    return smooth


@compiled
def _instrument(theta, height, east, north, t, gps_variance, range_variance, instrument):
    """Fills `instrument` (P,) for one ping from its neighbours' place for the ship; the ping's weight."""
    ix, iy, z = east - theta[0], north - theta[1], theta[2] - height
    if len(theta) > 4:
        ix, iy, z = ix - t * theta[4], iy - t * theta[5], z + t * theta[6]
    h2 = ix * ix + iy * iy
    s2 = h2 + z * z
    instrument[0], instrument[1], instrument[2], instrument[3] = -2 * ix, -2 * iy, 2 * z, 2 * np.sqrt(s2)
    for k in range(4, len(theta)):
        instrument[k] = t * instrument[k - 4]
    return 1 / (4 * h2 * gps_variance + 4 * gps_variance**2 + 4 * s2 * range_variance + 2 * range_variance**2)


@compiled
def _sums(theta, ship, smooth, ranges, epochs, gps_variance, range_variance, score, own, spread):
    """Score sum of w J q, its matrix sum of w J J_own' and its variance sum of w J J'."""
    unknowns = len(theta)
    score[:] = 0.0
    own[:] = 0.0
    spread[:] = 0.0
    instrument, slope = np.empty(unknowns), np.empty(unknowns)
    for n in range(len(ship)):
        t = epochs[n]
        w = _instrument(
            theta, ship[n, 2], smooth[n, 0], smooth[n, 1], t, gps_variance, range_variance, instrument
        )
        dx, dy, z = ship[n, 0] - theta[0], ship[n, 1] - theta[1], theta[2] - ship[n, 2]
        if unknowns > 4:
            dx, dy, z = dx - t * theta[4], dy - t * theta[5], z + t * theta[6]
        s = ranges[n] - theta[3]
        q = dx * dx + dy * dy - 2 * gps_variance + z * z - s * s + range_variance
        slope[0], slope[1], slope[2], slope[3] = -2 * dx, -2 * dy, 2 * z, 2 * s
        for k in range(4, unknowns):
            slope[k] = t * slope[k - 4]
        for i in range(unknowns):
            score[i] += w * instrument[i] * q
            for j in range(unknowns):
                own[i, j] += w * instrument[i] * slope[j]
                spread[i, j] += w * instrument[i] * instrument[j]


@compiled
def _scaled_solve(matrix, right):
    """Solution of a symmetric-looking system scaled by its diagonal, and whether it is well determined.

    By elimination with row exchange; a pivot below LEAST_PIVOT of the scaled system says that it is not.
    """
    count = len(matrix)
    scale = np.sqrt(np.abs(np.diag(matrix)))
    left, solved = np.empty((count, count)), np.empty(right.shape)
    for i in range(count):
        if not 0 < scale[i] < np.inf:
            return solved, False
    for i in range(count):
        for j in range(count):
            left[i, j] = matrix[i, j] / (scale[i] * scale[j])
        solved[i] = right[i] / scale[i]
    for k in range(count):
        best = k
        for i in range(k + 1, count):
            if abs(left[i, k]) > abs(left[best, k]):
                best = i
        if not abs(left[best, k]) > LEAST_PIVOT:
            return solved, False
        if best != k:
            for j in range(k, count):
                left[k, j], left[best, j] = left[best, j], left[k, j]
            for j in range(right.shape[1]):
                solved[k, j], solved[best, j] = solved[best, j], solved[k, j]
        for i in range(k + 1, count):
            share = left[i, k] / left[k, k]
            for j in range(k + 1, count):
                left[i, j] -= share * left[k, j]
            for j in range(right.shape[1]):
                solved[i, j] -= share * solved[k, j]
    for k in range(count - 1, -1, -1):
        for j in range(right.shape[1]):
            value = solved[k, j]
            for i in range(k + 1, count):
                value -= left[k, i] * solved[i, j]
            solved[k, j] = value / left[k, k]
    for i in range(count):
        solved[i] /= scale[i]
    return solved, True


@compiled
def linear_start(ship, smooth, ranges, epochs, moving):
    """Unknowns from the equations that are linear in position, velocity, c0 and the remaining squares.

    |r|^2 - (C T)^2 = 2 r p + 2 t r v - 2 C T c0 - K0 (- K1 t - K2 t^2), with instruments of the neighbours.
    K0 = |p|^2 - c0^2, K1 = 2 p v, K2 = v^2; heights are counted from the hydrophone's mean height.
    """
    count = len(ship)
    size = 8 if moving else 4
    normal, right = np.zeros((size, size)), np.zeros((size, 1))
    left, row = np.empty(size), np.empty(size)
    height, east, north = np.mean(ship[:, 2]), np.mean(ship[:, 0]), np.mean(ship[:, 1])
    middle = np.mean(ranges)
    span = max(np.max(np.abs(epochs)), 1.0)
    for n in range(count):
        x, y, r, t = ship[n, 0] - east, ship[n, 1] - north, ranges[n] - middle, epochs[n] / span
        left[0], left[1], left[2], left[3] = smooth[n, 0] - east, smooth[n, 1] - north, r, 1.0
        row[0], row[1], row[2], row[3] = 2 * x, 2 * y, -2 * r, -1.0
        if moving:
            left[4], left[5], left[6], left[7] = t * left[0], t * left[1], t, t * t
            row[4], row[5], row[6], row[7] = 2 * t * x, 2 * t * y, -t, -t * t
        known = x * x + y * y - r * r
        for i in range(size):
            right[i, 0] += left[i] * known
            for j in range(size):
                normal[i, j] += left[i] * row[j]
    theta = np.zeros(7 if moving else 4)
    solved, fine = _scaled_solve(normal, right)
    if not fine:
        return theta, False
    p0, p1, c0 = solved[0, 0], solved[1, 0], solved[2, 0]
    square = solved[3, 0] + c0 * c0 - p0 * p0 - p1 * p1
    depth = np.sqrt(max(square, 100.0))
    theta[0], theta[1], theta[2], theta[3] = p0 + east, p1 + north, height - depth, c0 + middle
    if moving:
        theta[4], theta[5] = solved[4, 0] / span, solved[5, 0] / span
        theta[6] = -(solved[6, 0] / span / 2 - p0 * theta[4] - p1 * theta[5]) / depth
        if not abs(theta[6]) < 5.0:
            theta[6] = 0.0
    return theta, True


@compiled
def _descend(theta, ship, smooth, ranges, epochs, gps_variance, range_variance, draws, estimate, covariance):
    """Newton's steps, halved while the score's own size grows; how many were needed, 0 if they did not settle."""
    unknowns = len(theta)
    score = np.empty((unknowns, 1))
    own, spread = np.empty((unknowns, unknowns)), np.empty((unknowns, unknowns))
    trial = theta.copy()
    highest = np.max(ship[:, 2])
    _sums(theta, ship, smooth, ranges, epochs, gps_variance, range_variance, score[:, 0], own, spread)
    for step in range(1, STEPS + 1):
        move, fine = _scaled_solve(own, -score)
        if not fine:
            return 0
        whitened, fine = _scaled_solve(spread, score)
        if not fine:
            return 0
        size = np.sum(score * whitened)
        share = 1.0
        while share > 1e-4:
            for k in range(unknowns):
                trial[k] = theta[k] + share * move[k, 0]
            if trial[2] < highest:
                _sums(
                    trial,
                    ship,
                    smooth,
                    ranges,
                    epochs,
                    gps_variance,
                    range_variance,
                    score[:, 0],
                    own,
                    spread,
                )
                whitened, fine = _scaled_solve(spread, score)
                if fine and np.sum(score * whitened) <= size * (1 + 1e-6) + 1e-12:
                    break
            share /= 2
        theta[:] = trial
        if share <= 1e-4:
            return 0
        if size < 1e-10 or np.sum(score * whitened) < 1e-14:
            inverse, fine = _scaled_solve(own, np.eye(unknowns))
            if not fine:
                return 0
            covariance[:] = inverse @ spread @ inverse.T
            moments = _moments(theta, ship, smooth, epochs, gps_variance, range_variance)
            if not follow_the_bend(own, spread, moments, draws, covariance):
                return 0
            estimate[:] = theta
            return step
    return 0


@compiled
def _moments(theta, ship, smooth, epochs, gps_variance, range_variance):
    """Sums (P, 3) over the pings of weight times instrument times 1, t and t squared."""
    unknowns = len(theta)
    moments = np.zeros((unknowns, 3))
    instrument = np.empty(unknowns)
    for n in range(len(ship)):
        w = _instrument(
            theta, ship[n, 2], smooth[n, 0], smooth[n, 1], epochs[n], gps_variance, range_variance, instrument
        )
        for i in range(unknowns):
            for power in range(3):
                moments[i, power] += w * instrument[i] * epochs[n] ** power
    return moments


@compiled
def _fix_one(ship, smooth, ranges, epochs, gps_variance, range_variance, draws, estimate, covariance):
    unknowns = len(estimate)
    still, fine = linear_start(ship, smooth, ranges, epochs, False)
    if not fine:
        return 0
    if unknowns == 4:
        return _descend(
            still, ship, smooth, ranges, epochs, gps_variance, range_variance, draws, estimate, covariance
        )
    free, fine = linear_start(ship, smooth, ranges, epochs, True)
    if fine:
        steps = _descend(
            free, ship, smooth, ranges, epochs, gps_variance, range_variance, draws, estimate, covariance
        )
        if steps > 0:
            return steps
    theta = np.zeros(unknowns)
    theta[:4] = still
    return _descend(
        theta, ship, smooth, ranges, epochs, gps_variance, range_variance, draws, estimate, covariance
    )


@warms
def _warm() -> None:
    rng = np.random.default_rng(1)
    ship = np.zeros((2, 30, 3))
    ship[:, :, :2] = 100 * rng.normal(size=(2, 30, 2))
    ranges = np.linalg.norm(ship - [10.0, 0.0, -200.0], axis=2)
    for moving in (False, True):
        fix_squared_range(ship, ranges, np.arange(30.0), 1.0, 1.0, moving=moving)
