"""One fix from 1126 pings, from a cold start: ours against one SciPy least-squares call on the same data.

SciPy gets slant ranges with weights for the ship's position error, its usual way (finite differences) and a start
at the thesis's guess; its errors are those of the bias that noisy ship positions give.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.optimize import least_squares

from trackerlib.beacon.squared_range import fix_squared_range
from trackerlib.compiled import warm
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S, sail_hexagon

RECEPTIONS, REPEATS, PEER_REPEATS = 1126, 400, 20
RANGE_RMS_M = SOUND_SPEED_MPS * TIME_RMS_S


def compare(scenario: int, gps_rms_m: float) -> None:
    """Prints time and error of both for one scenario."""
    points = sail_hexagon(SCENARIOS[scenario], RECEPTIONS)
    moving, epochs, truth = points.scenario.moving, points.emitted_s, points.truth
    rng = np.random.default_rng(1)
    ship = np.repeat(points.ship[None], REPEATS, axis=0)
    ship[:, :, :2] += rng.normal(0, gps_rms_m, (REPEATS, RECEPTIONS, 2))
    ranges = points.range_m + rng.normal(0, RANGE_RMS_M, (REPEATS, RECEPTIONS)) + 300.0

    begin = time.perf_counter()
    ours = [
        fix_squared_range(ship[k : k + 1], ranges[k : k + 1], epochs, gps_rms_m, RANGE_RMS_M, moving=moving)
        for k in range(REPEATS)
    ]
    seconds = (time.perf_counter() - begin) / REPEATS

    def peer(k: int) -> np.ndarray:
        def misfit(state):
            place = state[:3] + (epochs[:, None] * state[4:] if moving else 0.0)
            offset = place - ship[k]
            distance = np.linalg.norm(offset, axis=1)
            level = np.sum(offset[:, :2] ** 2, axis=1) / distance**2
            return (ranges[k] - state[3] - distance) / np.sqrt(RANGE_RMS_M**2 + gps_rms_m**2 * level)

        return least_squares(misfit, [0, 0, -2500, 0, *([0] * 3 if moving else [])], x_scale="jac").x

    begin = time.perf_counter()
    theirs = [peer(k) for k in range(PEER_REPEATS)]
    peer_seconds = (time.perf_counter() - begin) / PEER_REPEATS
    mine = np.array([fix.estimate[0, :3] for fix in ours]) - truth[:3]
    other = np.array([state[:3] for state in theirs]) - truth[:3]
    other[:, 2] = -np.abs(other[:, 2] + truth[2]) - truth[2]  # the mirror above the surface is the same fit
    print(
        f"scenario {scenario}, {gps_rms_m:g} m GPS: ours {1e3 * seconds:.3f} ms, rms error "
        f"{np.sqrt(np.mean(mine**2)):.2f} m; scipy least_squares {1e3 * peer_seconds:.1f} ms, "
        f"{np.sqrt(np.mean(other**2)):.2f} m; peer/ours {peer_seconds / seconds:.0f}"
    )


if __name__ == "__main__":
    warm()
    for scenario in (1, 4):
        for gps_rms_m in (3.0, 25.0):
            compare(scenario, gps_rms_m)
