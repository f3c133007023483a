"""One array reporting one vehicle twice at one point count: which report is kept, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackerlib.compiled import compiled, in_threads, warms
from trackerlib.crossover.gate_scan import find_repeats
from trackerlib.crossover.reports import PositionReports

NEIGHBOUR_COUNTS = 12  # how far in point counts a neighbour may be
NEIGHBOURS_PER_SIDE = 5
_MOST = 2 * NEIGHBOURS_PER_SIDE
_PAIRS = 48  # room for every two of these, in whole steps of the processor
_WEIGHT, _REACHED, _ROOM = 3 * _PAIRS, 4 * _PAIRS, 7 * _PAIRS  # rows behind those of x, y and z
_AWAY = np.arange(-NEIGHBOUR_COUNTS, NEIGHBOUR_COUNTS + 1.0)
with np.errstate(divide="ignore", invalid="ignore"):
    # Of two neighbours so many counts away: which share of the way from the first to the second the prediction is
    # at, and how little it amplifies their noise. Kept, for a division takes as long as all else of a pair.
    _SHARE = -_AWAY[:, None] / (_AWAY - _AWAY[:, None])
    _QUIET = 1.0 / np.sqrt(_SHARE * _SHARE + (1.0 - _SHARE) * (1.0 - _SHARE))
_TIE = 1e-12  # of all weight: two halves that are alike but for rounding
_FEWEST = 500  # repeats for which a thread of its own is worth its start


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


@dataclass(frozen=True, eq=False)
class RepeatChoices(Sequence):
    """Every choice among repeats, in order of point count and array: a sequence of RepeatChoice."""

    reports: PositionReports
    kept: np.ndarray  # (R,) report that was kept
    neighbours: np.ndarray  # (R,) reports of the array's own track that it was measured against
    told: np.ndarray  # (R,) true where the caller named the line to keep
    member: np.ndarray  # (R, M) the reports among which it was chosen, -1 behind the last
    distance: np.ndarray  # (R, M) ft from where the array's own track puts the vehicle

    def __len__(self) -> int:
        return len(self.kept)

    def __getitem__(self, k):
        if isinstance(k, slice):
            return tuple(self[i] for i in range(*k.indices(len(self))))
        kept = int(self.kept[k])
        member = self.member[k][self.member[k] >= 0]
        distance = self.distance[k][: len(member)]
        dropped = member != kept
        return RepeatChoice(
            array=int(self.reports.array[kept]),
            point_count=int(self.reports.point_count[kept]),
            kept_line=int(self.reports.line[kept]),
            dropped_lines=tuple(self.reports.line[member[dropped]].tolist()),
            kept_distance_ft=float(distance[~dropped][0]),
            dropped_distances_ft=tuple(distance[dropped].tolist()),
            reason=self._reason(k),
        )

    def _reason(self, k: int) -> str:
        if self.told[k]:
            return "this line was named as the one to keep"
        if self.neighbours[k] == 0:
            return f"the array has no other report within {NEIGHBOUR_COUNTS} counts; the first is kept"
        return f"nearest to the array's own track through {self.neighbours[k]} neighbours"


def choose_repeats(
    tracks: PositionReports, kept: np.ndarray, firsts: np.ndarray, keep_lines: Sequence[int] = ()
) -> tuple[np.ndarray, RepeatChoices]:
    """Reports (K,) without those not chosen of repeats, and every choice that was made.

    tracks : all reports of one vehicle in order of point count, those that no other array saw too, from which
        the array's own track near a repeat is taken
    kept : (K,) reports among which there are repeats
    firsts : (R,) which of these are the first of a repeat
    keep_lines : lines of the file to keep whatever their distance, which takes a choice back
    """
    firsts = firsts[np.lexsort((tracks.array[kept[firsts]], tracks.point_count[kept[firsts]]))]
    told = np.zeros(len(kept), np.bool_)
    if len(keep_lines):
        told = np.isin(tracks.line[kept], np.asarray(keep_lines, dtype=np.int64))
    most = _most_members(tracks.point_count, tracks.array, kept, firsts)
    member = np.full((len(firsts), most), -1, dtype=np.int64)
    distance = np.full((len(firsts), most), np.nan)
    chosen, neighbours = np.empty(len(firsts), np.int64), np.empty(len(firsts), np.int64)
    by_hand, keep = np.zeros(len(firsts), np.bool_), np.ones(len(kept), np.bool_)
    cuts = [*range(0, len(firsts), max(_FEWEST, len(firsts) // 4 + 1)), len(firsts)]
    columns = (tracks.point_count, tracks.array, tracks.position, kept, told, keep)
    rows = (firsts, member, distance, chosen, neighbours, by_hand)
    in_threads(_choose, [(*columns, *(row[a:b] for row in rows)) for a, b in pairwise(cuts)])
    return kept[keep], RepeatChoices(tracks, chosen, neighbours, by_hand, member, distance)


def resolve_repeats(
    reports: PositionReports, tracks: PositionReports
) -> tuple[PositionReports, RepeatChoices]:
    """Reports with one report for each array and point count, and every choice that was made.

    reports : some of the vehicle's reports, in order of point count
    tracks : all of them in that order, from which the array's own track near a repeat is taken
    """
    order = np.argsort(tracks.line, kind="stable")
    kept = order[np.searchsorted(tracks.line, reports.line, sorter=order)]
    kept, choices = choose_repeats(tracks, kept, find_repeats(reports.point_count, reports.array))
    return tracks.only(kept), choices


def predict_position(point_count: int, counts: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Where a track (K, 3) at `counts` (K,) puts the vehicle at `point_count`: (3,), NaN without a neighbour.

    Each two neighbours, of whom there are 10 at most and none farther than 12 counts, at different counts give a
    straight-line prediction; the answer is the median of these, weighted by how little each amplifies the
    neighbours' noise, so that a few wild neighbours do not move it.
    """
    predicted, size = np.empty(3), len(counts)
    if size > _MOST:
        raise ValueError(f"found {size} neighbours, wanted {_MOST} at most")
    away = np.asarray(counts, np.int64) - point_count
    if np.any(np.abs(away) > NEIGHBOUR_COUNTS):
        raise ValueError(
            f"found a neighbour {np.abs(away).max()} counts away, wanted {NEIGHBOUR_COUNTS} at most"
        )
    _predict(away, np.asarray(positions, np.float64), size, np.empty(_ROOM), predicted)
    return predicted


