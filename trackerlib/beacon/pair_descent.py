"""Kernels of the fix from experiments: sums over experiments, damped Gauss-Newton steps, places to start from.

The loop over the experiments of a fix is what the processor works on side by side: nothing in it is stored, and
square roots come from its estimate of them. Equation numbers are those of Wojcik (1993).
"""

from __future__ import annotations

import numba
import numpy as np

from trackerlib.compiled import compiled

STEPS = 200
ATTEMPTS = 7  # two linear starts, the one told, one in each quarter of the box
PRESSED = 8  # steps in a row against the side of the search box: the answer lies outside
EXPLAINED = 6.0  # standard errors of chi-square, which shared receptions widen; below it starts end
AT_REST = 1e-8  # squared step in standard errors
CAREFUL = 1e-3  # damping after a step that failed or left the box
ROUNDING = 1e-10  # of a sum of squares
FAR = 400.0  # ship position errors: from here on one round puts an experiment's corrections right, else two
LANES = 8  # experiments are padded to a multiple of this
STILL_COLUMNS, MOVING_COLUMNS = 3, 7  # that a start's squares are linear in
ROWS = 10  # weight, two epochs, two places, difference of ranges
ONE_ROUND, TWO_ROUNDS = (0,), (0, 0)  # their lengths are known when compiled
FAST = {"reassoc", "contract", "arcp", "nsz"}  # NaN and infinity keep their meaning


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def fix_all(
    ship, ranges, epochs, pairs, gps_variance, range_variance, start, limits,
    estimate, covariance, misfit, converged, iterations, threads,
):  # fmt: skip
    """Fixes of all surveys into the last arrays, by threads; the others as `fix_pairs` has checked them."""
    surveys = len(ship)
    chunks = min(surveys, 8 * threads)
    for chunk in numba.prange(chunks):
        fix_some(
            ship, ranges, epochs, pairs, gps_variance, range_variance, start, limits, estimate, covariance, misfit,
            converged, iterations, chunk * surveys // chunks, (chunk + 1) * surveys // chunks,
        )  # fmt: skip


@compiled
def fix_some(
    ship, ranges, epochs, pairs, gps_variance, range_variance, start, limits,
    estimate, covariance, misfit, converged, iterations, first, last,
):  # fmt: skip
    """The same of surveys first to last, by this thread alone."""
    work, scratch = _rows(epochs, pairs), _scratch(len(start))
    place = np.zeros(len(start)), np.zeros((len(start), len(start)))
    columns, linear = _columns(epochs, len(start) == 6), _scratch(MOVING_COLUMNS)
    for k in range(first, last):
        _gather(ship[k], ranges[k], pairs, work)
        misfit[k], iterations[k], converged[k] = _best_descent(
            ship[k], ranges[k], len(pairs), start, work, gps_variance, range_variance, limits,
            scratch, place, columns, linear, estimate[k], covariance[k],
        )  # fmt: skip


@compiled
def _scratch(unknowns):
    """Two normal matrices and a factor, two right sides, a step and a place."""
    n = unknowns
    return (
        np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    )  # fmt: skip


@compiled
def _rows(epochs, pairs):
    """What is the same for all surveys; places beyond the last experiment keep no weight and a range above zero."""
    work = np.zeros((ROWS, (len(pairs) + LANES - 1) // LANES * LANES))
    work[5], work[8] = 1e3, 1e3
    for n in range(len(pairs)):
        work[0, n], work[1, n], work[2, n] = 1.0, epochs[pairs[n, 0]], epochs[pairs[n, 1]]
    return work


@compiled
def _gather(ship, ranges, pairs, work):
    for n in range(len(pairs)):
        i, j = pairs[n]
        work[3, n], work[4, n], work[5, n] = ship[i, 0], ship[i, 1], ship[i, 2]
        work[6, n], work[7, n], work[8, n] = ship[j, 0], ship[j, 1], ship[j, 2]
        work[9, n] = ranges[i] - ranges[j]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST, inline="always")
def _rough_root(square):
    """1 / sqrt(square) to 7 digits: processors estimate it quickly in single precision."""
    return np.float64(np.float32(1) / np.sqrt(np.float32(square)))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST, inline="always")
