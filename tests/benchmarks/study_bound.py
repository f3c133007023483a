"""Every ping against the Cramér-Rao bound: 25 experiments at spacing 45, all scenarios, 3 m and 25 m, 5 and 1 m/s.

A row a cell: largest root-mean-square error over the bound of any component, what share of the stated 95 %
ellipsoids hold the truth, how many trials converged, why others were refused; beside it the error in space of the
thesis's experiments and of the usual least squares over ours, on the same simulated surveys.

.venv/bin/python tests/benchmarks/study_bound.py [TRIALS [SEED]]
"""

from __future__ import annotations

import sys

import numpy as np

from trackerlib.compiled import warm
from trackerlib.simulation.hexagon import SCENARIOS, Trials
from trackerlib.simulation.study import GPS_RMS_M, StudyPoint, run_study_point

EXPERIMENTS, SPACING = 25, 45
OTHERS = ("thesis", "usual")


def error(trials: Trials) -> float:
    """Root-mean-square error of the place in space [m]."""
    return float(np.sqrt(np.sum(trials.rmse[:3] ** 2)))


def main(trials: int, seed: int) -> None:
    def run(scenario: int, gps: float, method: str, speed: float) -> Trials:
        point = StudyPoint(scenario, "experiments", EXPERIMENTS, SPACING, gps, method)
        return run_study_point(point, trials, seed, speed)

    for speed in (5.0, 1.0):
        for scenario in SCENARIOS:
            for gps in GPS_RMS_M:
                ours = run(scenario, gps, "all-pings", speed)
                count = int(ours.converged.sum())
                cell = f"scenario {scenario}, ship {speed:g} m/s, {gps:g} m: {count} of {trials} converged"
                refused = "".join(f"; {k} refused: {why}" for why, k in ours.refused_why.items())
                if not count:
                    print(cell + refused, flush=True)
                    continue
                worst = float(np.max(ours.rmse / ours.bound))
                others = ", ".join(
                    f"{method} {error(run(scenario, gps, method, speed)) / error(ours):.1f}"
                    for method in OTHERS
                )
                print(
                    f"{cell}, at most {worst:.3f} bounds, coverage {ours.coverage:.4f}{refused}; "
                    f"error in space over ours: {others}",
                    flush=True,
                )


if __name__ == "__main__":
    warm()
    told = [int(one) for one in sys.argv[1:3]]
    main(*told, *(2000, 1)[len(told) :])
