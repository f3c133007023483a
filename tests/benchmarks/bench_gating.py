"""Gating a T-file of 4 million records, from the file to crossover sets, against pandas.read_fwf and polars.

The two only read the same columns; all in one run, on a generated file in a temporary folder.

.venv/bin/python tests/benchmarks/bench_gating.py [COUNTS]
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import polars as pl
import psutil

from trackerlib.crossover.gating import gate_reports
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.tfile import read_tfile

HEADER = 31
BLOCK = 2500  # point counts whose records are made once; the next block has them again, counted on
PER_COUNT = 40  # reports at a point count: 16 of each of two vehicles, 8 of others
FWF_ROWS = 200_000  # read_fwf takes half a minute for all; its time a row is constant
COLUMNS = {
    "count": (0, 5),
    "mark": (5, 2),
    "x": (8, 7),
    "y": (17, 7),
    "z": (26, 7),
    "array": (63, 2),
    "mode": (67, 1),
}
NUMBER = np.array([*range(1, 21)])
PLACE = np.column_stack([7000.0 * (NUMBER % 5), 6000.0 * (NUMBER // 5), np.full(len(NUMBER), -1300.0)])
SURVEY = ArraySurvey(NUMBER, PLACE, np.full(len(NUMBER), "NaT", "datetime64[D]"), np.zeros(len(NUMBER), bool))


def make_file(path: Path, counts: int) -> int:
    """A run of two vehicles that the nearest 16 arrays report, one report in a hundred twice; one bad line."""
    block = _block(np.random.default_rng(1), np.arange(BLOCK))
    with path.open("wb") as file:
        file.writelines(b"SIMULATED header %d\n" % n for n in range(HEADER))
        for first in range(0, counts, BLOCK):
            columns = np.array(
                [list(b"%5d" % count) for count in range(first, first + BLOCK)], dtype=np.uint8
            )
            block[:, :5] = np.repeat(columns, PER_COUNT, axis=0)
            file.write(block.tobytes())
        file.write(b"cut off\n")
    return counts * PER_COUNT + 1


def _block(rng, t):
    parts = []
    for vehicle, mode, reports in ((0, 2, 16), (1, 7, 16), (2, 1, 4), (3, 8, 4)):
        at = np.column_stack(
            [14_000 + 13_000 * np.sin(t / 900 + vehicle), 12_000 + 11_000 * np.cos(t / 700), 0.0 * t - 300]
        )
        near = np.argsort(np.linalg.norm(at[:, None] - PLACE, axis=2), axis=1)[:, :reports]
        near[:, -1] = np.where(rng.random(len(t)) < 0.16, near[:, 0], near[:, -1])
        position = np.repeat(at, reports, axis=0) + rng.normal(0, 2, (len(t) * reports, 3))
        parts.append(
            np.column_stack([np.repeat(t, reports), position, NUMBER[near.ravel()], 0 * near.ravel() + mode])
        )
    rows = np.concatenate(parts)
    form = "%5d   %7.1f  %7.1f  %7.1f   176.1  344.3   -6.07   82 5%2d  %d\n"
    text = "".join(form % tuple(row) for row in rows[np.argsort(rows[:, 0], kind="stable")].tolist())
    return np.frombuffer(text.encode(), dtype=np.uint8).reshape(len(rows), -1).copy()


def ours(path: Path):
    """From the file to crossover sets."""
    reports = read_tfile(path, HEADER, 7).reports
    return reports, gate_reports(reports, SURVEY, 7)


def by_polars(path: Path) -> pl.DataFrame:
    """The same columns as numbers."""
    lines = pl.read_csv(
        path,
        has_header=False,
        skip_rows=HEADER,
        separator="\n",
        quote_char=None,
        schema={"record": pl.String},
    )
    kinds = {"mark": pl.String, "x": pl.Float64, "y": pl.Float64, "z": pl.Float64}
    columns = []
    for name, (start, width) in COLUMNS.items():
        text = pl.col("record").str.slice(start, width)
        kind = kinds.get(name, pl.Int32)
        columns.append(
            (text if kind == pl.String else text.str.strip_chars().cast(kind, strict=False)).alias(name)
        )
    return lines.select(columns)


def by_read_fwf(path: Path) -> pd.DataFrame:
    """The same columns of the first rows."""
    places = [(start, start + width) for start, width in COLUMNS.values()]
    return pd.read_fwf(
        path, skiprows=HEADER, header=None, nrows=FWF_ROWS, colspecs=places, names=list(COLUMNS)
    )


def best_of(times: int, path: Path, *works) -> np.ndarray:
    """Least seconds (W, 2) of each, by the clock and of the processor in all threads; they take turns."""
    seconds = np.empty((times, len(works), 2))
    for turn in seconds:
        for taken, work in zip(turn, works, strict=True):
            start = time.perf_counter(), time.process_time()
            work(path)
            taken[:] = time.perf_counter() - start[0], time.process_time() - start[1]
    return seconds.min(axis=0)


def peak_memory(path: Path) -> tuple[float, float]:
    """Greatest memory of a gating beyond that before it, and what is kept of it at the end, bytes.

    Sampled each millisecond while the kernels run. Pages of the mapped file do not count: they are the system's
    cache of the file, which it takes back when it needs them.
    """
    before, peak, running = _own_memory(), 0, True

    def sample():
        nonlocal peak
        while running:
            peak = max(peak, _own_memory())
            time.sleep(0.001)

    thread = threading.Thread(target=sample)
    thread.start()
    reports, result = ours(path)
    running = False
    thread.join()
    columns = ("line", "point_count", "position", "array", "mode", "flagged")
    kept = sum(getattr(reports, name).nbytes for name in columns)
    kept += sum(one.x.nbytes + one.y.nbytes + one.point_count.nbytes for one in result.sets)
    return peak - before, kept


def _own_memory() -> int:
    memory = psutil.Process().memory_info()
    return memory.rss - memory.shared


def main():
    counts = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    with tempfile.TemporaryDirectory() as folder:
        small, path = Path(folder) / "small.dat", Path(folder) / "t.dat"
        make_file(small, BLOCK)
        ours(small)  # loads the kernels, which are no memory of a gating
        records = make_file(path, counts)
        peak, kept = peak_memory(path)  # first, while nothing that an earlier gating let go can be had again
        reports, result = ours(path)
        print(f"{records:,} records, {len(reports):,} of the mode kept, {len(result.choices):,} repeats,")
        print(
            f"{len(result.sets)} sets of {sum(s.points for s in result.sets):,} points, {result.counts.bad} bad line"
        )
        reading, whole, polars = best_of(8, path, lambda p: read_tfile(p, HEADER, 7), ours, by_polars)
        (fwf,) = best_of(1, path, by_read_fwf) * records / FWF_ROWS
        print(f"peak memory {peak / 1e6:.0f} MB over {kept / 1e6:.0f} MB kept: {peak / kept:.2f}")
        print(
            f"ours, to sets {records / whole[0]:13,.0f} records/s (reading alone {records / reading[0]:,.0f})"
        )
        for name, theirs in (("polars", polars), ("read_fwf", fwf)):
            clock, processor = theirs / whole
            print(f"{name:8} reads {records / theirs[0]:11,.0f} records/s", end="   ")
            print(f"ratio {clock:.1f} by the clock, {processor:.1f} in processor time")


if __name__ == "__main__":
    main()
