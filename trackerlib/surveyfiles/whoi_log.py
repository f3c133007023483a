"""Survey log of the WHOI program EdgeNmea.

    # TAT:                  13 ms
    # Sys date time utc, rng m,rng ms,    latitude  ,    longitude  , GPS time, heading
    2023-04-06 05:10:05,  2329,  3106, 01 35.6648 N, 091 48.5082 W, 05:10:03.00, 84.1

Times are two-way, in whole milliseconds, with the turn-around in them. Two clocks stand in a line:
the computer's at the reply and the GPS's at the position, often seconds older; times of the pings
are the computer's. The range column assumes the header's sound speed and is not used.
"""

from __future__ import annotations

import re

from trackerlib.surveyfiles.reading import (
    DEFAULT_TURNAROUND_S,
    Reception,
    SurveyReading,
    build_reading,
    degrees_from_minutes,
    utc_from_parts,
)
from trackerlib.textfiles import BadRecord

_ROW_START = re.compile(r"\s*\d{4}-\d\d-\d\d\s+\d\d:\d\d:\d\d(\.\d*)?\s*,")
_TURNAROUND = re.compile(r"#\s*TAT:\s*([\d.]+)\s*ms", re.IGNORECASE)


def is_whoi_log(lines: list[str]) -> bool:
    """Whether these lines are a log of this kind."""
    return any(_ROW_START.match(line) and line.count(",") >= 5 for line in lines[:2000])


def read_whoi_log(lines: list[str], name: str, *, turnaround_s=None, hydrophone_depth_m=0.0) -> SurveyReading:
    """Pings of an EdgeNmea log, its one-way times (two-way minus turn-around) / 2."""
    in_header = next(
        (float(m[1]) * 1e-3 for line in lines if (m := _TURNAROUND.match(line))), DEFAULT_TURNAROUND_S
    )
    turnaround = in_header if turnaround_s is None else turnaround_s
    receptions, bad, skipped = [], [], 0
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        if text.startswith("*") or text.lower().startswith("event skipped"):
            skipped += 1
            continue
        try:
            receptions.append(_reception(text, turnaround, hydrophone_depth_m))
        except ValueError as error:
            bad.append(BadRecord(number, str(error)))
    notes = [f"two-way times; turn-around {1e3 * turnaround:g} ms taken off"]
    if skipped:
        notes.append(f"{skipped} lines marked with * or 'Event skipped' left out")
    return build_reading(receptions, name, "whoi", bad, notes)


def _reception(text: str, turnaround_s: float, hydrophone_depth_m: float) -> Reception:
    fields = [field.strip() for field in text.split(",")]
    if len(fields) < 6 or not _ROW_START.match(text):
        raise ValueError(
            f"found {text[:60]!r}; wanted 'date time, range, ms, latitude, longitude, GPS time, heading'"
        )
    try:
        two_way_s = float(fields[2]) * 1e-3
    except ValueError:
        raise ValueError(f"time is {fields[2]!r}; wanted milliseconds in the third column") from None
    if not turnaround_s < two_way_s < 1000:
        raise ValueError(f"time is {fields[2]} ms; wanted more than the turn-around and less than 1000 s")
    date, time = fields[0].split(maxsplit=1)
    return Reception(
        number=None,
        lat_deg=degrees_from_minutes(fields[3], "latitude"),
        lon_deg=degrees_from_minutes(fields[4], "longitude"),
        up_m=-hydrophone_depth_m,
        travel_time_s=(two_way_s - turnaround_s) / 2,
        utc=utc_from_parts(date, time),
    )
