"""Seven-column crossover files: point count, then x y z from the first array and from the second, ft."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.textfiles import BadRecord, InputError, decode_lines, read_bytes, write_text

TRAILER_COUNT = 999  # point count of TIMECOR's closing record, which holds the two arrays' positions
TRAILER_TOLERANCE_FT = 1.0
WANTED = "point count and six coordinates"


@dataclass(frozen=True, eq=False)
class CrossoverReading:
    """A crossover set as read, with what could not be used."""

    set: CrossoverSet
    bad_records: tuple[BadRecord, ...] = ()
    notes: tuple[str, ...] = ()


def read_crossover(
    path: str | Path, survey: ArraySurvey | None = None, pair: tuple[int, int] | None = None
) -> CrossoverReading:
    """Crossover set of a file with or without its first line, of seven columns or (with `pair`) six.

    A last record 999 is a trailer only if its six numbers are two positions of `survey` to a foot; any
    other 999 is a point count. The arrays are known from the first line, else from the trailer, else from
    `pair`. Raises InputError if they are not, if `pair` contradicts the file, or if no record is left.
    """
    return parse_crossover(read_bytes(path), Path(path).name, survey, pair)


def parse_crossover(
    content: bytes, name: str, survey: ArraySurvey | None = None, pair: tuple[int, int] | None = None
) -> CrossoverReading:
    """The same from the bytes of a file (or upload) called `name`."""
    lines = [(n, text) for n, text in enumerate(decode_lines(content, name), 1) if text.strip()]
    range_name, file_pair = _first_line(lines[0][1])
    if file_pair:
        lines = lines[1:]
    records, bad, notes = _records(lines, name)
    trailer_pair = _trailer_pair(records, survey)
    if trailer_pair:
        records = records[:-1]
        a, b = trailer_pair
        notes.append(f"last record {TRAILER_COUNT} holds the positions of arrays {a} and {b}")
    if file_pair and trailer_pair and file_pair != trailer_pair:
        notes.append(f"first line says arrays {file_pair[0]} and {file_pair[1]}; the first line is believed")
    known = _settle_pair(file_pair or trailer_pair, pair, name)
    records, repeats = _ascending(records, notes)
    if not records:
        raise InputError(
            f"{name}: found no record, wanted point count and six coordinates; " + _first_why(bad)
        )
    values = np.array([record for _, record in records])
    match = re.search(r"_(\d+)$", Path(name).stem) if name.startswith("crossover_") else None
    crossover = CrossoverSet(
        pair=known,
        point_count=values[:, 0].astype(np.int64),
        x=values[:, 1:4],
        y=values[:, 4:7],
        pass_number=int(match[1]) if match else 1,
        range_name=range_name,
        source=name,
        lines=np.array([(line, line) for line, _ in records]),
    )
    return CrossoverReading(crossover, tuple(sorted(bad + repeats, key=lambda b: b.line)), tuple(notes))


def write_crossover(path: str | Path, crossover: CrossoverSet, decimals: int = 1) -> None:
    """Writes a set as KEYGATE did, whole or not at all."""
    write_text(path, crossover_text(crossover, decimals))


def crossover_text(crossover: CrossoverSet, decimals: int = 1) -> str:
    """A set as KEYGATE wrote it: (16X,A10,2X,I2,3X,I2), then (2X,I5,1X,6(2X,F11.1)) a point count."""
    a, b = crossover.pair
    lines = [f"{'':16}{crossover.range_name[:10]:10}  {a:2d}   {b:2d}"]
    for count, x, y in zip(crossover.point_count, crossover.x, crossover.y, strict=True):
        lines.append(f"  {count:5d} " + "".join(f"  {value:11.{decimals}f}" for value in (*x, *y)))
    return "\n".join(lines) + "\n"


def write_trpdotrx(path: str | Path, crossover: CrossoverSet, survey: ArraySurvey) -> None:
    """Writes a set as TIMECOR reads it (TRPDOTRX.DAT): no first line, and behind the records a trailer 999.

    Raises InputError for an array that the survey lacks, whose position the trailer could not hold.
    """
    trailer = CrossoverSet(
        crossover.pair,
        np.array([TRAILER_COUNT]),
        survey.position_of(crossover.pair[0])[None, :],
        survey.position_of(crossover.pair[1])[None, :],
    )
    records = (crossover_text(one).split("\n", 1)[1] for one in (crossover, trailer))
    write_text(path, "".join(records))


def crossover_file_name(crossover: CrossoverSet) -> str:
    """crossover_AA_BB_P.txt: the array pair and the number of the pass."""
    return "crossover_{:02d}_{:02d}_{}.txt".format(*crossover.pair, crossover.pass_number)


def _first_line(text: str) -> tuple[str, tuple[int, int] | None]:
    """Range name and array pair of the first line, or no pair if it is a record already."""
    match = re.fullmatch(r"\s*(.*?)\s*(?<!\S)(\d{1,3})\s+(\d{1,3})\s*", text)
    if not match or (len(text.split()) >= 6 and _numbers(text) is not None):
        return "", None
    return match[1], (int(match[2]), int(match[3]))


def _numbers(text: str) -> list[float] | None:
    try:
        return [float(column) for column in text.replace(",", " ").split()]
    except ValueError:
        return None


def _records(lines, name):
    """Records as (line, [count and six coordinates]), bad records, and notes; all rows one width."""
    parsed = [(line, _numbers(text), text) for line, text in lines]
    widths = [len(row) for _, row, _ in parsed if row and len(row) in (6, 7)]
    if not widths:
        start = f", line {lines[0][0]}: found {lines[0][1].strip()[:40]!r}" if lines else ": found no record"
        raise InputError(f"{name}{start}, wanted {WANTED}")
    width = max((7, 6), key=widths.count)
    records, bad = [], []
    for count, (line, row, text) in enumerate(parsed, 1):
        why = _fault(row, width, text)
        if why:
            bad.append(BadRecord(line, why))
        elif row:
            records.append((line, row if width == 7 else [float(count), *row]))
    notes = ["six columns: the records are counted 1, 2, ... in place of point counts"] if width == 6 else []
    return records, bad, notes


def _fault(row: list[float] | None, width: int, text: str) -> str:
    if row is None:
        return f"found {text.strip()[:60]!r}, wanted {width} numbers"
    if len(row) != width:
        return f"found {len(row)} numbers, wanted {width}"
    if not all(abs(value) < 1e7 for value in row):
        return f"found {text.strip()[:60]!r}, wanted feet"
    if width == 7 and (row[0] != round(row[0]) or row[0] < 0):
        return f"point count is {row[0]:g}, wanted a whole number"
    return ""


def _trailer_pair(records, survey: ArraySurvey | None) -> tuple[int, int] | None:
    """The two arrays whose positions the last record holds, if it is a trailer."""
    if survey is None or not records or records[-1][1][0] != TRAILER_COUNT:
        return None
    found = []
    for place in (records[-1][1][1:4], records[-1][1][4:7]):
        far = np.max(np.abs(survey.position - place), axis=1)
        if far.min() > TRAILER_TOLERANCE_FT:
            return None
        found.append(int(survey.number[np.argmin(far)]))
    return (found[0], found[1]) if found[0] != found[1] else None


def _settle_pair(in_file, told, name: str) -> tuple[int, int]:
    if in_file and told and tuple(told) != in_file:
        raise InputError(
            f"{name}: arrays {in_file[0]} and {in_file[1]} in the file, {told[0]} and {told[1]} in the call"
        )
    pair = in_file or told
    if not pair:
        raise InputError(f"{name}: no first line and no trailer name the two arrays; give them with --set")
    if pair[0] == pair[1]:
        raise InputError(f"{name}: found array {pair[0]} twice, wanted two arrays")
    return int(pair[0]), int(pair[1])


def _ascending(records, notes):
    """Records by ascending point count, each count once, and the repeats as bad records."""
    ordered = sorted(records, key=lambda record: record[1][0])
    if ordered != records:
        notes.append("records were not in order of point count; they are put in order")
    kept: list[tuple[int, list[float]]] = []
    repeats = []
    for line, row in ordered:
        if kept and kept[-1][1][0] == row[0]:
            repeats.append(BadRecord(line, f"point count {row[0]:.0f} again; line {kept[-1][0]} is kept"))
        else:
            kept.append((line, row))
    return kept, repeats


def _first_why(bad: list[BadRecord]) -> str:
    return f"line {bad[0].line}: {bad[0].why}" if bad else "the file ends after its first line"
