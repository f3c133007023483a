"""Noise of the sea and of the water that flows past a hydrophone, at the frequencies of beacons.

Wojcik (1993), section 5.2 and Table 5-1, which is data/ambient_noise.csv. Levels are of a band of 1 Hz.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np

TABLE = Path(__file__).resolve().parents[2] / "data/ambient_noise.csv"
SCALE = "sea state (Beaufort), Table 5-1"  # what the numbers of `ambient_noise_db` are, for labels
LIMIT = "limit"  # the table's row for the noisiest sea

HYDROPHONE_DB = -201.0  # open circuit, re 1 V/uPa, Benthos AQ-4
FLOW_NOISE_DB_AT_5_MPS = 60.0  # as loud as sea state 3 at the greatest speed that the report allows


@cache
def table_5_1() -> tuple[tuple[str, float, float, float], ...]:
    """Rows of Table 5-1: sea state, dB re 1 uPa, nV per root hertz, uV in 100 Hz."""
    lines = [line for line in TABLE.read_text().splitlines() if not line.startswith("#")]
    return tuple((row[0], float(row[1]), float(row[2]), float(row[3])) for row in csv.reader(lines[1:]))


def ambient_noise_db(sea_state: float | str) -> float:
    """Noise of the sea [dB re 1 uPa in 1 Hz] at a number of SCALE, or at "limit".

    Between the table's rows the level is interpolated. Raises ValueError outside them.
    """
    rows = [row for row in table_5_1() if row[0] != LIMIT]
    if sea_state == LIMIT:
        return next(row[1] for row in table_5_1() if row[0] == LIMIT)
    states = [float(row[0]) for row in rows]
    if isinstance(sea_state, str) or not states[0] <= sea_state <= states[-1]:
        raise ValueError(
            f"sea_state is {sea_state}; wanted {states[0]:g} to {states[-1]:g}, {SCALE}, or 'limit'"
        )
    return float(np.interp(sea_state, states, [row[1] for row in rows]))


def flow_noise_db(speed_mps: float, at_5_mps_db: float = FLOW_NOISE_DB_AT_5_MPS) -> float:
    """Noise of the water that flows past the hydrophone [dB re 1 uPa in 1 Hz]; minus infinity at rest.

    Power grows with the sixth power of the speed, as dipole sound of a body in a stream does (Curle 1955). The
    report only says that the ship should do at most 5 m/s; the level at that speed is a setting, not a measurement.
    """
    return at_5_mps_db + 60 * np.log10(speed_mps / 5.0) if speed_mps > 0 else -np.inf


def equivalent_noise_v(
    noise_db: float, bandwidth_hz: float = 1.0, hydrophone_db: float = HYDROPHONE_DB
) -> float:
    """Noise at the hydrophone's terminals [V rms in the band], (5-6).

    (5-6) prints log10 of the bandwidth where half of it is meant; with the half all six rows of Table 5-1 come out.
    """
    return float(10 ** ((hydrophone_db + noise_db) / 20) * np.sqrt(bandwidth_hz))
