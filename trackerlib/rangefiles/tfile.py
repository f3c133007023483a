"""T-files: header records, then one fixed-column record for each position an array reported.

Columns 1-5 point count, 6-7 edit mark (blank to keep), 9-15, 18-24, 27-33 downrange, crossrange and z in
feet with one decimal, 64-65 array number, 68 mode; after KEYGATE's (I5,A2,1X,F7.1,2X,F7.1,2X,F7.1,30X,I2,
2X,I1), Read (1990), Appendix E. A sign or digit right before a position belongs to it: where Fortran skips the
minus of -12345.6, it is read.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from mmap import mmap
from pathlib import Path

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.reports import PositionReports
from trackerlib.rangefiles.arrays import parse_date
from trackerlib.rangefiles.record_scan import COLUMNS, EVERY_MODE, scan_records
from trackerlib.textfiles import BadRecord, InputError, decode_lines, map_bytes, text_end

HEADER_RECORDS = 31
CORRECTED = "CORRECTED COPY"  # what the first record of such a copy says
MAX_HEADER_RECORDS = 1000  # how far a header is looked for
_HEAD_BYTES = 65_536
# A record whose columns are shifted is a bad record, not a line of the header.
NEARLY_RECORD = re.compile(r"\s*\d{1,5}(\s+-?\d{1,6}\.\d){3}\s")
_CHUNK = 200_000  # lines judged at a time, to bound the memory of a file of millions that are odd
SHIFTS = (
    "",
    "; the record is shifted to the right by one column",
    "; the record is shifted to the left by one column",
)
_BLANK, _POINT, _PLUS, _MINUS, _ZERO = (ord(c) for c in " .+-0")
OF_NUMBERS = np.frombuffer(b"0123456789.+-", np.uint8)


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

    def of(self, columns: np.ndarray) -> np.ndarray:
        """The characters of the field (N, W) in records (N, 68); of feet, with what runs over to the left."""
        if not self.decimals:
            return columns[:, self.first - 1 : self.last]
        wide = columns[:, self.first - 2 : self.last].copy()
        wide[~np.isin(wide[:, 0], OF_NUMBERS), 0] = _BLANK
        return wide


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
    corrected: str = ""  # how its positions were corrected, if the first record says that they were
    warnings: tuple[str, ...] = ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """The warnings, and that positions would be corrected twice."""
        again = (f"the positions were corrected before: {self.corrected}",) if self.corrected else ()
        return (*self.warnings, *again)

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


def read_tfile(
    path: str | Path, header_records: int | None = HEADER_RECORDS, mode: int | None = None
) -> TFileReading:
    """Reports of a T-file; records that cannot be read are kept apart with their line numbers.

    header_records : how many lines to skip; None takes all before the first that is, or was meant for, a record
    mode : keep only reports of that mode without an edit mark; the others are checked and counted
    Warns of a header count that cuts data off or leaves header in. Raises InputError if the file cannot be
    read, is shorter than its header, or holds no record.
    """
    return parse_tfile(map_bytes(path), Path(path).name, header_records, mode)


def parse_tfile(
    content: bytes | mmap, name: str, header_records: int | None = HEADER_RECORDS, mode: int | None = None
) -> TFileReading:
    """The same from the bytes of a file (or upload) called `name`."""
    decode_lines(content[:_HEAD_BYTES], name)  # refuses what is no text
    reading = _read_plain(content, name, header_records, mode)
    return reading or _read_plain(one_byte_text(content[:], name), name, header_records, mode, foreign=True)


def one_byte_text(content: bytes, name: str) -> bytes:
    """A file with one byte a character and Unix line ends, so that columns can be counted in bytes."""
    if content.isascii():
        return content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return "\n".join(decode_lines(content, name)).encode("latin-1", errors="replace")


@dataclass(frozen=True)
class _Records:
    """All lines of a file behind its header, read or judged."""

    columns: list[np.ndarray]  # line, point count, position, array, mode, flag
    bad: list[BadRecord]
    read: int  # records that were read, of any mode
    modes: tuple[int, ...]  # of these
    first_line: int | None  # of these


def _read_plain(content, name, header_records, mode, foreign=False) -> TFileReading | None:
    """The reading of a text of Unix lines in ASCII; None if it is none, unless the caller made it `foreign`."""
    if header_records is None:
        lines = content[:_HEAD_BYTES].decode("latin-1").split("\n", MAX_HEADER_RECORDS)[:MAX_HEADER_RECORDS]
        ends = (n for n, line in enumerate(lines) if _is_record(line) or NEARLY_RECORD.match(line))
        header_records = next(ends, 0)
    if header_records < 0:
        raise InputError(f"{name}: header count is {header_records}, wanted 0 or more")
    start = _line_place(content, header_records)
    head_text = content[: len(content) if start is None else start]
    if not foreign and not (head_text.isascii() and b"\r" not in head_text):
        return None
    head = head_text.decode("latin-1").split("\n")
    if start is None:
        lines = len(head) - (head[-1] == "")
        raise InputError(f"{name}: found {lines} lines, wanted {header_records} of header and then records")
    head = head[:-1]
    text = np.frombuffer(content, np.uint8, text_end(content))
    found = _read_records(text, start, header_records + 1, mode, foreign)
    if found is None:
        return None
    if found.first_line is None:
        why = f"; line {found.bad[0].line}: {found.bad[0].why}" if found.bad else ""
        raise InputError(f"{name}: found no position record after {header_records} lines of header{why}")
    said = content[:_HEAD_BYTES].decode("latin-1").split("\n", 1)[0]
    corrected = said[said.index(CORRECTED) :].rstrip() if CORRECTED in said else ""
    return _reading(head, found, name, mode is None, corrected)


def _reading(head: list[str], found: _Records, name: str, everything: bool, corrected: str) -> TFileReading:
    title = " ".join(line for line in head if not _speed_pairs(line)).upper()
    simulated = "SYNTHETIC" in title or "SIMULATED" in title
    line, point_count, position, array, mode, flagged = found.columns
    reports = PositionReports(
        line=line,
        point_count=point_count,
        position=position,
        array=array,
        mode=mode,
        flagged=flagged,
        bad_records=tuple(found.bad),
        left_out=found.read - len(line),
        other_modes=() if everything else found.modes,
        source=name,
        range_name="SIMULATED" if simulated else "",
    )
    return TFileReading(
        reports=reports,
        header=tuple(head),
        sound_speed_table=_sound_speed_table(head),
        run_date=_only_date(title),
        simulated=simulated,
        corrected=corrected,
        warnings=tuple(_header_warnings(head, found.first_line)),
    )


def _line_place(content: bytes | mmap, lines: int) -> int | None:
    """Where the line after so many begins, or None if there is none."""
    start = 0
    for _ in range(lines):
        start = content.find(b"\n", start) + 1
        if start == 0:
            return None
    return start if start < len(content) else None


def _read_records(text, start, first_line, mode, foreign) -> _Records | None:
    """Records of all lines from `start` on: the well-formed ones by the compiled scan, the others judged."""
    plain = np.where(text > 127, ord("?"), text).astype(np.uint8) if foreign else text
    scan = scan_records(plain, start, first_line, EVERY_MODE if mode is None else mode)
    if scan is None:
        return None
    columns, modes = scan.columns, scan.modes
    seen = [] if scan.first_line is None else [scan.first_line]
    line, values, flagged, bad = judge_lines(text, scan.odd)
    if len(line):
        seen.append(int(line[0]))
        modes = modes + np.bincount(values[:, 5].astype(np.int64), minlength=len(modes))
        wanted = np.full(len(line), True) if mode is None else (values[:, 5] == mode) & ~flagged
        judged = (line, values[:, 0], values[:, 1:4], values[:, 4], values[:, 5], flagged)
        columns = _in_order(columns, [column[wanted] for column in judged])
    return _Records(
        columns=columns,
        bad=bad,
        read=int(modes.sum()),
        modes=tuple(np.flatnonzero(modes).tolist()),
        first_line=min(seen, default=None),
    )


def _in_order(columns: list[np.ndarray], more: list[np.ndarray]) -> list[np.ndarray]:
    """Both lots of reports as one, in the order of their lines, which stand first."""
    if not len(more[0]):
        return columns
    order = np.argsort(np.concatenate([columns[0], more[0]]), kind="stable")
    return [
        np.concatenate([column, extra.astype(column.dtype)])[order]
        for column, extra in zip(columns, more, strict=True)
    ]


def judge_lines(text: np.ndarray, places: np.ndarray):
    """Line numbers, values (N, 6) and edit marks of the lines that are records, and the bad ones.

    text : bytes of the file, one a character
    places : (K, 3) number, start and length of each line
    """
    parts = [
        _parse_records(_columns(text, lines[:, 1], lines[:, 2]), lines[:, 2], lines[:, 0])
        for lines in np.split(places, range(_CHUNK, len(places), _CHUNK))
    ]
    line, values, flagged = (np.concatenate(column) for column in zip(*[p[:3] for p in parts], strict=True))
    return line, values, flagged, [record for part in parts for record in part[3]]


def _columns(text: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The first 68 characters of each line (N, 68), blanks behind the end of a short one."""
    column = np.arange(COLUMNS)
    place = np.minimum(starts[:, None] + column, len(text) - 1)
    return np.where(column < lengths[:, None], text[place], _BLANK)


