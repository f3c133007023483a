"""All that pings say of a beacon through squared ranges, in a dozen weighted sums.

The squared range q is quadratic in the unknowns, so with instruments J and weights w held, the sum of w J q is a
quadratic polynomial in them. Its coefficients are moments: sums of w J times the columns of `COLUMNS`.

    instrument_sums(theta, track, smooth, origin, noise, moments, spread)
    score(moments, theta, value, own)
"""

from __future__ import annotations

import numba
import numpy as np

from trackerlib.beacon.small_systems import whiten
from trackerlib.compiled import compiled

# Columns of the moments: what is known of q, place, range, one; the same times t, t, t squared.
KNOWN, EAST, NORTH, UP, RANGE, ONE, T_EAST, T_NORTH, T_UP, T, TT = range(11)
STILL_COLUMNS, COLUMNS = 6, 11
BLOCK = 128  # pings worked on side by side
FAST = {"reassoc", "contract", "arcp", "nsz"}  # NaN and infinity keep their meaning

_fast = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)


@_fast
def _add_products(left, right, rows, columns, out):
    """Adds to `out` (rows, columns) the products of rows of two buffers (., BLOCK)."""
    for i in range(rows):
        for j in range(columns):
            total = 0.0
            for k in range(BLOCK):
                total += left[i, k] * right[j, k]
            out[i, j] += total


@_fast
def _fill_columns(ship, ranges, epochs, origin, first, count, moving, known, columns):
    """Fills the columns (COLUMNS, BLOCK) of pings first to first + count, zero beyond; `known` is taken from q."""
    for k in range(count):
        x, y = ship[first + k, 0] - origin[0], ship[first + k, 1] - origin[1]
        up, r = ship[first + k, 2] - origin[2], ranges[first + k] - origin[3]
        columns[KNOWN, k] = x * x + y * y + up * up - r * r - known
        columns[EAST, k], columns[NORTH, k], columns[UP, k] = x, y, up
        columns[RANGE, k], columns[ONE, k] = r, 1.0
    if moving:
        for k in range(count):
            t = epochs[first + k]
            columns[T_EAST, k], columns[T_NORTH, k] = t * columns[EAST, k], t * columns[NORTH, k]
            columns[T_UP, k], columns[T, k], columns[TT, k] = t * columns[UP, k], t, t * t
    columns[:, count:] = 0.0


@_fast
def _fill_instruments(theta, ship, smooth, epochs, origin, first, count, noise, instruments, weighted):
    """Fills instruments (P, BLOCK) and the same times their weights, zero beyond `count`."""
    gx, gy, rr = noise[0], noise[1], noise[2]
    floor = 2 * gx * gx + 2 * gy * gy + 2 * rr * rr
    moving = len(theta) > 4
    vx = vy = vz = 0.0
    if moving:
        vx, vy, vz = theta[4], theta[5], theta[6]
    for k in range(count):
        t = epochs[first + k] if moving else 0.0
        ix = smooth[first + k, 0] - origin[0] - theta[0] - t * vx
        iy = smooth[first + k, 1] - origin[1] - theta[1] - t * vy
        z = theta[2] + t * vz - ship[first + k, 2] + origin[2]
        xx, yy = ix * ix, iy * iy
        ss = xx + yy + z * z
        w = 1 / (4 * (xx * gx + yy * gy + ss * rr) + floor)
        s = np.sqrt(ss)
        instruments[0, k], instruments[1, k] = -2 * ix, -2 * iy
        instruments[2, k], instruments[3, k] = 2 * z, 2 * s
        weighted[0, k], weighted[1, k] = -2 * ix * w, -2 * iy * w
        weighted[2, k], weighted[3, k] = 2 * z * w, 2 * s * w
    if moving:
        for i in range(3):
            for k in range(count):
                instruments[4 + i, k] = epochs[first + k] * instruments[i, k]
                weighted[4 + i, k] = epochs[first + k] * weighted[i, k]
    instruments[:, count:] = 0.0
    weighted[:, count:] = 0.0


