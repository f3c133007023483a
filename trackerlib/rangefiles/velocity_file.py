"""VELOCITY.DAT: the sound-speed table of a range, a layer a row.

Depth of the layer's upper boundary (ft) and the speed at the layer's middle (ft/s), usually every 25
ft; speed runs in a straight line between middles (Read 1990, appendix E). Tables of another kind give
the speed at the depth itself: `speeds="boundary"`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile, gap_notes
from trackerlib.textfiles import BadRecord, InputError, decode_lines, read_bytes

SPEED_LIMITS = (4300.0, 5700.0)  # of sea water, ft/s


@dataclass(frozen=True, eq=False)
class VelocityReading:
    """A sound-speed profile as read, with what could not be used."""

    profile: SoundSpeedProfile  # its notes say where depths have gaps
    bad_records: tuple[BadRecord, ...] = ()


def read_velocity(path: str | Path, speeds: str = "middle") -> VelocityReading:
    """The profile of a VELOCITY.DAT, in feet; `speeds` is "middle" or "boundary".

    Raises InputError with the line where depths do not grow, or where the speeds are not those of sea
    water in feet per second. A row that holds no two numbers is reported and left out.
    """
    return parse_velocity(read_bytes(path), Path(path).name, speeds)


def parse_velocity(content: bytes, name: str, speeds: str = "middle") -> VelocityReading:
    """The same from the bytes of a file (or upload) called `name`."""
    depths: list[float] = []
    found: list[float] = []
    bad = []
    for number, line in enumerate(decode_lines(content, name), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            depth, speed = (float(cell) for cell in line.replace(",", " ").split())
        except ValueError:
            bad.append(BadRecord(number, f"found {line.strip()[:40]!r}; wanted depth (ft) and speed (ft/s)"))
            continue
        _check(depth, speed, depths, f"{name}, line {number}")
        depths.append(depth)
        found.append(speed)
    if len(depths) < 2:
        why = f"; line {bad[0].line}: {bad[0].why}" if bad else ""
        raise InputError(
            f"{name}: found {len(depths)} rows, wanted two or more of depth (ft) and speed (ft/s){why}"
        )
    if speeds == "middle":
        profile = SoundSpeedProfile.from_layer_middles(np.array(depths), np.array(found), "ft", name)
    else:
        notes = gap_notes(np.array(depths), "ft")
        profile = SoundSpeedProfile(np.array(depths), np.array(found), "ft", name, notes)
    return VelocityReading(profile, tuple(bad))


def _check(depth: float, speed: float, before: list[float], where: str) -> None:
    if not 0 <= depth < math.inf:
        raise InputError(f"{where}: found depth {depth:g}; wanted feet below the surface, positive down")
    if before and not depth > before[-1]:
        raise InputError(f"{where}: found depth {depth:g} ft after {before[-1]:g} ft; wanted growing depths")
    if not SPEED_LIMITS[0] <= speed <= SPEED_LIMITS[1]:
        hint = " (metres per second?)" if 1300 <= speed <= 1700 else ""
        raise InputError(f"{where}: found speed {speed:g}{hint}; wanted feet per second, 4300 to 5700")
