"""Survey log of the SIO ranging program.

    6306 msec. Lat: 4 52.9270 S  Lon: 133 40.4700 W  Alt: 17.54 Time(UTC): 2018:114:06:04:30
    Event skipped - Timeout or Badly formatted data was received

Times are two-way, in whole milliseconds, with the transponder's turn-around in them. Positions are
those of the GPS antenna when the line was logged; altitude is its height and is not used.
"""

from __future__ import annotations

import re

from trackerlib.surveyfiles.reading import (
    DEFAULT_TURNAROUND_S,
    Reception,
    SurveyReading,
    build_reading,
    degrees_from_minutes,
    utc_from_day_of_year,
)
from trackerlib.textfiles import BadRecord

_RULE = re.compile(r"\s*={5,}\s*")
_PING = re.compile(
    r"\s*(?P<ms>\S+)\s+msec\.?\s+Lat:\s*(?P<lat>.*?)\s*Lon:\s*(?P<lon>.*?)\s*Alt:\s*(?P<alt>\S*)"
    r"\s*Time\(UTC\):\s*(?P<utc>\S+)\s*"
)


def is_sio_log(lines: list[str]) -> bool:
    """Whether these lines are a log of this kind."""
    return any(_PING.fullmatch(line) for line in lines[:2000])


def read_sio_log(lines: list[str], name: str, *, turnaround_s=None, hydrophone_depth_m=0.0) -> SurveyReading:
    """Pings of a log of the SIO ranging program, its one-way times (two-way minus turn-around) / 2."""
    turnaround = DEFAULT_TURNAROUND_S if turnaround_s is None else turnaround_s
    receptions, bad, skipped, starred = [], [], 0, 0
    rules = [number for number, line in enumerate(lines) if _RULE.fullmatch(line)]
    first = rules[0] + 1 if rules else 0
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip():
            continue
        if line.strip().lower().startswith("event skipped"):
            skipped += 1
        elif line.lstrip().startswith("*"):
            starred += 1
        else:
            try:
                receptions.append(_reception(line, turnaround, hydrophone_depth_m))
            except ValueError as error:
                bad.append(BadRecord(number, str(error)))
    notes = [f"two-way times; turn-around {1e3 * turnaround:g} ms taken off"]
    if skipped:
        notes.append(f"{skipped} lines 'Event skipped' (no reply)")
    if starred:
        notes.append(f"{starred} lines marked with * left out")
    return build_reading(receptions, name, "sio", bad, notes)


def _reception(line: str, turnaround_s: float, hydrophone_depth_m: float) -> Reception:
    match = _PING.fullmatch(line)
    if not match:
        raise ValueError(
            f"found {line.strip()[:60]!r}; wanted 'NNNN msec. Lat: ... Lon: ... Alt: ... Time(UTC): ...'"
        )
    try:
        two_way_s = float(match["ms"]) * 1e-3
    except ValueError:
        raise ValueError(f"time is {match['ms']!r}; wanted milliseconds") from None
    if not turnaround_s < two_way_s < 1000:
        raise ValueError(f"time is {match['ms']} ms; wanted more than the turn-around and less than 1000 s")
    return Reception(
        number=None,
        lat_deg=degrees_from_minutes(match["lat"], "latitude"),
        lon_deg=degrees_from_minutes(match["lon"], "longitude"),
        up_m=-hydrophone_depth_m,
        travel_time_s=(two_way_s - turnaround_s) / 2,
        utc=utc_from_day_of_year(match["utc"]),
    )