def _reciprocal_root(square):
    """1 / sqrt(square) to 14 digits: one Newton step doubles those of the estimate."""
    q = _rough_root(square)
    return q * (1.5 - 0.5 * square * q * q)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST, inline="always")
def _rest(x1, y1, z1, x2, y2, z2, difference, gps_variance, range_variance, rounds):
    """Level directions and reciprocal ranges of one experiment whose corrections rest, its misfit and 1 / sqrt(c).

    An experiment's corrections are -lambda V a with g = 0 (2-70). They only stretch the level offsets, by f1 and f2,
    and h = h0 -+ mu a with a = h / d, mu = lambda gps_variance, gives f to second order before it is put right.
    """
    hh1, hh2, zz1, zz2 = x1 * x1 + y1 * y1, x2 * x2 + y2 * y2, z1 * z1, z2 * z2
    s1, s2 = hh1 + zz1, hh2 + zz2
    q1, q2 = _rough_root(s1), _rough_root(s2)
    qq1, qq2 = q1 * q1, q2 * q2
    level1, level2 = hh1 * qq1, hh2 * qq2
    root = _rough_root(gps_variance * (level1 + level2) + 2 * range_variance)
    over_c = root * root
    mu = (s1 * q1 - s2 * q2 - difference) * over_c * gps_variance
    up1, up2 = zz1 * qq1, zz2 * qq2
    mu *= 1 + 1.5 * mu * gps_variance * over_c * (level1 * up1 * q1 - level2 * up2 * q2)
    p1, p2 = mu * q1, mu * q2
    f1, f2 = 1 - p1 * (1 - p1 * up1), 1 + p2 * (1 + p2 * up2)
    miss = 0.0
    for k in range(len(rounds)):
        q1, q2 = _reciprocal_root(f1 * f1 * hh1 + zz1), _reciprocal_root(f2 * f2 * hh2 + zz2)
        u1, u2 = f1 * q1, f2 * q2
        root = _reciprocal_root(gps_variance * (u1 * u1 * hh1 + u2 * u2 * hh2) + 2 * range_variance)
        over_c = root * root
        # slant range of the corrected place plus a times its correction
        miss = (f1 * hh1 * f1 + zz1) * q1 - (f2 * hh2 * f2 + zz2) * q2 - difference
        miss += u1 * (1 - f1) * hh1 - u2 * (1 - f2) * hh2
        if k < len(rounds) - 1:
            mu = miss * over_c * gps_variance
            f1, f2 = 1 - mu * u1, 1 + mu * u2
    return u1 * x1, u1 * y1, u2 * x2, u2 * y2, z1 * q1, z2 * q2, miss, root


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _still_sums(theta, work, gps_variance, range_variance, rounds, normal, right):
    """Fills D (2-67) and the right side (2-68) of a still beacon; the sum of squared misfits."""
    px, py, pz = theta[0], theta[1], theta[2]
    total = rx = ry = rz = nxx = nxy = nyy = nxz = nyz = nzz = 0.0
    for n in range(work.shape[1]):
        ux1, uy1, ux2, uy2, uz1, uz2, miss, root = _rest(
            work[3, n] - px, work[4, n] - py, pz - work[5, n], work[6, n] - px, work[7, n] - py, pz - work[8, n],
            work[9, n], gps_variance, range_variance, rounds,
        )  # fmt: skip
        root *= work[0, n]
        miss *= root
        bx, by, bz = (ux2 - ux1) * root, (uy2 - uy1) * root, (uz1 - uz2) * root
        total += miss * miss
        rx += bx * miss
        ry += by * miss
        rz += bz * miss
        nxx += bx * bx
        nxy += bx * by
        nyy += by * by
        nxz += bx * bz
        nyz += by * bz
        nzz += bz * bz
    right[0], right[1], right[2] = -rx, -ry, -rz
    normal[0, 0], normal[1, 0], normal[1, 1] = nxx, nxy, nyy
    normal[2, 0], normal[2, 1], normal[2, 2] = nxz, nyz, nzz
    return total


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _moving_sums(theta, work, gps_variance, range_variance, rounds, normal, right):
    """The same of a moving beacon."""
    px, py, pz, vx, vy, vz = theta[0], theta[1], theta[2], theta[3], theta[4], theta[5]
    total = r0 = r1 = r2 = r3 = r4 = r5 = 0.0
    n00 = n10 = n11 = n20 = n21 = n22 = n30 = n31 = n32 = n33 = n40 = n41 = n42 = n43 = n44 = 0.0
    n50 = n51 = n52 = n53 = n54 = n55 = 0.0
    for n in range(work.shape[1]):
        t1, t2 = work[1, n], work[2, n]
        ux1, uy1, ux2, uy2, uz1, uz2, miss, root = _rest(
            work[3, n] - px - t1 * vx, work[4, n] - py - t1 * vy, pz + t1 * vz - work[5, n],
            work[6, n] - px - t2 * vx, work[7, n] - py - t2 * vy, pz + t2 * vz - work[8, n],
            work[9, n], gps_variance, range_variance, rounds,
        )  # fmt: skip
        root *= work[0, n]
        miss *= root
        b0, b1, b2 = (ux2 - ux1) * root, (uy2 - uy1) * root, (uz1 - uz2) * root
        t1, t2 = t1 * root, t2 * root
        b3, b4, b5 = t2 * ux2 - t1 * ux1, t2 * uy2 - t1 * uy1, t1 * uz1 - t2 * uz2
        total += miss * miss
        r0, r1, r2, r3, r4, r5 = (
            r0 + b0 * miss, r1 + b1 * miss, r2 + b2 * miss, r3 + b3 * miss, r4 + b4 * miss, r5 + b5 * miss
        )  # fmt: skip
        n00, n10, n11 = n00 + b0 * b0, n10 + b1 * b0, n11 + b1 * b1
        n20, n21, n22 = n20 + b2 * b0, n21 + b2 * b1, n22 + b2 * b2
        n30, n31, n32, n33 = n30 + b3 * b0, n31 + b3 * b1, n32 + b3 * b2, n33 + b3 * b3
        n40, n41, n42, n43, n44 = n40 + b4 * b0, n41 + b4 * b1, n42 + b4 * b2, n43 + b4 * b3, n44 + b4 * b4
        n50, n51, n52 = n50 + b5 * b0, n51 + b5 * b1, n52 + b5 * b2
        n53, n54, n55 = n53 + b5 * b3, n54 + b5 * b4, n55 + b5 * b5
    right[0], right[1], right[2], right[3], right[4], right[5] = -r0, -r1, -r2, -r3, -r4, -r5
    normal[0, 0], normal[1, 0], normal[1, 1] = n00, n10, n11
    normal[2, 0], normal[2, 1], normal[2, 2] = n20, n21, n22
    normal[3, 0], normal[3, 1], normal[3, 2], normal[3, 3] = n30, n31, n32, n33
    normal[4, 0], normal[4, 1], normal[4, 2], normal[4, 3], normal[4, 4] = n40, n41, n42, n43, n44
    normal[5, 0], normal[5, 1], normal[5, 2] = n50, n51, n52
    normal[5, 3], normal[5, 4], normal[5, 5] = n53, n54, n55
    return total


