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
BLOCK = 64  # pings worked on side by side
FAST = {"reassoc", "contract", "arcp", "nsz"}  # NaN and infinity keep their meaning

_fast = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)


@_fast
def _add_products(left, right, rows, columns, out):
    """Adds to `out` (rows, columns) the products of the rows of two buffers."""
    for i in range(rows):
        for j in range(columns):
            total = 0.0
            for k in range(BLOCK):
                total += left[i * BLOCK + k] * right[j * BLOCK + k]
            out[i, j] += total


@_fast
def _fill_columns(ship, ranges, epochs, origin, first, count, moving, known, columns):
    """Fills the columns of pings first to first + count, zero beyond; `known` is taken from q.

    A buffer here is flat, its rows BLOCK long, which tells the compiler that they do not overlap.
    """
    x0, y0, up0, r0 = origin[0], origin[1], origin[2], origin[3]
    for k in range(count):
        x, y = ship[first + k, 0] - x0, ship[first + k, 1] - y0
        up, r = ship[first + k, 2] - up0, ranges[first + k] - r0
        columns[KNOWN * BLOCK + k] = x * x + y * y + up * up - r * r - known
        columns[EAST * BLOCK + k] = x
        columns[NORTH * BLOCK + k] = y
        columns[UP * BLOCK + k] = up
        columns[RANGE * BLOCK + k] = r
        columns[ONE * BLOCK + k] = 1.0
    if moving:
        for k in range(count):
            t = epochs[first + k]
            columns[T_EAST * BLOCK + k] = t * columns[EAST * BLOCK + k]
            columns[T_NORTH * BLOCK + k] = t * columns[NORTH * BLOCK + k]
            columns[T_UP * BLOCK + k] = t * columns[UP * BLOCK + k]
            columns[T * BLOCK + k] = t
            columns[TT * BLOCK + k] = t * t
    _clear_beyond(columns, count)


@_fast
def _fill_instruments(theta, ship, smooth, epochs, origin, first, count, noise, instruments, weighted):
    """Fills instruments (P rows) and the same times their weights, zero beyond `count`."""
    gx, gy, rr = 4 * (noise[0] + noise[2]), 4 * (noise[1] + noise[2]), 4 * noise[2]
    floor = 2 * (noise[0] * noise[0] + noise[1] * noise[1] + noise[2] * noise[2])
    x0, y0, z0 = origin[0] + theta[0], origin[1] + theta[1], origin[2] + theta[2]
    vx = vy = vz = 0.0
    if len(theta) > 4:
        vx, vy, vz = theta[4], theta[5], theta[6]
    for k in range(count):
        t = epochs[first + k]
        x, y = smooth[first + k, 0] - x0 - t * vx, smooth[first + k, 1] - y0 - t * vy
        z = z0 + t * vz - ship[first + k, 2]
        xx, yy, zz = x * x, y * y, z * z
        s = 2 * np.sqrt(xx + yy + zz)
        w = 1 / (xx * gx + yy * gy + zz * rr + floor)
        instruments[k] = -2 * x
        instruments[BLOCK + k] = -2 * y
        instruments[2 * BLOCK + k] = 2 * z
        instruments[3 * BLOCK + k] = s
        weighted[k] = -2 * x * w
        weighted[BLOCK + k] = -2 * y * w
        weighted[2 * BLOCK + k] = 2 * z * w
        weighted[3 * BLOCK + k] = s * w
    if len(theta) > 4:
        for k in range(count):
            t = epochs[first + k]
            for i in range(3):
                instruments[(4 + i) * BLOCK + k] = t * instruments[i * BLOCK + k]
                weighted[(4 + i) * BLOCK + k] = t * weighted[i * BLOCK + k]
    _clear_beyond(instruments, count)
    _clear_beyond(weighted, count)


@_fast
def _clear_beyond(buffer, count):
    if count < BLOCK:
        for row in range(0, len(buffer), BLOCK):
            buffer[row + count : row + BLOCK] = 0.0


@compiled
def instrument_sums(theta, ship, smooth, ranges, epochs, origin, noise, moments, spread):
    """Fills the moments (P, COLUMNS) of w J and the sum of w J J' (P, P), instruments and weights at theta (P,).

    theta : east, north, up, c0, then three velocities if it moves, less `origin` (4,)
    smooth : (N, 2) what the others tell of the ship's place; noise : variances (3,) east, north, range
    """
    unknowns, count = len(theta), len(ship)
    moving = unknowns > 4
    columns, used = np.empty(COLUMNS * BLOCK), COLUMNS if moving else STILL_COLUMNS
    instruments, weighted = np.empty(unknowns * BLOCK), np.empty(unknowns * BLOCK)
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
    columns, left = np.empty(COLUMNS * BLOCK), np.empty(rows * BLOCK)
    sums[:] = 0.0
    for first in range(0, count, BLOCK):
        part = min(BLOCK, count - first)
        _fill_columns(ship, ranges, epochs, origin, first, part, moving, 0.0, columns)
        _fill_left(smooth, epochs, origin, first, part, span, moving, columns, left)
        _add_products(left, columns, rows, COLUMNS if moving else STILL_COLUMNS, sums)


