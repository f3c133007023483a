"""`montecarlo --scenario 1..6 ...`: how good fixes of one simulated beacon are, and whether they know it."""

from __future__ import annotations

import argparse
import time

import numba

from trackerlib.rounding import value_with_sigma
from trackerlib.simulation.hexagon import METHODS, SCENARIOS, run_point
from trackerlib.simulation.study import COMPONENTS, summary
from trackerlib.textfiles import InputError

SUMMARY = "simulate many fixes of one of the thesis's six beacons and compare them with the bound"
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
    add("--method", choices=METHODS, default=METHODS[0], help="every reception, or chained pairs")
    add("--speed-mps", type=float, default=5.0, metavar="C", help="of the ship (default 5)")
    add("--start-vertex", type=int, default=4, metavar="V", help="it starts at 60 V degrees (default 4)")
    add("--workers", type=int, metavar="W", help="threads (default: all cores)")


def run(args: argparse.Namespace) -> dict:
    """The answer of `montecarlo` as a document for JSON."""
    use_workers(args.workers)
    point = (args.scenario, args.experiments, args.spacing, args.gps_rms_m)
    how = (args.seed, args.method, args.speed_mps, args.start_vertex)
    try:
        run_point(*point, min(args.trials, 1), *how)  # compiled kernels are loaded before the clock starts
        begin = time.perf_counter()
        trials = run_point(*point, args.trials, *how)
    except ValueError as error:
        raise InputError(str(error)) from None
    seconds = time.perf_counter() - begin
    return {
        "scenario": args.scenario,
        "method": args.method,
        **summary(trials),
        "refused_why": [{"why": why, "count": count} for why, count in trials.refused_why.items()],
        "fixes_per_s": len(trials.estimate) / seconds,
    }


def use_workers(count: int | None) -> None:
    """Lets kernels run on this many threads.

    Raises InputError for a count that this machine does not have.
    """
    if count is None:
        return
    most = numba.config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
    if not 1 <= count <= most:
        raise InputError(f"--workers is {count}; wanted 1 to {most}")
    numba.set_num_threads(count)


def report(document: dict) -> str:
    """The same for a person."""
    lines = [
        f"SIMULATED: scenario {document['scenario']}, {document['converged']} of {document['trials']} fixes converged, "
        f"{document['fixes_per_s']:.0f} a second"
    ]
    lines += [f"  {one['count']} refused: {one['why']}" for one in document["refused_why"]]
    if document["refused_why"]:
        lines.append("  a faster ship, a longer survey or better positions would help")
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
