"""From the position reports of a run to crossover sets, through four gates, each counted.

After KEYGATE, Read (1990), Appendix E, but a point count seen by three or four arrays keeps every pair of
them, and a repeated report is judged by its own array's track (`repeats`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.repeats import RepeatChoice, resolve_repeats
from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.textfiles import BadRecord

MAX_SLANT_RANGE_FT = 4700.0
GAP_COUNTS = 30


@dataclass(frozen=True)
class GateCounts:
    """How many reports each gate let through."""

    records_read: int  # all records after the header, those that could not be read too
    bad: int
    kept_mode: int
    kept_paired: int
    kept_range: int
    kept_repaired: int  # paired again after the range gate
    repeats_left_out: int  # of these, further reports of one array at one point count
    unplaced: int  # dropped at the range gate because their array has no surveyed position


@dataclass(frozen=True, eq=False)
class GatingResult:
    """Crossover sets of one vehicle's run, and an account of every report that is not in them."""

    mode: int
    counts: GateCounts
    sets: tuple[CrossoverSet, ...]  # by array pair, then pass
    choices: tuple[RepeatChoice, ...]
    unplaced_arrays: dict[int, int]  # reports at the range gate by array without a surveyed position
    bad_records: tuple[BadRecord, ...]
    warnings: tuple[str, ...]
    source: str = ""


def gate_reports(
    reports: PositionReports,
    survey: ArraySurvey,
    mode: int,
    max_slant_range_ft: float = MAX_SLANT_RANGE_FT,
    gap_counts: int = GAP_COUNTS,
    run_date: np.datetime64 | None = None,
) -> GatingResult:
    """Crossover sets of the vehicle of one mode, with the count after each of the four gates.

    Reports of an array that the table lacks, or has as a placeholder, have no slant range and are dropped,
    and counted, at the range gate. A survey later than `run_date` is warned about.
    """
    vehicle = gate_mode_and_flag(reports, mode)
    paired = gate_several_arrays(vehicle)
    placed, unplaced = _split_unplaced(paired, survey)
    in_range = gate_slant_range(placed, survey, max_slant_range_ft)
    repaired = gate_several_arrays(in_range)
    single, choices = resolve_repeats(repaired, vehicle)
    unplaced_arrays = {
        int(a): int(n) for a, n in zip(*np.unique(unplaced.array, return_counts=True), strict=True)
    }
    counts = GateCounts(
        records_read=len(reports) + len(reports.bad_records),
        bad=len(reports.bad_records),
        kept_mode=len(vehicle),
        kept_paired=len(paired),
        kept_range=len(in_range),
        kept_repaired=len(repaired),
        repeats_left_out=len(repaired) - len(single),
        unplaced=len(unplaced),
    )
    return GatingResult(
        mode=mode,
        counts=counts,
        sets=tuple(pair_up(single, gap_counts)),
        choices=choices,
        unplaced_arrays=unplaced_arrays,
        bad_records=reports.bad_records,
        warnings=tuple(_warnings(reports, single, survey, mode, unplaced_arrays, run_date)),
        source=reports.source,
    )


def gate_mode_and_flag(reports: PositionReports, mode: int) -> PositionReports:
    """Gate 1: reports of one vehicle's mode without an edit mark, in order of point count."""
    kept = reports.only((reports.mode == mode) & ~reports.flagged)
    return kept.only(np.argsort(kept.point_count, kind="stable"))


def gate_several_arrays(reports: PositionReports) -> PositionReports:
    """Gates 2 and 4: reports at point counts that two or more arrays report."""
    seen = np.unique(np.column_stack([reports.point_count, reports.array]), axis=0)
    count, arrays = np.unique(seen[:, 0], return_counts=True)
    return reports.only(np.isin(reports.point_count, count[arrays >= 2]))


def gate_slant_range(
    reports: PositionReports, survey: ArraySurvey, max_slant_range_ft: float
) -> PositionReports:
    """Gate 3: reports at most so far from the surveyed position of the array that made them."""
    array_position = survey.position[survey.index_of(reports.array)]
    slant_range = np.linalg.norm(reports.position - array_position, axis=1)
    return reports.only(slant_range <= max_slant_range_ft)


def pair_up(reports: PositionReports, gap_counts: int = GAP_COUNTS) -> list[CrossoverSet]:
    """Crossover sets of every two arrays that share point counts, split into passes.

    reports : each array at most once at a point count, in order of point count
    """
    tracks = {int(number): reports.only(reports.array == number) for number in np.unique(reports.array)}
    sets = []
    for a, b in combinations(tracks, 2):
        counts, in_a, in_b = np.intersect1d(
            tracks[a].point_count, tracks[b].point_count, assume_unique=True, return_indices=True
        )
        if len(counts):
            x, y = tracks[a].position[in_a], tracks[b].position[in_b]
            whole = CrossoverSet((a, b), counts, x, y, 1, reports.range_name, reports.source)
            sets += split_passes(whole, gap_counts)
    return sets


def split_passes(crossover: CrossoverSet, gap_counts: int) -> list[CrossoverSet]:
    """Passes of a set, numbered from 1; one ends where point counts jump by more than the gap."""
    cuts = np.flatnonzero(np.diff(crossover.point_count) > gap_counts) + 1
    parts = np.split(np.arange(crossover.points), cuts)
    return [crossover.only(part).numbered(number) for number, part in enumerate(parts, 1)]


def _split_unplaced(reports: PositionReports, survey: ArraySurvey):
    """Reports of arrays with a surveyed position, and of those without."""
    row = survey.index_of(reports.array)
    placed = row >= 0
    placed[placed] = ~survey.placeholder[row[placed]]
    return reports.only(placed), reports.only(~placed)


def _warnings(reports, single, survey, mode, unplaced_arrays, run_date) -> list[str]:
    warnings = []
    if not np.any(reports.mode == mode):
        have = ", ".join(map(str, np.unique(reports.mode)))
        warnings.append(f"no report has mode {mode}; the file has modes {have}")
    for array, count in unplaced_arrays.items():
        row = int(survey.index_of(np.array([array]))[0])
        why = "is a placeholder in the array table" if row >= 0 else "is not in the array table"
        warnings.append(f"array {array} {why}: {count} reports have no slant range and are left out")
    if run_date is not None and not np.isnat(run_date):
        used = survey.index_of(np.unique(single.array))
        for row in used[survey.survey_date[used] > run_date]:
            number, day = survey.number[row], survey.survey_date[row]
            warnings.append(f"array {number} was surveyed on {day}, after the run of {run_date}")
    return warnings
