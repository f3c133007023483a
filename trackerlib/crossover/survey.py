"""Where the arrays of a range were surveyed to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.textfiles import InputError


@dataclass(frozen=True, eq=False)
class ArraySurvey:
    """Surveyed positions of the arrays of a range, in the range's frame."""

    number: np.ndarray  # (K,) integers, each once
    position: np.ndarray  # (K, 3) downrange, crossrange, z, ft; z up, negative below the surface
    survey_date: np.ndarray  # (K,) datetime64[D], NaT where the table has none
    placeholder: np.ndarray  # (K,) true where the row is no surveyed position
    source: str = ""  # file it came from

    def index_of(self, number: np.ndarray) -> np.ndarray:
        """Row (N,) of each array number (N,), -1 where it is not in the table."""
        number = np.asarray(number)
        if not len(self.number):
            return np.full(number.shape, -1)
        order = np.argsort(self.number)
        place = np.minimum(np.searchsorted(self.number, number, sorter=order), len(order) - 1)
        row = order[place]
        return np.where(self.number[row] == number, row, -1)

    def places_of(self, number: np.ndarray) -> np.ndarray:
        """Surveyed position (N, 3) of each array number (N,), NaN for one not in the table or a placeholder there."""
        row = self.index_of(number)
        known = row >= 0
        known[known] = ~self.placeholder[row[known]]
        place = np.full((len(row), 3), np.nan)
        place[known] = self.position[row[known]]
        return place

    def position_of(self, number: int) -> np.ndarray:
        """Position (3,) of one array, ft. Raises InputError if it is not in the table."""
        row = int(self.index_of(np.array([number]))[0])
        if row < 0:
            have = ", ".join(map(str, np.sort(self.number)))
            raise InputError(f"array {number} is not in the array table {self.source}; it has {have}")
        return self.position[row]


def find_placeholders(position: np.ndarray) -> np.ndarray:
    """Which positions (K, 3) are no survey of an array on the sea floor: true (K,).

    A z that is not below the surface; or a position round in all three (100, 100 and 10 ft) in a table
    where that is the exception. Of Table E.1 (Read 1990) these are arrays 9, 10, 27, 28 and 29.
    """
    above = position[:, 2] >= 0
    is_round = np.all(np.mod(position, (100.0, 100.0, 10.0)) == 0, axis=1) & ~above
    exception = is_round.sum() < 0.5 * (~above).sum()
    return above | (is_round & exception)