@compiled
def instrument_sums(theta, ship, smooth, ranges, epochs, origin, noise, moments, spread):
    """Fills the moments (P, COLUMNS) of w J and the sum of w J J' (P, P), instruments and weights at theta (P,).

    theta : east, north, up, c0, then three velocities if it moves, less `origin` (4,)
    smooth : (N, 2) what the others tell of the ship's place; noise : variances (3,) east, north, range
    """
    unknowns, count = len(theta), len(ship)
    moving = unknowns > 4
    columns, used = np.empty((COLUMNS, BLOCK)), COLUMNS if moving else STILL_COLUMNS
    instruments, weighted = np.empty((unknowns, BLOCK)), np.empty((unknowns, BLOCK))
    known = noise[0] + noise[1] - noise[2]
    moments[:] = 0.0
    spread[:] = 0.0
    for first in range(0, count, BLOCK):
        part = min(BLOCK, count - first)
        _fill_columns(ship, ranges, epochs, origin, first, part, moving, known, columns)
        _fill_instruments(theta, ship, smooth, epochs, origin, first, part, noise, instruments, weighted)
        _add_products(weighted, columns, unknowns, used, moments)
        _add_products(weighted, instruments, unknowns, unknowns, spread)


@compiled
def start_sums(ship, smooth, ranges, epochs, origin, span, moving, sums):
    """Fills sums (4 or 8, COLUMNS) of smoothed place, range and one (and t times these, t squared) times columns.

    Instants are counted in `span`; what heights differ by is left out.
    """
    count, rows = len(ship), 8 if moving else 4
    columns, left = np.empty((COLUMNS, BLOCK)), np.empty((rows, BLOCK))
    sums[:] = 0.0
    for first in range(0, count, BLOCK):
        part = min(BLOCK, count - first)
        _fill_columns(ship, ranges, epochs, origin, first, part, moving, 0.0, columns)
        left[:, part:] = 0.0
        for k in range(part):
            left[0, k], left[1, k] = smooth[first + k, 0] - origin[0], smooth[first + k, 1] - origin[1]
            left[2, k], left[3, k] = columns[RANGE, k], 1.0
            columns[KNOWN, k] -= columns[UP, k] ** 2
        if moving:
            for k in range(part):
                t = epochs[first + k] / span
                left[4, k], left[5, k], left[6, k], left[7, k] = t * left[0, k], t * left[1, k], t, t * t
        _add_products(left, columns, rows, COLUMNS if moving else STILL_COLUMNS, sums)


@compiled
def score(moments, theta, value, own):
    """Fills the score (P,), the sum of w J q, and its derivative `own` (P, P), at theta (P,)."""
    unknowns = len(theta)
    px, py, pz, c0 = theta[0], theta[1], theta[2], theta[3]
    square = px * px + py * py + pz * pz - c0 * c0
    for i in range(unknowns):
        m = moments[i]
        value[i] = (
            m[KNOWN] - 2 * (m[EAST] * px + m[NORTH] * py + m[UP] * pz - m[RANGE] * c0) + m[ONE] * square
        )
        own[i, 0] = 2 * (m[ONE] * px - m[EAST])
        own[i, 1] = 2 * (m[ONE] * py - m[NORTH])
        own[i, 2] = 2 * (m[ONE] * pz - m[UP])
        own[i, 3] = 2 * (m[RANGE] - m[ONE] * c0)
    if unknowns > 4:
        _add_motion(moments, theta, value, own)


@compiled
def _add_motion(moments, theta, value, own):
    px, py, pz, vx, vy, vz = theta[0], theta[1], theta[2], theta[4], theta[5], theta[6]
    along, speed = px * vx + py * vy + pz * vz, vx * vx + vy * vy + vz * vz
    for i in range(len(theta)):
        m = moments[i]
        value[i] += m[TT] * speed + 2 * m[T] * along - 2 * (m[T_EAST] * vx + m[T_NORTH] * vy + m[T_UP] * vz)
        own[i, 0] += 2 * m[T] * vx
        own[i, 1] += 2 * m[T] * vy
        own[i, 2] += 2 * m[T] * vz
        own[i, 4] = 2 * (m[T] * px + m[TT] * vx - m[T_EAST])
        own[i, 5] = 2 * (m[T] * py + m[TT] * vy - m[T_NORTH])
        own[i, 6] = 2 * (m[T] * pz + m[TT] * vz - m[T_UP])


