"""Compiled passes over the reports of one vehicle, a point count at a time.

Reports stand in order of point count, so all that a gate asks of one point count lies side by side. Passes run
in threads that split where the point count changes.
"""

from __future__ import annotations

import math
import os

import numba
import numpy as np

from trackerlib.compiled import compiled, in_threads, warms

ALONE, UNPLACED, TOO_FAR, ALONE_IN_RANGE, KEPT = range(5)  # where a report ends
_BEFORE, _BEYOND = np.int64(-1 << 40), np.int64(1 << 40)  # below and above any array number
_BLOCK = 64  # reports whose ranges are judged together
_FEWEST = 50_000  # reports for which a thread of its own is worth its start


@compiled
def needs_no_gate(point_count, mode, flagged, wanted):
    """Whether all reports (N,) are of one mode without an edit mark; whether they stand in order of point count."""
    other = back = False
    for k in range(len(mode)):
        other |= flagged[k] | (mode[k] != wanted)
    for k in range(1, len(point_count)):
        back |= point_count[k] < point_count[k - 1]
    return not other, not back


def judge_reports(
    point_count: np.ndarray,
    array: np.ndarray,
    position: np.ndarray,
    place: np.ndarray,
    lowest: int,
    limit: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where each report (N,) ends: ALONE, UNPLACED, TOO_FAR, ALONE_IN_RANGE or KEPT; how many of each (5,); those KEPT.

    array : (N,) number of the reporting array
    place : (K, 3) surveyed positions of the arrays from number `lowest` on, NaN where one has none
    limit : greatest slant range
    """
    verdict = np.empty(len(point_count), dtype=np.uint8)

    def work(first: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
        part = slice(first, stop)
        _judge(point_count[part], array[part], position[part], place, lowest, limit, verdict[part])
        ended = [np.count_nonzero(verdict[part] == ends) for ends in range(5)]
        return np.array(ended), first + np.flatnonzero(verdict[part] == KEPT)

    ended, kept = zip(*in_threads(work, _stretches(point_count)), strict=True)
    return verdict, np.sum(ended, axis=0), np.concatenate(kept)


def match_pairs(point_count: np.ndarray, array: np.ndarray, arrays: int) -> tuple[np.ndarray, np.ndarray]:
    """Every two reports of one point count, by pair of arrays.

    array : (N,) rows from 0 to arrays - 1, in order of array number; each once at a point count
    Returns how many matches each pair has (arrays, arrays) and the two reports of each (2, P), pair by pair, in
    order of point count within one.
    """
    sizes = np.zeros(arrays * arrays, dtype=np.int64)
    _match(point_count, array, arrays, sizes, np.empty((2, 0), dtype=np.int64))
    place = np.cumsum(sizes) - sizes
    matches = np.empty((2, sizes.sum()), dtype=np.int64)
    _match(point_count, array, arrays, place, matches)
    return sizes.reshape(arrays, arrays), matches


def _stretches(point_count: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of reports, one a thread, that cut no point count in two."""
    size = len(point_count)
    parts = max(1, min(os.cpu_count() or 1, size // _FEWEST))
    cuts = [0]
    for k in range(1, parts):
        cuts.append(int(np.searchsorted(point_count, point_count[k * size // parts])))
    return list(zip(cuts, [*cuts[1:], size], strict=True))


@compiled
def _group_end(point_count, end, stop):
    """Where the reports at the point count of that before `end` end."""
    while end < stop and point_count[end] == point_count[end - 1]:
        end += 1
    return end


@compiled
def _judge_ranges(array, position, place, lowest, limit, verdict):
    """Fills UNPLACED, TOO_FAR or KEPT: without a branch, as which way it would go cannot be foreseen."""
    square = np.empty(_BLOCK)
    for first in range(0, len(verdict), _BLOCK):
        part = verdict[first : first + _BLOCK]
        for k in range(len(part)):
            report, row = np.uint64(first + k), np.uint64(array[first + k] - lowest)
            x = position[report, 0] - place[row, 0]
            y = position[report, 1] - place[row, 1]
            z = position[report, 2] - place[row, 2]
            square[k] = x * x + y * y + z * z
        # Apart, so that the compiler works on several at once: nothing is looked up here.
        for k in range(len(part)):
            part[k] = UNPLACED + (square[k] == square[k]) + 2 * (math.sqrt(square[k]) <= limit)


@compiled
def _keeps_one_array(array, verdict):
    """Whether all that are KEPT have the same array."""
    low, high = _BEYOND, _BEFORE
    for k in range(len(verdict)):
        number, kept = np.int64(array[k]), verdict[k] == KEPT
        low, high = min(low, number if kept else _BEYOND), max(high, number if kept else _BEFORE)
    return low == high


@compiled
def _judge(point_count, array, position, place, lowest, limit, verdict):
    _judge_ranges(array, position, place, lowest, limit, verdict)
    start, size = 0, 1
    while start < len(verdict):
        end = start + size  # as many as at the last point count, mostly
        if end > len(verdict) or point_count[end - 1] != point_count[start]:
            end = start + 1
        end = _group_end(point_count, end, len(verdict))
        size = end - start
        several, best = False, verdict[start]
        for k in range(numba.uint64(start), numba.uint64(end)):
            several |= array[k] != array[start]
            best = max(best, verdict[k])
        if not several:
            verdict[start:end] = ALONE
        elif best == KEPT and _keeps_one_array(array[start:end], verdict[start:end]):
            for k in range(start, end):
                verdict[k] -= verdict[k] == KEPT
        start = end


@compiled
def find_repeats(point_count, array):
    """Reports (R,) that are the first of several of their array at their point count."""
    found, count = np.empty(64, np.int64), 0
    start = 0
    while start < len(point_count):
        end, seen, doubtful = start, np.uint64(0), np.uint64(0)
        while end < len(point_count) and point_count[end] == point_count[start]:
            bit = np.uint64(1) << np.uint64(array[end] & 63)
            doubtful |= seen & bit
            seen |= bit
            end += 1
        for k in range(start, end if doubtful else start):
            earlier = later = False
            for j in range(start, k):
                earlier |= array[j] == array[k]
            for j in range(k + 1, end):
                later |= array[j] == array[k]
            if later and not earlier:
                if count == len(found):
                    found = np.concatenate((found, np.empty_like(found)))
                found[count] = k
                count += 1
        start = end
    return found[:count]


@compiled
def _match(point_count, array, arrays, place, matches):
    """Writes the matches of each pair from its place on, which moves; without room for any it only counts."""
    start = 0
    while start < len(point_count):
        end = _group_end(point_count, start + 1, len(point_count))
        for j in range(start, end):
            for k in range(j + 1, end):
                low, high = (j, k) if array[j] < array[k] else (k, j)
                pair = array[low] * arrays + array[high]
                if matches.shape[1] > 0:
                    matches[0, place[pair]], matches[1, place[pair]] = low, high
                place[pair] += 1
        start = end


@warms
def _warm() -> None:
    count, rows = np.zeros(2, np.int32), np.arange(2, dtype=np.int16)
    needs_no_gate(count, np.zeros(2, np.int8), np.zeros(2, np.bool_), 0)
    judge_reports(count, rows, np.zeros((2, 3)), np.zeros((2, 3)), 0, 1.0)
    find_repeats(count, rows)
    match_pairs(count, rows, 2)
