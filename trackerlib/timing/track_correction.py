"""A whole run's positions with the clock corrected, those that one array alone saw too.

Read (1990), equations (3), (4) and (6), for every report of a vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.timing.stretch import stretch


@dataclass(frozen=True, eq=False)
class CorrectedReports:
    """New positions of one vehicle's reports, and why others have none."""

    which: np.ndarray  # (K,) reports that have a new position
    position: np.ndarray  # (K, 3) ft
    in_shadow: int  # left as they were: no direct ray joins them to their array
    unplaced: dict[int, int]  # left as they were, by array without a surveyed position


@dataclass(frozen=True, eq=False)
class ArrayMovement:
    """What a calibration makes of one array: corrected = intercept + rotation x original."""

    rotation: np.ndarray  # (3, 3)
    intercept_ft: np.ndarray  # (3,)

    def applied(self, position: np.ndarray) -> np.ndarray:
        """Corrected positions (N, 3) of positions (N, 3)."""
        return self.intercept_ft + position @ self.rotation.T


def correct_reports(
    reports: PositionReports,
    survey: ArraySurvey,
    profile: SoundSpeedProfile,
    offset_s: float,
    drift_s_per_count: float = 0.0,
    t0: float = 0.0,
    mode: int | None = None,
    movements: dict[int, ArrayMovement] | None = None,
) -> CorrectedReports:
    """Positions of a vehicle's reports with its clock corrected, each along the ray from its own array.

    mode : only that vehicle; None for all reports. Reports with an edit mark stay as they are.
    movements : by array number, applied after the clock: rotation and intercept of a calibration, which move
        the tracks as they were measured from the array's surveyed place
    """
    wanted = ~reports.flagged if mode is None else (reports.mode == mode) & ~reports.flagged
    position = reports.position.copy()
    done, shadow, unplaced = np.zeros(len(reports), bool), 0, {}
    for number in np.unique(reports.array[wanted]).tolist():
        these = np.flatnonzero(wanted & (reports.array == number))
        (place,) = survey.places_of(np.array([number]))
        if np.isnan(place[0]):
            unplaced[number] = len(these)
            continue
        g = offset_s + drift_s_per_count * (reports.point_count[these] - t0)
        direction = stretch(reports.position[these], place, profile)
        moved = reports.position[these] + g[:, None] * np.where(
            direction.reached[:, None], direction.velocity, 0.0
        )
        if movements and number in movements:
            moved = movements[number].applied(moved)
        shadow += int(np.sum(~direction.reached))
        position[these[direction.reached]] = moved[direction.reached]
        done[these[direction.reached]] = True
    which = np.flatnonzero(done)
    return CorrectedReports(which, position[which], shadow, unplaced)
