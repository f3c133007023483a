"""A SIMULATED hunt as the files that a ship would bring home: a recording, and the log of her GPS beside it."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.live.nmea import checksum
from trackerlib.simulation.hunt_sound import HuntSound
from trackerlib.simulation.sail_units import degrees_minutes
from trackerlib.simulation.sound import write_sound
from trackerlib.textfiles import write_text

DECIMALS = 4  # of a minute: 0.2 m


def write_hunt(recording: Path, hunt: HuntSound, seconds: float, began_s: float, **layout) -> Path:
    """Writes so much of a hunt as a recording whose head says when it began; the path of its NMEA log, beside it.

    began_s : since 1970, UTC; layout : see `write_sound`
    """
    write_sound(recording, hunt.open(), seconds, began_s, **layout)
    log = recording.with_suffix(".nmea")
    write_text(log, "\n".join(["# SIMULATED positions", *nmea_lines(hunt.fixes, began_s)]) + "\n")
    return log


def nmea_lines(fixes: NavigationFixes, began_s: float) -> list[str]:
    """RMC and GGA sentences of fixes whose clock began at `began_s` [s since 1970]."""
    lines = []
    for time_s, lat, lon, hdop in zip(fixes.time_s, fixes.lat_deg, fixes.lon_deg, fixes.hdop, strict=True):
        utc = datetime.fromtimestamp(round(began_s + time_s, 2), UTC)
        clock = f"{utc:%H%M%S}.{utc.microsecond // 10_000:02d}"
        north, east = degrees_minutes(lat, 2, DECIMALS), degrees_minutes(lon, 3, DECIMALS)
        place = f"{north},{'S' if lat < 0 else 'N'},{east},{'W' if lon < 0 else 'E'}"
        lines.append(sentence(f"GPRMC,{clock},A,{place},,,{utc:%d%m%y},,,A"))
        lines.append(sentence(f"GPGGA,{clock},{place},1,08,{hdop:.1f},0.0,M,0.0,M,,"))
    return lines


def sentence(body: str) -> str:
    """The line of a sentence's fields."""
    return f"${body}*{checksum(body):02X}"
