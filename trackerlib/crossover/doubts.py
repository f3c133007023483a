"""What is odd about reported positions: asked in words, never mended unasked."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trackerlib.acoustics.profile import FEET_PER_METRE, SoundSpeedProfile
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey

FAR_FT = 6000.0  # beyond what a gate lets through
USUAL = 0.5  # share of reports near their array that makes a unit likely
FEWER = (
    0.6  # of that share, what the other unit brings near at most; of a pair, one array may lie near by chance
)


def unit_doubts(position: np.ndarray, place: np.ndarray, limit: float, what: str = "T-file") -> list[str]:
    """A question, where tracks (N, 3) lie near their arrays (N, 3) only if one of the two is in metres.

    place : NaN where an array has no position
    limit : how far from its array a report may lie, ft
    what : the file that holds the tracks
    """

    def near(a: float, b: float) -> float:
        return float(np.mean(np.linalg.norm(a * position[known] - b * place[known], axis=1) <= limit))

    known = ~np.isnan(place[:, 0])
    if not known.any():
        return []
    doubts = ((what, near(FEET_PER_METRE, 1)), ("array table", near(1, FEET_PER_METRE)))
    return [
        f"is the {which} in metres? {share:.0%} of the reports lie within {limit:g} ft of their array if it is, "
        f"{near(1, 1):.0%} if it is in feet"
        for which, share in doubts
        if share > USUAL and near(1, 1) <= FEWER * share
    ]


def depth_doubts(position: np.ndarray, number: np.ndarray, place: np.ndarray) -> list[str]:
    """A question, where targets (N, 3) lie deeper than the arrays that report them, which stand on the sea floor.

    number, place : (N,), (N, 3) of the reporting arrays; NaN where one has no position
    """
    below = position[:, 2] < place[:, 2]
    if not below.any():
        return []
    arrays = ", ".join(map(str, np.unique(number[below])))
    return [
        f"{below.mean():.1%} of the reports lie deeper than their own array, which stands on the sea floor (arrays "
        f"{arrays}); their rays go down. Is z a height, negative below the surface?"
    ]


def report_doubts(
    position: np.ndarray, number: np.ndarray, survey: ArraySurvey, limit: float, what: str = "T-file"
) -> list[str]:
    """Both questions about positions (N, 3) that arrays of these numbers (N,) report; some are enough."""
    place = survey.places_of(number)
    return unit_doubts(position, place, limit, what) + depth_doubts(position, number, place)


def set_doubts(crossover: CrossoverSet, survey: ArraySurvey) -> list[str]:
    """What is odd about both versions of a crossover set."""
    row = survey.index_of(np.array(crossover.pair))
    unplaced = [
        f"array {one} is a placeholder in the array table, no surveyed position; the offset means little"
        for one, where in zip(crossover.pair, row, strict=True)
        if where >= 0 and survey.placeholder[where]
    ]
    position = np.concatenate([crossover.x, crossover.y])
    number = np.repeat(crossover.pair, crossover.points)
    return unplaced + report_doubts(position, number, survey, FAR_FT, "crossover file")


def profile_doubts(profile: SoundSpeedProfile, survey: ArraySurvey, arrays: Iterable[int]) -> list[str]:
    """What is odd about a profile (feet) that begins far below the surface or ends above some of these arrays."""
    doubts = []
    start, end = profile.depth[0], profile.depth[-1]
    if start > 2 * (profile.depth[1] - start):
        doubts.append(f"the profile begins at {start:g} ft: above it speed goes on with the first gradient")
    row = survey.index_of(np.unique(np.array(list(arrays), np.int64)))
    row = row[row >= 0]
    depth = -survey.position[row, 2]
    below = row[depth > end]
    if len(below):
        numbers = ", ".join(map(str, np.sort(survey.number[below])))
        stand = f"array {numbers} stands" if len(below) == 1 else f"arrays {numbers} stand"
        in_metres = end < depth.max() / 2 and end * FEET_PER_METRE > 0.8 * depth.max()
        asked = ". Are its depths in metres?" if in_metres else ""
        doubts.append(
            f"the profile ends at {end:g} ft, and {stand} deeper, down to {depth.max():g} ft: below its "
            f"end speed goes on with the mean step of the last rows{asked}"
        )
    return doubts
