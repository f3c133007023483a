"""Kernels of the fix from experiments: damped steps to a place of rest, places to start from, the lowest of all.

Equation numbers are those of Wojcik (1993).
"""

from __future__ import annotations

import numba
import numpy as np

from trackerlib.beacon.pair_sums import FAST, experiment_rows, gather_experiments, normal_equations
from trackerlib.compiled import compiled

STEPS = 100  # of a descent, each of them one sum over the experiments
ATTEMPTS = 11  # the one told and two linear starts, four aslant of it at half the depth, four beside it
FEWEST_ATTEMPTS = 6  # and one for every four experiments where those are more
PRESSED = 4  # steps in a row against the side of the search box: the answer lies outside
EXPLAINED = 6.0  # standard errors of chi-square, which shared receptions widen; below it starts end
AT_REST = 1e-8  # squared step in standard errors
SLOW = 0.05  # of the sum of squares: a step that gains less,
TARDY = 0.2  # and more than this of what the last one gained, is slow
NEAR = 0.01  # standard errors over which second derivatives are differences
SAME = 0.1  # squared distance in standard errors of one place of rest from another
WORTH = 0.02  # of what a descent lies above the best: it must gain as much with each step
DOUBTFUL = 0.08, 0.12  # standard error of a place, still or moving, in distances: from here on
PROMPT = 7, 8  # and where a search took more steps, there may be other places with less squares
ALONG = 2.0, -2.0, 5.0, -5.0  # standard errors of the depth, to where a still beacon is looked for then
CAREFUL = 1e-3  # damping after a step that failed or left the box
ROUNDING = 1e-6  # of a sum of squares
STILL_COLUMNS, MOVING_COLUMNS = 3, 7  # that a start's squares are linear in


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
    work, scratch = experiment_rows(epochs, pairs), _scratch(len(start))
    n = len(start)
    place = np.zeros(n), np.zeros((n, n)), np.zeros((ATTEMPTS, n)), np.zeros((n, n))
    columns, linear = _columns(epochs), _scratch(MOVING_COLUMNS)
    for k in range(first, last):
        gather_experiments(ship[k], ranges[k], pairs, work)
        misfit[k], iterations[k], converged[k] = _best_descent(
            ship[k], ranges[k], len(pairs), start, work, gps_variance, range_variance, limits,
            scratch, place, columns, linear, estimate[k], covariance[k],
        )  # fmt: skip


@compiled
def _scratch(unknowns):
    """Two normal matrices, one of second derivatives and a factor, two right sides, a step and a place."""
    n = unknowns
    return (
        np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n),
        np.zeros(n), np.zeros(n)
    )  # fmt: skip


@compiled
def _factor(unknowns, normal, bend, damping, lower):
    """Fills lower with L of L D L' = normal + bend + damping diag(normal), on its diagonal 1 / D; whether it could."""
    for i in range(unknowns):
        for j in range(i):
            value = normal[i, j] + bend[i, j]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            lower[i, j] = value  # times D until the row is done
        pivot = normal[i, i] * (1 + damping) + bend[i, i]
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
def _copy_rows(matrix, to):
    for row in range(len(matrix)):
        for k in range(len(matrix)):
            to[row, k] = matrix[row, k]


@compiled
def _substitute(unknowns, lower, right, move):
    """Fills move with the solution of L D L' move = right."""
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
    if trial[2] > limits[1, 2]:  # above the surface: the same squares as below it, sinking for rising
        trial[2] = 2 * limits[1, 2] - trial[2]
        for k in range(5, len(theta)):
            trial[k] = -trial[k]
    for k in range(len(theta)):
        trial[k] = min(max(trial[k], limits[0, k]), limits[1, k])
        outside |= trial[k] <= limits[0, k] or trial[k] >= limits[1, k]
    return outside


