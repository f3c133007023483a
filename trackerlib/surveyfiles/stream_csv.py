"""Streams of a hunt as CSV: arrivals of a pinger, and fixes of the ship's GPS, both by one clock.

Arrivals: `arrival_s` and optionally `ping`. Fixes: `time_s, lat_deg, lon_deg` (or `utc` for `time_s`: ISO 8601, which
becomes seconds since 1970) and optionally `hdop, heading_deg`; a fix without a position has empty cells. Lines that
begin with # are comments.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.surveyfiles.pings_csv import utc_of
from trackerlib.textfiles import BadRecord, InputError

ARRIVAL = ("arrival_s",)
NAVIGATION = ("time_s", "lat_deg", "lon_deg")
DATED = ("utc", "lat_deg", "lon_deg")


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Instants of reception, as a receiver logs them."""

    number: np.ndarray  # (N,) the file's own, or 1, 2, ...
    arrival_s: np.ndarray  # (N,)
    bad_records: tuple[BadRecord, ...]
    simulated: bool


def read_arrivals(lines: list[str], name: str) -> Arrivals:
    """Arrivals of a file. Raises InputError for a missing column and for a file without any."""
    rows, bad = _rows(lines, name, ARRIVAL)
    if not rows:
        raise InputError(f"{name}: found no usable arrival, wanted at least one")
    numbers = [row.get("ping", math.nan) for row in rows]
    known = all(math.isfinite(number) for number in numbers) and len(set(numbers)) == len(numbers)
    return Arrivals(
        np.array(numbers if known else range(1, len(rows) + 1), dtype=np.int64),
        np.array([row["arrival_s"] for row in rows]),
        bad,
        says_simulated(lines),
    )


def read_navigation(lines: list[str], name: str) -> tuple[NavigationFixes, tuple[BadRecord, ...]]:
    """Fixes of a file, and the lines that could not be read. Raises InputError for a missing column or no fix."""
    needed = DATED if tells_utc(lines) else NAVIGATION
    rows, bad = _rows(lines, name, needed, may_lack=("lat_deg", "lon_deg"))
    if not rows:
        first = f"; line {bad[0].line}: {bad[0].why}" if bad else ""
        raise InputError(f"{name}: found no usable fix, wanted at least two{first}")

    def column(key: str) -> np.ndarray:
        return np.array([row.get(key, math.nan) for row in rows])

    heading = column("heading_deg")
    fixes = NavigationFixes(
        column(needed[0]),
        column("lat_deg"),
        column("lon_deg"),
        column("hdop"),
        np.radians(heading) if np.isfinite(heading).any() else None,
    )
    return fixes, bad


def tells_utc(lines: list[str]) -> bool:
    """Whether a file of fixes tells UTC instead of seconds: its header has `utc` and no `time_s`."""
    header = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")
    columns = [column.strip().lower() for column in header.split(",")]
    return "utc" in columns and "time_s" not in columns


def says_simulated(lines: list[str]) -> bool:
    """Whether a comment near the top says so."""
    return any("simulated" in line.lower() for line in lines[:20] if line.lstrip().startswith("#"))


def _rows(lines, name, needed, may_lack=()) -> tuple[list[dict[str, float]], tuple[BadRecord, ...]]:
    numbered = [
        (k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")
    ]
    if not numbered:
        raise InputError(f"{name}: the file holds no header and no rows")
    header_line, header = numbered[0]
    columns = [column.strip().lower() for column in next(csv.reader([header]))]
    missing = [column for column in needed if column not in columns]
    if missing:
        raise InputError(
            f"{name}, line {header_line}: found columns {', '.join(columns)[:120]!r}; wanted {', '.join(needed)} "
            f"({', '.join(missing)} missing)"
        )
    rows, bad = [], []
    for number, line in numbered[1:]:
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        try:
            if len(cells) != len(columns):
                raise ValueError(f"found {len(cells)} columns; wanted {len(columns)}, as in the header")
            row = {}
            for column, cell in zip(columns, cells, strict=True):
                if cell or (column in needed and column not in may_lack):
                    row[column] = _number(column, cell, column in needed)
            rows.append(row)
        except ValueError as error:
            bad.append(BadRecord(number, str(error)))
    return rows, tuple(bad)


def _number(column: str, cell: str, needed: bool) -> float:
    if column == "utc" and needed:
        if not cell:
            raise ValueError("utc is empty; wanted ISO 8601, such as 2018-04-26T05:10:33Z")
        return float(utc_of(cell).astype("datetime64[us]").astype(float)) * 1e-6
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if needed and not math.isfinite(value):
        raise ValueError(f"{column} is {cell!r}; wanted a number")
    return value
