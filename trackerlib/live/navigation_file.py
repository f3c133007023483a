"""A file of the ship's positions beside a recording: an NMEA 0183 log, or a CSV, by the clock of the recording.

    log = read_navigation_file(read_lines("gps.nmea"), "gps.nmea", began_s)
    ship_at_receptions(log.fixes, arrivals.arrival_s)

The CSV has `utc, lat_deg, lon_deg` or, with seconds since the recording's first sample, `time_s, lat_deg, lon_deg`;
optionally `hdop` and `heading_deg`. Whatever stands before the $ of a sentence, such as a logger's own time, is passed
over.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import timedelta

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.live.navigation_stream import NavigationStream
from trackerlib.surveyfiles.stream_csv import read_navigation, says_simulated, tells_utc
from trackerlib.textfiles import BadRecord, InputError

SENTENCE = re.compile(r"[$!][A-Z]{2}[A-Z]{3},")
HEAD = 200  # lines in which a sentence shows that a file is a log


class BeginUnknown(InputError):
    """Dated positions beside a recording that tells no date."""

    def __init__(self, name: str):
        super().__init__(
            f"{name}: needs the time at which the recording began, which neither its head nor name tells"
        )


@dataclass(frozen=True, eq=False)
class NavigationFile:
    """Positions of a file; the lines that gave none."""

    fixes: NavigationFixes  # seconds since the recording's first sample
    bad_records: tuple[BadRecord, ...]
    layout: str  # "NMEA 0183" or "CSV"
    simulated: bool = False


def read_navigation_file(lines: list[str], name: str, began_s: float | None) -> NavigationFile:
    """Positions of a file by the clock of a recording that began at `began_s` [s since 1970, UTC].

    Raises InputError for a file of another kind or one without two positions, BeginUnknown for dates without `began_s`.
    """
    if any(SENTENCE.search(line) for line in lines[:HEAD]):
        return _read_nmea(lines, name, began_s)
    fixes, bad = read_navigation(lines, name)
    if tells_utc(lines):
        if began_s is None:
            raise BeginUnknown(name)
        fixes = replace(fixes, time_s=fixes.time_s - began_s)
    if len(fixes.time_s) < 2:
        raise InputError(f"{name}: found one position, wanted at least two")
    return NavigationFile(fixes, bad, "CSV", says_simulated(lines))


def _read_nmea(lines: list[str], name: str, began_s: float | None) -> NavigationFile:
    if began_s is None:
        raise BeginUnknown(name)
    stream = NavigationStream(kept=len(lines))
    bad, now_s, refused = [], began_s, 0
    for number, line in enumerate(lines, 1):
        place = max(line.find("$"), line.find("!"))
        if place < 0:
            if line.strip() and not line.lstrip().startswith("#"):
                bad.append(BadRecord(number, f"found {line.strip()[:60]!r}; wanted a sentence of NMEA 0183"))
            continue
        fix = stream.feed(line[place:], now_s)
        now_s = getattr(
            fix, "time_s", now_s
        )  # of the latest position: dates what has no date, tells a heading's age
        if stream.refused.total() > refused:
            refused = stream.refused.total()
            bad.append(BadRecord(number, stream.last_refused))
    fixes = _each_said_once(stream.fixes())
    if len(fixes.time_s) < 2:
        first = f"; line {bad[0].line}: {bad[0].why}" if bad else ""
        raise InputError(f"{name}: found {len(fixes.time_s)} positions, wanted at least two{first}")
    fixes = replace(fixes, time_s=fixes.time_s - began_s)
    return NavigationFile(fixes, tuple(bad), "NMEA 0183", says_simulated(lines))


def _each_said_once(fixes: NavigationFixes) -> NavigationFixes:
    """Without the positions that RMC or GLL repeats: the GGA of the same instant has the HDOP they lack."""
    told = np.isfinite(fixes.hdop)
    keep = told | ~np.isin(fixes.time_s, fixes.time_s[told])
    return NavigationFixes(
        fixes.time_s[keep],
        fixes.lat_deg[keep],
        fixes.lon_deg[keep],
        fixes.hdop[keep],
        None if fixes.heading_rad is None else fixes.heading_rad[keep],
    )


def outside_words(fixes: NavigationFixes, seconds: float) -> str:
    """What to say if none of the positions is of the recording's time; empty if some are."""
    first, last = float(np.nanmin(fixes.time_s)), float(np.nanmax(fixes.time_s))
    if first <= seconds and last >= 0:
        return ""
    off, when = (first - seconds, "after its end") if first > seconds else (-last, "before its beginning")
    return (
        f"no position is of the time of the recording: the nearest is {timedelta(seconds=round(off))} {when}"
    )