@compiled
def _fill_bend(theta, work, gps_variance, range_variance, normal, right, spare, bend):
    """Fills bend with half the second derivatives of the squares less the normal matrix, by differences."""
    normal_there, right_there, trial = spare
    for k in range(len(theta)):
        _copy(theta, trial)
        trial[k] += NEAR / np.sqrt(normal[k, k])
        normal_equations(trial, work, gps_variance, range_variance, normal_there, right_there)
        for i in range(len(theta)):
            bend[i, k] = (right[i] - right_there[i]) / (trial[k] - theta[k])
    for i in range(len(theta)):
        for k in range(i + 1):
            bend[i, k] = (bend[i, k] + bend[k, i]) / 2 - normal[i, k]


@compiled
def _apart(theta, known, normal):
    """Squared distance of two places in standard errors."""
    square = 0.0
    for i in range(len(theta)):
        row = normal[i, i] * (theta[i] - known[i]) / 2
        for k in range(i):
            row += normal[i, k] * (theta[k] - known[k])
        square += 2 * row * (theta[i] - known[i])
    return square


@compiled
def _is_known(theta, rests, known, normal):
    """Whether a place is beside one of the first places of rest."""
    nearest = np.inf
    for k in range(known):
        nearest = min(nearest, _apart(theta, rests[k], normal))
    return nearest < SAME


@compiled
def _leads_nowhere(theta, total, gain, slow, normal, rests, known, best):
    """Whether a descent nears a place of rest that is known or one above the best."""
    if gain < 1 and _is_known(theta, rests, known, normal):
        return True
    return total > best and (slow or gain < WORTH * (total - best))


@compiled
def _zero(matrix):
    for i in range(len(matrix)):
        for k in range(i + 1):
            matrix[i, k] = 0.0


@compiled
def _invert(normal, bend, lower, covariance):
    """Fills covariance with the inverse of a normal matrix; whether it has one."""
    unknowns = len(normal)
    _zero(bend)
    if not _factor(unknowns, normal, bend, 0.0, lower):
        return False
    over = bend  # 1 / L below its diagonal
    for i in range(unknowns):
        for j in range(i):
            value = lower[i, j]
            for k in range(j + 1, i):
                value += lower[i, k] * over[k, j]
            over[i, j] = -value
    for i in range(unknowns):
        for j in range(i + 1):
            value = lower[i, i] * over[i, j] if j < i else lower[i, i]
            for k in range(i + 1, unknowns):
                value += over[k, i] * lower[k, k] * over[k, j]
            covariance[i, j] = covariance[j, i] = value
    return True


@compiled
def _descend(theta, work, gps_variance, range_variance, limits, scratch, covariance, rests, known, best):
    """Damped steps from theta, in place: sum of squares, steps taken, whether it came to rest.

    Gauss-Newton steps as long as they gain fast, then those of Newton; second derivatives serve several steps.
    A rest is an undamped one. Where some rests are known, with best the lowest, only a lower one is looked for.
    """
    normal, normal_there, bend, lower, right, right_there, move, trial = scratch
    total = normal_equations(theta, work, gps_variance, range_variance, normal, right)
    _zero(bend)
    damping, gain, rest, slow, stale = 0.0, np.inf, False, False, False
    step = pressed = 0
    while step < STEPS and np.isfinite(total):
        step += 1
        if slow and stale:
            spare = normal_there, right_there, trial
            _fill_bend(theta, work, gps_variance, range_variance, normal, right, spare, bend)
            step += len(theta)
            stale = False
        if not _factor(len(theta), normal, bend, damping, lower):
            damping = max(10 * damping, CAREFUL)
            if damping > 1e12:
                break
            continue
        _substitute(len(theta), lower, right, move)
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
        if small < AT_REST and damping == 0.0:
            _copy(trial, theta)
            rest = not outside
            break
        there = normal_equations(trial, work, gps_variance, range_variance, normal_there, right_there)
        if there > total * (1 + ROUNDING) or not np.isfinite(there):
            damping = max(10 * damping, CAREFUL)
            continue
        _copy(trial, theta)
        damping = 0.0 if damping < 1e-6 or small < AT_REST else damping / 10
        _copy_rows(normal_there, normal)  # quicker than an exchange, which counts who holds each
        _copy(right_there, right)
        tardy = total - there > TARDY * gain
        gain, total = total - there, there
        if slow and gain > SLOW:
            _zero(bend)
        slow, stale = gain < SLOW and (slow or tardy), tardy or not slow
        if normal[2, 2] * limits[0, 2] ** 2 < 1:  # at the surface nothing tells the depth
            break
        if known > 0 and _leads_nowhere(theta, total, gain, slow, normal, rests, known, best):
            break
    return total, step, rest and _invert(normal, bend, lower, covariance)