@compiled
def _normal_equations(theta, work, gps_variance, range_variance, normal, right):
    x, y, z = work[3, 0] - theta[0], work[4, 0] - theta[1], work[5, 0] - theta[2]
    far = x * x + y * y + z * z > FAR**2 * gps_variance
    if len(theta) == 3:
        if far:
            return _still_sums(theta, work, gps_variance, range_variance, ONE_ROUND, normal, right)
        return _still_sums(theta, work, gps_variance, range_variance, TWO_ROUNDS, normal, right)
    if far:
        return _moving_sums(theta, work, gps_variance, range_variance, ONE_ROUND, normal, right)
    return _moving_sums(theta, work, gps_variance, range_variance, TWO_ROUNDS, normal, right)


@compiled
def _factor(normal, damping, lower):
    """Fills lower with L of L D L' = normal + damping diag(normal), on its diagonal 1 / D; whether it could."""
    unknowns = len(normal)
    for i in range(unknowns):
        for j in range(i):
            value = normal[i, j]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            lower[i, j] = value  # times D until the row is done
        pivot = normal[i, i] * (1 + damping)
        for j in range(i):
            scaled = lower[i, j] * lower[j, j]
            pivot -= lower[i, j] * scaled
            lower[i, j] = scaled
        if not pivot > 1e-13 * normal[i, i]:
            return False
        lower[i, i] = 1 / pivot
    return True


