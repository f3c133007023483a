"""From the position reports of a run to crossover sets, through four gates, each counted.

After KEYGATE, Read (1990), Appendix E, but a point count seen by three or four arrays keeps every pair of
them, and a repeated report is judged by its own array's track (`repeats`). The gates: mode and edit mark; a
point count that two arrays report; slant range; once more a point count that two arrays report.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackerlib.compiled import in_threads
from trackerlib.crossover.doubts import report_doubts
from trackerlib.crossover.gate_scan import (
    ALONE,
    ALONE_IN_RANGE,
    TOO_FAR,
    UNPLACED,
    find_repeats,
    judge_reports,
    match_pairs,
    needs_no_gate,
)  # fmt: skip
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.repeats import RepeatChoice, choose_repeats
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
    choices: Sequence[RepeatChoice]
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
    keep_lines: Sequence[int] = (),
) -> GatingResult:
    """Crossover sets of the vehicle of one mode, with the count after each of the four gates.

    keep_lines : lines to keep of repeated reports, where the choice made is not wanted
    Reports of an array that the table lacks, or has as a placeholder, have no slant range and are dropped,
    and counted, at the range gate. A survey later than `run_date` is warned about.
    """
    vehicle = gate_mode_and_flag(reports, mode)
    lowest, place = _places(vehicle.array, survey)
    verdict, ended, repaired = judge_reports(
        vehicle.point_count, vehicle.array, vehicle.position, place, lowest, max_slant_range_ft
    )
    repeats = find_repeats(vehicle.point_count[repaired], vehicle.array[repaired])
    single, choices = choose_repeats(vehicle, repaired, repeats, keep_lines)
    unplaced_arrays = {}
    if ended[UNPLACED]:
        unplaced = np.unique(vehicle.array[verdict == UNPLACED], return_counts=True)
        unplaced_arrays = {int(n): int(k) for n, k in zip(*unplaced, strict=True)}
    paired = len(vehicle) - int(ended[ALONE])
    in_range = paired - int(ended[UNPLACED]) - int(ended[TOO_FAR])
    counts = GateCounts(
        records_read=len(reports) + reports.left_out + len(reports.bad_records),
        bad=len(reports.bad_records),
        kept_mode=len(vehicle),
        kept_paired=paired,
        kept_range=in_range,
        kept_repaired=in_range - int(ended[ALONE_IN_RANGE]),
        repeats_left_out=len(repaired) - len(single),
        unplaced=int(ended[UNPLACED]),
    )
    some = slice(None, None, 1 + len(vehicle) // 4000)  # enough to tell feet from metres
    sets = tuple(_pair_up(vehicle, single, gap_counts))
    return GatingResult(
        mode=mode,
        counts=counts,
        sets=sets,
        choices=choices,
        unplaced_arrays=unplaced_arrays,
        bad_records=reports.bad_records,
        warnings=(
            *_warnings(reports, len(vehicle), sets, survey, mode, unplaced_arrays, run_date),
            *report_doubts(vehicle.position[some], vehicle.array[some], survey, max_slant_range_ft),
        ),
        source=reports.source,
    )


def ready_sets(sets: Sequence[CrossoverSet]) -> GatingResult:
    """Sets that were gated elsewhere, with nothing to tell of the gates."""
    return GatingResult(0, GateCounts(0, 0, 0, 0, 0, 0, 0, 0), tuple(sets), (), {}, (), ())


def gate_mode_and_flag(reports: PositionReports, mode: int) -> PositionReports:
    """Gate 1: reports of one vehicle's mode without an edit mark, in order of point count."""
    kept = reports
    clean, in_order = needs_no_gate(kept.point_count, kept.mode, kept.flagged, mode)
    if not clean:
        kept = reports.only((reports.mode == mode) & ~reports.flagged)
        in_order = bool(np.all(kept.point_count[1:] >= kept.point_count[:-1]))
    return kept if in_order else kept.only(np.argsort(kept.point_count, kind="stable"))


