"""All that pings say of a beacon through squared ranges, in a dozen weighted sums.

The squared range q is quadratic in the unknowns, so with instruments J and weights w held, the sum of w J q is a
quadratic polynomial in them. Its coefficients are moments: sums of w J times the columns of `COLUMNS`.

    track = lay_out(ship, smooth, ranges, epochs, origin, span, moving, sums)
    instrument_sums(theta, track, noise, moments, spread)
    score(moments, theta, value, own)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackerlib.beacon.small_systems import whiten
from trackerlib.compiled import compiled, compiled_with

# Columns of the moments: what is known of q, place, range, one; the same times t, t, t squared.
KNOWN, EAST, NORTH, UP, RANGE, ONE, T_EAST, T_NORTH, T_UP, T, TT = range(11)
STILL_COLUMNS, COLUMNS = 6, 11
STILL_ROWS, MOVING_ROWS = 4, 7  # instruments, one an unknown
ROWS, WEIGHT = 8, 7  # place enough for any instruments, and the row of weights after them
LINE = 8  # numbers in a line of the processor's cache
BLOCK = 128  # pings worked on side by side
FAST = {"reassoc", "contract", "arcp", "nsz"}  # NaN and infinity keep their meaning
# Whether there is motion is known when compiled, by the length of these. A loop must not name a row that a track of no
# motion does not have, even where it is not read: it would be asked whether that row lies apart from what the loop
# writes, which is chance, and where it does not the loop goes one ping at a time and rounds its sums otherwise.
NO_MOTION, MOTION = (), (0,)

_fast = compiled_with(*FAST)


class Track(NamedTuple):
    """A survey laid out for sums: block after block of BLOCK pings, in each one row after the other, zero at the end.

    A buffer is flat, its rows of constant length, which tells the compiler that they do not overlap.
    """

    pings: int
    highest: float  # the greatest height of the hydrophone
    width: int  # rows of columns a block: those of `COLUMNS`, and an empty one where they are odd in number
    columns: np.ndarray
    told: np.ndarray  # east and north (2 rows) of the ship as the others tell it
    instruments: np.ndarray  # of the block in work (ROWS rows)
    weighted: np.ndarray  # the same times their weights, and the weights in row WEIGHT


@compiled
def _empty_track(count, highest, moving):
    blocks, width = (count + BLOCK - 1) // BLOCK, COLUMNS + 1 if moving else STILL_COLUMNS
    columns, told = _lined_up(blocks * width * BLOCK), _lined_up(blocks * 2 * BLOCK)
    last = blocks - 1
    columns[last * width * BLOCK :] = 0.0
    told[last * 2 * BLOCK :] = 0.0
    instruments, weighted = _lined_up(ROWS * BLOCK), _lined_up(ROWS * BLOCK)
    instruments[:], weighted[:] = 0.0, 0.0
    return Track(count, highest, width, columns, told, instruments, weighted)


@compiled
def _lined_up(size):
    """An empty buffer (size,) that begins where a line of the processor's cache does."""
    room = np.empty(size + LINE)
    skip = -(room.ctypes.data // room.itemsize) % LINE
    return room[skip : skip + size]


@_fast
def _add_products(left, right, first, rows, columns, out, apart=1):
    """Adds to `out` (rows, columns) the products of rows of two buffers, those of the right one from `first` on.

    They are taken two by two, so that buffers need a row more where rows or columns are odd in number; two of the
    right one lie so many rows `apart`.
    """
    for i in range(0, rows, 2):
        one, other = left[i * BLOCK : (i + 1) * BLOCK], left[(i + 1) * BLOCK : (i + 2) * BLOCK]
        for j in range(0, columns, 2):
            at, then = (first + j) * BLOCK, (first + j + apart) * BLOCK
            this, next_one = right[at : at + BLOCK], right[then : then + BLOCK]
            a = b = c = d = 0.0
            for k in range(BLOCK):
                a += one[k] * this[k]
                b += one[k] * next_one[k]
                c += other[k] * this[k]
                d += other[k] * next_one[k]
            out[i, j] += a
            if j + 1 < columns:
                out[i, j + 1] += b
            if i + 1 < rows:
                out[i + 1, j] += c
                if j + 1 < columns:
                    out[i + 1, j + 1] += d


@compiled
def _block(track, first):
    """Columns and told places of the block from ping `first` on."""
    at, size = first * track.width, track.width * BLOCK
    return track.columns[at : at + size], track.told[2 * first : 2 * (first + BLOCK)]


@compiled
def lay_out(ship, smooth, ranges, epochs, origin, span, moving, sums):
    """The track, counted from `origin` (4,), and what starts are made of, as they need the same columns.

    smooth : (N, 2) what the others tell of the ship's place
    sums : (4 or 8, COLUMNS) filled with sums of smoothed place, range and one (and t times these but the range, t
        squared) times the columns. Instants are counted in `span`; what heights differ by is left out of `KNOWN`.
    """
    track, highest = _empty_track(len(ship), 0.0, moving), 0.0
    used = COLUMNS if moving else STILL_COLUMNS
    sums[:] = 0.0
    for first in range(0, len(ship), BLOCK):
        part, (columns, told) = slice(first, first + BLOCK), _block(track, first)
        _fill_columns(ship[part], smooth[part], ranges[part], epochs[part], origin, moving, columns, told)
        _add_products(told, columns, 0, 2, used, sums[:2])
        _add_products(columns[RANGE * BLOCK :], columns, 0, 2, used, sums[2:4])
        if moving:
            _fill_motion(2, columns, told, track.weighted)
            _add_products(track.weighted, columns, 0, 2, used, sums[4:6])
            _add_products(columns[T * BLOCK :], columns, 0, 2, used, sums[6:])
        highest = max(highest, _add_heights(columns))
    if moving:
        sums[4:7] /= span
        sums[7] /= span * span
    return Track(
        track.pings, highest, track.width, track.columns, track.told, track.instruments, track.weighted
    )


@_fast
def _fill_columns(ship, smooth, ranges, epochs, origin, moving, columns, told):
    """Fills a block; squares of heights are not yet in `KNOWN`."""
    flat, flat_smooth = ship.reshape(ship.size), smooth.reshape(smooth.size)
    east, north, up, distance = origin[0], origin[1], origin[2], origin[3]
    _fill_places(flat, east, north, up, columns)
    for k in range(len(smooth)):
        told[k] = flat_smooth[2 * k] - east
        told[BLOCK + k] = flat_smooth[2 * k + 1] - north
    for k in range(len(ship)):
        x, y, r = columns[EAST * BLOCK + k], columns[NORTH * BLOCK + k], ranges[k] - distance
        columns[KNOWN * BLOCK + k] = x * x + y * y - r * r
        columns[RANGE * BLOCK + k] = r
        columns[ONE * BLOCK + k] = 1.0
    if moving:
        for k in range(len(ship)):
            t = epochs[k]
            columns[T_EAST * BLOCK + k] = t * columns[EAST * BLOCK + k]
            columns[T_NORTH * BLOCK + k] = t * columns[NORTH * BLOCK + k]
            columns[T_UP * BLOCK + k] = t * columns[UP * BLOCK + k]
            columns[T * BLOCK + k] = t
            columns[TT * BLOCK + k] = t * t
            columns[COLUMNS * BLOCK + k] = 0.0


@_fast
def _fill_places(ship, east, north, up, columns):
    for k in range(len(ship) // 3):
        columns[EAST * BLOCK + k] = ship[3 * k] - east
        columns[NORTH * BLOCK + k] = ship[3 * k + 1] - north
        columns[UP * BLOCK + k] = ship[3 * k + 2] - up


@_fast
def _add_heights(columns):
    """Adds squares of heights to what is known; the greatest height, or zero, as they are counted from their mean."""
    for k in range(BLOCK):
        columns[KNOWN * BLOCK + k] += columns[UP * BLOCK + k] ** 2
    a = b = c = d = 0.0  # four, as each waits for the one before
    for k in range(UP * BLOCK, (UP + 1) * BLOCK, 4):
        a, b = max(a, columns[k]), max(b, columns[k + 1])
        c, d = max(c, columns[k + 2]), max(d, columns[k + 3])
    return max(max(a, b), max(c, d))


@compiled
def radius_of(track):
    """Root-mean-square distance of the ship from the origin."""
    total = 0.0
    for first in range(0, track.pings, BLOCK):
        at = first * track.width
        for k in range(2 * BLOCK):  # east and north follow each other
            total += track.columns[at + EAST * BLOCK + k] ** 2
    return np.sqrt(total / track.pings)


@compiled
def thinned(track):
    """A track of every so many pings, a block or less, evenly taken: enough to say how well a place is seen."""
    step = (track.pings + BLOCK - 1) // BLOCK
    few = _empty_track((track.pings + step - 1) // step, track.highest, track.width > STILL_COLUMNS)
    for k in range(few.pings):
        ping = min(k * step + step // 2, track.pings - 1)
        first = ping // BLOCK * BLOCK
        columns, told = _block(track, first)
        for row in range(track.width):
            few.columns[row * BLOCK + k] = columns[row * BLOCK + ping - first]
        for row in range(2):
            few.told[row * BLOCK + k] = told[row * BLOCK + ping - first]
    return few


@compiled
def instrument_sums(theta, track, noise, moments, spread):
    """Fills the moments (P, COLUMNS) of w J and the sum of w J J' (P, P), instruments and weights at theta (P,).

    theta : east, north, up, c0, then three velocities if it moves, less the track's origin
    noise : variances (3,) east, north, range
    """
    unknowns = len(theta)
    used = COLUMNS if unknowns > STILL_ROWS else STILL_COLUMNS
    moments[:] = 0.0
    spread[:] = 0.0
    for first in range(0, track.pings, BLOCK):
        fill_instruments(theta, track, first, noise)
        _add_products(track.weighted, track.columns, first // BLOCK * track.width, unknowns, used, moments)
        _add_products(track.weighted, track.instruments, 0, unknowns, unknowns, spread)
    known = noise[0] + noise[1] - noise[2]
    for i in range(unknowns):
        moments[i, KNOWN] -= known * moments[i, ONE]


@compiled
def fill_instruments(theta, track, first, noise):
    """Fills the track's instruments and the same times their weights for the block from ping `first` on."""
    columns, told = _block(track, first)
    if len(theta) > STILL_ROWS:
        _fill_instruments(theta, columns, told, noise, MOTION, track.instruments, track.weighted)
        _fill_motion(3, columns, track.instruments, track.instruments[STILL_ROWS * BLOCK :])
        _fill_motion(3, columns, track.weighted, track.weighted[STILL_ROWS * BLOCK :])
    else:
        _fill_instruments(theta, columns, told, noise, NO_MOTION, track.instruments, track.weighted)


@_fast
def _fill_instruments(theta, columns, told, noise, motion, instruments, weighted):
    gx, gy, rr = 4 * (noise[0] + noise[2]), 4 * (noise[1] + noise[2]), 4 * noise[2]
    floor = 2 * (noise[0] * noise[0] + noise[1] * noise[1] + noise[2] * noise[2])
    x0, y0, z0 = theta[0], theta[1], theta[2]
    moving = len(motion) > 0
    vx, vy, vz = (theta[4], theta[5], theta[6]) if moving else (0.0, 0.0, 0.0)
    for k in range(BLOCK):
        t = columns[T * BLOCK + k] if moving else 0.0
        x, y = told[k] - x0 - t * vx, told[BLOCK + k] - y0 - t * vy
        z = z0 + t * vz - columns[UP * BLOCK + k]
        xx, yy, zz = x * x, y * y, z * z
        # In single precision, which takes a third of the time: rounding of instruments and weights biases nothing.
        s = 2 * np.sqrt(np.float32(xx + yy + zz))
        w = np.float32(columns[ONE * BLOCK + k]) / np.float32(xx * gx + yy * gy + zz * rr + floor)
        instruments[k] = -2 * x
        instruments[BLOCK + k] = -2 * y
        instruments[2 * BLOCK + k] = 2 * z
        instruments[3 * BLOCK + k] = s
        weighted[k] = -2 * x * w
        weighted[BLOCK + k] = -2 * y * w
        weighted[2 * BLOCK + k] = 2 * z * w
        weighted[3 * BLOCK + k] = s * w
        weighted[WEIGHT * BLOCK + k] = w


@_fast
def _fill_motion(rows, columns, places, velocities):
    """Fills the rows of velocities: those of places times t."""
    for i in range(rows):
        for k in range(BLOCK):
            velocities[i * BLOCK + k] = columns[T * BLOCK + k] * places[i * BLOCK + k]


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
def take_out_shared(theta, track, shared, noise, moments):
    """Takes out of the moments what instruments that share the ping's own position error would leave in the mean.

    shared : (N,) covariance of smoothed place and own over the variance of a position. By Stein's lemma w J q then
        has the mean 2 shared (gx^2 dx d/dx + gy^2 dy d/dy) w J; dx and dy are taken from the ping itself.
    """
    own, change, lost = _nothing_lost(len(theta))
    for first in range(0, track.pings, BLOCK):
        fill_instruments(theta, track, first, noise)
        part = shared[first : first + BLOCK]
        own[: len(part)] = part
        own[len(part) :] = 0.0
        _lose(len(theta), track, first, noise, own, change, lost)
    _take_out(lost, moments)


@compiled
def take_out_noise(theta, track, noise, root, moments):
    """Takes out of the moments the bias that noise in the instruments leaves.

    The noise of a smoothed place is that of the pings it is made of, and so goes with the error of the solution that
    these pings move. To second order the score's mean changes as if each ping shared its leverage, w J' spread^-1 J,
    of its own error, the other way round. root : (P, P) of the spread.
    """
    own, change, lost = _nothing_lost(len(theta))
    form = _leverage_form(root)
    for first in range(0, track.pings, BLOCK):
        fill_instruments(theta, track, first, noise)
        columns = _block(track, first)[0]
        if len(theta) > STILL_ROWS:
            _fill_leverage(form, columns, MOTION, track.instruments, track.weighted, own)
        else:
            _fill_leverage(form, columns, NO_MOTION, track.instruments, track.weighted, own)
        _lose(len(theta), track, first, noise, own, change, lost)
    _take_out(lost, moments)


@compiled
def _leverage_form(root):
    """Coefficients (4, 4, 3) of the products of a ping's first four instruments, and of these times t and t squared."""
    unknowns = len(root)
    inverse, form = np.eye(unknowns), np.zeros((4, 4, 3))
    whiten(root, inverse)
    for i in range(unknowns):
        for j in range(unknowns):
            value = 0.0
            for k in range(unknowns):
                value += inverse[k, i] * inverse[k, j]
            power = (i > 3) + (j > 3)
            form[min(i % 4, j % 4), max(i % 4, j % 4), power] += value
    return form


@_fast
def _fill_leverage(form, columns, motion, instruments, weighted, leverage):
    """Fills the leverages (BLOCK,), less than zero, of a block; form : (4, 4, 3)."""
    moving = len(motion) > 0
    for k in range(BLOCK):
        t = columns[T * BLOCK + k] if moving else 0.0
        x, y, z, s = (
            instruments[k],
            instruments[BLOCK + k],
            instruments[2 * BLOCK + k],
            instruments[3 * BLOCK + k],
        )
        total = x * (
            _at(form, 0, 0, t) * x + _at(form, 0, 1, t) * y + _at(form, 0, 2, t) * z + _at(form, 0, 3, t) * s
        )
        total += y * (_at(form, 1, 1, t) * y + _at(form, 1, 2, t) * z + _at(form, 1, 3, t) * s)
        total += z * (_at(form, 2, 2, t) * z + _at(form, 2, 3, t) * s) + _at(form, 3, 3, t) * s * s
        leverage[k] = -total * weighted[WEIGHT * BLOCK + k]


@_fast
def _at(form, i, j, t):
    return form[i, j, 0] + t * (form[i, j, 1] + t * form[i, j, 2])


@compiled
def _nothing_lost(unknowns):
    """What a block's pings share (BLOCK,), scratch for `_lose`, and sums to begin with."""
    return np.empty(BLOCK), np.zeros(2 * ROWS * BLOCK), np.zeros((2, unknowns, 3))


@compiled
def _lose(unknowns, track, first, noise, own, change, lost):
    """Adds to `lost`, by axis, what a block loses of known squares, of places, and of places times t."""
    columns = _block(track, first)[0]
    _fill_change(noise, own, track.instruments, track.weighted, change)
    for axis in range(2):
        rows = change[axis * ROWS * BLOCK : (axis + 1) * ROWS * BLOCK]
        if unknowns > STILL_ROWS:
            _fill_motion(3, columns, rows, rows[STILL_ROWS * BLOCK :])
            _add_products(rows, columns, T, unknowns, 1, lost[axis, :, 2:])
        _add_products(rows, columns, EAST + axis, unknowns, 2, lost[axis], ONE - EAST - axis)


@compiled
def _take_out(lost, moments):
    for axis in range(2):
        for i in range(len(moments)):
            moments[i, KNOWN] -= lost[axis, i, 0]
            moments[i, EAST + axis] -= lost[axis, i, 1] / 2
            moments[i, T_EAST + axis] -= lost[axis, i, 2] / 2


@_fast
def _fill_change(noise, shared, instruments, weighted, change):
    """Fills 2 shared g^2 times how weighted instruments change with the smoothed place, east and then north."""
    gx, gy, rr, north = noise[0], noise[1], noise[2], ROWS * BLOCK
    for k in range(BLOCK):
        x, y, z, s = weighted[k], weighted[BLOCK + k], weighted[2 * BLOCK + k], weighted[3 * BLOCK + k]
        w, per = weighted[WEIGHT * BLOCK + k], 1 / instruments[3 * BLOCK + k]
        east_share, north_share = 4 * shared[k] * gx, 4 * shared[k] * gy
        # the logarithm of w changes by -8 dx w (gx^2 + range's), and dx is -instrument / 2
        by_east, by_north = 2 * east_share * x * (gx + rr), 2 * north_share * y * (gy + rr)
        change[k] = by_east * x - east_share * w
        change[BLOCK + k] = by_east * y
        change[2 * BLOCK + k] = by_east * z
        change[3 * BLOCK + k] = by_east * s - east_share * x * per
        change[north + k] = by_north * x
        change[north + BLOCK + k] = by_north * y - north_share * w
        change[north + 2 * BLOCK + k] = by_north * z
        change[north + 3 * BLOCK + k] = by_north * s - north_share * y * per


@compiled
def correlated_spread(theta, track, epochs, noise, correlation, spread):
    """Adds to the score's covariance (P, P) what errors of position that are correlated in time add.

    Two pings' q covary by 4 (gx^2 dx dx' + gy^2 dy dy') r + 2 (gx^4 + gy^4) r^2 where their position errors
    correlate by r = exp(-|t - t'| / correlation); such sums fall by a factor from one ping to the next.
    """
    unknowns, instruments, weighted = len(theta), track.instruments, track.weighted
    east, north, both = np.zeros(unknowns), np.zeros(unknowns), np.zeros(unknowns)
    gx, gy = noise[0], noise[1]
    fourth = 2 * (gx * gx + gy * gy)
    for first in range(0, track.pings, BLOCK):
        fill_instruments(theta, track, first, noise)
        for k in range(min(BLOCK, track.pings - first)):
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