def _parse_records(columns: np.ndarray, lengths: np.ndarray, numbers: np.ndarray):
    """Line numbers, values (N, 6) and flags of the records that can be read; and the bad ones.

    A record with an edit mark may have any position, unless the mark is part of a number: then the columns
    are shifted and it is a bad record.
    """
    parsed = [parse_numbers(f.of(columns), f.decimals) for f in FIELDS]
    values = np.column_stack([value for value, _ in parsed])
    good = np.column_stack([ok for _, ok in parsed])
    mark = columns[:, 5:7]
    flagged = np.any(mark != _BLANK, axis=1)
    is_number = np.any((mark >= _ZERO) & (mark <= _ZERO + 9), axis=1)
    whole = [k for k, f in enumerate(FIELDS) if not f.decimals]
    read = good.all(axis=1) | (flagged & ~is_number & good[:, whole].all(axis=1))
    written = np.any(columns != _BLANK, axis=1)
    wrong = np.flatnonzero(written & ~read)
    bad = [
        BadRecord(int(numbers[k]), _why_bad(columns[k], int(lengths[k]), good[k]) + SHIFTS[shift])
        for k, shift in zip(wrong, _shifts(columns[wrong]), strict=True)
    ]
    keep = written & read
    values = np.where(good, values, 0.0)  # of a record with an edit mark, which no gate lets through
    return numbers[keep], values[keep], flagged[keep], bad


