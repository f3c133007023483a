"""Sound-speed profile as CSV: `depth_m, speed_mps`, depth positive down, one row a level."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile, gap_notes
from trackerlib.textfiles import InputError, read_lines

SIMULATED = "simulated"  # note of a profile whose file says so in a comment


def read_profile_csv(path: str | Path) -> SoundSpeedProfile:
    """The profile in a CSV file, in metres; speed is linear between its depths.

    Two columns, with the header `depth_m,speed_mps` (in either order) or with none.
    Raises InputError, with the line, for a number that is none, a depth that does not grow, or a
    speed that is not one of sea water in metres per second.
    """
    return parse_profile_csv(read_lines(path), Path(path).name)


def parse_profile_csv(lines: list[str], name: str) -> SoundSpeedProfile:
    """The same from lines already read."""
    order = (0, 1)
    depths: list[float] = []
    speeds: list[float] = []
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        cells = [cell.strip() for cell in (next(csv.reader([text])) if "," in text else text.split())]
        if not depths and "depth_m" in (lowered := [cell.lower() for cell in cells]):
            if "speed_mps" not in lowered:
                raise InputError(
                    f"{name}, line {number}: found columns {text!r}; wanted depth_m and speed_mps"
                )
            order = (lowered.index("depth_m"), lowered.index("speed_mps"))
            continue
        depth, speed = _level(cells, order, f"{name}, line {number}")
        if depths and depth <= depths[-1]:
            raise InputError(
                f"{name}, line {number}: found depth {depth:g} m after {depths[-1]:g} m; wanted growing depths"
            )
        depths.append(depth)
        speeds.append(speed)
    if len(depths) < 2:
        raise InputError(
            f"{name}: found {len(depths)} levels, wanted at least two rows of depth_m, speed_mps"
        )
    simulated = any("simulated" in line.lower() for line in lines if line.lstrip().startswith("#"))
    notes = (*((SIMULATED,) if simulated else ()), *gap_notes(np.array(depths), "m"))
    return SoundSpeedProfile(np.array(depths), np.array(speeds), unit="m", name=name, notes=notes)


def _level(cells: list[str], order: tuple[int, int], where: str) -> tuple[float, float]:
    try:
        depth, speed = (float(cells[k]) for k in order)
    except (ValueError, IndexError):
        raise InputError(
            f"{where}: found {','.join(cells)[:60]!r}; wanted two numbers, depth_m and speed_mps"
        ) from None
    if not 0 <= depth <= 12_000:
        raise InputError(f"{where}: found depth {depth:g}; wanted metres, positive down, to 12000")
    if not 1300 <= speed <= 1700:
        hint = " (feet per second?)" if 4300 < speed < 5600 else ""
        raise InputError(f"{where}: found speed {speed:g}{hint}; wanted metres per second, 1300 to 1700")
    return depth, speed
