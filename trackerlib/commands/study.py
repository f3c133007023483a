"""`study ... --out DIR`: the whole of the thesis's chapter IV, as a table and as its figures."""

from __future__ import annotations

import argparse
import csv
import io
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, fields
from pathlib import Path

import numba
import pandas as pd

from trackerlib.commands.workers import add_trials, add_workers, dask_client, use_workers
from trackerlib.simulation.figures import draw_page
from trackerlib.simulation.hexagon import METHODS, SCENARIOS, Scenario
from trackerlib.simulation.report import write_report
from trackerlib.simulation.study import (
    COMPONENTS,
    GPS_RMS_M,
    STUDY_METHODS,
    SWEEPS,
    StudyPoint,
    flat,
    run_study_point,
    study_points,
    summary,
)
from trackerlib.textfiles import InputError

SUMMARY = "simulate the thesis's study of accuracy: six beacons, two sweeps, two qualities of GPS"
POINT = tuple(field.name for field in fields(StudyPoint))
KEY = (*POINT, "speed_mps")  # what names a row
Page = tuple[int, str, float]  # scenario, sweep, ship's speed
NAMED = ("rmse", "bias", "mean_sigma", "crlb")
COLUMNS = (
    *POINT, "simulated", "seed", "speed_mps", "trials", "converged", "coverage95", "rmse_2d_m", "rmse_3d_m",
    "crlb_2d_m", "crlb_3d_m",
    *(f"{key}.{axis}" for key in NAMED for axis in COMPONENTS),
    *(f"{key}.{axis}" for key in ("rmse_now", "mean_sigma_now", "crlb_now") for axis in COMPONENTS[:3]),
    "seconds",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `study`."""
    add = parser.add_argument
    add("--scenarios", type=_list(int), default=tuple(SCENARIOS), metavar="1,..,6", help="default: all six")
    add("--sweeps", type=_list(str), default=SWEEPS, metavar=",".join(SWEEPS), help="default: both")
    add(
        "--gps-rms-m",
        type=_list(float),
        default=GPS_RMS_M,
        metavar="3,25",
        help="ship position error, each axis (default: both)",
    )
    add(
        "--methods",
        type=_list(str),
        default=METHODS,
        metavar=",".join(STUDY_METHODS),
        help=f"every reception, chained pairs, usual least squares (default {','.join(METHODS)})",
    )
    add_trials(parser, "at each point")
    add("--speed-mps", type=_list(float), default=(5.0,), metavar="5,1", help="of the ship (default 5)")
    add_workers(parser)
    add("--resume", action="store_true", help="keep the points that DIR/study.csv already holds")
    add("--out", type=Path, required=True, metavar="DIR", help="folder of table, figures and report")


def run(args: argparse.Namespace) -> dict:
    """Runs the study, a row of study.csv as each point ends, and draws its figures."""
    use_workers(args.workers)
    wanted = _wanted(args)
    begin = time.perf_counter()
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "study.csv"
    kept = _kept(path, args) if args.resume else []
    done = {_key(row) for row in kept}
    left = [one for one in wanted if _name(*one) not in done]
    _begin_table(path, kept)
    pages = _Pages([_name(*one) for one in wanted], kept, args.out)
    with path.open("a", newline="", encoding="utf-8") as table:
        writer = csv.DictWriter(table, COLUMNS)
        try:
            for number, row in enumerate(_rows(left, args), 1):
                writer.writerow(row)
                table.flush()
                pages.add(row)
                _show_progress(number, len(left))
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f"the points done are kept in {path}; --resume goes on from them"
            ) from None
    rows = pd.read_csv(path)
    simulated = time.perf_counter() - begin
    written, contours = write_report(rows, args.out, args.seed)
    figures = pages.drawn()
    return {
        "simulated": True,
        "points": len(rows),
        "resumed": len(kept),
        "trials": int(rows.trials.sum()),
        "converged": int(rows.converged.sum()),
        "table": str(path),
        "figures": [str(figure) for figure in [*figures, contours]],
        "report": str(written),
        "seconds": simulated,
    }


def _wanted(args: argparse.Namespace) -> list[tuple[StudyPoint, float]]:
    """Every point with its ship's speed. Raises InputError for what makes no sense."""
    try:
        points = study_points(args.scenarios, args.sweeps, args.gps_rms_m, args.methods)
    except ValueError as error:
        raise InputError(error) from None
    if args.trials < 1:
        raise InputError(f"--trials is {args.trials}; wanted at least 1")
    speeds = args.speed_mps
    if not all(0 < speed < 100 for speed in speeds) or len(set(speeds)) < len(speeds):
        raise InputError(f"--speed-mps is {speeds}; wanted speeds above 0 and below 100, each once")
    return [(point, speed) for speed in speeds for point in points]


def _key(row: dict) -> tuple[str, ...]:
    """What names a row, as text."""
    return tuple(str(row[name]) for name in KEY)


def _name(point: StudyPoint, speed_mps: float) -> tuple[str, ...]:
    """The same of a row that is wanted."""
    return _key(asdict(point) | {"speed_mps": speed_mps})


class _Pages:
    """Draws each page as soon as its last point is there, while the kernels work on the next."""

    def __init__(self, wanted: list[tuple[str, ...]], kept: list[dict], folder: Path):
        every = {_key(row) for row in kept} | set(wanted)
        self._wanted = Counter(_page(dict(zip(KEY, key, strict=True))) for key in sorted(every))
        self._rows: dict[Page, list[dict]] = {page: [] for page in self._wanted}
        self._folder = folder
        self._pool = ThreadPoolExecutor(1)
        self._drawn: dict[Page, Future[Path]] = {}
        for row in kept:
            self.add(row)

    def add(self, row: dict) -> None:
        """Takes one more row of the table."""
        page = _page(row)
        self._rows[page].append(row)
        if len(self._rows[page]) == self._wanted[page]:
            self._drawn[page] = self._pool.submit(self._draw, page)

    def _draw(self, page: Page) -> Path:
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS)  # through text, as a table that is resumed holds text
        writer.writeheader()
        writer.writerows(self._rows[page])
        text.seek(0)
        return draw_page(pd.read_csv(text), self._folder)

    def drawn(self) -> list[Path]:
        """The files written, in the order of the study."""
        with self._pool:
            return [self._drawn[page].result() for page in self._wanted]


