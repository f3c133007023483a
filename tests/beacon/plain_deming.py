"""The thesis's estimator as it prints it: one step of all corrections and of the beacon at a time, thousands of times.

Wojcik (1993), (2-48)-(2-71), (3-11), (3-18), slips mended: one common fraction for beacon and corrections, no stop
unless every component rests. Plain and slow; compiled only because a test wants millions of steps.
"""

from __future__ import annotations

import numba
import numpy as np

SMALLEST_SHARE = 1e-6
compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@compiled
def deming_fixes(ship, ranges, epochs, pairs, variance, limits, start, steps):
    """Beacons (B, P), and whether each came to rest inside the box within so many steps.

    ship (B, R, 3), ranges (B, R), epochs (R,), pairs (N, 2) as for `fix_pairs`; variance (3,) east, north, range
    """
    theta, rests = np.empty((len(ship), len(start))), np.zeros(len(ship), np.bool_)
    for k in range(len(ship)):
        theta[k] = start
        rests[k] = _iterate(ship[k], ranges[k], epochs, pairs, variance, limits, theta[k], steps)
    return theta, rests


@compiled
def _experiment(place, at, slope_w, slope_theta):
    """g, its slopes a (6,) in the measurements (2-63) and b (P,) in the beacon (2-64), (3-18).

    place : (P,) of the beacon; at : (10,) x, y, s of the first reception, then of the second, both heights, both epochs
    """
    moving = len(place) == 6
    unit, distance = np.empty((2, 3)), np.empty(2)
    for half in range(2):
        for axis in range(3):
            ship = at[6 + half] if axis == 2 else at[3 * half + axis]
            unit[half, axis] = ship - place[axis] - (at[8 + half] * place[3 + axis] if moving else 0.0)
        distance[half] = np.sqrt(np.sum(unit[half] ** 2))
        unit[half] /= distance[half]
        sign = 1.0 if half == 0 else -1.0
        slope_w[3 * half], slope_w[3 * half + 1] = sign * unit[half, 0], sign * unit[half, 1]
        slope_w[3 * half + 2] = -sign
    for axis in range(3):
        slope_theta[axis] = unit[1, axis] - unit[0, axis]
        if moving:
            slope_theta[3 + axis] = at[9] * unit[1, axis] - at[8] * unit[0, axis]
    return distance[0] - distance[1] - (at[2] - at[5])


@compiled
def _gather(ship, ranges, epochs, pairs):
    """What is measured of every experiment, its heights and its epochs (N, 10)."""
    logged = np.empty((len(pairs), 10))
    for n in range(len(pairs)):
        for half in range(2):
            i = pairs[n, half]
            logged[n, 3 * half], logged[n, 3 * half + 1], logged[n, 3 * half + 2] = (
                ship[i, 0],
                ship[i, 1],
                ranges[i],
            )
            logged[n, 6 + half], logged[n, 8 + half] = ship[i, 2], epochs[i]
    return logged


@compiled
def _squares(place, at, variance):
    """Z, the sum of g^2 / c (2-52), (2-53)."""
    a, b, total = np.empty(6), np.empty(len(place)), 0.0
    for n in range(len(at)):
        g = _experiment(place, at[n], a, b)
        c = 0.0
        for k in range(6):
            c += a[k] * a[k] * variance[k % 3]
        total += g * g / c
    return total


@compiled
def _iterate(ship, ranges, epochs, pairs, variance, limits, theta, steps):
    logged = _gather(ship, ranges, epochs, pairs)
    count, unknowns = len(pairs), len(theta)
    at, there, correction = logged.copy(), logged.copy(), np.empty((count, 6))
    a, b = np.empty((count, 6)), np.empty((count, unknowns))
    gap, c = np.empty(count), np.empty(count)
    for _ in range(steps):
        normal, right, before = np.zeros((unknowns, unknowns)), np.zeros(unknowns), 0.0
        for n in range(count):
            g = _experiment(theta, at[n], a[n], b[n])
            c[n], gap[n] = 0.0, -g
            for k in range(6):
                c[n] += a[n, k] * a[n, k] * variance[k % 3]
                gap[n] += a[n, k] * (at[n, k] - logged[n, k])  # a'e - g
            before += g * g / c[n]
            for i in range(unknowns):
                right[i] += gap[n] * b[n, i] / c[n]
                for j in range(unknowns):
                    normal[i, j] += b[n, i] * b[n, j] / c[n]
        if not np.all(np.diag(normal) > 0):  # at the surface depth moves nothing
            return False
        move = np.linalg.solve(normal, right)  # (2-68)
        for n in range(count):
            multiplier = (np.sum(b[n] * move) - gap[n]) / c[n]  # (2-69)
            for k in range(6):  # (2-70)
                correction[n, k] = logged[n, k] - at[n, k] - multiplier * variance[k % 3] * a[n, k]
        rests = np.all(np.abs(move) < 1e-4 * (np.abs(theta) + 1e-3))  # (2-59)
        share = _inside(theta, move, limits)
        while share > SMALLEST_SHARE:
            there[:, :6] = at[:, :6] + share * correction
            if rests or _squares(theta + share * move, there, variance) < before:
                break
            share /= 2
        theta += share * move
        at[:, :6] += share * correction
        if rests:
            return share == 1.0
    return False


@compiled
def _inside(theta, move, limits):
    """The whole step, or what takes it 1 / sqrt(2) of the way to the side of the box (2-51)."""
    room = np.inf
    for k in range(len(theta)):
        if move[k] != 0:
            side = limits[1, k] if move[k] > 0 else limits[0, k]
            room = min(room, (side - theta[k]) / move[k])
    return 1.0 if room > 1 else room / np.sqrt(2.0)


@compiled
def least_squares_at(theta, ship, ranges, epochs, pairs, variance):
    """Least weighted sums of squared corrections (B,) with beacons held at theta (B, P): (2-69), (2-70)."""
    found = np.empty(len(theta))
    for k in range(len(theta)):
        logged = _gather(ship[k], ranges[k], epochs, pairs)
        a, b, total = np.empty(6), np.empty(theta.shape[1]), 0.0
        for n in range(len(pairs)):
            at, square = logged[n].copy(), 0.0
            for _ in range(50):
                gap = -_experiment(theta[k], at, a, b)
                c = 0.0
                for m in range(6):
                    c += a[m] * a[m] * variance[m % 3]
                    gap += a[m] * (at[m] - logged[n, m])
                for m in range(6):
                    at[m] = logged[n, m] + gap / c * variance[m % 3] * a[m]
                square = gap * gap / c
            total += square
        found[k] = total
    return found