@compiled
def _predict(away, positions, size, work, predicted):
    """`predict_position` of neighbours so many counts `away`; work (_ROOM,) is to work in."""
    count = 0
    for i in range(size):
        for j in range(i + 1, size):
            if away[i] != away[j]:
                one, two = away[i] + NEIGHBOUR_COUNTS, away[j] + NEIGHBOUR_COUNTS
                share, work[_WEIGHT + count] = _SHARE[one, two], _QUIET[one, two]
                for axis in range(3):
                    work[_PAIRS * axis + count] = positions[i, axis] + share * (
                        positions[j, axis] - positions[i, axis]
                    )
                count += 1
    if count == 0:
        for axis in range(3):
            predicted[axis] = np.median(positions[:size, axis].copy()) if size else np.nan
        return
    for k in range(count, _PAIRS):
        for axis in range(3):
            work[_PAIRS * axis + k] = np.inf
        work[_WEIGHT + k] = 0.0
    _weighted_medians(work, count, predicted)


@compiled
def _weighted_medians(work, count, median):
    """In x, y and z the least prediction at which, with all below, half of the weight is reached.

    Weighs every prediction against every other, two at a time: that has no branches, where sorting has one a
    comparison. In one array, so that the compiler sees that what is added to is not what is compared.
    """
    work[_REACHED:] = 0.0
    total = 0.0
    for j in range(0, count, 2):
        weight, other = work[_WEIGHT + j], work[_WEIGHT + j + 1]
        total = total + weight + other
        for axis in range(3):
            row = _PAIRS * axis
            one, two = work[row + j], work[row + j + 1]
            for i in range(row, row + _PAIRS):
                reached = work[_REACHED + i] + (weight if one <= work[i] else 0.0)
                work[_REACHED + i] = reached + (other if two <= work[i] else 0.0)
    half = (0.5 - _TIE) * total
    for axis in range(3):
        least = np.inf
        for i in range(_PAIRS * axis, _PAIRS * (axis + 1)):
            least = min(least, work[i] if work[_REACHED + i] >= half else np.inf)
        median[axis] = least


@compiled
def _neighbours(point_count, array, position, report, away, near):
    """Fills the counts away and positions of the array's nearest other reports; how many there are."""
    count, size = point_count[report], 0
    for step in (-1, 1):
        k, side = report + step, 0
        while 0 <= k < len(point_count) and side < NEIGHBOURS_PER_SIDE:
            if abs(point_count[k] - count) > NEIGHBOUR_COUNTS:
                break
            if point_count[k] != count and array[k] == array[report]:
                away[size] = point_count[k] - count
                near[size] = position[k]
                size, side = size + 1, side + 1
            k += step
    return size


@compiled
def _most_members(point_count, array, kept, firsts):
    """Of how many reports the greatest repeat consists."""
    most = 1
    for first in firsts:
        size, k = 0, first
        while k < len(kept) and point_count[kept[k]] == point_count[kept[first]]:
            size += array[kept[k]] == array[kept[first]]
            k += 1
        most = max(most, size)
    return most


@compiled
def _choose(
    point_count, array, position, kept, told, keep, firsts, member, distance, chosen, neighbours, by_hand
):
    away, near, expected = np.empty(_MOST, np.int64), np.empty((_MOST, 3)), np.empty(3)
    work = np.empty(_ROOM)
    for r in range(len(firsts)):
        first = kept[firsts[r]]
        neighbours[r] = _neighbours(point_count, array, position, first, away, near)
        _predict(away, near, neighbours[r], work, expected)
        size, best, k = 0, firsts[r], firsts[r]
        least = np.inf
        while k < len(kept) and point_count[kept[k]] == point_count[first]:
            if array[kept[k]] == array[first]:
                square = 0.0
                for axis in range(3):
                    square += (position[kept[k], axis] - expected[axis]) ** 2
                member[r, size], distance[r, size] = kept[k], math.sqrt(square)
                if told[k] or (distance[r, size] < least and not by_hand[r]):
                    best, least = k, distance[r, size]
                by_hand[r] |= told[k]
                keep[k] = False
                size += 1
            k += 1
        keep[best] = True
        chosen[r] = kept[best]


@warms
def _warm() -> None:
    count, rows = np.array([1, 2, 2], np.int32), np.zeros(3, np.int16)
    line = np.arange(3, dtype=np.int32)
    reports = PositionReports(line, count, np.zeros((3, 3)), rows, rows, rows > 0)
    choose_repeats(reports, np.arange(3), np.array([1]))
    predict_position(1, count, np.zeros((3, 3)))
