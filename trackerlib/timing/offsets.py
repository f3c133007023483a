"""Timing offsets of many crossover sets, by day, run and array pair: what the constancy test starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class OffsetTable:
    """One offset a row, as in Table 1 of Read (1990)."""

    day: np.ndarray  # (N,) text
    run: np.ndarray  # (N,) text; runs of two days are two runs even where the text is the same
    pair: np.ndarray  # (N,) text, such as "4-55"
    offset_s: np.ndarray  # (N,)
    source: str = ""
    simulated: bool = False

    def __len__(self) -> int:
        return len(self.offset_s)

    @property
    def runs(self) -> dict[str, np.ndarray]:
        """Rows (N,) true of each run, in the order of the table; a name that two days share gets its day."""
        shared = {run for run in self.run if len(set(self.day[self.run == run])) > 1}
        keys = dict.fromkeys(zip(self.day, self.run, strict=True))
        return {
            f"{day}/{run}" if run in shared else str(run): (self.day == day) & (self.run == run)
            for day, run in keys
        }


def indicator(labels: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Columns (N, L), one of each label (N,) and 1 where a row has it; and the labels in order of appearance."""
    names = list(dict.fromkeys(map(str, labels)))
    return (labels.astype(str)[:, None] == np.array(names)[None]).astype(float), names
