"""The wet-paper chart: arrivals folded at an interval, one line of paper a period, newest last.

A recorder's stylus starts at the left once every interval and marks the paper while sound comes
in. A beacon that repeats exactly at that interval draws a straight line down the paper; another
interval slants it, and a range that changes bends it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARK_MS = 10.0  # length of a beacon's pulse, and so of a mark
PAPER_NOISE = 26  # darkest grain of bare paper, of 255


@dataclass(frozen=True)
class ChartSettings:
    """How arrivals are laid on paper. Raises ValueError, naming the setting, for one that makes no sense."""

    interval_s: float = 2.0  # fold period: one line of paper
    columns: int = 1000  # marks across the paper
    offset_s: float = 0.0  # arrival time that falls on the left edge

    def __post_init__(self):
        if not 0.01 <= self.interval_s <= 600:
            raise ValueError(f"interval_s is {self.interval_s:g}; wanted 0.01 to 600 s")
        if not 50 <= self.columns <= 10_000:
            raise ValueError(f"columns is {self.columns}; wanted 50 to 10000")


def fold(arrival_s, interval_s: float, offset_s: float = 0.0) -> np.ndarray:
    """Arrival times modulo the interval, 0 to interval [s]: where on the paper each falls."""
    return np.mod(np.asarray(arrival_s, float) - offset_s, interval_s)


def chart_lines(
    arrival_s, settings: ChartSettings, first_line: int = 0, mark_ms: float = MARK_MS
) -> np.ndarray:
    """Lines of paper (N, columns) uint8, 0 bare to 255 darkest, one a ping in the order heard.

    arrival_s : (N,) one-way travel time plus any constant, NaN for a line without a mark
    first_line : number of the first line, which seeds its grain: a line drawn again looks the same
    A logged survey has no sound levels, so every mark is equally dark and the grain is the paper's.
    """
    arrival = np.atleast_1d(np.asarray(arrival_s, float))
    paper = (
        np.stack([_grain(first_line + k, settings.columns) for k in range(len(arrival))])
        if len(arrival)
        else np.zeros((0, settings.columns), np.uint8)
    )
    column = fold(arrival, settings.interval_s, settings.offset_s) / settings.interval_s * settings.columns
    width = max(mark_ms * 1e-3 / settings.interval_s * settings.columns, 3.0)
    for k in np.flatnonzero(np.isfinite(arrival)):
        _ink(paper[k], column[k], width, first_line + int(k))
    return paper


def _grain(line: int, columns: int) -> np.ndarray:
    """Bare paper: faint grain that belongs to its line number."""
    return np.random.default_rng(line).integers(0, PAPER_NOISE, columns, dtype=np.uint8)


def _ink(row: np.ndarray, column: float, width: float, line: int) -> None:
    """Burns one mark into a line: a sharp leading edge, a fading tail, the stylus's uneven bite."""
    columns = len(row)
    length = int(np.ceil(width * 1.6))
    place = (int(column) + np.arange(length)) % columns  # a mark that runs off the edge goes on at the left
    after = (np.arange(length) - width).clip(0) / (0.6 * width)
    bite = np.random.default_rng((line, 1)).uniform(0.75, 1.0, length)
    row[place] = np.maximum(row[place], (235 * bite * (1 - after).clip(0.1)).astype(np.uint8))
