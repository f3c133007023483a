"""The study of Wojcik (1993), chapter IV: six beacons, two sweeps, two qualities of GPS, several estimators.

    points = study_points(scenarios=(1, 2, 3), sweeps=("experiments",), gps_rms_m=(3.0,), methods=("thesis",))
    rows = [summary(run_study_point(point, trials=1000, seed=1)) for point in points]

Everything made here is simulated.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from trackerlib.rounding import value_with_sigma
from trackerlib.simulation.hexagon import (
    METHODS,
    SCENARIOS,
    Scenario,
    Trials,
    run_method,
    sail_for,
)
from trackerlib.simulation.usual import run_usual_trials

STUDY_METHODS = (*METHODS, "usual")  # and weighted least squares as it is usually done, on request
COMPONENTS = ("x", "y", "z", "vx", "vy", "vz")
SWEEPS = ("experiments", "spacing")
GPS_RMS_M = (3.0, 25.0)


@dataclass(frozen=True, order=True)
class StudyPoint:
    """One point of one curve: what was simulated and how it was fixed."""

    scenario: int
    sweep: str
    experiments: int
    spacing: int
    gps_rms_m: float
    method: str

    @property
    def abscissa(self) -> int:
        """What the sweep turns."""
        return self.experiments if self.sweep == "experiments" else self.spacing


def study_points(
    scenarios: Sequence[int] = tuple(SCENARIOS),
    sweeps: Sequence[str] = SWEEPS,
    gps_rms_m: Sequence[float] = GPS_RMS_M,
    methods: Sequence[str] = METHODS,  # some of STUDY_METHODS
) -> list[StudyPoint]:
    """Every point of the study, curve after curve: 1590 a method in the whole of chapter IV.

    Still: 5 to 50 experiments at spacing 45, spacings 2 to 90 of 25; moving: 10 to 50 at 60, 2 to 90 of 30.
    Raises ValueError for an unknown scenario, sweep or method.
    """
    for found, wanted in ((scenarios, SCENARIOS), (sweeps, SWEEPS), (methods, STUDY_METHODS)):
        unknown = [one for one in found if one not in wanted]
        if unknown or not found:
            raise ValueError(f"found {unknown or 'nothing'}; wanted some of {', '.join(map(str, wanted))}")
    return [
        StudyPoint(scenario, sweep, experiments, spacing, gps, method)
        for scenario in scenarios
        for sweep in sweeps
        for method in methods
        for gps in gps_rms_m
        for experiments, spacing in _grid(SCENARIOS[scenario].moving, sweep)
    ]


def _grid(moving: bool, sweep: str) -> Iterable[tuple[int, int]]:
    if sweep == "experiments":
        return ((n, 60) for n in range(10, 51)) if moving else ((n, 45) for n in range(5, 51))
    return ((30 if moving else 25, k) for k in range(2, 91))


def run_study_point(
    point: StudyPoint, trials: int, seed: int, speed_mps: float = 5.0, beacon: Scenario | None = None
) -> Trials:
    """The trials of one point, the same that `montecarlo` makes.

    beacon : one of one's own, in the place of the point's scenario
    """
    beacon = SCENARIOS[point.scenario] if beacon is None else beacon
    receptions = sail_for(beacon, point.experiments, point.spacing, speed_mps)
    if point.method == "usual":
        return run_usual_trials(receptions, point.gps_rms_m, trials, seed)
    return run_method(receptions, point.spacing, point.gps_rms_m, trials, seed, point.method)


def summary(trials: Trials) -> dict:
    """What many trials came to, under the keys that others rely on; NaN where none converged."""

    def named(values: np.ndarray) -> dict[str, float]:
        return dict(zip(COMPONENTS, map(float, values), strict=False))

    rmse = trials.rmse
    return {
        "simulated": True,
        "trials": len(trials.estimate),
        "converged": int(trials.converged.sum()),
        "rmse": named(rmse),
        "bias": named(trials.bias),
        "mean_sigma": named(trials.mean_sigma),
        "crlb": named(trials.bound),
        "coverage95": trials.coverage,
        "rmse_2d_m": float(np.linalg.norm(rmse[:2])),
        "rmse_3d_m": float(np.linalg.norm(rmse[:3])),
        "crlb_2d_m": float(np.linalg.norm(trials.bound[:2])),
        "crlb_3d_m": float(np.linalg.norm(trials.bound[:3])),
        "rmse_now": named(trials.rmse_now),
        "mean_sigma_now": named(trials.mean_sigma_now),
        "crlb_now": named(trials.bound_now),
    }


def coverage_words(share: float, converged: int) -> str:
    """How often the truth lay inside its ellipsoid, with the standard error that so many trials leave.

    That of Agresti and Coull (1998), as if two more lay inside and two outside: all of five tell no certainty.
    """
    middle = (share * converged + 2) / (converged + 4)
    sigma = (middle * (1 - middle) / (converged + 4)) ** 0.5
    return f"the truth lies inside {value_with_sigma(100 * share, 100 * sigma, '%')} of the stated 95 % ellipsoids"


def flat(document: dict, prefix: str = "") -> dict:
    """The same with one level of keys, joined by dots: a row of a table."""
    row: dict = {}
    for key, value in document.items():
        row |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return row
