"""Tables of the arrays on the sea floor: where each was surveyed, when, and whether it is a real survey."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from trackerlib.crossover.survey import ArraySurvey, find_placeholders
from trackerlib.textfiles import BadRecord, InputError, decode_lines, read_bytes

__all__ = ["LAYOUTS", "ArrayReading", "ArraySurvey", "parse_arrays", "parse_date", "read_arrays"]

LAYOUTS = {
    "xyz-number": "columns x, y, z, number (KEYGATE)",
    "number-date-xyz": "columns number, date, x, y, z (KEYMAIN's AR1.DAT)",
    "csv": "CSV with a header",
}

# Header names, in order of preference, of what is read from a CSV.
_NAMES = {
    "number": ("array", "number", "array_number"),
    "x": ("downrange_ft", "x_ft", "x"),
    "y": ("crossrange_ft", "y_ft", "y"),
    "z": ("vertical_ft", "depth_coordinate_ft", "z_ft", "z"),
    "date": ("survey_date_iso", "survey_date", "date", "survey_date_printed"),
    "doubt": ("doubt",),
}


@dataclass(frozen=True, eq=False)
class ArrayReading:
    """An array table as read, with what could not be used."""

    survey: ArraySurvey
    layout: str  # a key of LAYOUTS
    bad_records: tuple[BadRecord, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Row:
    number: int
    position: tuple[float, float, float]
    survey_date: np.datetime64
    doubt: str = ""


def read_arrays(path: str | Path) -> ArrayReading:
    """Array table of a file, in any of LAYOUTS; which one is told by its shape and said in the notes.

    Raises InputError if the file cannot be read or holds no array.
    """
    return parse_arrays(read_bytes(path), Path(path).name)


def parse_arrays(content: bytes, name: str) -> ArrayReading:
    """The same from the bytes of a file (or upload) called `name`."""
    lines = [
        (n, text) for n, text in enumerate(decode_lines(content, name), 1)
        if text.strip() and not text.lstrip().startswith("#")
    ]  # fmt: skip
    if not lines:
        raise InputError(f"{name}: found no array, only blank lines and remarks")
    has_header = "," in lines[0][1] and re.search(r"[A-Za-z]", lines[0][1])
    layout, rows, bad = (_csv_rows if has_header else _column_rows)(lines, name)
    rows, bad = _each_number_once(rows, bad)
    if not rows:
        first = f"; line {bad[0].line}: {bad[0].why}" if bad else ""
        raise InputError(f"{name}: found no array, wanted {LAYOUTS[layout]}{first}")
    survey = _survey([row for _, row in rows], name)
    notes = [f"read as {LAYOUTS[layout]}: {len(rows)} arrays"]
    if survey.placeholder.any():
        numbers = ", ".join(map(str, survey.number[survey.placeholder]))
        notes.append(f"no surveyed position, left out of every pair: arrays {numbers}")
    if np.all(survey.position[:, 2] > 0):
        notes.append(
            "no array is below the surface: are its z depths, positive down? Wanted heights, negative"
        )
    return ArrayReading(survey, layout, tuple(sorted(bad, key=lambda b: b.line)), tuple(notes))


def parse_date(text: str) -> np.datetime64:
    """Day from 850620, 6/20/85, 6/20/1985 or 1985-06-20; years 70 to 99 are of the last century.

    NaT for a blank. Raises ValueError with what was found and wanted.
    """
    text = text.strip()
    if not text:
        return np.datetime64("NaT", "D")
    for pattern, order in (
        (r"(\d\d)(\d\d)(\d\d)", (0, 1, 2)),
        (r"(\d{1,2})/(\d{1,2})/(\d\d|\d{4})", (2, 0, 1)),
        (r"(\d{4})-(\d\d)-(\d\d)", (0, 1, 2)),
    ):
        if match := re.fullmatch(pattern, text):
            year, month, day = (int(match.groups()[k]) for k in order)
            if year < 100:
                year += 1900 if year >= 70 else 2000
            try:
                return np.datetime64(date(year, month, day), "D")
            except ValueError:
                break
    raise ValueError(f"date is {text!r}; wanted yymmdd, month/day/year or year-month-day, such as 850620")


def _survey(rows: list[_Row], name: str) -> ArraySurvey:
    position = np.array([row.position for row in rows])
    doubted = np.array(["placeholder" in row.doubt.lower() for row in rows])
    return ArraySurvey(
        number=np.array([row.number for row in rows]),
        position=position,
        survey_date=np.array([row.survey_date for row in rows], dtype="datetime64[D]"),
        placeholder=find_placeholders(position) | doubted,
        source=name,
    )


def _each_number_once(rows, bad):
    seen: dict[int, int] = {}
    kept = []
    for line, row in rows:
        if row.number in seen:
            bad.append(BadRecord(line, f"array {row.number} again; line {seen[row.number]} is kept"))
        else:
            seen[row.number] = line
            kept.append((line, row))
    return kept, bad


def _column_rows(lines, name):
    """Rows of a table without a header; the first row of four or five columns settles the layout."""
    by_width = {4: "xyz-number", 5: "number-date-xyz"}
    widths = [len(_columns(text)) for _, text in lines]
    width = next((w for w in widths if w in by_width), None)
    if width is None:
        raise InputError(
            f"{name}, line {lines[0][0]}: found {widths[0]} columns, wanted 4 (x, y, z, number), "
            "5 (number, date, x, y, z) or a CSV with a header"
        )
    rows, bad = [], []
    for line, text in lines:
        columns = _columns(text)
        try:
            if len(columns) != width:
                raise ValueError(f"found {len(columns)} columns, wanted {width} as in the rest of the file")
            if width == 4:
                rows.append((line, _row(columns[3], columns[:3])))
            else:
                rows.append((line, _row(columns[0], columns[2:], columns[1])))
        except ValueError as error:
            bad.append(BadRecord(line, str(error)))
    return by_width[width], rows, bad


def _columns(text: str) -> list[str]:
    return text.replace(",", " ").split()


def _csv_rows(lines, name):
    header_line, header = lines[0]
    names = [cell.strip().lower() for cell in next(csv.reader([header]))]
    place = {
        key: next((names.index(n) for n in wanted if n in names), None) for key, wanted in _NAMES.items()
    }
    for key in ("number", "x", "y", "z"):
        if place[key] is None:
            raise InputError(
                f"{name}, line {header_line}: found columns {', '.join(names)}; "
                f"wanted one of {', '.join(_NAMES[key])}"
            )
    rows, bad = [], []
    for line, text in lines[1:]:
        cells = next(csv.reader([text]))
        try:
            if len(cells) != len(names):
                raise ValueError(f"found {len(cells)} cells, wanted {len(names)} as in the header")
            cell = {key: "" if k is None else cells[k] for key, k in place.items()}
            rows.append((line, _row(cell["number"], [cell[a] for a in "xyz"], cell["date"], cell["doubt"])))
        except ValueError as error:
            bad.append(BadRecord(line, str(error)))
    return "csv", rows, bad


def _row(number: str, position: list[str], day: str = "", doubt: str = "") -> _Row:
    if not re.fullmatch(r"\s*\d{1,4}(\.0*)?\s*", number):
        raise ValueError(f"array number is {number!r}; wanted a whole number")
    x, y, z = (_feet(text) for text in position)
    return _Row(int(float(number)), (x, y, z), parse_date(day), doubt)


def _feet(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not abs(value) < 1e7:
        raise ValueError(f"coordinate is {text!r}; wanted feet")
    return value
