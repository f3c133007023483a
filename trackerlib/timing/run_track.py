"""One clock correction applied to a whole run: every array's part of the track, and the jumps where arrays take over.

    run = correct_run(reports, survey, profile, offset_s=2.85e-3)
    run.track, run.hand_overs

Read (1990) improves crossover sets; what a vehicle's track gains is seen where one array hands it to the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.gating import GAP_COUNTS, gate_slant_range, pair_up
from trackerlib.crossover.repeats import resolve_repeats
from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.timing.track_correction import ArrayMovement, correct_reports


@dataclass(frozen=True)
class HandOver:
    """Where two arrays see the track together: how far apart their versions are, before and after."""

    pair: tuple[int, int]
    pass_number: int
    first: int  # point counts
    last: int
    points: int
    before: tuple[float, float, float]  # median gap downrange, crossrange, vertical
    after: tuple[float, float, float]

    @property
    def jump_before(self) -> float:
        """Length of the step that the track takes here, uncorrected."""
        return float(np.linalg.norm(self.before))

    @property
    def jump_after(self) -> float:
        """The same with the clock corrected."""
        return float(np.linalg.norm(self.after))


@dataclass(frozen=True, eq=False)
class RunTrack:
    """A vehicle's whole track with its clock corrected."""

    reports: PositionReports  # the vehicle's, one an array and point count
    corrected: np.ndarray  # (N, 3) of each report; as reported where no ray reaches
    reached: np.ndarray  # (N,)
    point_count: np.ndarray  # (T,) growing
    track: np.ndarray  # (T, 3) mean of the arrays that saw the count
    arrays: np.ndarray  # (T,) how many they were
    hand_overs: tuple[HandOver, ...]  # in order of point count

    @property
    def mean_jump(self) -> tuple[float, float]:
        """Root-mean-square step at the hand-overs before and after, each by its points."""
        if not self.hand_overs:
            return 0.0, 0.0
        weight = np.array([one.points for one in self.hand_overs], float)
        jumps = np.array([(one.jump_before, one.jump_after) for one in self.hand_overs])
        before, after = np.sqrt(weight @ jumps**2 / weight.sum())
        return float(before), float(after)


def correct_run(
    reports: PositionReports,
    survey: ArraySurvey,
    profile: SoundSpeedProfile,
    max_slant_range: float,
    offset_s: float,
    drift_s_per_count: float = 0.0,
    t0: float = 0.0,
    gap_counts: int = GAP_COUNTS,
    movements: dict[int, ArrayMovement] | None = None,
) -> RunTrack:
    """The whole track of one vehicle with one offset and drift, single-array parts included.

    reports : of one vehicle, those with an edit mark left out, in order of point count; reports of arrays that
        the survey lacks or holds as placeholders, and of targets beyond max_slant_range, are left out
    movements : of the arrays by a calibration, as for `correct_reports`
    Raises ValueError where no report is left.
    """
    near = gate_slant_range(reports, survey, max_slant_range)
    single, _ = resolve_repeats(near, reports)
    if not len(single):
        raise ValueError("no report of this vehicle lies within range of an array whose position is known")
    moved = correct_reports(single, survey, profile, offset_s, drift_s_per_count, t0, movements=movements)
    corrected, reached = single.position.astype(float), np.zeros(len(single), bool)
    corrected[moved.which], reached[moved.which] = moved.position, True
    count, where, arrays = np.unique(single.point_count, return_inverse=True, return_counts=True)
    track = np.column_stack([np.bincount(where, corrected[:, axis]) for axis in range(3)]) / arrays[:, None]
    return RunTrack(
        single, corrected, reached, count, track, arrays, _hand_overs(single, corrected, gap_counts)
    )


def _hand_overs(single: PositionReports, corrected: np.ndarray, gap_counts: int) -> tuple[HandOver, ...]:
    before, after = (
        pair_up(replace(single, position=place), gap_counts) for place in (single.position, corrected)
    )
    found = [
        HandOver(
            pair=one.pair,
            pass_number=one.pass_number,
            first=int(one.point_count[0]),
            last=int(one.point_count[-1]),
            points=one.points,
            before=tuple(np.median(one.gap, axis=0).tolist()),
            after=tuple(np.median(other.gap, axis=0).tolist()),
        )
        for one, other in zip(before, after, strict=True)
    ]
    return tuple(sorted(found, key=lambda one: one.first))