def _page(row: dict) -> Page:
    """The page that a row is drawn on."""
    return int(row["scenario"]), row["sweep"], float(row["speed_mps"])


def one_row(
    point: StudyPoint, trials: int, seed: int, speed_mps: float, beacon: Scenario | None = None
) -> dict:
    """One point as a row of study.csv; a beacon of one's own takes the place of the scenario's."""
    begin = time.perf_counter()
    row = asdict(point) | flat(summary(run_study_point(point, trials, seed, speed_mps, beacon)))
    return row | {"seed": seed, "speed_mps": speed_mps, "seconds": round(time.perf_counter() - begin, 4)}


def rows_by_threads(points: list[StudyPoint], trials: int, seed: int, speed_mps: float) -> Iterator[dict]:
    """The rows of many points, in their order, a point a thread."""
    # Kernels of one thread each: two that took both cores would wait for one another.
    pool = ThreadPoolExecutor(numba.get_num_threads(), "study", lambda: numba.set_num_threads(1))
    try:
        yield from pool.map(lambda point: one_row(point, trials, seed, speed_mps), points)
    finally:
        pool.shutdown(cancel_futures=True)


def report(document: dict) -> str:
    """The same for a person."""
    return (
        f"SIMULATED: {document['points']} points ({document['resumed']} kept from before), "
        f"{document['converged']} of {document['trials']} fixes converged, {document['seconds']:.1f} s\n"
        f"table    {document['table']}\nreport   {document['report']}\nfigures  "
        + "\n         ".join(document["figures"])
    )


def _rows(left: list[tuple[StudyPoint, float]], args: argparse.Namespace) -> Iterator[dict]:
    if args.scheduler is None:
        for speed in args.speed_mps:
            points = [point for point, of in left if of == speed]
            yield from rows_by_threads(points, args.trials, args.seed, speed)
        return
    with dask_client(args.scheduler) as client:
        from distributed import as_completed

        futures = [
            client.submit(one_row, point, args.trials, args.seed, speed, pure=False) for point, speed in left
        ]
        for _, row in as_completed(futures, with_results=True):
            yield row


def _kept(path: Path, args: argparse.Namespace) -> list[dict]:
    """Whole rows of an earlier table; a line cut short by a kill is left out."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as table:
        reader = csv.DictReader(table)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise InputError(
                f"{path}, line 1: found other columns than a study's; wanted {', '.join(POINT)}, ..."
            )
        rows = [row for row in reader if None not in row.values() and row["seconds"]]
    wanted = (args.trials, args.seed)
    for line, row in enumerate(rows, 2):
        found = int(row["trials"]), int(row["seed"])
        if found != wanted:
            raise InputError(f"{path}, line {line}: found trials and seed {found}; wanted {wanted} to resume")
    return rows


def _begin_table(path: Path, kept: list[dict]) -> None:
    beside = path.with_suffix(".part")
    with beside.open("w", newline="", encoding="utf-8") as table:
        writer = csv.DictWriter(table, COLUMNS)
        writer.writeheader()
        writer.writerows(kept)
    os.replace(beside, path)


def _show_progress(number: int, of: int) -> None:
    if sys.stderr.isatty():
        print(f"\r{number} of {of} points", end="\n" if number == of else "", file=sys.stderr, flush=True)


def _list(kind):
    def parse(text: str) -> tuple:
        try:
            return tuple(kind(part) for part in text.split(","))
        except ValueError:
            raise argparse.ArgumentTypeError(f"found {text!r}; wanted a list with commas") from None

    return parse