@compiled
def _columns(epochs):
    """Room for the columns of `_moving_products` and the known side, those of the epochs alone already there."""
    columns = np.zeros((MOVING_COLUMNS + 1, len(epochs)))
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


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _still_products(ship, ranges, normal, right, mean):
    """Fills products of place, range and the known side about their means, and the means; gives that of the known."""
    flat, count = ship.reshape(ship.size), len(ranges)
    east, north, near = flat[0], flat[1], ranges[0]
    sx = sy = sr = sk = xx = yx = yy = rx = ry = rr = xk = yk = rk = 0.0
    for n in range(count):
        x, y, r = flat[3 * n] - east, flat[3 * n + 1] - north, ranges[n] - near
        k = x * x + y * y - r * r
        sx, sy, sr, sk = sx + x, sy + y, sr + r, sk + k
        xx, yx, yy = xx + x * x, yx + y * x, yy + y * y
        rx, ry, rr = rx + r * x, ry + r * y, rr + r * r
        xk, yk, rk = xk + x * k, yk + y * k, rk + r * k
    x, y, r, k = sx / count, sy / count, sr / count, sk / count
    mean[0], mean[1], mean[2] = x, y, r
    right[0], right[1], right[2] = xk - sx * k, yk - sy * k, rk - sr * k
    normal[0, 0], normal[1, 0], normal[1, 1] = xx - sx * x, yx - sy * x, yy - sy * y
    normal[2, 0], normal[2, 1], normal[2, 2] = rx - sr * x, ry - sr * y, rr - sr * r
    return k


@compiled
def _moving_products(ship, ranges, columns, normal, right, mean):
    """The same of a moving beacon, with the columns that motion adds."""
    count, last = len(ranges), MOVING_COLUMNS
    for n in range(count):
        x, y, r = ship[n, 0] - ship[0, 0], ship[n, 1] - ship[0, 1], ranges[n] - ranges[0]
        columns[0, n], columns[1, n], columns[2, n], columns[last, n] = x, y, r, x * x + y * y - r * r
        columns[3, n], columns[4, n] = columns[5, n] * x, columns[5, n] * y
    known = _mean(columns, last)
    for i in range(last):
        mean[i] = _mean(columns, i)
        right[i] = _dot(columns, i, last) - count * mean[i] * known
        for j in range(i + 1):
            normal[i, j] = _dot(columns, i, j) - count * mean[i] * mean[j]
    return known


@compiled
def _keep_inside(theta, limits):
    for k in range(len(theta)):
        theta[k] = min(max(theta[k], 0.9 * limits[0, k]), 0.9 * limits[1, k])


@compiled
def _linear_place(theta, moving, ship, ranges, columns, scratch, limits):
    """Fills theta from equations linear in place, velocity, c0 and the remaining squares; whether they tell it.

    |r|^2 - (C T)^2 = 2 r p + 2 t r v - 2 C T c0 - K0 (- K1 t - K2 t^2) by least squares, counted from the first ping
    and then about the means of all.
    """
    size = MOVING_COLUMNS if moving else STILL_COLUMNS
    normal, bend, lower, right, solved, mean = (
        scratch[0],
        scratch[2],
        scratch[3],
        scratch[4],
        scratch[6],
        scratch[7],
    )
    if moving:
        known = _moving_products(ship, ranges, columns, normal, right, mean)
    else:
        known = _still_products(ship, ranges, normal, right, mean)
    if not _factor(size, normal, bend, 0.0, lower):
        return False
    _substitute(size, lower, right, solved)
    p0, p1, c0 = solved[0] / 2, solved[1] / 2, -solved[2] / 2
    square = c0 * c0 - p0 * p0 - p1 * p1 - known
    for k in range(size):
        square += mean[k] * solved[k]
    depth = np.sqrt(max(square, 100.0))
    for k in range(len(theta)):
        theta[k] = 0.0
    theta[0], theta[1] = p0 + ship[0, 0], p1 + ship[0, 1]
    theta[2] = min(ship[0, 2] - depth, 0.02 * limits[0, 2])
    if moving:
        theta[3], theta[4] = solved[3] / 2, solved[4] / 2
        theta[5] = (solved[5] / 2 + p0 * theta[3] + p1 * theta[4]) / depth
        if not abs(theta[5]) < limits[1, 5]:
            theta[5] = 0.0
    _keep_inside(theta, limits)
    return np.isfinite(square)


