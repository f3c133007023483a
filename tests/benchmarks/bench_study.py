"""The whole study of chapter IV by the thesis's estimator: 1590 points of 1000 trials, against SciPy a fix.

SciPy's least_squares, one call a fix with the same model, is timed on a sample of the points in the same run and
multiplied up. The study's own time is that of all its points, each to a row of its table, without its pictures.
"""

from __future__ import annotations

import time

import numpy as np
from scipy.optimize import least_squares

from trackerlib.beacon.pairs import START, experiments
from trackerlib.commands.study import rows_by_threads
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S, sail_hexagon
from trackerlib.simulation.study import StudyPoint, study_points

TRIALS, SEED, SPEED_MPS = 1000, 1, 5.0
SAMPLE, PEER_FIXES = 40, 2  # points, fixes at each
RANGE_RMS_M = SOUND_SPEED_MPS * TIME_RMS_S


def peer_seconds(point: StudyPoint) -> float:
    """Seconds of one least_squares call at a point, corrections solved to first order."""
    points = sail_hexagon(SCENARIOS[point.scenario], point.experiments * point.spacing + 1, SPEED_MPS)
    moving = points.scenario.moving
    chain = np.arange(0, len(points.ship), point.spacing)
    i, j = experiments(point.experiments, 1).T
    epochs = points.emitted_s[chain]
    rng = np.random.default_rng(SEED)
    start = np.array([*START, *([0.0] * 3 if moving else [])])
    begin = time.perf_counter()
    for _ in range(PEER_FIXES):
        ship = points.ship[chain] + rng.normal(0, point.gps_rms_m, (len(chain), 3)) * [1, 1, 0]
        ranges = points.range_m[chain] + rng.normal(0, RANGE_RMS_M, len(chain))

        def weighted(theta, ship=ship, ranges=ranges):
            place = theta[:3] + (epochs[:, None] * theta[3:] if moving else 0.0)
            offset = ship - place
            distance = np.linalg.norm(offset, axis=1)
            level = (offset[:, :2] ** 2).sum(axis=1) / distance**2
            variance = point.gps_rms_m**2 * (level[i] + level[j]) + 2 * RANGE_RMS_M**2
            return (distance[i] - distance[j] - (ranges[i] - ranges[j])) / np.sqrt(variance)

        least_squares(weighted, start, x_scale="jac")
    return (time.perf_counter() - begin) / PEER_FIXES


def main() -> None:
    points = study_points(methods=("thesis",))
    list(
        rows_by_threads(points[:: len(points) - 1], 1, SEED, SPEED_MPS)
    )  # kernels are loaded before the clock starts
    begin = time.perf_counter()
    rows = list(rows_by_threads(points, TRIALS, SEED, SPEED_MPS))
    own = time.perf_counter() - begin
    sample = [point for point in points[:: len(points) // SAMPLE] if point.experiments > 6]
    peer = np.mean([peer_seconds(point) for point in sample]) * len(points) * TRIALS
    converged = sum(row["converged"] for row in rows)
    print(
        f"study of {len(points)} points x {TRIALS} trials: {own:.1f} s, {converged} converged, "
        f"{len(points) * TRIALS - converged} counted as not; scipy least_squares {peer:.0f} s, "
        f"peer/ours {peer / own:.0f}"
    )


if __name__ == "__main__":
    main()