@compiled
def _copy(values, to):
    for k in range(len(values)):  # quicker than a slice of so few
        to[k] = values[k]


@compiled
def _substitute(lower, right, move):
    """Fills move with the solution of L D L' move = right."""
    unknowns = len(right)
    for i in range(unknowns):
        value = right[i]
        for k in range(i):
            value -= lower[i, k] * move[k]
        move[i] = value
    for i in range(unknowns - 1, -1, -1):
        value = move[i] * lower[i, i]
        for k in range(i + 1, unknowns):
            value -= lower[k, i] * move[k]
        move[i] = value


@compiled
def _try(theta, move, limits, trial):
    """Fills trial with theta + move inside the box; whether it lies against a side of it."""
    outside = False
    for k in range(len(theta)):
        trial[k] = theta[k] + move[k]
    if trial[2] > limits[1, 2]:  # above the surface: the same squares as below it
        trial[2] = 2 * limits[1, 2] - trial[2]
    for k in range(len(theta)):
        trial[k] = min(max(trial[k], limits[0, k]), limits[1, k])
        outside |= trial[k] <= limits[0, k] or trial[k] >= limits[1, k]
    return outside


@compiled
def _descend(theta, work, gps_variance, range_variance, limits, scratch, covariance):
    """Damped Gauss-Newton steps from theta, in place: sum of squares, steps taken, whether it came to rest."""
    normal, normal_there, lower, right, right_there, move, trial = scratch
    total = _normal_equations(theta, work, gps_variance, range_variance, normal, right)
    damping, rest, outside = 0.0, False, False
    step = pressed = 0
    while step < STEPS and np.isfinite(total):
        step += 1
        if not _factor(normal, damping, lower):
            damping = max(10 * damping, CAREFUL)
            if damping > 1e12:
                break
            continue
        _substitute(lower, right, move)
        small = 0.0  # squared step in standard errors
        for k in range(len(theta)):
            small += right[k] * move[k]
        outside = _try(theta, move, limits, trial)
        if outside and damping < CAREFUL:
            damping = CAREFUL
            continue
        pressed = pressed + 1 if outside else 0
        if pressed > PRESSED:
            break
        if small < AT_REST:
            _copy(trial, theta)
            rest = not outside
            break
        there = _normal_equations(trial, work, gps_variance, range_variance, normal_there, right_there)
        if there <= total * (1 + ROUNDING):
            _copy(trial, theta)
            total = there
            normal, normal_there = normal_there, normal
            right, right_there = right_there, right
            damping = 0.0 if damping < 1e-6 else damping / 10
        else:
            damping = max(10 * damping, CAREFUL)
    if not _factor(normal, 0.0, lower):
        return total, step, False
    for column in range(len(theta)):
        for k in range(len(theta)):
            right[k] = 1.0 if k == column else 0.0
        _substitute(lower, right, covariance[column])
    return total, step, rest


@compiled
def _columns(epochs, moving):
    """Room for the columns of `_linear_place` and the known side, those of the epochs alone already there."""
    columns = np.zeros(((MOVING_COLUMNS if moving else STILL_COLUMNS) + 1, len(epochs)))
    if moving:
        columns[5] = epochs
        columns[6] = epochs**2
    return columns


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _mean(rows, i):
    total = 0.0
    for n in range(rows.shape[1]):
        total += rows[i, n]
    return total / rows.shape[1]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _dot(rows, i, j):
    total = 0.0
    for n in range(rows.shape[1]):
        total += rows[i, n] * rows[j, n]
    return total


