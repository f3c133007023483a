"""CALIBRATE.json: the answer of `calibrate`, of which corrections need rotation and intercept of each array."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from trackerlib.textfiles import InputError, decode_lines, read_bytes
from trackerlib.timing.track_correction import ArrayMovement


def read_calibration(path: str | Path) -> dict[int, ArrayMovement]:
    """Movement of each array. Raises InputError with the key where the file is not as `calibrate` writes it."""
    name = Path(path).name
    try:
        answer = json.loads("\n".join(decode_lines(read_bytes(path), name)))
    except json.JSONDecodeError as error:
        raise InputError(
            f"{name}, line {error.lineno}: {error.msg}; wanted the answer of calibrate"
        ) from None
    if not isinstance(answer, dict) or not isinstance(answer.get("arrays"), list) or not answer["arrays"]:
        raise InputError(f"{name}: found no list 'arrays'; wanted the answer of calibrate")
    movements = {}
    for place, entry in enumerate(answer["arrays"], 1):
        where = f"{name}, arrays[{place}]"
        try:
            number = int(entry["array"])
            rotation = np.array(entry["rotation"], dtype=float).reshape(3, 3)
            intercept = np.array(entry["intercept_ft"], dtype=float).reshape(3)
        except KeyError as error:
            raise InputError(f"{where}: key {error} is missing") from None
        except (TypeError, ValueError):
            raise InputError(
                f"{where}: wanted array a number, rotation 3 x 3 and intercept_ft three numbers"
            ) from None
        if not (np.isfinite(rotation).all() and np.isfinite(intercept).all()):
            raise InputError(f"{where}: found a number that is none; wanted rotation and intercept_ft")
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
            raise InputError(f"{where}: found a matrix that is no rotation")
        movements[number] = ArrayMovement(rotation, intercept)
    return movements
