"""What reading a survey gives: the pings, and everything that was left out with its reason."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.pings import Pings
from trackerlib.textfiles import BadRecord, InputError

DEFAULT_TURNAROUND_S = 0.013  # of the common acoustic releases; a constant, so a passive fix ignores it


@dataclass(frozen=True, eq=False)
class SurveyReading:
    """Pings of a survey file, with what could not be used."""

    pings: Pings
    layout: str  # "csv", "sio" or "whoi"
    bad_records: tuple[BadRecord, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reception:
    """One usable line of a survey."""

    number: int | None
    lat_deg: float
    lon_deg: float
    up_m: float
    travel_time_s: float
    utc: np.datetime64
    time_s: float = np.nan  # by a clock without a date


def build_reading(receptions, name, layout, bad_records, notes, simulated=False) -> SurveyReading:
    """A reading from the receptions of a file. Raises InputError if there is none."""
    if not receptions:
        first = f"; line {bad_records[0].line}: {bad_records[0].why}" if bad_records else ""
        raise InputError(f"{name}: found no usable ping, wanted at least one{first}")
    notes = list(notes)
    numbers = [r.number if r.number is not None else k for k, r in enumerate(receptions, 1)]
    if len(set(numbers)) < len(numbers):
        notes.append("ping numbers repeat in the file; pings are numbered 1, 2, ... in file order instead")
        numbers = list(range(1, len(receptions) + 1))
    travel_time = np.array([r.travel_time_s for r in receptions])
    utc = np.array([r.utc for r in receptions], dtype="datetime64[ms]")
    clock = np.array([r.time_s for r in receptions])
    pings = Pings(
        number=np.array(numbers, dtype=np.int64),
        lat_deg=np.array([r.lat_deg for r in receptions]),
        lon_deg=np.array([r.lon_deg for r in receptions]),
        up_m=np.array([r.up_m for r in receptions]),
        travel_time_s=travel_time,
        utc=utc,
        clock_s=clock if np.isnat(utc).any() and np.isfinite(clock).all() else None,
        time_step_s=time_step(travel_time),
        source=name,
        simulated=simulated,
    )
    return SurveyReading(pings, layout, tuple(bad_records), tuple(notes))


def time_step(travel_time_s: np.ndarray) -> float:
    """Step [s] in which times were logged: their greatest common divisor if at least 0.1 ms, else 0.

    Differences are used, so a constant added to every time changes nothing.
    """
    if len(travel_time_s) < 3:
        return 0.0
    microseconds = np.rint((travel_time_s - travel_time_s[0]) * 1e6).astype(np.int64)
    step = int(np.gcd.reduce(microseconds))
    return step * 1e-6 if step >= 100 else 0.0


_ANGLE = re.compile(r"\s*(\d{1,3})\s+(\d{1,2}(?:\.\d*)?)\s*([NSEW])\s*", re.IGNORECASE)


def degrees_from_minutes(text: str, kind: str) -> float:
    """Degrees, south and west negative, from text such as `5 42.3510 S`; `kind` is "latitude" or "longitude".

    Raises ValueError with what was found and wanted.
    """
    letters, limit = ("NS", 90) if kind == "latitude" else ("EW", 180)
    match = _ANGLE.fullmatch(text)
    if not match or match[3].upper() not in letters or float(match[2]) >= 60:
        raise ValueError(
            f"{kind} is {text.strip()!r}; wanted degrees, minutes below 60 and {letters[0]} or {letters[1]}"
        )
    value = int(match[1]) + float(match[2]) / 60
    if value > limit:
        raise ValueError(f"{kind} is {text.strip()!r}; wanted at most {limit} degrees")
    return -value if match[3].upper() == letters[1] else value


def utc_from_parts(date: str, time: str) -> np.datetime64:
    """UTC from `2023-04-06` and `05:10:05`. Raises ValueError with what was found and wanted."""
    try:
        return np.datetime64(f"{date}T{time}", "ms")
    except ValueError:
        raise ValueError(f"time is {date} {time}; wanted YYYY-MM-DD HH:MM:SS") from None


def utc_from_day_of_year(text: str) -> np.datetime64:
    """UTC from `2018:116:05:10:33` (year, day of year, time). Raises ValueError if it is not that."""
    parts = text.strip().split(":")
    try:
        year, day, hour, minute = (int(part) for part in parts[:4])
        second = float(parts[4])
        last_day = 366 if year % 4 == 0 and (year % 100 or year % 400 == 0) else 365
        if len(parts) != 5 or not (1 <= day <= last_day and hour < 24 and minute < 60 and 0 <= second < 61):
            raise ValueError
    except (ValueError, IndexError):
        raise ValueError(
            f"time is {text.strip()!r}; wanted year:day of year:hour:minute:second, such as 2018:116:05:10:33"
        ) from None
    start = np.datetime64(f"{year:04d}-01-01", "ms")
    milliseconds = ((day - 1) * 24 + hour) * 3_600_000 + minute * 60_000 + round(second * 1000)
    return start + np.timedelta64(milliseconds, "ms")
