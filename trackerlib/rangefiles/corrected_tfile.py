"""A T-file with every position moved, in the columns it had; all else stays as it was, line ends and letters too.

What was done to the copy is written behind the text of its first record, so that a count of 31 header records stays
a count of 31. Where there is no header that is a position record, and the words stand behind its columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.rangefiles.record_scan import COLUMNS
from trackerlib.rangefiles.tfile import FIELDS, OF_NUMBERS, TFileReading
from trackerlib.textfiles import BadRecord, text_encoding

_X, _Y, _Z = FIELDS[1:4]
_WIDTH = _X.last - _X.first + 2  # with the column before
_LINE_END, _RETURN, _BLANK = (ord(letter) for letter in "\n\r ")


@dataclass(frozen=True)
class CorrectedCopy:
    """Bytes of a corrected copy, and the records whose new position has no room in its columns."""

    content: bytes
    written: np.ndarray  # (N,) true where the new position stands in the copy
    too_wide: tuple[BadRecord, ...]


def corrected_copy(
    content: bytes, reading: TFileReading, which: np.ndarray, position: np.ndarray, provenance: str
) -> CorrectedCopy:
    """The T-file with the positions of some of its reports replaced.

    which : (N,) reports of `reading`, which read the same content
    position : (N, 3) their new positions, ft
    provenance : a line that says what was done
    A position that needs more than seven columns, or eight where it had eight, is left as it was and told.
    """
    encoding = text_encoding(content)
    letters = _letters(content, encoding)
    columns = np.char.mod(f"%{_WIDTH}.1f", np.round(position, 1) + 0.0)
    starts = _line_starts(letters)
    places = starts[reading.reports.line[which] - 1]
    begins = places[:, None] + np.array([field.first - 2 for field in (_X, _Y, _Z)])
    wider = np.isin(letters[begins], OF_NUMBERS)  # the number has a column before the seven
    fits = np.all(np.char.str_len(np.char.strip(columns)) <= _WIDTH - 1 + wider, axis=1)
    for begin, wide, column in zip(begins[fits].T, wider[fits].T, columns[fits].T, strict=True):
        digits = np.frombuffer("".join(column).encode("ascii"), dtype=np.uint8).reshape(-1, _WIDTH)
        letters[begin[:, None] + np.arange(1, _WIDTH)] = digits[:, 1:]
        letters[begin[wide]] = digits[wide, 0]
    too_wide = [
        BadRecord(
            int(line),
            f"the corrected position {', '.join(row)} needs more than {_WIDTH - 1} columns; left as it was",
        )
        for line, row in zip(reading.reports.line[which[~fits]], np.char.strip(columns[~fits]), strict=True)
    ]
    line = letters[: starts[1]] if len(starts) > 1 else letters
    first = _with_provenance(line, provenance, 0 if reading.header else COLUMNS)
    copy = np.concatenate([first, letters[len(line) :]])
    return CorrectedCopy(_bytes(copy, encoding), fits, tuple(too_wide))


def _letters(content: bytes, encoding: str) -> np.ndarray:
    """The characters of a text, a number each: its bytes where one is one character, as in most T-files."""
    if content.isascii() or encoding == "latin-1":
        return np.frombuffer(content, np.uint8).copy()
    return np.frombuffer(content.decode(encoding, "replace").encode("utf-32-le"), "<u4").copy()


def _bytes(letters: np.ndarray, encoding: str) -> bytes:
    if letters.dtype == np.uint8:
        return letters.tobytes()
    return letters.tobytes().decode("utf-32-le").encode(encoding)


def _line_starts(letters: np.ndarray) -> np.ndarray:
    """Where each line begins, whichever of the three line ends a file has."""
    returns = np.flatnonzero(letters == _RETURN)
    alone = returns[letters[np.minimum(returns + 1, len(letters) - 1)] != _LINE_END]
    return np.sort(np.concatenate([[-1], np.flatnonzero(letters == _LINE_END), alone])) + 1


def _with_provenance(line: np.ndarray, provenance: str, column: int) -> np.ndarray:
    """A line with the provenance behind what it says, and behind so many columns."""
    ends = np.flatnonzero((line == _LINE_END) | (line == _RETURN))
    end = ends[0] if len(ends) else len(line)
    said = np.flatnonzero(line[:end] != _BLANK)
    first = line[: said[-1] + 1 if len(said) else 0]
    words = " " * max(column - len(first), 0) + "  " + provenance
    coded = words.encode("latin-1", "replace") if line.dtype == np.uint8 else words.encode("utf-32-le")
    return np.concatenate([first, np.frombuffer(coded, line.dtype), line[end:]])
