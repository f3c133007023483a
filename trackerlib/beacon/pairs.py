"""Fixes from experiments, pairs of receptions whose difference of ranges no emission time can change.

    pairs = experiments(25, spacing=45)
    fixes = fix_pairs(ship, ranges, epochs, pairs, gps_rms_m=3, range_rms_m=0.43)

The estimator of Wojcik (1993), chapters II and III: every measured quantity of an experiment may err, and the
beacon is where the least weighted squares of all corrections satisfy (2-19) or (3-10). The thesis steps all
corrections and the beacon together, hundreds of times where it is slow; here the corrections of an experiment
are solved for at each trial place, which leaves a least-squares problem in 3 or 6 unknowns and the same answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from trackerlib.beacon.squared_range import linear_start
from trackerlib.compiled import compiled, warms

START = (0.0, 0.0, -2500.0)  # (4-6), (4-7)
STEPS = 200
ATTEMPTS = 7  # two linear starts, the one told, one in each quarter of the box
PRESSED = 8  # steps in a row against the side of the search box: the answer lies outside
EXPLAINED = 4.0  # standard errors of chi-square: no further start is tried below this
LEAST_EXPERIMENTS = {False: (20, 35), True: (30, 45)}  # count, spacing: the thesis's minima still and moving
BLOCK = 32  # experiments worked on side by side
ROWS = 17  # of BLOCK numbers: misfits and their 6 slopes, then the 10 rows of measurements
DATA = 7 * BLOCK
FAST = {"reassoc", "contract", "arcp", "nsz"}  # NaN and infinity keep their meaning


@dataclass(frozen=True)
class SearchBox:
    """Where a beacon may be and how fast (2-48), (3-11)."""

    range_m: float = 5000.0  # |east|, |north| from the origin
    depth_m: float = 5000.0
    speed_mps: float = 5.0  # |each component|

    def __post_init__(self):
        for name in ("range_m", "depth_m", "speed_mps"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name):g}; wanted more than 0")

    def limits(self, unknowns: int) -> np.ndarray:
        """Lowest and highest value of each unknown (2, 3 or 6)."""
        r, d, v = self.range_m, self.depth_m, self.speed_mps
        return np.array([[-r, -r, -d, -v, -v, -v], [r, r, 0.0, v, v, v]])[:, :unknowns]


@dataclass(frozen=True, eq=False)
class PairFixes:
    """Fixes of B surveys: metres and m/s, unknowns east, north, up and, if it moves, three velocities."""

    estimate: np.ndarray  # (B, 3 or 6)
    covariance: np.ndarray  # (B, 3 or 6, 3 or 6) D^-1 (3-20), as if no two experiments shared a reception
    misfit: np.ndarray  # (B,) least weighted sum of squared corrections
    converged: np.ndarray  # (B,) at rest inside the search box, every direction seen
    iterations: np.ndarray  # (B,) steps taken


def experiments(count: int, spacing: int, step: int | None = None) -> np.ndarray:
    """Pairs of receptions (count, 2): first ones `step` apart (default: chained), partners `spacing` later.

    Raises ValueError for a count, spacing or step below one.
    """
    step = spacing if step is None else step
    if min(count, spacing, step) < 1:
        raise ValueError(
            f"found {count} experiments, spacing {spacing}, step {step}; wanted at least 1 of each"
        )
    first = step * np.arange(count)
    return np.column_stack([first, first + spacing])


def fix_pairs(
    ship: np.ndarray,
    ranges: np.ndarray,
    epochs: np.ndarray,
    pairs: np.ndarray,
    gps_rms_m: float,
    range_rms_m: float,
    *,
    moving: bool = False,
    box: SearchBox | None = None,
    start: tuple[float, ...] = START,
) -> PairFixes:
    """Maximum-likelihood places of beacons from pairs of receptions, all measurements in error.

    ship : (B, R, 3) logged positions of the hydrophone [m]; east and north in error, up known
    ranges : (B, R) speed of sound times arrival time less emission number times interval [m] (2-6)
    epochs : (R,) emission times [s]; a moving beacon's position is that at epoch 0
    pairs : (N, 2) which receptions make an experiment
    gps_rms_m, range_rms_m : sigma of a position (each axis) and of speed of sound times arrival time
    box, start : search region (2-48) and first guess (4-6); velocities start at zero unless given

    A fix starts from equations that are linear in squared ranges, then from `start`, then from `start` moved
    into each quarter of the box, until one comes to rest at a misfit that the noise explains; the least is kept.
    Fewer experiments than unknowns plus one is `converged` false.
    Raises ValueError for shapes that do not fit and for noise that is not positive.
    """
    ship, ranges = np.ascontiguousarray(ship, float), np.ascontiguousarray(ranges, float)
    epochs, pairs = np.ascontiguousarray(epochs, float), np.ascontiguousarray(pairs, np.int64)
    if (
        ship.ndim != 3
        or ship.shape[2] != 3
        or ranges.shape != ship.shape[:2]
        or epochs.shape != ranges.shape[1:]
    ):
        raise ValueError(
            f"found ship {ship.shape}, ranges {ranges.shape}, epochs {epochs.shape}; wanted (B, R, 3), (B, R), (R,)"
        )
    if (
        pairs.ndim != 2
        or pairs.shape[1] != 2
        or (pairs.size and not 0 <= pairs.min() <= pairs.max() < len(epochs))
    ):
        raise ValueError(
            f"found pairs {pairs.shape}; wanted (N, 2) numbers of receptions below {len(epochs)}"
        )
    if not gps_rms_m >= 0 or not range_rms_m >= 0 or gps_rms_m + range_rms_m <= 0:
        raise ValueError(f"found noise of {gps_rms_m} m and {range_rms_m} m; wanted at least one above zero")
    surveys, unknowns = len(ship), 6 if moving else 3
    first = np.zeros(unknowns)
    first[: len(start)] = start
    fixes = PairFixes(
        np.full((surveys, unknowns), np.nan),
        np.full((surveys, unknowns, unknowns), np.nan),
        np.full(surveys, np.nan),
        np.zeros(surveys, bool),
        np.zeros(surveys, np.int64),
    )
    if len(pairs) > unknowns:
        _fix_all(
            ship, ranges, epochs, pairs, float(gps_rms_m) ** 2, float(range_rms_m) ** 2, first,
            (box or SearchBox()).limits(unknowns), numba.get_num_threads(), fixes.estimate, fixes.covariance,
            fixes.misfit, fixes.converged, fixes.iterations,
        )  # fmt: skip
    return fixes


def shared_covariance(
    ship: np.ndarray,
    ranges: np.ndarray,
    epochs: np.ndarray,
    pairs: np.ndarray,
    state: np.ndarray,
    gps_rms_m: float,
    range_rms_m: float,
) -> np.ndarray:
    """Covariance (P, P) of one fix, the errors of a reception counted once in every experiment that holds it.

    ship (R, 3), ranges (R,), epochs (R,), pairs (N, 2) as for `fix_pairs`; state (P,) what it came to.
    D^-1 (3-20) is this where no two experiments share a reception.
    """
    moving = len(state) > 3
    place = state[:3] + (epochs[:, None] * state[3:] if moving else 0.0)
    offset = place - ship
    direction = offset / np.linalg.norm(offset, axis=1)[:, None]
    slope = np.hstack([direction, epochs[:, None] * direction]) if moving else direction
    b = slope[pairs[:, 0]] - slope[pairs[:, 1]]
    variance = gps_rms_m**2 * np.sum(direction[:, :2] ** 2, axis=1) + range_rms_m**2  # of one reception
    c = variance[pairs].sum(axis=1)
    sign = np.zeros((len(pairs), len(epochs)))
    rows = np.arange(len(pairs))
    sign[rows, pairs[:, 0]], sign[rows, pairs[:, 1]] = 1.0, -1.0
    pull = (b / c[:, None]).T @ sign  # (P, R): how each reception's error moves the normal equations
    scale = np.linalg.norm(b / np.sqrt(c)[:, None], axis=0)
    root = np.linalg.inv((b / c[:, None]).T @ b / np.outer(scale, scale)) / np.outer(scale, scale)
    return root @ (pull * variance) @ pull.T @ root


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _fix_all(
    ship, ranges, epochs, pairs, gps_variance, range_variance, start, limits, threads,
    estimate, covariance, misfit, converged, iterations,
):  # fmt: skip
    surveys = len(ship)
    chunks = min(surveys, 8 * threads)
    for chunk in numba.prange(chunks):
        blocks = (len(pairs) + BLOCK - 1) // BLOCK
        work = np.zeros((blocks, ROWS * BLOCK))
        for k in range(chunk * surveys // chunks, (chunk + 1) * surveys // chunks):
            _gather(ship[k], ranges[k], epochs, pairs, work)
            misfit[k], iterations[k], converged[k] = _best_descent(
                ship[k], ranges[k], epochs, len(pairs), start, work, gps_variance, range_variance, limits,
                estimate[k], covariance[k],
            )  # fmt: skip


@compiled
def _gather(ship, ranges, epochs, pairs, work):
    """Measurements of the experiments in rows of BLOCK; a last block that is not full repeats with no weight."""
    count = len(pairs)
    for n in range(len(work) * BLOCK):
        i, j = pairs[min(n, count - 1)]
        row = work[n // BLOCK, DATA + n % BLOCK :: BLOCK]
        row[0], row[1], row[2], row[3] = ship[i, 0], ship[i, 1], ship[i, 2], epochs[i]
        row[4], row[5], row[6], row[7] = ship[j, 0], ship[j, 1], ship[j, 2], epochs[j]
        row[8] = ranges[i] - ranges[j]
        row[9] = 1.0 if n < count else 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST, inline="always")
def _rest(x1, y1, z1, x2, y2, z2, difference, gps_variance, range_variance):
    """Level directions and reciprocal ranges of one experiment whose corrections rest, its misfit and 1 / c.

    An experiment's corrections are -lambda V a with g = 0 (2-70); a turns with them, which two rounds settle.
    One reciprocal a round serves both ranges and c.
    """
    zz1, zz2 = z1 * z1, z2 * z2
    ax1, ay1, ax2, ay2 = x1, y1, x2, y2
    ux1 = uy1 = ux2 = uy2 = q1 = q2 = over_c = miss = shift = 0.0
    for k in range(3):
        h1, h2 = ax1 * ax1 + ay1 * ay1, ax2 * ax2 + ay2 * ay2
        s1, s2 = h1 + zz1, h2 + zz2
        d1, d2 = np.sqrt(s1), np.sqrt(s2)
        product = d1 * d2
        square = s1 * s2
        c = gps_variance * (h1 * s2 + h2 * s1) + 2 * range_variance * square  # times s1 s2
        one = 1 / (product * c)
        over = c * one  # 1 / (d1 d2)
        q1, q2 = d2 * over, d1 * over
        over_c = square * product * one
        px1, py1, px2, py2 = ax1 * q1, ay1 * q1, ax2 * q2, ay2 * q2
        turned = px1 * ux1 + py1 * uy1 + px2 * ux2 + py2 * uy2
        miss = d1 - d2 - difference + shift * turned
        ux1, uy1, ux2, uy2 = px1, py1, px2, py2
        if k < 2:
            shift = miss * over_c * gps_variance
            ax1, ay1, ax2, ay2 = x1 - shift * ux1, y1 - shift * uy1, x2 + shift * ux2, y2 + shift * uy2
    return ux1, uy1, ux2, uy2, z1 * q1, z2 * q2, miss, over_c


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _still_sums(work, theta, gps_variance, range_variance, normal, right):
    """Adds one block of experiments to D (2-67) and the right side (2-68); its weighted squares."""
    px, py, pz = theta[0], theta[1], theta[2]
    total = rx = ry = rz = nxx = nxy = nyy = nxz = nyz = nzz = 0.0
    for n in range(BLOCK):
        at = DATA + n
        ux1, uy1, ux2, uy2, uz1, uz2, miss, over_c = _rest(
            work[at] - px, work[at + BLOCK] - py, pz - work[at + 2 * BLOCK],
            work[at + 4 * BLOCK] - px, work[at + 5 * BLOCK] - py, pz - work[at + 6 * BLOCK],
            work[at + 8 * BLOCK], gps_variance, range_variance,
        )  # fmt: skip
        weight = work[at + 9 * BLOCK] * over_c
        bx, by, bz = ux2 - ux1, uy2 - uy1, uz1 - uz2
        total += weight * miss * miss
        wx, wy, wz = weight * bx, weight * by, weight * bz
        rx += wx * miss
        ry += wy * miss
        rz += wz * miss
        nxx += wx * bx
        nxy += wx * by
        nyy += wy * by
        nxz += wx * bz
        nyz += wy * bz
        nzz += wz * bz
    right[0] -= rx
    right[1] -= ry
    right[2] -= rz
    normal[0, 0] += nxx
    normal[1, 0] += nxy
    normal[1, 1] += nyy
    normal[2, 0] += nxz
    normal[2, 1] += nyz
    normal[2, 2] += nzz
    return total


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _moving_experiments(work, theta, gps_variance, range_variance):
    """Weighted misfits of one block of experiments and their slopes by the six unknowns, in rows of `work`."""
    px, py, pz, vx, vy, vz = theta[0], theta[1], theta[2], theta[3], theta[4], theta[5]
    for n in range(BLOCK):
        at = DATA + n
        t1, t2 = work[at + 3 * BLOCK], work[at + 7 * BLOCK]
        ux1, uy1, ux2, uy2, uz1, uz2, miss, over_c = _rest(
            work[at] - px - t1 * vx, work[at + BLOCK] - py - t1 * vy, pz + t1 * vz - work[at + 2 * BLOCK],
            work[at + 4 * BLOCK] - px - t2 * vx, work[at + 5 * BLOCK] - py - t2 * vy,
            pz + t2 * vz - work[at + 6 * BLOCK],
            work[at + 8 * BLOCK], gps_variance, range_variance,
        )  # fmt: skip
        root = work[at + 9 * BLOCK] * np.sqrt(over_c)
        work[n] = miss * root
        work[BLOCK + n], work[2 * BLOCK + n], work[3 * BLOCK + n] = (
            (ux2 - ux1) * root,
            (uy2 - uy1) * root,
            (uz1 - uz2) * root,
        )
        work[4 * BLOCK + n] = (t2 * ux2 - t1 * ux1) * root
        work[5 * BLOCK + n] = (t2 * uy2 - t1 * uy1) * root
        work[6 * BLOCK + n] = (t1 * uz1 - t2 * uz2) * root


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def _dot(work, one, other):
    total = 0.0
    for n in range(BLOCK):
        total += work[one + n] * work[other + n]
    return total


@compiled
def _normal_equations(theta, work, gps_variance, range_variance, normal, right):
    """Fills D (2-67) and the right side (2-68) at theta; the sum of squared misfits."""
    unknowns = len(theta)
    normal[:] = 0.0
    right[:] = 0.0
    total = 0.0
    for block in range(len(work)):
        rows = work[block]
        if unknowns == 3:
            total += _still_sums(rows, theta, gps_variance, range_variance, normal, right)
            continue
        _moving_experiments(rows, theta, gps_variance, range_variance)
        total += _dot(rows, 0, 0)
        for i in range(unknowns):
            right[i] -= _dot(rows, (1 + i) * BLOCK, 0)
            for j in range(i + 1):
                normal[i, j] += _dot(rows, (1 + i) * BLOCK, (1 + j) * BLOCK)
    return total


@compiled
def _solve(normal, damping, right, lower, move):
    """Solves (normal + damping diag(normal)) move = right by Cholesky; whether it could."""
    unknowns = len(right)
    for i in range(unknowns):
        for j in range(i + 1):
            value = normal[i, j] * (1 + damping if i == j else 1.0)
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            if i == j:
                if not value > 1e-13 * normal[i, i]:
                    return False
                lower[i, i] = np.sqrt(value)
            else:
                lower[i, j] = value / lower[j, j]
    for i in range(unknowns):
        value = right[i]
        for k in range(i):
            value -= lower[i, k] * move[k]
        move[i] = value / lower[i, i]
    for i in range(unknowns - 1, -1, -1):
        value = move[i]
        for k in range(i + 1, unknowns):
            value -= lower[k, i] * move[k]
        move[i] = value / lower[i, i]
    return True


@compiled
def _descend(theta, work, gps_variance, range_variance, limits, covariance):
    """Damped Gauss-Newton steps from theta, in place: sum of squares, steps taken, whether it came to rest."""
    unknowns = len(theta)
    normal, normal_there = np.zeros((unknowns, unknowns)), np.zeros((unknowns, unknowns))
    right, right_there = np.zeros(unknowns), np.zeros(unknowns)
    lower, move, trial = np.zeros((unknowns, unknowns)), np.zeros(unknowns), np.zeros(unknowns)
    total = _normal_equations(theta, work, gps_variance, range_variance, normal, right)
    damping, rest = 1e-3, False
    step = pressed = 0
    while step < STEPS and np.isfinite(total):
        step += 1
        if not _solve(normal, damping, right, lower, move):
            damping = max(10 * damping, 1e-3)
            if damping > 1e12:
                break
            continue
        for k in range(unknowns):
            trial[k] = min(max(theta[k] + move[k], limits[0, k]), limits[1, k])
        if theta[2] + move[2] > limits[1, 2]:  # above the surface: the same squares as below it
            trial[2] = max(2 * limits[1, 2] - theta[2] - move[2], limits[0, 2])
        there = _normal_equations(trial, work, gps_variance, range_variance, normal_there, right_there)
        outside = False
        for k in range(unknowns):
            outside |= trial[k] <= limits[0, k] or trial[k] >= limits[1, k]
        pressed = pressed + 1 if outside else 0
        if pressed > PRESSED:
            break
        small = 0.0  # squared step in standard errors
        for i in range(unknowns):
            small += right[i] * move[i]
        if there <= total * (1 + 1e-12):
            theta[:] = trial
            total = there
            normal, normal_there = normal_there, normal
            right, right_there = right_there, right
            damping = 0.0 if damping < 1e-9 else damping / 10
            if small < 1e-8:
                rest = True
                break
        else:
            if small < 1e-8:  # what rounding leaves
                rest = True
                break
            damping = max(10 * damping, 1e-6)
    for k in range(unknowns):
        if theta[k] <= limits[0, k] or theta[k] >= limits[1, k]:
            rest = False
    for column in range(unknowns):
        right[:] = 0.0
        right[column] = 1.0
        if not _solve(normal, 0.0, right, lower, move):
            rest = False
            break
        covariance[:, column] = move
    return total, step, rest


@compiled
def _place_start(theta, attempt, ship, ranges, epochs, start, limits):
    """Fills theta with the place that an attempt starts from; whether there is one."""
    unknowns = len(start)
    theta[:] = start
    if attempt < 2:
        moving = attempt == 0 and unknowns == 6
        solved, fine = linear_start(ship, ship[:, :2], ranges, epochs, moving)
        if not fine or not np.all(np.isfinite(solved)) or (attempt == 1 and unknowns == 3):
            return False
        theta[:] = 0.0
        theta[:3] = solved[:3]
        if moving:
            theta[3:] = solved[4:]
        for k in range(unknowns):
            theta[k] = min(max(theta[k], 0.9 * limits[0, k]), 0.9 * limits[1, k])
        theta[2] = min(theta[2], 0.02 * limits[0, 2])
    elif attempt > 2:
        theta[0] = limits[(attempt - 3) % 2, 0] / 2
        theta[1] = limits[(attempt - 3) // 2, 1] / 2
    return True


@compiled
def _best_descent(
    ship, ranges, epochs, count, start, work, gps_variance, range_variance, limits, estimate, covariance
):
    """The lowest place that any start leads to: misfit, steps taken in all, whether it is at rest."""
    unknowns = len(estimate)
    degrees = count - unknowns
    theta, there = np.empty(unknowns), np.empty((unknowns, unknowns))
    best, found, taken = np.inf, False, 0
    for attempt in range(ATTEMPTS):
        if not _place_start(theta, attempt, ship, ranges, epochs, start, limits):
            continue
        total, steps, rest = _descend(theta, work, gps_variance, range_variance, limits, there)
        taken += steps
        if (rest and not found) or (rest == found and total < best):
            best, found = total, rest
            estimate[:] = theta
            covariance[:] = there
        if found and best < degrees + EXPLAINED * np.sqrt(2.0 * degrees):
            break
    return best, taken, found


@warms
def _warm() -> None:
    rng = np.random.default_rng(1)
    ship = np.zeros((2, 30, 3))
    ship[:, :, :2] = 100 * rng.normal(size=(2, 30, 2))
    ranges = np.linalg.norm(ship - [10.0, 0.0, -200.0], axis=2)
    for moving in (False, True):
        fix_pairs(ship, ranges, np.arange(30.0), experiments(20, 5, 1), 1.0, 1.0, moving=moving)