@_fast
def _fill_left(smooth, epochs, origin, first, count, span, moving, columns, left):
    """Fills what the equations of a start are multiplied by, and takes heights out of what is known."""
    for k in range(count):
        left[k] = smooth[first + k, 0] - origin[0]
        left[BLOCK + k] = smooth[first + k, 1] - origin[1]
        left[2 * BLOCK + k] = columns[RANGE * BLOCK + k]
        left[3 * BLOCK + k] = 1.0
        columns[KNOWN * BLOCK + k] -= columns[UP * BLOCK + k] ** 2
    if moving:
        for k in range(count):
            t = epochs[first + k] / span
            for i in range(3):
                left[(4 + i) * BLOCK + k] = t * (left[i * BLOCK + k] if i < 2 else 1.0)
            left[7 * BLOCK + k] = t * t
    _clear_beyond(left, count)


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
    instruments, weighted = np.empty(unknowns * BLOCK), np.empty(unknowns * BLOCK)
    change, right, lost = np.empty(unknowns * BLOCK), np.empty(3 * BLOCK), np.empty((unknowns, 3))
    for first in range(0, len(ship), BLOCK):
        part = min(BLOCK, len(ship) - first)
        _fill_instruments(theta, ship, smooth, epochs, origin, first, part, noise, instruments, weighted)
        for axis in range(2):
            _fill_change(axis, unknowns, epochs, shared, first, part, noise, instruments, weighted, change)
            for k in range(part):
                right[k] = ship[first + k, axis] - origin[axis]
                right[BLOCK + k], right[2 * BLOCK + k] = 1.0, epochs[first + k]
            _clear_beyond(right, part)
            lost[:] = 0.0
            _add_products(change, right, unknowns, 3, lost)
            for i in range(unknowns):
                moments[i, KNOWN] -= lost[i, 0]
                moments[i, EAST + axis] -= lost[i, 1] / 2
                moments[i, T_EAST + axis] -= lost[i, 2] / 2


@_fast
def _fill_change(axis, unknowns, epochs, shared, first, count, noise, instruments, weighted, change):
    """Fills 2 shared g^2 times how weighted instruments change with the smoothed place along an axis."""
    for k in range(count):
        twice = 2 * shared[first + k] * noise[axis]
        d = -instruments[axis * BLOCK + k] / 2
        s, ws = instruments[3 * BLOCK + k], weighted[3 * BLOCK + k]
        w = ws / s
        by_weight = -8 * twice * d * w * (noise[axis] + noise[2])
        for i in range(3):
            change[i * BLOCK + k] = by_weight * weighted[i * BLOCK + k]
        change[axis * BLOCK + k] -= 2 * twice * w
        change[3 * BLOCK + k] = by_weight * ws + 4 * twice * w * d / s
    if unknowns > 4:
        for k in range(count):
            for i in range(3):
                change[(4 + i) * BLOCK + k] = epochs[first + k] * change[i * BLOCK + k]
    _clear_beyond(change, count)


@compiled
def share_by_leverage(theta, ship, smooth, epochs, origin, noise, root, shared):
    """Fills `shared` (N,) with what `take_out_shared` needs to undo the bias that noise in the instruments leaves.

    The noise of a smoothed place is that of the pings it is made of, and so goes with the error of the solution that
    these pings move. To second order the score's mean changes as if each ping shared its leverage, w J' spread^-1 J,
    of its own error, the other way round. root : (P, P) of the spread.
    """
    unknowns = len(theta)
    instruments, weighted = np.empty(unknowns * BLOCK), np.empty(unknowns * BLOCK)
    for first in range(0, len(ship), BLOCK):
        part = min(BLOCK, len(ship) - first)
        _fill_instruments(theta, ship, smooth, epochs, origin, first, part, noise, instruments, weighted)
        whiten(root, instruments.reshape(unknowns, BLOCK))
        whiten(root, weighted.reshape(unknowns, BLOCK))
        shared[first : first + part] = 0.0
        for i in range(unknowns):
            for k in range(part):
                shared[first + k] -= instruments[i * BLOCK + k] * weighted[i * BLOCK + k]


@compiled
def correlated_spread(theta, ship, smooth, epochs, origin, noise, correlation, spread):
    """Adds to the score's covariance (P, P) what errors of position that are correlated in time add.

    Two pings' q covary by 4 (gx^2 dx dx' + gy^2 dy dy') r + 2 (gx^4 + gy^4) r^2 where their position errors
    correlate by r = exp(-|t - t'| / correlation); such sums fall by a factor from one ping to the next.
    """
    unknowns = len(theta)
    instruments, weighted = np.empty(unknowns * BLOCK), np.empty(unknowns * BLOCK)
    east, north, both = np.zeros(unknowns), np.zeros(unknowns), np.zeros(unknowns)
    gx, gy = noise[0], noise[1]
    fourth = 2 * (gx * gx + gy * gy)
    for first in range(0, len(ship), BLOCK):
        part = min(BLOCK, len(ship) - first)
        _fill_instruments(theta, ship, smooth, epochs, origin, first, part, noise, instruments, weighted)
        for k in range(part):
            n = first + k
            fall = np.exp(-abs(epochs[n] - epochs[n - 1]) / correlation) if n else 0.0
            ix, iy = instruments[k], instruments[BLOCK + k]
            for i in range(unknowns):
                east[i], north[i], both[i] = fall * east[i], fall * north[i], fall * fall * both[i]
            for i in range(unknowns):
                for j in range(unknowns):
                    shared = gx * ix * east[j] + gy * iy * north[j] + fourth * both[j]
                    spread[i, j] += weighted[i * BLOCK + k] * shared
                    spread[j, i] += weighted[i * BLOCK + k] * shared
            for i in range(unknowns):
                east[i] += ix * weighted[i * BLOCK + k]
                north[i] += iy * weighted[i * BLOCK + k]
                both[i] += weighted[i * BLOCK + k]