@compiled
def _linear_place(theta, moving, ship, ranges, columns, scratch, limits):
    """Fills theta from equations linear in place, velocity, c0 and the remaining squares; whether they tell it.

    |r|^2 - (C T)^2 = 2 r p + 2 t r v - 2 C T c0 - K0 (- K1 t - K2 t^2) by least squares, about the means of all.
    """
    size = MOVING_COLUMNS if moving else STILL_COLUMNS
    normal, lower, right, solved, mean = scratch[0], scratch[2], scratch[3], scratch[5], scratch[6]
    count, last = len(ranges), len(columns) - 1
    east = north = height = middle = 0.0
    for n in range(count):
        east += ship[n, 0]
        north += ship[n, 1]
        height += ship[n, 2]
        middle += ranges[n]
    east, north, height, middle = east / count, north / count, height / count, middle / count
    for n in range(count):
        x, y, r = ship[n, 0] - east, ship[n, 1] - north, ranges[n] - middle
        columns[0, n], columns[1, n], columns[2, n], columns[last, n] = x, y, r, x * x + y * y - r * r
    if moving:
        for n in range(count):
            columns[3, n], columns[4, n] = columns[5, n] * columns[0, n], columns[5, n] * columns[1, n]
    mean_known = _mean(columns, last)
    for i in range(size):
        mean[i] = _mean(columns, i)
        right[i] = _dot(columns, i, last) - count * mean[i] * mean_known
        for j in range(i + 1):
            normal[i, j] = _dot(columns, i, j) - count * mean[i] * mean[j]
    if not _factor(normal[:size, :size], 0.0, lower):
        return False
    _substitute(lower, right[:size], solved)
    p0, p1, c0 = solved[0] / 2, solved[1] / 2, -solved[2] / 2
    square = c0 * c0 - p0 * p0 - p1 * p1 - mean_known
    for k in range(size):
        square += mean[k] * solved[k]
    depth = np.sqrt(max(square, 100.0))
    for k in range(len(theta)):
        theta[k] = 0.0
    theta[0], theta[1], theta[2] = p0 + east, p1 + north, min(height - depth, 0.02 * limits[0, 2])
    if moving:
        theta[3], theta[4] = solved[3] / 2, solved[4] / 2
        theta[5] = (solved[5] / 2 + p0 * theta[3] + p1 * theta[4]) / depth
        if not abs(theta[5]) < limits[1, 5]:
            theta[5] = 0.0
    for k in range(len(theta)):
        theta[k] = min(max(theta[k], 0.9 * limits[0, k]), 0.9 * limits[1, k])
    return np.isfinite(square)


@compiled
def _place_start(theta, attempt, ship, ranges, start, columns, linear, limits):
    """Fills theta with the place that an attempt starts from; whether there is one."""
    moving = len(start) == 6
    if attempt == 0 or (attempt == 1 and moving):
        return _linear_place(theta, moving and attempt == 0, ship, ranges, columns, linear, limits)
    _copy(start, theta)
    if attempt > 2:
        theta[0] = limits[(attempt - 3) % 2, 0] / 2
        theta[1] = limits[(attempt - 3) // 2, 1] / 2
    return attempt > 1


@compiled
def _best_descent(
    ship, ranges, count, start, work, gps_variance, range_variance, limits, scratch, place, columns, linear, estimate,
    covariance,
):  # fmt: skip
    """The lowest place that any start leads to: misfit, steps taken in all, whether it is at rest."""
    unknowns = len(estimate)
    degrees = count - unknowns
    theta, there = place
    best, found, taken = np.inf, False, 0
    for attempt in range(ATTEMPTS):
        if not _place_start(theta, attempt, ship, ranges, start, columns, linear, limits):
            continue
        total, steps, rest = _descend(theta, work, gps_variance, range_variance, limits, scratch, there)
        taken += steps
        if (rest and not found) or (rest == found and total < best):
            best, found = total, rest
            _copy(theta, estimate)
            for row in range(unknowns):
                _copy(there[row], covariance[row])
        if found and best < degrees + EXPLAINED * np.sqrt(2.0 * degrees):
            break
    return best, taken, found
