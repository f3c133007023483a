"""Array tables and profiles that several commands read; what is odd about them goes to standard error."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.textfiles import BadRecord


def read_survey(path: Path) -> ArraySurvey:
    """The array table of a file. Raises InputError as `read_arrays`."""
    reading = read_arrays(path)
    tell(path.name, reading.bad_records, reading.notes)
    return reading.survey


def read_profile(path: Path, speeds: str) -> SoundSpeedProfile:
    """The profile of a VELOCITY.DAT. Raises InputError as `read_velocity`."""
    reading = read_velocity(path, speeds)
    tell(path.name, reading.bad_records, reading.profile.notes)
    return reading.profile


def tell(name: str, bad_records: Iterable[BadRecord], notes: Iterable[str]) -> None:
    """Says which lines of a file could not be used, and what else was found."""
    for record in bad_records:
        print(f"{name}, line {record.line}: {record.why}", file=sys.stderr)
    for note in notes:
        print(f"{name}: {note}", file=sys.stderr)
