"""Points of crossover sets left out by hand, each with its reason: a log that outlives re-reading and re-sorting.

    edits = edits.exclude(crossover, rows, mode, "vehicle turning")
    kept = crossover.only(~edits.excluded(crossover, mode))

A point is known by its vehicle, the two arrays and its point count, which stay when a file is put in another order;
the lines of the file that it came from are written beside them.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property

import numpy as np

from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.textfiles import BadRecord, InputError

EXCLUDE, RESTORE = "exclude", "restore"
COLUMNS = (
    "utc", "action", "mode", "first_array", "second_array", "point_count", "first_line", "second_line", "source",
    "reason",
)  # fmt: skip


@dataclass(frozen=True)
class PointEdit:
    """One point left out, or put back."""

    utc: str  # when, ISO
    action: str  # EXCLUDE or RESTORE
    mode: int  # of the vehicle
    first_array: int
    second_array: int
    point_count: int
    first_line: int | None  # of the file, where known
    second_line: int | None
    source: str
    reason: str

    @property
    def point(self) -> tuple[int, int, int, int]:
        """What the point is known by."""
        return self.mode, self.first_array, self.second_array, self.point_count


@dataclass(frozen=True)
class PointEdits:
    """Every edit in the order in which it was made."""

    log: tuple[PointEdit, ...] = ()

    def __len__(self) -> int:
        return len(self.log)

    @cached_property
    def reasons(self) -> dict[tuple[int, int, int, int], str]:
        """Why each point that is left out now is left out."""
        out: dict[tuple[int, int, int, int], str] = {}
        for edit in self.log:
            if edit.action == EXCLUDE:
                out[edit.point] = edit.reason
            else:
                out.pop(edit.point, None)
        return out

    def excluded(self, crossover: CrossoverSet, mode: int) -> np.ndarray:
        """Which points (T,) of a set are left out."""
        pair = (mode, *crossover.pair)
        counts = [point[3] for point in self.reasons if point[:3] == pair]
        return np.isin(crossover.point_count, counts)

    def of_source(self, name: str) -> PointEdits:
        """The edits of points that came from the file of this name."""
        return PointEdits(tuple(edit for edit in self.log if edit.source == name))

    def kept(self, crossover: CrossoverSet, mode: int) -> CrossoverSet:
        """A set without the points left out."""
        return crossover.only(~self.excluded(crossover, mode)) if self.log else crossover

    def exclude(self, crossover: CrossoverSet, rows: Iterable[int], mode: int, reason: str) -> PointEdits:
        """The log with these points of a set left out."""
        return self._with(crossover, rows, mode, EXCLUDE, reason)

    def restore(self, crossover: CrossoverSet, rows: Iterable[int], mode: int) -> PointEdits:
        """The log with those of these points that are left out put back."""
        out = self.excluded(crossover, mode)
        return self._with(crossover, [row for row in rows if out[row]], mode, RESTORE, "")

    def _with(self, crossover, rows, mode, action, reason) -> PointEdits:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        added = []
        for row in rows:
            lines = (None, None) if crossover.lines is None else crossover.lines[row].tolist()
            added.append(
                PointEdit(
                    utc=now,
                    action=action,
                    mode=mode,
                    first_array=crossover.pair[0],
                    second_array=crossover.pair[1],
                    point_count=int(crossover.point_count[row]),
                    first_line=lines[0],
                    second_line=lines[1],
                    source=crossover.source,
                    reason=reason,
                )
            )
        return PointEdits((*self.log, *added))


def edits_csv(edits: PointEdits) -> str:
    """The log as CSV, an edit a row."""
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(
        ["" if (value := getattr(edit, name)) is None else value for name in COLUMNS] for edit in edits.log
    )
    return out.getvalue()


def parse_edits(lines: list[str], name: str) -> tuple[PointEdits, tuple[BadRecord, ...]]:
    """The log of a CSV that `edits_csv` wrote; rows that cannot be read are kept apart.

    Raises InputError for a file without its columns.
    """
    header: list[str] | None = None
    log, bad = [], []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = next(csv.reader([line]))
        if header is None:
            header = cells
            if missing := [column for column in COLUMNS if column not in header]:
                raise InputError(
                    f"{name}, line {number}: no column {', '.join(missing)}; wanted {', '.join(COLUMNS)}"
                )
            continue
        try:
            log.append(_edit(dict(zip(header, cells, strict=False))))
        except (KeyError, ValueError):
            bad.append(BadRecord(number, f"found {line.strip()[:60]!r}; wanted an edit of a point"))
    return PointEdits(tuple(log)), tuple(bad)


def _edit(named: dict[str, str]) -> PointEdit:
    """One row; raises ValueError or KeyError where it is none."""
    if named["action"] not in (EXCLUDE, RESTORE):
        raise ValueError(named["action"])
    first, second = (int(named[key]) if named[key] else None for key in ("first_line", "second_line"))
    return PointEdit(
        utc=named["utc"],
        action=named["action"],
        mode=int(named["mode"]),
        first_array=int(named["first_array"]),
        second_array=int(named["second_array"]),
        point_count=int(named["point_count"]),
        first_line=first,
        second_line=second,
        source=named["source"],
        reason=named["reason"],
    )
