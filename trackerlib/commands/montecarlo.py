"""`montecarlo --scenario 1..6 ...`: how good fixes of one simulated beacon are, and whether they know it."""

from __future__ import annotations

import argparse
import time

import numba

from trackerlib.rounding import value_with_sigma
from trackerlib.simulation.hexagon import SCENARIOS, Trials, run_trials, sail_hexagon
from trackerlib.textfiles import InputError

SUMMARY = "simulate many fixes of one of the thesis's six beacons and compare them with the bound"
COMPONENTS = ("x", "y", "z", "vx", "vy", "vz")
UNITS = {name: "m" if len(name) == 1 else "m/s" for name in COMPONENTS}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `montecarlo`."""
    add = parser.add_argument
    add("--scenario", type=int, choices=sorted(SCENARIOS), required=True, help="row of Table 4-1")
    add("--experiments", type=int, required=True, metavar="N", help="pairs of receptions of the thesis")
    add("--spacing", type=int, required=True, metavar="K", help="receptions from one pair to the next")
    add("--gps-rms-m", type=float, required=True, metavar="G", help="ship position error, each axis")
    add("--trials", type=int, required=True, metavar="M")
    add("--seed", type=int, required=True, metavar="S")
    add("--method", choices=("all-pings",), default="all-pings", help="every reception from 0 to N K")
    add("--speed-mps", type=float, default=5.0, metavar="C", help="of the ship (default 5)")
    add("--start-vertex", type=int, default=4, metavar="V", help="it starts at 60 V degrees (default 4)")
    add("--workers", type=int, metavar="W", help="threads (default: all cores)")


def run(args: argparse.Namespace) -> dict:
    """The answer of `montecarlo` as a document for JSON."""
    if args.experiments < 1 or args.spacing < 1:
        raise InputError(
            f"found {args.experiments} experiments at spacing {args.spacing}; wanted at least 1 of each"
        )
    if not args.gps_rms_m > 0:
        raise InputError(f"--gps-rms-m is {args.gps_rms_m:g}; wanted more than 0")
    if args.workers is not None:
        most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        if not 1 <= args.workers <= most:
            raise InputError(f"--workers is {args.workers}; wanted 1 to {most}")
        numba.set_num_threads(args.workers)
    try:
        receptions = sail_hexagon(
            SCENARIOS[args.scenario], args.experiments * args.spacing + 1, args.speed_mps, args.start_vertex
        )
        begin = time.perf_counter()
        trials = run_trials(receptions, args.gps_rms_m, args.trials, args.seed)
    except ValueError as error:
        raise InputError(str(error)) from None
    return {"scenario": args.scenario, "method": args.method, **document(trials, time.perf_counter() - begin)}


def document(trials: Trials, seconds: float) -> dict:
    """Trials under the keys that others rely on."""

    def named(values):
        return dict(zip(COMPONENTS, values, strict=False))

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
        "rmse_2d_m": float((rmse[:2] ** 2).sum() ** 0.5),
        "rmse_3d_m": float((rmse[:3] ** 2).sum() ** 0.5),
        "rmse_now": named(trials.rmse_now),
        "fixes_per_s": len(trials.estimate) / seconds,
    }


def report(document: dict) -> str:
    """The same for a person."""
    lines = [
        f"SIMULATED: scenario {document['scenario']}, {document['converged']} of {document['trials']} fixes converged, "
        f"{document['fixes_per_s']:.0f} a second"
    ]
    if document["converged"]:
        for name, rmse in document["rmse"].items():
            bound = document["crlb"][name]
            lines.append(
                f"  {name:2} error {rmse:.3g} {UNITS[name]}, {rmse / bound:.2f} of the Cramer-Rao bound; "
                f"stated {document['mean_sigma'][name]:.3g}; bias {document['bias'][name]:+.2g}"
            )
        spread = (document["coverage95"] * (1 - document["coverage95"]) / document["converged"]) ** 0.5
        share = value_with_sigma(100 * document["coverage95"], max(100 * spread, 0.1), "%")
        lines.append(f"  the truth lies inside {share} of the stated 95 % ellipsoids")
    return "\n".join(lines)
