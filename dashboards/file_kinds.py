"""Which kind of file it is, seen from its first lines."""

from __future__ import annotations

from trackerlib.acoustics.profile import FEET_PER_METRE
from trackerlib.live.navigation_file import SENTENCE
from trackerlib.rangefiles.tfile import NEARLY_RECORD
from trackerlib.rangefiles.velocity_file import SPEED_LIMITS


def kind_of(lines: list[str]) -> str:
    """Which kind of file begins with these lines: a key of the openers in `Opening`."""
    head = "\n".join(lines[:40]).lower()
    if "workbench_session" in head:
        return "session"
    if "[[runs]]" in lines or ("{" in lines[0] and any('"tfile"' in line for line in lines)):
        return "campaign"
    if "offset_ms" in head:
        return "offsets"
    if "first_array" in head and "point_count" in head:
        return "edits"
    if "speed_mps" in head:
        return "profile"
    if "oneway_s" in head or "msec." in head or "gps time" in head:
        return "survey"
    if "arrival_s" in head:
        return "arrivals"
    if "lat_deg" in head or any(SENTENCE.search(line) for line in lines):
        return "navigation"
    rows = [line.replace(",", " ").split() for line in lines[1:8] if not line.startswith("#")]
    seven = [len(row) == 7 and row[0].isdigit() and "." in row[5] and "." in row[6] for row in rows]
    if 2 * sum(seven) > len(rows):  # a few may be spoilt
        return "crossover"
    if any(_is_record(line) for line in lines[:400]):
        return "tfile"
    if rows and all(len(row) == 2 and _is_speed(row[1]) for row in rows):
        return "velocity"
    if "array" in head or all(len(line.replace(",", " ").split()) in (4, 5) for line in lines[:3]):
        return "arrays"
    return "survey"


def _is_record(line: str) -> bool:
    """Whether a line is a T-file's record, or one whose columns are shifted by one."""
    whole = len(line) >= 68 and line[67:68].isdigit() and line[:5].strip().isdigit()
    return whole or bool(NEARLY_RECORD.match(line) and len(line) >= 67)


def _is_speed(text: str) -> bool:
    """Whether a number is a speed of sound in feet per second, or in metres, which the reader then asks about."""
    try:
        speed = float(text)
    except ValueError:
        return False
    return any(SPEED_LIMITS[0] <= one <= SPEED_LIMITS[1] for one in (speed, speed * FEET_PER_METRE))
