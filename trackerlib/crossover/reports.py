"""Position reports of a range run: which array put which vehicle where, at which point count."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.textfiles import BadRecord


@dataclass(frozen=True, eq=False)
class PositionReports:
    """Records of a T-file, one report a row, in the order of the file."""

    line: np.ndarray  # (N,) line number in the file, from 1
    point_count: np.ndarray  # (N,) integers
    position: np.ndarray  # (N, 3) downrange, crossrange, z (up), ft
    array: np.ndarray  # (N,) number of the reporting array
    mode: np.ndarray  # (N,) 2 ship, 7 torpedo; others exist
    flagged: np.ndarray  # (N,) true where an edit mark says the report is not to be used
    bad_records: tuple[BadRecord, ...] = ()  # records that could not be read
    left_out: int = (
        0  # records that were read, of other modes or with an edit mark, where only one was asked for
    )
    other_modes: tuple[int, ...] = ()  # modes of these
    source: str = ""  # file they came from
    range_name: str = ""

    def __post_init__(self):
        # one type a column, whoever built it: the compiled passes are compiled for these
        for name, kind in (("line", np.int32), ("point_count", np.int32), ("array", np.int16)):
            object.__setattr__(self, name, np.asarray(getattr(self, name)).astype(kind, copy=False))

    def __len__(self) -> int:
        return len(self.line)

    def only(self, keep: np.ndarray) -> PositionReports:
        """The reports where `keep` (N,) is true, or those at these indices."""
        names = ("line", "point_count", "position", "array", "mode", "flagged")
        return replace(self, **{name: getattr(self, name)[keep] for name in names})
