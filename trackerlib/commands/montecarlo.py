"""`montecarlo --scenario 1..6 ...`: how good fixes of one simulated beacon are, and whether they know it."""

from __future__ import annotations

import argparse
import time
from contextlib import nullcontext

from trackerlib.commands.workers import add_trials, add_workers, dask_client, use_workers
from trackerlib.rounding import rounded, value_with_sigma
from trackerlib.simulation.hexagon import METHODS, SCENARIOS, Trials, run_point
from trackerlib.simulation.study import COMPONENTS, coverage_words, summary
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
    add_trials(parser, "simulated surveys")
    add("--method", choices=METHODS, default=METHODS[0], help="every reception, or chained pairs")
    add("--speed-mps", type=float, default=5.0, metavar="C", help="of the ship (default 5)")
    add("--start-vertex", type=int, default=4, metavar="V", help="it starts at 60 V degrees (default 4)")
    add_workers(parser)


def run(args: argparse.Namespace) -> dict:
    """The answer of `montecarlo` as a document for JSON."""
    use_workers(args.workers)
    point = (args.scenario, args.experiments, args.spacing, args.gps_rms_m)
    how = (args.seed, args.method, args.speed_mps, args.start_vertex)
    with nullcontext() if args.scheduler is None else dask_client(args.scheduler) as cluster:
        try:
            _run(cluster, *point, min(args.trials, 1), *how)  # kernels are loaded before the clock starts
            begin = time.perf_counter()
            trials = _run(cluster, *point, args.trials, *how)
        except ValueError as error:
            raise InputError(error) from None
    seconds = time.perf_counter() - begin
    return {
        "scenario": args.scenario,
        "method": args.method,
        **summary(trials),
        "refused_why": [{"why": why, "count": count} for why, count in trials.refused_why.items()],
        "fixes_per_s": len(trials.estimate) / seconds,
    }


def _run(cluster, *point) -> Trials:
    """The trials of a point, here or on a cluster."""
    return run_point(*point) if cluster is None else cluster.submit(run_point, *point, pure=False).result()


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
        fixes = document["converged"]
        for name, rmse in document["rmse"].items():
            unit = UNITS[name]
            error = value_with_sigma(rmse, rmse / (2 * fixes) ** 0.5, unit)
            bias = value_with_sigma(document["bias"][name], rmse / fixes**0.5, unit)
            lines.append(
                f"  {name:2} error {error}, {rmse / document['crlb'][name]:.2f} times the Cramer-Rao bound; "
                f"stated {rounded(document['mean_sigma'][name])} {unit}; bias {bias}"
            )
        lines.append(f"  {coverage_words(document['coverage95'], fixes)}")
    return "\n".join(lines)
