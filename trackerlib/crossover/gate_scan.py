"""Compiled passes over the reports of one vehicle, a point count at a time.

Reports stand in order of point count, so all that a gate asks of one point count lies side by side. Passes run
in threads that split where the point count changes.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import numpy as np

from trackerlib.compiled import compiled, in_threads, warms

ALONE, UNPLACED, TOO_FAR, ALONE_IN_RANGE, KEPT, REPEAT = range(6)  # where a report ends
_FEWEST = 50_000  # reports for which a thread of its own is worth its start


def judge_reports(
    point_count: np.ndarray, array: np.ndarray, position: np.ndarray, place: np.ndarray, limit: float
) -> np.ndarray:
    """Where each report (N,) ends: ALONE, UNPLACED, TOO_FAR, ALONE_IN_RANGE or KEPT.

    array : (N,) row of the reporting array in `place`
    place : (K, 3) surveyed positions, NaN where an array has none
    limit : greatest slant range
    """
    verdict = np.empty(len(point_count), dtype=np.uint8)
    _in_stretches(point_count, lambda a, b: _judge(point_count, array, position, place, limit, a, b, verdict))
    return verdict


def find_repeats(point_count: np.ndarray, array: np.ndarray, verdict: np.ndarray) -> np.ndarray:
    """Reports (R,) that are kept and the first of several of their array at their point count."""
    return np.concatenate(
        _in_stretches(point_count, lambda a, b: _repeats(point_count, array, verdict, a, b))
    )


def match_pairs(point_count: np.ndarray, array: np.ndarray, verdict: np.ndarray, arrays: int):
    """Every two kept reports of one point count, by pair of arrays.

    array : (N,) rows from 0 to arrays - 1, in order of array number
    Returns how many matches each pair has (arrays, arrays) and the two reports of each (2, P), pair by pair, in
    order of point count within one.
    """
    cuts = _stretches(point_count)
    sizes = np.array(
        in_threads(_count_pairs, [(point_count, array, verdict, arrays, a, b) for a, b in cuts])
    ).reshape(len(cuts), -1)
    # where each thread writes the first match of each pair
    starts = np.cumsum(np.concatenate([[0], sizes.T.ravel()]))[:-1].reshape(-1, len(cuts)).T.copy()
    matches = np.empty((2, sizes.sum()), dtype=np.int64)
    in_threads(
        _fill_pairs,
        [(point_count, array, verdict, arrays, a, b, starts[k], matches) for k, (a, b) in enumerate(cuts)],
    )
    return sizes.sum(axis=0).reshape(arrays, arrays), matches


def _in_stretches(point_count: np.ndarray, work: Callable) -> list:
    return in_threads(work, _stretches(point_count))


def _stretches(point_count: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of reports, one a thread, that cut no point count in two."""
    size = len(point_count)
    parts = max(1, min(os.cpu_count() or 1, size // _FEWEST))
    cuts = [0]
    for k in range(1, parts):
        cuts.append(int(np.searchsorted(point_count, point_count[k * size // parts])))
    return list(zip(cuts, [*cuts[1:], size], strict=True))


@compiled
def _group_end(point_count, start, stop):
    end = start + 1
    while end < stop and point_count[end] == point_count[start]:
        end += 1
    return end


@compiled
def _judge(point_count, array, position, place, limit, first, stop, verdict):
    start = first
    while start < stop:
        end = _group_end(point_count, start, stop)
        alone = True
        for k in range(start + 1, end):
            alone &= array[k] == array[start]
        nearest, several = -1, False
        for k in range(start, end):
            if alone:
                verdict[k] = ALONE
                continue
            row = array[k]
            square = 0.0
            for axis in range(3):
                square += (position[k, axis] - place[row, axis]) ** 2
            slant_range = math.sqrt(square)
            verdict[k] = TOO_FAR if slant_range > limit else KEPT
            if math.isnan(place[row, 0]):
                verdict[k] = UNPLACED
            if verdict[k] == KEPT:
                several |= nearest >= 0 and nearest != row
                nearest = row
        for k in range(start, end):
            if verdict[k] == KEPT and not several:
                verdict[k] = ALONE_IN_RANGE
        start = end


@compiled
def _repeats(point_count, array, verdict, first, stop):
    found, count = np.empty(64, np.int64), 0
    start = first
    while start < stop:
        end = _group_end(point_count, start, stop)
        for k in range(start, end):
            if verdict[k] != KEPT:
                continue
            earlier = later = False
            for j in range(start, end):
                same = j != k and verdict[j] == KEPT and array[j] == array[k]
                earlier |= same and j < k
                later |= same and j > k
            if later and not earlier:
                if count == len(found):
                    found = np.concatenate((found, np.empty_like(found)))
                found[count] = k
                count += 1
        start = end
    return found[:count]


@compiled
def _count_pairs(point_count, array, verdict, arrays, first, stop):
    sizes = np.zeros(arrays * arrays, np.int64)
    start = first
    while start < stop:
        end = _group_end(point_count, start, stop)
        for j in range(start, end):
            for k in range(j + 1, end):
                if verdict[j] == KEPT and verdict[k] == KEPT:
                    low, high = min(array[j], array[k]), max(array[j], array[k])
                    sizes[low * arrays + high] += 1
        start = end
    return sizes


@compiled
def _fill_pairs(point_count, array, verdict, arrays, first, stop, place, matches):
    start = first
    while start < stop:
        end = _group_end(point_count, start, stop)
        for j in range(start, end):
            for k in range(j + 1, end):
                if verdict[j] == KEPT and verdict[k] == KEPT:
                    low, high = (j, k) if array[j] < array[k] else (k, j)
                    pair = array[low] * arrays + array[high]
                    matches[0, place[pair]], matches[1, place[pair]] = low, high
                    place[pair] += 1
        start = end


@warms
def _warm() -> None:
    count, rows = np.zeros(2, np.int32), np.arange(2, dtype=np.int16)
    verdict = judge_reports(count, rows, np.zeros((2, 3)), np.zeros((2, 3)), 1.0)
    find_repeats(count, rows, verdict)
    match_pairs(count, rows, verdict, 2)