@compiled
def take_out_shared(theta, ship, smooth, shared, epochs, origin, noise, moments):
    """Takes out of the moments what instruments that share the ping's own position error would leave in the mean.

    shared : (N,) covariance of smoothed place and own over the variance of a position. By Stein's lemma w J q then
        has the mean 2 shared (gx^2 dx d/dx + gy^2 dy d/dy) w J; dx and dy are taken from the ping itself.
    """
    unknowns = len(theta)
    instruments, weighted = np.empty((unknowns, BLOCK)), np.empty((unknowns, BLOCK))
    change = np.empty(unknowns)
    for first in range(0, len(ship), BLOCK):
        part = min(BLOCK, len(ship) - first)
        _fill_instruments(theta, ship, smooth, epochs, origin, first, part, noise, instruments, weighted)
        for k in range(part):
            n = first + k
            s = instruments[3, k] / 2
            w = weighted[3, k] / instruments[3, k]
            for axis in range(2):
                gps, d = noise[axis], -instruments[axis, k] / 2
                by_weight = -8 * d * w * (gps + noise[2])
                for i in range(4):
                    change[i] = by_weight * weighted[i, k]
                change[axis] -= 2 * w
                change[3] += 2 * w * d / s
                for i in range(4, unknowns):
                    change[i] = epochs[n] * change[i - 4]
                own = ship[n, axis] - origin[axis]
                for i in range(unknowns):
                    lost = 2 * shared[n] * gps * change[i]
                    moments[i, KNOWN] -= lost * own
                    moments[i, EAST + axis] -= lost / 2
                    moments[i, T_EAST + axis] -= lost * epochs[n] / 2


@compiled
def share_by_leverage(theta, ship, smooth, epochs, origin, noise, root, shared):
    """Fills `shared` (N,) with what `take_out_shared` needs to undo the bias that noise in the instruments leaves.

    The noise of a smoothed place is that of the pings it is made of, and so goes with the error of the solution that
    these pings move. To second order the score's mean changes as if each ping shared its leverage, w J' spread^-1 J,
    of its own error, the other way round. root : (P, P) of the spread.
    """
    unknowns = len(theta)
    instruments, weighted = np.empty((unknowns, BLOCK)), np.empty((unknowns, BLOCK))
    for first in range(0, len(ship), BLOCK):
        part = min(BLOCK, len(ship) - first)
        _fill_instruments(theta, ship, smooth, epochs, origin, first, part, noise, instruments, weighted)
        for k in range(part):
            shared[first + k] = 0.0
        whiten(root, instruments)
        whiten(root, weighted)
        for i in range(unknowns):
            for k in range(part):
                shared[first + k] -= instruments[i, k] * weighted[i, k]


@compiled
def correlated_spread(theta, ship, smooth, epochs, origin, noise, correlation, spread):
    """Adds to the score's covariance (P, P) what errors of position that are correlated in time add.

    Two pings' q covary by 4 (gx^2 dx dx' + gy^2 dy dy') r + 2 (gx^4 + gy^4) r^2 where their position errors
    correlate by r = exp(-|t - t'| / correlation); such sums fall by a factor from one ping to the next.
    """
    unknowns = len(theta)
    instruments, weighted = np.empty((unknowns, BLOCK)), np.empty((unknowns, BLOCK))
    east, north, both = np.zeros(unknowns), np.zeros(unknowns), np.zeros(unknowns)
    gx, gy = noise[0], noise[1]
    fourth = 2 * (gx * gx + gy * gy)
    for first in range(0, len(ship), BLOCK):
        part = min(BLOCK, len(ship) - first)
        _fill_instruments(theta, ship, smooth, epochs, origin, first, part, noise, instruments, weighted)
        for k in range(part):
            n = first + k
            fall = np.exp(-abs(epochs[n] - epochs[n - 1]) / correlation) if n else 0.0
            ix, iy = instruments[0, k], instruments[1, k]
            for i in range(unknowns):
                east[i], north[i], both[i] = fall * east[i], fall * north[i], fall * fall * both[i]
            for i in range(unknowns):
                for j in range(unknowns):
                    shared = gx * ix * east[j] + gy * iy * north[j] + fourth * both[j]
                    spread[i, j] += weighted[i, k] * shared
                    spread[j, i] += weighted[i, k] * shared
            for i in range(unknowns):
                east[i] += ix * weighted[i, k]
                north[i] += iy * weighted[i, k]
                both[i] += weighted[i, k]