def gate_slant_range(
    reports: PositionReports, survey: ArraySurvey, max_slant_range_ft: float
) -> PositionReports:
    """Gate 3 alone: reports at most so far from the array that made them, whose position was surveyed."""
    slant_range = np.linalg.norm(reports.position - survey.places_of(reports.array), axis=1)
    return reports.only(slant_range <= max_slant_range_ft)


def pair_up(reports: PositionReports, gap_counts: int = GAP_COUNTS) -> list[CrossoverSet]:
    """Crossover sets of every two arrays that share point counts, split into passes.

    reports : each array at most once at a point count, in order of point count
    """
    return _pair_up(reports, np.arange(len(reports)), gap_counts)


def _pair_up(reports: PositionReports, chosen: np.ndarray, gap_counts: int) -> list[CrossoverSet]:
    """The same of the reports at the indices `chosen`."""
    numbers, row = _rows(reports.array[chosen])
    sizes, matches = match_pairs(reports.point_count[chosen], row, len(numbers))
    both = chosen[matches]
    point_count = reports.point_count[both[0]].astype(np.int64)
    x, y = in_threads(reports.position.take, [(which, 0) for which in both])
    lines = reports.line[both].T
    sets: list[CrossoverSet] = []
    end = 0
    for a, b in np.argwhere(sizes):
        part = slice(end, end + sizes[a, b])
        end = part.stop
        whole = CrossoverSet(
            pair=(int(numbers[a]), int(numbers[b])),
            point_count=point_count[part],
            x=x[part],
            y=y[part],
            range_name=reports.range_name,
            source=reports.source,
            lines=lines[part],
        )
        sets += split_passes(whole, gap_counts)
    return sets


def split_passes(crossover: CrossoverSet, gap_counts: int) -> list[CrossoverSet]:
    """Passes of a set, numbered from 1; one ends where point counts jump by more than the gap."""
    cuts = np.flatnonzero(np.diff(crossover.point_count) > gap_counts) + 1
    parts = zip([0, *cuts], [*cuts, crossover.points], strict=True)
    return [crossover.only(slice(a, b), number) for number, (a, b) in enumerate(parts, 1)]


def _rows(array: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Array numbers (K,) that occur, ascending, and the place of each report's array among them (N,)."""
    lowest = int(array.min(initial=0))
    place = array.astype(np.int64) - lowest
    seen = np.bincount(place) > 0
    return np.flatnonzero(seen) + lowest, (np.cumsum(seen) - 1).astype(np.int16)[place]


def _places(array: np.ndarray, survey: ArraySurvey) -> tuple[int, np.ndarray]:
    """Lowest of the array numbers (N,), and surveyed positions (K, 3) from it to the highest, NaN for none."""
    if not len(array):
        return 0, np.empty((0, 3))
    lowest = int(array.min())
    return lowest, survey.places_of(np.arange(lowest, int(array.max()) + 1))


def _warnings(reports, of_vehicle, sets, survey, mode, unplaced_arrays, run_date) -> list[str]:
    warnings = []
    if not (mode in reports.other_modes or np.any(reports.mode == mode)):
        modes = sorted({*reports.other_modes, *np.unique(reports.mode).tolist()})
        have = ", ".join(map(str, modes))
        warnings.append(f"no report has mode {mode}; the file has modes {have}")
    elif not of_vehicle:
        warnings.append(f"every report of mode {mode} bears an edit mark")
    for array, count in unplaced_arrays.items():
        row = int(survey.index_of(np.array([array]))[0])
        why = "is a placeholder in the array table" if row >= 0 else "is not in the array table"
        warnings.append(f"array {array} {why}: {count} reports have no slant range and are left out")
    if run_date is not None and not np.isnat(run_date):
        used = survey.index_of(np.unique(np.array([one.pair for one in sets], dtype=np.int64)))
        for row in used[survey.survey_date[used] > run_date]:
            number, day = survey.number[row], survey.survey_date[row]
            warnings.append(f"array {number} was surveyed on {day}, after the run of {run_date}")
    return warnings