def _shifts(columns: np.ndarray) -> np.ndarray:
    """Which of SHIFTS makes records (N, 68) that cannot be read fit: (N,), 0 for none."""
    blank = np.full((len(columns), 1), _BLANK, columns.dtype)
    shift = np.zeros(len(columns), np.int64)
    # of records moved to the right, the last column is not among these
    for number, moved, fields in (
        (1, np.hstack((columns[:, 1:], blank)), FIELDS[:-1]),
        (2, np.hstack((blank, columns[:, :-1])), FIELDS),
    ):
        fits = [parse_numbers(f.of(moved), f.decimals)[1] for f in fields]
        shift[np.all(fits, axis=0)] = number
    return shift


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
    field = FIELDS[int(np.argmin(good))]
    text = bytes(field.of(columns[None])[0]).decode("latin-1")
    first = field.first
    if field.decimals:
        first, text = (first, text[1:]) if text[0] == " " else (first - 1, text)
    where = f"columns {first}-{field.last}" if field.last > first else f"column {first}"
    return f"{where} ({field.name}) hold {text!r}, wanted {field.wanted}"


def _header_warnings(head: list[str], first_line: int) -> list[str]:
    """What is odd about the count of header records."""
    warnings = []
    cut = [n for n, line in enumerate(head, 1) if _is_record(line)]
    if cut:
        warnings.append(
            f"the header count {len(head)} cuts {len(cut)} position records off, from line {cut[0]} on; "
            f"the header seems to have {cut[0] - 1} records"
        )
    lead = first_line - 1
    if lead > len(head):
        warnings.append(
            f"the first record that can be read is line {lead + 1}: the header count {len(head)} may leave "
            f"header in, {lead} would not"
        )
    return warnings


def _is_record(line: str) -> bool:
    row = np.frombuffer(line[:COLUMNS].encode("latin-1"), dtype=np.uint8)[None, :]
    return len(line) >= COLUMNS and all(parse_numbers(f.of(row), f.decimals)[1][0] for f in FIELDS)


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