@compiled
def _place_start(theta, attempt, ship, ranges, start, columns, linear, limits):
    """Fills theta with the place that an attempt starts from; whether there is one."""
    moving = len(start) == 6
    if attempt == 0 or (attempt == 2 and moving):
        return _linear_place(theta, moving and attempt == 0, ship, ranges, columns, linear, limits)
    _copy(start, theta)
    beside, turned = 0.4 * start[2], (attempt - 3) % 4
    if attempt > 6:
        theta[turned % 2] += beside if turned < 2 else -beside
    elif attempt > 2:
        theta[0] += beside if turned % 2 == 0 else -beside
        theta[1] += beside if turned < 2 else -beside
        theta[2] /= 2
    _keep_inside(theta, limits)
    return attempt != 2


@compiled
def _is_doubtful(theta, covariance, steps, work):
    """Whether a place of rest is known too badly, and was too hard to find, for the only one."""
    moving = 1 if len(theta) == 6 else 0
    x, y, z = work[3, 0] - theta[0], work[4, 0] - theta[1], work[5, 0] - theta[2]
    variance = covariance[0, 0] + covariance[1, 1] + covariance[2, 2]
    return steps > PROMPT[moving] and variance > DOUBTFUL[moving] ** 2 * (x * x + y * y + z * z)


@compiled
def _step_along(theta, rest, covariance, side, limits):
    """Fills theta with the likeliest place where the depth is some standard errors from that of a rest."""
    for k in range(len(theta)):
        theta[k] = rest[k] + side * covariance[2, k] / np.sqrt(covariance[2, 2])
    if theta[2] > limits[1, 2]:
        theta[2] = 2 * limits[1, 2] - theta[2]
    _keep_inside(theta, limits)


@compiled
def _best_descent(
    ship, ranges, count, start, work, gps_variance, range_variance, limits, scratch, place, columns, linear, estimate,
    covariance,
):  # fmt: skip
    """The lowest place that any start leads to: misfit, steps taken in all, whether it is at rest."""
    still, degrees = len(estimate) == 3, count - len(estimate)
    explained = degrees + EXPLAINED * np.sqrt(2.0 * degrees)
    theta, there, rests, first = place
    best, lowest, known, taken, doubtful = np.inf, np.inf, 0, 0, False
    for attempt in range(min(max(FEWEST_ATTEMPTS, count // 4), ATTEMPTS)):
        if lowest < explained and (not doubtful or (still and attempt > 6)):
            break
        if still and known > 0 and 2 < attempt < 7:
            _step_along(theta, rests[0], first, ALONG[attempt - 3], limits)
        elif not _place_start(theta, attempt, ship, ranges, start, columns, linear, limits):
            continue
        total, steps, rest = _descend(
            theta, work, gps_variance, range_variance, limits, scratch, there, rests, known, lowest
        )
        taken += steps
        if (rest and known == 0) or (rest == (known > 0) and total < best):
            best = total
            _copy(theta, estimate)
            _copy_rows(there, covariance)
        if rest:
            lowest = min(lowest, total)
            doubtful |= _is_doubtful(theta, there, steps, work)
            if known == 0:
                if lowest < explained and not doubtful:
                    return best, taken, True
                _copy_rows(there, first)
            _copy(theta, rests[known])
            known += 1
    return best, taken, known > 0
