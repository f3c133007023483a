"""One array reporting one vehicle twice at one point count: which report is kept, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.crossover.reports import PositionReports

NEIGHBOUR_COUNTS = 12  # how far in point counts a neighbour may be
NEIGHBOURS_PER_SIDE = 5


@dataclass(frozen=True)
class RepeatChoice:
    """Which of several reports of one array at one point count was kept."""

    array: int
    point_count: int
    kept_line: int  # line number in the file
    dropped_lines: tuple[int, ...]
    kept_distance_ft: float  # from where the array's own track puts the vehicle; NaN without neighbours
    dropped_distances_ft: tuple[float, ...]
    reason: str


def resolve_repeats(
    reports: PositionReports, tracks: PositionReports
) -> tuple[PositionReports, tuple[RepeatChoice, ...]]:
    """Reports with one report for each array and point count, and every choice that was made.

    reports : of one vehicle, in order of point count
    tracks : all reports of that vehicle in that order, those that no other array saw too, from which the
        array's own track near a repeat is taken
    """
    order = np.lexsort((reports.line, reports.point_count, reports.array))
    key = np.column_stack([reports.array, reports.point_count])[order]
    starts = np.flatnonzero(np.any(np.diff(key, axis=0, prepend=-1) != 0, axis=1))
    sizes = np.diff(starts, append=len(order))
    keep = np.ones(len(reports), dtype=bool)
    choices = []
    for start, size in zip(starts[sizes > 1], sizes[sizes > 1], strict=True):
        group = order[start : start + size]
        best, choice = _choose(reports.only(group), tracks)
        keep[np.delete(group, best)] = False
        choices.append(choice)
    choices.sort(key=lambda choice: (choice.point_count, choice.array))
    return reports.only(keep), tuple(choices)


def predict_position(point_count: int, counts: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Where a track (K, 3) at `counts` (K,) puts the vehicle at `point_count`: (3,), NaN without a neighbour.

    Each two neighbours at different counts give a straight-line prediction; the answer is the median of
    these, weighted by how little each amplifies the neighbours' noise, so that a few wild neighbours do
    not move it.
    """
    away = counts - point_count
    if len(counts) == 0:
        return np.full(3, np.nan)
    i, j = np.triu_indices(len(counts), k=1)
    i, j = i[away[i] != away[j]], j[away[i] != away[j]]
    if not len(i):
        return np.median(positions, axis=0)
    share_j = -away[i] / (away[j] - away[i])
    prediction = positions[i] + share_j[:, None] * (positions[j] - positions[i])
    return _weighted_median(prediction, 1.0 / np.hypot(share_j, 1.0 - share_j))


def _weighted_median(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Median of each column of `values` (K, 3) under one weight (K,)."""
    order = np.argsort(values, axis=0)
    total = np.cumsum(weight[order], axis=0)
    middle = np.argmax(total >= 0.5 * total[-1], axis=0)
    column = np.arange(values.shape[1])
    return values[order[middle, column], column]


def _neighbours(array: int, point_count: int, tracks: PositionReports) -> np.ndarray:
    """Indices of the array's reports nearest in time on either side, those of the same count left out."""
    limits = point_count + np.array([-NEIGHBOUR_COUNTS, 0, 1, NEIGHBOUR_COUNTS + 1])
    first, here, next_count, last = np.searchsorted(tracks.point_count, limits)
    before = first + np.flatnonzero(tracks.array[first:here] == array)
    after = next_count + np.flatnonzero(tracks.array[next_count:last] == array)
    return np.concatenate([before[-NEIGHBOURS_PER_SIDE:], after[:NEIGHBOURS_PER_SIDE]])


def _choose(repeats: PositionReports, tracks: PositionReports) -> tuple[int, RepeatChoice]:
    array, count = int(repeats.array[0]), int(repeats.point_count[0])
    near = _neighbours(array, count, tracks)
    expected = predict_position(count, tracks.point_count[near], tracks.position[near])
    distance = np.linalg.norm(repeats.position - expected, axis=1)
    if len(near):
        best = int(np.argmin(distance))
        reason = f"nearest to the array's own track through {len(near)} neighbours"
    else:
        best = 0
        reason = f"the array has no other report within {NEIGHBOUR_COUNTS} counts; the first is kept"
    return best, RepeatChoice(
        array=array,
        point_count=count,
        kept_line=int(repeats.line[best]),
        dropped_lines=tuple(int(line) for line in np.delete(repeats.line, best)),
        kept_distance_ft=float(distance[best]),
        dropped_distances_ft=tuple(float(d) for d in np.delete(distance, best)),
        reason=reason,
    )
