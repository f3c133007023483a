"""OFFSETS.csv: timing offsets by day, run and array pair, as `timing` writes and `constancy` reads them."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from trackerlib.textfiles import BadRecord, InputError, read_lines
from trackerlib.timing.offsets import OffsetTable

MAX_OFFSET_MS = 1e6
NEEDED = ("day", "run", "pair", "offset_ms")


def read_offsets(path: str | Path) -> tuple[OffsetTable, tuple[BadRecord, ...]]:
    """The offsets of a table with columns day, run, pair, offset_ms (others may stand beside them).

    They are simulated where a remark says so or a column `simulated` says yes.

    Rows that cannot be read are kept apart with their line numbers; lines that begin with # are remarks.
    Raises InputError for a file without those columns or without a row.
    """
    return parse_offsets(read_lines(path), Path(path).name)


def parse_offsets(lines: list[str], name: str) -> tuple[OffsetTable, tuple[BadRecord, ...]]:
    """The same from lines already read."""
    header: list[str] | None = None
    rows: list[tuple[str, str, str, float]] = []
    bad: list[BadRecord] = []
    simulated = False
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            simulated |= "simulated" in line.lower()
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if header is None:
            header = [cell.lower() for cell in cells]
            missing = [column for column in NEEDED if column not in header]
            if missing:
                raise InputError(
                    f"{name}, line {number}: no column {', '.join(missing)}; wanted {', '.join(NEEDED)}"
                )
            continue
        named = dict(zip(header, cells, strict=False))
        try:
            rows.append(_row(named))
            simulated |= named.get("simulated", "").lower() == "yes"
        except ValueError as error:
            bad.append(BadRecord(number, str(error)))
    if not rows:
        raise InputError(f"{name}: found no offset; wanted rows of {', '.join(NEEDED)}")
    day, run, pair, offset_ms = zip(*rows, strict=True)
    table = OffsetTable(
        np.array(day), np.array(run), np.array(pair), 1e-3 * np.array(offset_ms), name, simulated
    )
    return table, tuple(bad)


def _row(named: dict[str, str]) -> tuple[str, str, str, float]:
    """One row; raises ValueError saying what was found and what was wanted."""
    for column in ("day", "run", "pair"):
        if not named.get(column):
            raise ValueError(f"{column} is empty; wanted a name or number")
    text = named.get("offset_ms", "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) < MAX_OFFSET_MS:
        raise ValueError(f"offset_ms holds {text!r}; wanted milliseconds, such as 3.54")
    return named["day"], named["run"], named["pair"], value
