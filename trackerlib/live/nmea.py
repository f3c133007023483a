"""Sentences of NMEA 0183, strictly: GGA, RMC, GLL, VTG, ZDA, HDT, THS, HDG, DBT, DPT, whoever talks.

    message = decode("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47")
    message.position.lat_deg

A checksum is required unless the caller waives it. A sentence without a fix has no position, which is never 0 N 0 E;
a field that is empty is None. What cannot be believed is a SentenceError that says why.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

DAY_S = 86_400.0
# Quality of GGA: 1 single, 2 differential, 3 PPS, 4 RTK, 5 RTK float; 6 dead reckoning, 7 by hand, 8 simulator.
GOOD_QUALITY = frozenset({1, 2, 3, 4, 5})
GOOD_MODES = frozenset("ADFRP")  # autonomous, differential, RTK float, RTK, precise
QUALITY_WORDS = {0: "no fix", 6: "dead reckoning", 7: "entered by hand", 8: "a simulator"}
FATHOM_M, FOOT_M = 1.8288, 0.3048
MPS_PER_KNOT = 1852 / 3600


class SentenceError(ValueError):
    """A line that is no sentence, or one that contradicts itself; the message says what was found and wanted."""


@dataclass(frozen=True)
class Position:
    """Where an antenna is."""

    lat_deg: float  # WGS 84, south negative
    lon_deg: float  # west negative
    hdop: float | None = None


@dataclass(frozen=True)
class Message:
    """What one sentence says; None for what it does not."""

    kind: str  # "GGA" and so on
    time_of_day_s: float | None = None  # UTC
    date: tuple[int, int, int] | None = None  # year, month, day
    position: Position | None = None
    no_position: str | None = None  # why a sentence that could have one has none
    heading_true_deg: float | None = None
    course_true_deg: float | None = None
    speed_mps: float | None = None
    depth_m: float | None = None  # below the transducer, or as offset by DPT


def checksum(body: str) -> int:
    """The exclusive or of the characters between $ and *."""
    total = 0
    for character in body:
        total ^= ord(character)
    return total


def decode(line: str, checksum_required: bool = True) -> Message | None:
    """What a sentence says; None for a kind that is not of this list, if its checksum is right.

    Raises SentenceError for a line that is no sentence, a missing or wrong checksum (a wrong one even if waived),
    and fields that make no sense.
    """
    found = re.fullmatch(r"\s*[$!]([\x20-\x29\x2B-\x7E]*)(?:\*([0-9A-Fa-f]{2}))?\s*", line)
    if not found:
        raise SentenceError(f"found {line.strip()[:60]!r}; wanted $, fields, * and two hex digits")
    body, given = found[1], found[2]
    if given is None:
        if checksum_required:
            raise SentenceError(f"${body[:60]} has no checksum; wanted *{checksum(body):02X} at its end")
    elif int(given, 16) != checksum(body):
        raise SentenceError(f"${body[:60]} has checksum {given}; wanted {checksum(body):02X}")
    name, *fields = body.split(",")
    reader = _READERS.get(name[-3:]) if len(name) >= 5 and not name.startswith("P") else None
    if reader is None:
        return None
    least, read = reader
    if len(fields) < least:
        raise SentenceError(f"${body[:60]} has {len(fields)} fields; wanted {least} or more")
    try:
        return read([field.strip() for field in fields])
    except ValueError as error:
        raise SentenceError(f"${body[:60]}: {error}") from None


def instant_near(time_of_day_s: float, reference_s: float) -> float:
    """Seconds since 1970 of a time of day, on the day that brings it nearest to a reference instant.

    So midnight needs no special case, as long as no more than twelve hours lie between.
    """
    return time_of_day_s + DAY_S * round((reference_s - time_of_day_s) / DAY_S)


def instant_on(date: tuple[int, int, int], time_of_day_s: float) -> float:
    """Seconds since 1970 of a date and a time of day. ValueError for a date that is none."""
    midnight = datetime(*date, tzinfo=UTC)
    return (midnight + timedelta(seconds=time_of_day_s)).timestamp()


# -- fields --------------------------------------------------------------------------------------


def number(text: str, name: str) -> float | None:
    """A plain decimal number; None for an empty field."""
    if not text:
        return None
    if not re.fullmatch(r"[+-]?\d+(\.\d*)?|[+-]?\.\d+", text):
        raise ValueError(f"{name} is {text!r}; wanted a number")
    return float(text)


def time_of_day(text: str) -> float | None:
    """Seconds since midnight of hhmmss.ss; None for an empty field. A leap second is second 60."""
    if not text:
        return None
    found = re.fullmatch(r"(\d\d)(\d\d)(\d\d(?:\.\d*)?)", text)
    if not found or int(found[1]) > 23 or int(found[2]) > 59 or float(found[3]) >= 61:
        raise ValueError(f"time is {text!r}; wanted hhmmss")
    return 3600 * int(found[1]) + 60 * int(found[2]) + float(found[3])


def angle(text: str, letter: str, letters: str, largest_deg: int) -> float | None:
    """Degrees of dddmm.mmm and its letter; None if both are empty."""
    if not text and not letter:
        return None
    digits = len(str(largest_deg))
    found = re.fullmatch(rf"(\d{{{digits}}})(\d\d(?:\.\d*)?)", text)
    if not found or letter not in letters or not letter:
        raise ValueError(f"found angle {text!r} {letter!r}; wanted {'d' * digits}mm.mmm and one of {letters}")
    degrees = int(found[1]) + float(found[2]) / 60
    if float(found[2]) >= 60 or degrees > largest_deg:
        raise ValueError(f"angle is {text!r}; wanted minutes below 60, at most {largest_deg} degrees")
    return -degrees if letter == letters[1] else degrees


def gga_position(fields: list[str]) -> tuple[Position | None, str | None]:
    """Position from latitude, N or S, longitude, E or W, quality, satellites, HDOP; or why there is none."""
    lat, lon = angle(fields[0], fields[1], "NS", 90), angle(fields[2], fields[3], "EW", 180)
    quality = number(fields[4], "quality")
    if quality not in GOOD_QUALITY:
        return None, QUALITY_WORDS.get(-1 if quality is None else int(quality), f"quality {fields[4]!r}")
    if lat is None or lon is None:
        return None, "no fix"
    satellites = number(fields[5], "satellites")
    if satellites == 0:
        return None, "no satellites"
    return Position(lat, lon, number(fields[6], "HDOP")), None


def _status_position(lat_lon: list[str], status: str, mode: str) -> tuple[Position | None, str | None]:
    lat = angle(lat_lon[0], lat_lon[1], "NS", 90)
    lon = angle(lat_lon[2], lat_lon[3], "EW", 180)
    if status != "A":
        return None, "no fix" if status == "V" else f"status {status!r}"
    if mode and mode not in GOOD_MODES:
        return None, {"N": "no fix", "E": "dead reckoning", "M": "entered by hand", "S": "a simulator"}.get(
            mode, f"mode {mode!r}"
        )
    if lat is None or lon is None:
        return None, "no fix"
    return Position(lat, lon), None


def _direction(text: str, name: str) -> float | None:
    value = number(text, name)
    if value is not None and not 0 <= value <= 360:
        raise ValueError(f"{name} is {text}; wanted 0 to 360")
    return None if value is None else value % 360


def _field(fields: list[str], k: int) -> str:
    return fields[k] if len(fields) > k else ""


# -- sentences -----------------------------------------------------------------------------------


def _gga(fields: list[str]) -> Message:
    position, why = gga_position(fields[1:8])
    return Message("GGA", time_of_day(fields[0]), position=position, no_position=why)


def _rmc(fields: list[str]) -> Message:
    position, why = _status_position(fields[2:6], fields[1], _field(fields, 11))
    knots = number(fields[6], "speed")
    date = None
    if fields[8]:
        found = re.fullmatch(r"(\d\d)(\d\d)(\d\d)", fields[8])
        if not found:
            raise ValueError(f"date is {fields[8]!r}; wanted ddmmyy")
        year = int(found[3])
        date = _date(year + (1900 if year >= 80 else 2000), int(found[2]), int(found[1]))
    return Message(
        "RMC",
        time_of_day(fields[0]),
        date,
        position,
        why,
        course_true_deg=_direction(fields[7], "course"),
        speed_mps=None if knots is None else knots * MPS_PER_KNOT,
    )


def _gll(fields: list[str]) -> Message:
    position, why = _status_position(fields[:4], fields[5], _field(fields, 6))
    return Message("GLL", time_of_day(fields[4]), position=position, no_position=why)


def _vtg(fields: list[str]) -> Message:
    if _field(fields, 8) in ("N", "E", "M", "S"):
        return Message("VTG")
    knots, kmh = number(fields[4], "speed"), number(fields[6], "speed")
    speed = knots * MPS_PER_KNOT if knots is not None else None if kmh is None else kmh / 3.6
    return Message("VTG", course_true_deg=_direction(fields[0], "course"), speed_mps=speed)


def _zda(fields: list[str]) -> Message:
    day, month, year = (number(field, "date") for field in fields[1:4])
    if day is None or month is None or year is None:
        return Message("ZDA", time_of_day(fields[0]))
    return Message("ZDA", time_of_day(fields[0]), _date(int(year), int(month), int(day)))


def _date(year: int, month: int, day: int) -> tuple[int, int, int]:
    try:
        datetime(year, month, day)
    except ValueError:
        raise ValueError(f"date is {year}-{month}-{day}; wanted one of the calendar") from None
    return year, month, day


def _hdt(fields: list[str]) -> Message:
    if fields[1] != "T":
        raise ValueError(f"heading is marked {fields[1]!r}; wanted T")
    return Message("HDT", heading_true_deg=_direction(fields[0], "heading"))


def _ths(fields: list[str]) -> Message:
    valid = fields[1] == "A"
    return Message("THS", heading_true_deg=_direction(fields[0], "heading") if valid else None)


def _hdg(fields: list[str]) -> Message:
    """A magnetic heading is a true one only if its variation is told; a deviation that is not told is zero."""
    magnetic = _direction(fields[0], "heading")
    deviation = _signed(fields[1], fields[2], "deviation")
    variation = _signed(fields[3], fields[4], "variation")
    if magnetic is None or variation is None:
        return Message("HDG")
    return Message("HDG", heading_true_deg=(magnetic + (deviation or 0.0) + variation) % 360)


def _signed(text: str, letter: str, name: str) -> float | None:
    value = number(text, name)
    if value is None:
        return None
    if letter not in ("E", "W"):
        raise ValueError(f"{name} is marked {letter!r}; wanted E or W")
    return value if letter == "E" else -value


def _dbt(fields: list[str]) -> Message:
    for k, unit, metres in ((2, "M", 1.0), (0, "f", FOOT_M), (4, "F", FATHOM_M)):
        value = number(fields[k], "depth")
        if value is not None:
            if fields[k + 1] != unit:
                raise ValueError(f"depth is in {fields[k + 1]!r}; wanted {unit}")
            return Message("DBT", depth_m=value * metres)
    return Message("DBT")


def _dpt(fields: list[str]) -> Message:
    depth, offset = number(fields[0], "depth"), number(fields[1], "offset")
    return Message("DPT", depth_m=None if depth is None else depth + (offset or 0.0))


_READERS = {
    "GGA": (8, _gga),
    "RMC": (9, _rmc),
    "GLL": (6, _gll),
    "VTG": (8, _vtg),
    "ZDA": (4, _zda),
    "HDT": (2, _hdt),
    "THS": (2, _ths),
    "HDG": (5, _hdg),
    "DBT": (6, _dbt),
    "DPT": (2, _dpt),
}
