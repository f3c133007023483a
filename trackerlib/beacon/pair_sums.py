"""Kernels of the fix from experiments: sums over experiments at a trial place.

The loop over the experiments of a fix is what the processor works on side by side: nothing in it is stored, and
square roots come from its estimate of them. Equation numbers are those of Wojcik (1993).
"""

from __future__ import annotations

import numba
import numpy as np

from trackerlib.compiled import compiled

FAR = 400.0  # ship position errors: from here on one round puts an experiment's corrections right, else two
LANES = 8  # experiments are padded to a multiple of this
ROWS = 10  # weight, two epochs, two places, difference of ranges
ONE_ROUND, TWO_ROUNDS = (0,), (0, 0)  # their lengths are known when compiled
FAST = {"reassoc", "contract", "arcp", "nsz"}  # NaN and infinity keep their meaning


@compiled
def experiment_rows(epochs, pairs):
    """What is the same for all surveys; places beyond the last experiment keep no weight and a range above zero."""
    work = np.zeros((ROWS, (len(pairs) + LANES - 1) // LANES * LANES))
    work[5], work[8] = 1e3, 1e3
    for n in range(len(pairs)):
        work[0, n], work[1, n], work[2, n] = 1.0, epochs[pairs[n, 0]], epochs[pairs[n, 1]]
    return work


@compiled
def gather_experiments(ship, ranges, pairs, work):
    """Fills the other rows with what one survey measured."""
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
def normal_equations(theta, work, gps_variance, range_variance, normal, right):
    """Fills the lower half of D (2-67) and the right side (2-68); the sum of squared misfits, corrections at rest."""
    x, y, z = work[3, 0] - theta[0], work[4, 0] - theta[1], work[5, 0] - theta[2]
    far = x * x + y * y + z * z > FAR**2 * gps_variance
    if len(theta) == 3:
        if far:
            return _still_sums(theta, work, gps_variance, range_variance, ONE_ROUND, normal, right)
        return _still_sums(theta, work, gps_variance, range_variance, TWO_ROUNDS, normal, right)
    if far:
        return _moving_sums(theta, work, gps_variance, range_variance, ONE_ROUND, normal, right)
    return _moving_sums(theta, work, gps_variance, range_variance, TWO_ROUNDS, normal, right)
