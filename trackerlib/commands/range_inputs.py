"""Files that several commands read and must not write over; what is odd about them goes to standard error."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.edits import PointEdits, parse_edits
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.range_profile import LAYOUTS, parse_range_profile
from trackerlib.textfiles import BadRecord, InputError, read_bytes, read_lines


def read_survey(path: Path) -> ArraySurvey:
    """The array table of a file. Raises InputError as `read_arrays`."""
    reading = read_arrays(path)
    tell(path.name, reading.bad_records, reading.notes)
    return reading.survey


def add_profile_speeds(parser: argparse.ArgumentParser) -> None:
    """The option that says what the numbers of a profile are."""
    parser.add_argument(
        "--profile-speeds",
        choices=tuple(LAYOUTS.values()),
        default="middle",
        help="where the profile's speeds belong: layers' middles, or the depths given; metres: depth_m, speed_mps",
    )


def read_profile(path: Path, speeds: str) -> SoundSpeedProfile:
    """The profile of a file in feet. Raises InputError as `parse_range_profile`."""
    try:
        reading = parse_range_profile(read_bytes(path), path.name, speeds)
    except InputError as error:
        option = " (--profile-speeds metres)" if "Is the file in metres?" in str(error) else ""
        raise InputError(f"{error}{option}") from None
    tell(path.name, reading.bad_records, reading.profile.notes)
    return reading.profile


def read_edits(path: Path | None) -> PointEdits:
    """The points that an edit log leaves out by hand; none without a file. Raises InputError as `parse_edits`."""
    if path is None:
        return PointEdits()
    edits, bad = parse_edits(read_lines(path), path.name)
    tell(path.name, bad, ())
    return edits


def tell(name: str, bad_records: Iterable[BadRecord], notes: Iterable[str]) -> None:
    """Says which lines of a file could not be used, and what else was found."""
    for record in bad_records:
        print(f"{name}, line {record.line}: {record.why}", file=sys.stderr)
    for note in notes:
        print(f"{name}: {note}", file=sys.stderr)


def check_outputs(written: dict[str, Path | None], read: dict[str, Path | None]) -> None:
    """Raises InputError where a file cannot be written: it is one that is read or written too, or has no folder.

    written, read : options, and what the files are; None where one is not told
    """
    taken: dict[Path, str] = {}
    for option, path in written.items():
        if path is None:
            continue
        for what, other in read.items():
            if other is not None and path.is_file() and other.is_file() and path.samefile(other):
                raise InputError(f"{option} is {path}, the {what} itself; wanted another file")
        if not path.parent.is_dir():
            raise InputError(
                f"{option} is {path}, and there is no folder {path.parent}; wanted one that is there"
            )
        place = Path(os.path.realpath(path))
        if place in taken:
            raise InputError(f"{option} is {path}, the file of {taken[place]} too; wanted another file")
        taken[place] = option
