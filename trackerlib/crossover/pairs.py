"""Crossover data: one vehicle's track as two arrays saw it, over a common set of point counts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class CrossoverSet:
    """Track of one vehicle from two arrays over a common set of point counts (Read 1990, eq. 1)."""

    pair: tuple[int, int]  # array numbers; x is the first one's version of the track
    point_count: np.ndarray  # (T,) integers, ascending
    x: np.ndarray  # (T, 3) downrange, crossrange, z (up) from the first array, ft
    y: np.ndarray  # (T, 3) the same from the second array, ft
    pass_number: int = 1  # passes of one pair, from 1
    range_name: str = ""
    source: str = ""  # file it came from
    lines: np.ndarray | None = None  # (T, 2) lines of that file that the two versions stand in, from 1

    def __post_init__(self):
        if not self.x.shape == self.y.shape == (self.points, 3):
            shapes = {"x": self.x.shape, "y": self.y.shape}
            raise ValueError(f"a set of {self.points} point counts needs (T, 3) tracks, got {shapes}")

    @property
    def points(self) -> int:
        """How many point counts both arrays saw (the report's T)."""
        return len(self.point_count)

    @property
    def gap(self) -> np.ndarray:
        """Vector from the second array's version to the first's, W = X - Y (T, 3), eq. (7)."""
        return self.x - self.y

    def lower_first(self) -> CrossoverSet:
        """The same set with the version of the array of lower number first."""
        if self.pair[0] < self.pair[1]:
            return self
        lines = None if self.lines is None else self.lines[:, ::-1]
        return replace(self, pair=self.pair[::-1], x=self.y, y=self.x, lines=lines)

    def only(self, keep: np.ndarray | slice, pass_number: int | None = None) -> CrossoverSet:
        """The points where `keep` (T,) is true, or those of a slice, as the same pass or another of the pair."""
        return CrossoverSet(
            pair=self.pair,
            point_count=self.point_count[keep],
            x=self.x[keep],
            y=self.y[keep],
            pass_number=self.pass_number if pass_number is None else pass_number,
            range_name=self.range_name,
            source=self.source,
            lines=None if self.lines is None else self.lines[keep],
        )
