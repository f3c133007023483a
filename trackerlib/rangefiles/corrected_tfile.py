"""A T-file with every position moved, in the columns it had; all other bytes stay as they were.

The header keeps its number of records: what was done to the copy is written behind a blank header record, or
behind the text of the first one, so that a count of 31 stays a count of 31.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.rangefiles.tfile import FIELDS, TFileReading, one_byte_text
from trackerlib.textfiles import BadRecord

_X, _Y, _Z = FIELDS[1:4]
_WIDTH = _X.last - _X.first + 1


@dataclass(frozen=True)
class CorrectedCopy:
    """Bytes of a corrected copy, and the records whose new position has no room in its columns."""

    content: bytes
    written: np.ndarray  # (N,) true where the new position stands in the copy
    too_wide: tuple[BadRecord, ...]


def corrected_copy(
    content: bytes, name: str, reading: TFileReading, which: np.ndarray, position: np.ndarray, provenance: str
) -> CorrectedCopy:
    """The T-file with the positions of some of its reports replaced.

    which : (N,) reports of `reading`, which read the same content
    position : (N, 3) their new positions, ft
    provenance : a line that says what was done, put into the header
    A position that needs more than seven columns is left as it was and told.
    """
    content = one_byte_text(content, name)
    text = np.frombuffer(content, dtype=np.uint8).copy()
    starts = np.concatenate([[0], np.flatnonzero(text == ord("\n")) + 1])
    columns = np.char.mod(f"%{_WIDTH}.1f", np.round(position, 1) + 0.0)
    fits = np.all(np.char.str_len(columns) == _WIDTH, axis=1)
    places = starts[reading.reports.line[which] - 1]
    for field, column in zip((_X, _Y, _Z), columns.T, strict=True):
        letters = np.frombuffer("".join(column[fits]).encode("ascii"), dtype=np.uint8).reshape(-1, _WIDTH)
        text[places[fits, None] + field.first - 1 + np.arange(_WIDTH)] = letters
    too_wide = [
        BadRecord(
            int(line),
            f"the corrected position {', '.join(row)} needs more than {_WIDTH} columns; left as it was",
        )
        for line, row in zip(reading.reports.line[which[~fits]], np.char.strip(columns[~fits]), strict=True)
    ]
    head_end = starts[len(reading.header)]
    head = _with_provenance(reading.header, provenance)
    return CorrectedCopy(head + text.tobytes()[head_end:], fits, tuple(too_wide))


def _with_provenance(header: tuple[str, ...], provenance: str) -> bytes:
    """The header with the provenance in its first record, which keeps its own text before it."""
    if not header:
        return b""
    first = f"{header[0].rstrip()}  {provenance}"
    return "".join(f"{line}\n" for line in (first, *header[1:])).encode("latin-1", errors="replace")
