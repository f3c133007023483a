"""T-files: header records, then one fixed-column record for each position an array reported.

Columns 1-5 point count, 6-7 edit mark (blank to keep), 9-15, 18-24, 27-33 downrange, crossrange and z in
feet with one decimal, 64-65 array number, 68 mode; after KEYGATE's (I5,A2,1X,F7.1,2X,F7.1,2X,F7.1,30X,I2,
2X,I1), Read (1990), Appendix E.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.reports import PositionReports
from trackerlib.rangefiles.arrays import parse_date
from trackerlib.textfiles import BadRecord, InputError, decode_lines, read_bytes

HEADER_RECORDS = 31
MAX_HEADER_RECORDS = 1000  # how far a header is looked for
COLUMNS = 68
_CHUNK = 200_000  # records parsed at a time, to bound the memory of a file of millions
_BLANK, _POINT, _PLUS, _MINUS, _ZERO, _NEWLINE = (ord(c) for c in " .+-0\n")


@dataclass(frozen=True)
class Field:
    """One number of a record."""

    name: str
    first: int  # column, from 1
    last: int
    decimals: int  # the decimal point stands this far before the last column; 0 for whole numbers

    @property
    def wanted(self) -> str:
        """What belongs there, in words."""
        return "feet with one decimal, such as '19463.2'" if self.decimals else "a whole number"


FIELDS = (
    Field("point count", 1, 5, 0),
    Field("downrange", 9, 15, 1),
    Field("crossrange", 18, 24, 1),
    Field("z", 27, 33, 1),
    Field("array number", 64, 65, 0),
    Field("mode", 68, 68, 0),
)


@dataclass(frozen=True, eq=False)
class TFileReading:
    """A T-file as read: its reports, what its header offers, and what should be looked at."""

    reports: PositionReports
    header: tuple[str, ...]
    sound_speed_table: np.ndarray  # (L, 2) depth [ft] and speed [ft/s] of the header's table; L may be 0
    run_date: np.datetime64  # the one date in the header, else NaT
    simulated: bool  # the header says so
    warnings: tuple[str, ...] = ()

    def profile(self, speeds: str = "middle") -> SoundSpeedProfile | None:
        """Sound-speed profile of the header's table, or None where there is none.

        speeds : "middle" if depths are layers' upper boundaries and speeds belong to the layers' middles (as
        in VELOCITY.DAT, which repeats this table), "boundary" if the speeds belong to the depths given.
        """
        if len(self.sound_speed_table) < 2:
            return None
        depth, speed = self.sound_speed_table.T
        name = f"header of {self.reports.source}"
        if speeds == "middle":
            return SoundSpeedProfile.from_layer_middles(depth, speed, "ft", name)
        return SoundSpeedProfile(depth, speed, "ft", name)


def read_tfile(path: str | Path, header_records: int | None = HEADER_RECORDS) -> TFileReading:
    """Reports of a T-file; records that cannot be read are kept apart with their line numbers.

    header_records : how many lines to skip; None takes all before the first that is a position record
    Warns of a header count that cuts data off or leaves header in. Raises InputError if the file cannot be
    read, is shorter than its header, or holds no record.
    """
    return parse_tfile(read_bytes(path), Path(path).name, header_records)


def parse_tfile(content: bytes, name: str, header_records: int | None = HEADER_RECORDS) -> TFileReading:
    """The same from the bytes of a file (or upload) called `name`."""
    content = _one_byte_text(content, name)
    starts, lengths = _line_places(content)
    if header_records is None:
        lines = content.decode("latin-1").split("\n", MAX_HEADER_RECORDS)[:MAX_HEADER_RECORDS]
        header_records = next((n for n, line in enumerate(lines) if _is_record(line)), 0)
    if header_records < 0:
        raise InputError(f"{name}: header count is {header_records}, wanted 0 or more")
    if len(starts) <= header_records:
        raise InputError(
            f"{name}: found {len(starts)} lines, wanted {header_records} of header and then records"
        )
    text = np.frombuffer(content, dtype=np.uint8)
    head = [
        content[start : start + length].decode("latin-1")
        for start, length in zip(starts[:header_records], lengths[:header_records], strict=True)
    ]
    title = " ".join(line for line in head if not _speed_pairs(line)).upper()
    simulated = "SYNTHETIC" in title or "SIMULATED" in title
    reports = _reports(text, starts, lengths, header_records, name, "SIMULATED" if simulated else "")
    return TFileReading(
        reports=reports,
        header=tuple(head),
        sound_speed_table=_sound_speed_table(head),
        run_date=_only_date(title),
        simulated=simulated,
        warnings=tuple(_header_warnings(head, reports)),
    )


def _one_byte_text(content: bytes, name: str) -> bytes:
    """The file with one byte a character and Unix line ends, so that columns can be counted in bytes."""
    decode_lines(content[:65536], name)  # refuses what is no text
    content = content.rstrip(b"\x1a").replace(b"\r\n", b"\n")
    if not content.isascii() or b"\r" in content:
        content = "\n".join(decode_lines(content, name)).encode("latin-1", errors="replace")
    return content


def _line_places(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Where each line starts and how long it is without its end."""
    ends = np.flatnonzero(np.frombuffer(content, dtype=np.uint8) == _NEWLINE)
    if not content.endswith(b"\n"):
        ends = np.append(ends, len(content))
    starts = np.concatenate(([0], ends[:-1] + 1))
    return starts, ends - starts


