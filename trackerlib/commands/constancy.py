"""`constancy OFFSETS.csv`: variance components of timing offsets, and whether one offset is enough for a run."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from trackerlib.commands.range_inputs import tell
from trackerlib.rangefiles.offsets_file import read_offsets
from trackerlib.textfiles import InputError
from trackerlib.timing.constancy import (
    Constancy,
    Variances,
    component_intervals,
    components_of,
    pair_effects,
    runs_constant,
    variances_of,
)
from trackerlib.timing.offsets import OffsetTable

SUMMARY = "test whether one timing offset is enough for a run, from a table of offsets"
NAMES = ("day", "run", "residual")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `constancy`."""
    add = parser.add_argument
    add("offsets", type=Path, nargs="+", metavar="OFFSETS.csv", help="columns day, run, pair, offset_ms")
    add(
        "--variances",
        type=_variances,
        metavar="DAY,RUN,RESIDUAL",
        help="the three components in ms^2, which are then not estimated",
    )


def run(args: argparse.Namespace) -> dict:
    """The answer of `constancy` as a document for JSON."""
    table = read_tables(args.offsets)
    warnings, intervals, converged = [], None, True
    if args.variances is None:
        try:
            components = components_of(table)
        except ValueError as error:
            raise InputError(f"{table.source}: {error}; tell them with --variances") from None
        if not components.freedom > 0:
            raise InputError(
                f"{table.source}: days and runs take up every offset, and no residual variance is left; tell the "
                "variances with --variances"
            )
        variances, converged = variances_of(components), components.converged
        intervals = 1e6 * component_intervals(table, components)
        warnings = [
            f"the array pairs take up every {name}, so its variance cannot be told"
            for name in components.not_estimable
        ]
    else:
        variances = Variances(*(1e-6 * value for value in args.variances))
    values = np.array([variances.day, variances.run, variances.residual])
    pairs = pair_effects(table, variances)
    return {
        "variance_components": dict(zip(NAMES, 1e6 * values, strict=True)),
        "gamma": dict(zip(NAMES[:2], values[:2] / values[2], strict=True)),
        "estimated": args.variances is None,
        "interval95_ms2": None if intervals is None else dict(zip(NAMES, intervals.tolist(), strict=True)),
        "residual_degrees_of_freedom": variances.freedom,
        "converged": converged,
        "at_boundary": [name for name, value in zip(NAMES, values, strict=True) if value == 0],
        "offsets": len(table),
        "runs": [{"run": test.name, **_judged(test)} for test in runs_constant(table, variances)],
        "pairs": [
            {"pair": test.name, "offsets": int(count), **_judged(test)}
            for test, count in zip(pairs.coherence, pairs.count, strict=True)
        ],
        "all_pairs": _judged(pairs.all_alike),
        "warnings": warnings,
        "simulated": table.simulated,
    }


def read_tables(paths: list[Path]) -> OffsetTable:
    """The offsets of all tables together, such as one of each run. Raises InputError for one named twice."""
    tables = []
    for place, path in enumerate(paths):
        if path.resolve() in (other.resolve() for other in paths[:place]):
            raise InputError(f"{path}: named twice; its offsets would count twice")
        table, bad = read_offsets(path)
        tell(path.name, bad, ())
        tables.append(table)
    day, run_, pair, offset_s = (
        np.concatenate([getattr(table, column) for table in tables])
        for column in ("day", "run", "pair", "offset_s")
    )
    source, simulated = ", ".join(one.source for one in tables), any(one.simulated for one in tables)
    return OffsetTable(day, run_, pair, offset_s, source, simulated)


def _judged(test: Constancy) -> dict:
    return {
        "mean_offset_ms": 1e3 * test.mean_s,
        "sigma_mean_offset_ms": 1e3 * test.sigma_mean_s,
        "pairs": test.effects,
        "distance": test.distance,
        "dof": test.dof,
        "p_value": test.p_value,
        "p_value_estimated_variance": test.p_value_estimated,
        "distance_over_sd": test.distance_over_sd,
    }


def report(answer: dict) -> str:
    """The answer of `constancy` for a person."""
    lines = ["component   variance (ms^2)" + ("   95 % interval" if answer["estimated"] else "   as told")]
    for name, value in answer["variance_components"].items():
        shown, between = f"{value:8.4g}", ""
        if answer["interval95_ms2"]:
            low, high = answer["interval95_ms2"][name]
            between = f"   {low:.3g} to {high:.3g}"
            if math.isnan(low):
                shown, between = f"{'-':>8}", "   cannot be told"
        lines.append(f"{name:10}  {shown}{between}")
    lines += [f"warning: {one}" for one in answer["warnings"]]
    lines.append("")
    wide = max(
        7, *(len(one["run"]) for one in answer["runs"]), *(len(one["pair"]) for one in answer["pairs"])
    )
    lines.append(
        f"{'run':{wide}} mean offset (ms)   pairs   distance   dof   p, chi-square   p, variance estimated"
    )
    lines += [_line(f"{one['run']:{wide}}", one) for one in answer["runs"]]
    lines.append("")
    lines.append(
        f"{'pair':{wide}} mean offset (ms)   offsets   distance   dof   p: do its offsets hang together?"
    )
    lines += [_line(f"{one['pair']:{wide}}", one) for one in answer["pairs"] if one["offsets"] > 1]
    single = sum(one["offsets"] == 1 for one in answer["pairs"])
    lines += (
        [f"pairs of one offset only, which have nothing to hang together with: {single}"] if single else []
    )
    alike = answer["all_pairs"]
    lines.append("")
    lines.append(f"all pairs share one offset: distance {alike['distance']:.2f}, {_p(alike['p_value'])}")
    if answer["simulated"]:
        lines.append("SIMULATED data")
    return "\n".join(lines)


def _line(name: str, one: dict) -> str:
    estimated = one["p_value_estimated_variance"]
    return (
        f"{name} {one['mean_offset_ms']:7.2f} ± {one['sigma_mean_offset_ms']:.2f}     {one['pairs']:4d}   "
        f"{one['distance']:9.2f}   {one['dof']:3d}   {one['p_value']:.2g}   "
        f"{'-' if estimated is None or math.isnan(estimated) else format(estimated, '.2g')}"
    )


def _p(value: float) -> str:
    return f"p {value:.2g}"


def _variances(text: str) -> tuple[float, float, float]:
    try:
        day, run_, residual = (float(part) for part in text.split(","))
        Variances(day, run_, residual)
        if not math.isfinite(day + run_ + residual):
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"found {text!r}; wanted DAY,RUN,RESIDUAL in ms^2, the last above zero"
        ) from None
    return day, run_, residual
