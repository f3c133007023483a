"""Straight pieces of one array's track: range name and array, then point count, x y z a line, ft."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackerlib.crossover.segments import TrackSegment
from trackerlib.textfiles import BadRecord, InputError, read_lines, write_text


@dataclass(frozen=True, eq=False)
class SegmentReading:
    """A straight piece as read, with what could not be used."""

    segment: TrackSegment
    bad_records: tuple[BadRecord, ...] = ()


def read_segment(path: str | Path) -> SegmentReading:
    """The straight piece of a file. Raises InputError if its first line names no array or no record is left."""
    name = Path(path).name
    lines = [(n, text) for n, text in enumerate(read_lines(path), 1) if text.strip()]
    first = re.fullmatch(r"\s*(.*?)\s*(?<!\S)(\d{1,3})\s*", lines[0][1])
    if not first:
        raise InputError(
            f"{name}, line {lines[0][0]}: found {lines[0][1].strip()[:40]!r}, wanted range name and array"
        )
    rows, bad = [], []
    for number, text in lines[1:]:
        try:
            row = [float(cell) for cell in text.split()]
        except ValueError:
            row = []
        if len(row) != 4 or not all(abs(value) < 1e7 for value in row) or row[0] != round(row[0]):
            bad.append(
                BadRecord(number, f"found {text.strip()[:60]!r}, wanted point count and x y z in feet")
            )
        else:
            rows.append(row)
    if not rows:
        why = f"; line {bad[0].line}: {bad[0].why}" if bad else ""
        raise InputError(f"{name}: found no record, wanted point count and x y z{why}")
    values = np.array(rows)
    values = values[np.argsort(values[:, 0], kind="stable")]
    match = re.search(r"_(\d+)$", Path(path).stem)
    piece = int(match[1]) if match else 1
    segment = TrackSegment(int(first[2]), values[:, 0].astype(np.int64), values[:, 1:], piece, first[1], name)
    return SegmentReading(segment, tuple(bad))


def write_segment(path: str | Path, segment: TrackSegment) -> None:
    """Writes a straight piece, in the columns of a crossover file, whole or not at all."""
    lines = [f"{'':16}{segment.range_name[:10]:10}  {segment.array:2d}"]
    for count, position in zip(segment.point_count, segment.position, strict=True):
        lines.append(f"  {count:5d} " + "".join(f"  {value:11.1f}" for value in position))
    write_text(path, "\n".join(lines) + "\n")


def segment_file_name(segment: TrackSegment) -> str:
    """segment_AA_P.txt: the array and the number of its piece."""
    return f"segment_{segment.array:02d}_{segment.piece}.txt"
