"""The wet-paper chart: sound or arrivals folded at an interval, one line of paper a period, newest last.

A recorder's stylus starts at the left once every interval and marks the paper while sound comes
in. A beacon that repeats exactly at that interval draws a straight line down the paper; another
interval slants it, and a range that changes bends it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MARK_MS = 10.0  # length of a beacon's pulse, and so of a mark
MARK_DARKNESS = 235.0  # of a mark whose level is not known, of 255
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
    dark = np.full(len(arrival), MARK_DARKNESS)
    return mark_lines(np.arange(len(arrival)), arrival, dark, len(arrival), settings, first_line, mark_ms)


def mark_lines(
    line,
    arrival_s,
    darkness,
    count: int,
    settings: ChartSettings,
    first_line: int = 0,
    mark_ms: float = MARK_MS,
) -> np.ndarray:
    """Lines of paper (count, columns) uint8 with a mark for each arrival.

    line : (N,) the line that each belongs to, less `first_line`; arrival_s : (N,) NaN for no mark
    darkness : (N,) of a mark, 0 to 255, such as a recorder's level
    """
    paper = grained(np.zeros((count, settings.columns), np.uint8), first_line)
    arrival = np.asarray(arrival_s, float)
    column = fold(arrival, settings.interval_s, settings.offset_s) / settings.interval_s * settings.columns
    width = max(mark_ms * 1e-3 / settings.interval_s * settings.columns, 3.0)
    for k in np.flatnonzero(np.isfinite(arrival)):
        _ink(paper[line[k]], column[k], width, first_line + int(line[k]), float(darkness[k]))
    return paper


def grained(lines: np.ndarray, first_line: int) -> np.ndarray:
    """Lines (N, columns) on paper, whose own faint grain shows where they are bare."""
    if not len(lines):
        return lines
    grain = np.stack([_grain(first_line + k, lines.shape[1]) for k in range(len(lines))])
    return np.maximum(lines, grain)


def line_of(arrival_s, settings: ChartSettings) -> tuple[np.ndarray, np.ndarray]:
    """Number of the line (N,) that each arrival falls on, and its time [s] from that line's left edge."""
    since = np.asarray(arrival_s, float) - left_edge(settings, 0)
    line = np.floor(since / settings.interval_s)
    return line.astype(int), since - line * settings.interval_s


def level_lines(
    levels: np.ndarray,
    settings: ChartSettings,
    sample_interval_s: float = 1e-3,
    first: int = 0,
    start: int = 0,
) -> np.ndarray:
    """Lines of paper (N, columns) uint8 from a recorder's levels: those from number `first` on that are whole.

    levels : (M,) uint8, one a sample interval, of samples from number `start` of the stream on
    Line 0 holds the stream's first sample; paper before it is bare. Edges are placed from the line's number, not from
    the line before, so that an interval of any fraction of a sample slants a trace evenly, without drift. A column
    shows the darkest of its samples, or where there are more columns than samples, the sample it falls in.
    """
    per_line = settings.interval_s / sample_interval_s
    across = np.arange(settings.columns + 1) / settings.columns
    lines, line = [], first
    while True:
        edges = np.floor(left_edge(settings, line) / sample_interval_s + across * per_line + 1e-6).astype(int)
        edges -= start
        if edges[-1] > len(levels):
            break
        bare = max(-edges[0], 0)
        piece = levels[max(edges[0], 0) : max(edges[-1], 0)]
        if bare:
            piece = np.concatenate([np.zeros(bare, np.uint8), piece])
        lines.append(np.maximum.reduceat(piece, np.minimum(edges[:-1] - edges[0], len(piece) - 1)))
        line += 1
    return np.stack(lines) if lines else np.zeros((0, settings.columns), np.uint8)


def left_edge(settings: ChartSettings, line: int) -> float:
    """Time of a line's left edge [s] since the stream's first sample; line 0 holds that sample."""
    early = -np.mod(-settings.offset_s, settings.interval_s)  # the last offset at or before the first sample
    return early + line * settings.interval_s


def _grain(line: int, columns: int) -> np.ndarray:
    """Bare paper: faint grain that belongs to its line number."""
    return np.random.default_rng(line).integers(0, PAPER_NOISE, columns, dtype=np.uint8)


def _ink(row: np.ndarray, column: float, width: float, line: int, darkness: float) -> None:
    """Burns one mark into a line: a sharp leading edge, a fading tail, the stylus's uneven bite."""
    columns = len(row)
    length = int(np.ceil(width * 1.6))
    place = (int(column) + np.arange(length)) % columns  # a mark that runs off the edge goes on at the left
    after = (np.arange(length) - width).clip(0) / (0.6 * width)
    bite = np.random.default_rng((line, 1)).uniform(0.75, 1.0, length)
    row[place] = np.maximum(row[place], (darkness * bite * (1 - after).clip(0.1)).astype(np.uint8))
