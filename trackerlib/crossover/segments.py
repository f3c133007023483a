"""Straight pieces of one array's own track, for arrays that share no point count with another.

A piece is a run of point counts without a long gap over which one straight line at constant speed holds: no
parabola fits better. A run that bends is cut where two lines fit best, and each part is looked at again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.crossover.gating import GAP_COUNTS, MAX_SLANT_RANGE_FT, gate_mode_and_flag, gate_slant_range
from trackerlib.crossover.repeats import resolve_repeats
from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.smooth_track import is_curved
from trackerlib.crossover.straight_line import fit_straight_line
from trackerlib.crossover.survey import ArraySurvey

MIN_PIECE = 15  # points of the shortest piece that says where a line runs
CUT = 5.0  # robust standard deviations from the line beyond which a point is left out of its piece
SIGNIFICANCE = 1e-6  # of a bend: a vehicle's wobble is no turn
_CANDIDATES = 40  # places tried for a cut


@dataclass(frozen=True, eq=False)
class TrackSegment:
    """A straight piece of a vehicle's track as one array saw it."""

    array: int
    point_count: np.ndarray  # (T,) ascending
    position: np.ndarray  # (T, 3) downrange, crossrange, z (up), ft
    piece: int = 1  # pieces of one array, from 1
    range_name: str = ""
    source: str = ""


def straight_segments(
    reports: PositionReports,
    survey: ArraySurvey,
    mode: int,
    max_slant_range_ft: float = MAX_SLANT_RANGE_FT,
    gap_counts: int = GAP_COUNTS,
) -> tuple[TrackSegment, ...]:
    """Straight pieces of every surveyed array's track of one vehicle, by array, in order of point count."""
    vehicle = gate_mode_and_flag(reports, mode)
    segments = []
    for number in np.unique(vehicle.array).tolist():
        own = vehicle.only(vehicle.array == number)
        near = gate_slant_range(own, survey, max_slant_range_ft)
        if not len(near):
            continue
        own, _ = resolve_repeats(near, own)
        cuts = np.flatnonzero(np.diff(own.point_count) > gap_counts) + 1
        pieces = [
            piece
            for run in np.split(np.arange(len(own)), cuts)
            for piece in straight_pieces(own.point_count[run], own.position[run], run)
        ]
        segments += [
            TrackSegment(
                number, own.point_count[k].astype(np.int64), own.position[k], n, own.range_name, own.source
            )
            for n, k in enumerate(pieces, 1)
        ]
    return tuple(segments)


def straight_pieces(point_count: np.ndarray, track: np.ndarray, index: np.ndarray) -> list[np.ndarray]:
    """Those of `index` (T,) that make up each straight piece of a track (T, 3); wild points are left out."""
    if len(index) < MIN_PIECE:
        return []
    kept = _near_the_line(point_count, track)
    if kept.sum() >= MIN_PIECE and not is_curved(track[kept], point_count[kept], SIGNIFICANCE):
        return [index[kept]]
    if len(index) < 2 * MIN_PIECE:
        return []
    cut = _best_cut(point_count, track)
    parts = (slice(None, cut), slice(cut, None))
    return [piece for part in parts for piece in straight_pieces(point_count[part], track[part], index[part])]


def _near_the_line(point_count: np.ndarray, track: np.ndarray) -> np.ndarray:
    """Points (T,) within CUT robust standard deviations of a line that wild ones do not pull."""
    kept = np.ones(len(track), bool)
    for _ in range(8):
        away = np.linalg.norm(track - fit_straight_line(track, point_count, kept).at(point_count), axis=1)
        near = away <= CUT * max(1.4826 * np.median(away[kept]), 0.1)
        if near.sum() < MIN_PIECE or np.array_equal(near, kept):
            break
        kept = near
    return kept


def _best_cut(point_count: np.ndarray, track: np.ndarray) -> int:
    """Where to cut so that the middles of the distances from two lines are least in sum."""
    places = np.unique(np.linspace(MIN_PIECE, len(track) - MIN_PIECE, _CANDIDATES).astype(int))
    costs = []
    for cut in places:
        cost = 0.0
        for part in (slice(None, cut), slice(cut, None)):
            line = fit_straight_line(track[part], point_count[part])
            away = np.linalg.norm(track[part] - line.at(point_count[part]), axis=1)
            cost += np.sum(np.minimum(away, 50.0))  # a wild point does not decide
        costs.append(cost)
    return int(places[np.argmin(costs)])