def _reports(text, starts, lengths, header_records, name, range_name) -> PositionReports:
    """Reports of all lines after the header. Raises InputError if there is none."""
    parts, bad = [], []
    for first in range(header_records, len(starts), _CHUNK):
        last = min(first + _CHUNK, len(starts))
        part, part_bad = _parse_records(
            _columns(text, starts[first:last], lengths[first:last]), lengths[first:last], first + 1
        )
        parts.append(part)
        bad += part_bad
    line, values, flagged = (np.concatenate(column) for column in zip(*parts, strict=True))
    if not len(line):
        why = f"; line {bad[0].line}: {bad[0].why}" if bad else ""
        raise InputError(f"{name}: found no position record after {header_records} lines of header{why}")
    whole = values[:, [0, 4, 5]].astype(np.int64)
    return PositionReports(
        line=line,
        point_count=whole[:, 0],
        position=values[:, 1:4],
        array=whole[:, 1],
        mode=whole[:, 2],
        flagged=flagged,
        bad_records=tuple(bad),
        source=name,
        range_name=range_name,
    )


def _columns(text: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The first 68 characters of each line (N, 68), blanks behind the end of a short one."""
    column = np.arange(COLUMNS)
    place = np.minimum(starts[:, None] + column, len(text) - 1)
    return np.where(column < lengths[:, None], text[place], _BLANK)


def _parse_records(columns: np.ndarray, lengths: np.ndarray, first_line: int):
    """Line numbers, values (N, 6) and flags of the records that can be read; and the bad ones.

    A record with an edit mark may have any position, unless the mark is part of a number: then the columns
    are shifted and it is a bad record.
    """
    parsed = [parse_numbers(columns[:, f.first - 1 : f.last], f.decimals) for f in FIELDS]
    values = np.column_stack([value for value, _ in parsed])
    good = np.column_stack([ok for _, ok in parsed])
    mark = columns[:, 5:7]
    flagged = np.any(mark != _BLANK, axis=1)
    is_number = np.any((mark >= _ZERO) & (mark <= _ZERO + 9), axis=1)
    whole = [k for k, f in enumerate(FIELDS) if not f.decimals]
    read = good.all(axis=1) | (flagged & ~is_number & good[:, whole].all(axis=1))
    written = np.any(columns != _BLANK, axis=1)
    bad = [
        BadRecord(first_line + int(k), _why_bad(columns[k], int(lengths[k]), good[k]))
        for k in np.flatnonzero(written & ~read)
    ]
    keep = written & read
    values = np.where(good, values, 0.0)  # of a record with an edit mark, which no gate lets through
    return (first_line + np.flatnonzero(keep), values[keep], flagged[keep]), bad


def parse_numbers(field: np.ndarray, decimals: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N,) of a column field (N, W) of character codes, and which are well formed (N,).

    Well formed: blanks, a sign or none, digits; the last column a digit, and the decimal point exactly
    `decimals` columns before it. So a record shifted by one column is found out.
    """
    digit = (field >= _ZERO) & (field <= _ZERO + 9)
    blank = field == _BLANK
    sign = (field == _MINUS) | (field == _PLUS)
    at_point = np.zeros(field.shape[1], dtype=bool)
    if decimals:
        at_point[-1 - decimals] = True
    begun = np.logical_or.accumulate(~blank, axis=1)
    before = np.column_stack([np.zeros(len(field), dtype=bool), begun[:, :-1]])
    fits = np.where(at_point, field == _POINT, digit | (blank & ~begun) | (sign & ~before))
    good = fits.all(axis=1) & digit[:, -1]
    value = np.zeros(len(field))
    for column, is_digit in zip(field.T, digit.T, strict=True):
        value = np.where(is_digit, 10.0 * value + (column - float(_ZERO)), value)
    minus = np.any(field == _MINUS, axis=1)
    return np.where(minus, -value, value) / 10.0**decimals, good


def _why_bad(columns: np.ndarray, length: int, good: np.ndarray) -> str:
    if length < COLUMNS:
        return f"the record ends at column {length}, wanted {COLUMNS} columns"
    text = bytes(columns).decode("latin-1")
    field = FIELDS[int(np.argmin(good))]
    where = f"columns {field.first}-{field.last}" if field.last > field.first else f"column {field.first}"
    return f"{where} ({field.name}) hold {text[field.first - 1 : field.last]!r}, wanted {field.wanted}"


def _header_warnings(head: list[str], reports: PositionReports) -> list[str]:
    """What is odd about the count of header records."""
    warnings = []
    cut = [n for n, line in enumerate(head, 1) if _is_record(line)]
    if cut:
        warnings.append(
            f"the header count {len(head)} cuts {len(cut)} position records off, from line {cut[0]} on; "
            f"the header seems to have {cut[0] - 1} records"
        )
    lead = int(reports.line[0]) - 1
    if lead > len(head):
        warnings.append(
            f"the first record that can be read is line {lead + 1}: the header count {len(head)} may leave "
            f"header in, {lead} would not"
        )
    return warnings


def _is_record(line: str) -> bool:
    row = np.frombuffer(line[:COLUMNS].ljust(COLUMNS).encode("latin-1"), dtype=np.uint8)[None, :]
    return all(parse_numbers(row[:, f.first - 1 : f.last], f.decimals)[1][0] for f in FIELDS)


def _sound_speed_table(head: list[str]) -> np.ndarray:
    """Depth and speed (L, 2) of the header lines that hold nothing but pairs of them, by depth."""
    pairs = sorted({pair for line in head for pair in _speed_pairs(line)})
    table = np.array(pairs).reshape(-1, 2)
    return table[np.concatenate(([True], np.diff(table[:, 0]) > 0))] if len(table) else table


def _speed_pairs(line: str) -> list[tuple[float, float]]:
    try:
        numbers = [float(word) for word in line.replace("$", " ").split()]
    except ValueError:
        return []
    pairs = list(zip(numbers[::2], numbers[1::2], strict=False))
    plausible = all(0 <= depth < 40_000 and 4000 < speed < 6000 for depth, speed in pairs)
    return pairs if plausible and len(numbers) % 2 == 0 else []


def _only_date(title: str) -> np.datetime64:
    """The date in the header's text if there is exactly one, else NaT."""
    days = set()
    for text in re.findall(r"(?<![\d/-])(?:\d{1,2}/\d{1,2}/(?:\d{4}|\d\d)|\d{4}-\d\d-\d\d)(?![\d/-])", title):
        try:
            days.add(parse_date(text))
        except ValueError:
            continue
    return days.pop() if len(days) == 1 else np.datetime64("NaT", "D")
