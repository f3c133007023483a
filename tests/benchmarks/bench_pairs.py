"""Fixes of 50 experiments, errors in all measurements: ours against one SciPy call a fix and against ODRPACK.

SciPy's least_squares gets the same model with its corrections solved to first order; ODRPACK the same
implicit equation. Those start from the thesis's guess (4-6), (4-7); noise of 3 m GPS in scenarios 2 and 5.
Ratios by the clock, and by processor time times our threads: what the clock says where nothing else runs.
"""

from __future__ import annotations

import time

import numba
import numpy as np
import odrpack
from scipy.optimize import least_squares

from trackerlib.beacon.pairs import START, experiments, fix_pairs
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S, sail_hexagon

COUNT, SPACING, GPS_RMS_M = 50, 45, 3.0
RANGE_RMS_M = SOUND_SPEED_MPS * TIME_RMS_S
FIXES, PEER_FIXES = 20_000, 20


def rates(function, count):
    """Calls a second by the clock and a second of processor time."""
    begin, worked = time.perf_counter(), time.process_time()
    function()
    return np.array([count / (time.perf_counter() - begin), count / (time.process_time() - worked)])


def compare(scenario: int) -> None:
    points = sail_hexagon(SCENARIOS[scenario], COUNT * SPACING + 1)
    moving = points.scenario.moving
    chain = np.arange(0, COUNT * SPACING + 1, SPACING)
    epochs, pairs = points.emitted_s[chain], experiments(COUNT, 1)
    rng = np.random.default_rng(1)
    ship = np.repeat(points.ship[chain][None], FIXES, axis=0)
    ship[:, :, :2] += rng.normal(0, GPS_RMS_M, (FIXES, len(chain), 2))
    ranges = points.range_m[chain] + rng.normal(0, RANGE_RMS_M, ship.shape[:2])
    start = np.array([*START, *([0.0] * 3 if moving else [])])
    i, j = pairs.T

    def offsets(theta, first, second):
        speed = theta[3:] if moving else np.zeros(3)
        place1 = theta[:3, None] + speed[:, None] * epochs[i]
        place2 = theta[:3, None] + speed[:, None] * epochs[j]
        return first - place1, second - place2

    def weighted(theta, k):
        one, two = offsets(theta, ship[k, i].T, ship[k, j].T)
        d1, d2 = np.linalg.norm(one, axis=0), np.linalg.norm(two, axis=0)
        level = (one[:2] ** 2).sum(axis=0) / d1**2 + (two[:2] ** 2).sum(axis=0) / d2**2
        variance = GPS_RMS_M**2 * level + 2 * RANGE_RMS_M**2
        return (d1 - d2 - (ranges[k, i] - ranges[k, j])) / np.sqrt(variance)

    def implicit(x, theta):
        one, two = offsets(
            theta, np.vstack([x[:2], 0 * x[0]]), np.vstack([x[3:5], 0 * x[3]])
        )  # hydrophone at the surface
        return np.linalg.norm(one, axis=0) - np.linalg.norm(two, axis=0) - (x[2] - x[5])

    def by_odrpack(k):
        x = np.vstack([ship[k, i, :2].T, ranges[k, i], ship[k, j, :2].T, ranges[k, j]])
        weight = np.array([GPS_RMS_M**-2, GPS_RMS_M**-2, RANGE_RMS_M**-2] * 2)
        odrpack.odr_fit(implicit, x, np.zeros(COUNT), start, weight_x=weight, task="implicit-ODR", maxit=500)

    def ours(count):
        return fix_pairs(ship[:count], ranges[:count], epochs, pairs, GPS_RMS_M, RANGE_RMS_M, moving=moving)

    fixes = ours(100)
    own = np.max([rates(lambda: ours(FIXES), FIXES) for _ in range(5)], axis=0)
    peers = {
        "scipy least_squares": lambda k: least_squares(weighted, start, args=(k,), x_scale="jac"),
        "odrpack": by_odrpack,
    }
    print(
        f"{'moving' if moving else 'still '} 50 experiments: {own[0]:9.0f} fixes/s, "
        f"{100 * fixes.converged.mean():.0f} % converged"
    )
    for name, peer in peers.items():
        theirs = rates(lambda peer=peer: [peer(k) for k in range(PEER_FIXES)], PEER_FIXES)
        clock, processor = own / theirs * [1, numba.get_num_threads()]
        print(f"  {name} {theirs[0]:.0f}/s, ours/peer {clock:.0f} by clock, {processor:.0f} by processor")


if __name__ == "__main__":
    compare(2)
    compare(5)
