"""Arrivals that a detector found in a stream of sound, and the levels that a recorder draws beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Receptions found in a stream, in order of period and then of rank."""

    period: np.ndarray  # (N,) integers: repetition periods since the stream's first sample, from 0
    rank: np.ndarray  # (N,) integers: 1 is the strongest of its period
    arrival_s: np.ndarray  # (N,) leading edge since the first sample, all filter delay taken off
    level: np.ndarray  # (N,) 0 to 255, as the recorder draws it
    attenuation_db: np.ndarray  # (N,) of the input at that time
    snr_db: np.ndarray  # (N,) of the pulse's energy over the noise's density; NaN where it is not told
    sigma_s: np.ndarray  # (N,) standard error of arrival_s; NaN where it is not told

    def __post_init__(self):
        lengths = {field.name: len(getattr(self, field.name)) for field in fields(self)}
        if len(set(lengths.values())) != 1:
            raise ValueError(f"columns of arrivals differ in length: {lengths}")

    def __len__(self) -> int:
        return len(self.period)


@dataclass(frozen=True, eq=False)
class Heard:
    """What became known with one more block of a stream."""

    levels: np.ndarray  # (M,) uint8, one a sample interval of the recorder, 0 bare to 255 darkest
    arrivals: Arrivals


class Detector(Protocol):
    """Takes a stream block by block; what it finds does not depend on where the blocks were cut."""

    def feed(self, samples: np.ndarray) -> Heard:
        """What became known with these samples (K,)."""

    def finish(self) -> Heard:
        """What the end of the stream makes known."""


def joined(parts: Sequence[Arrivals]) -> Arrivals:
    """The arrivals of several parts, in the order told."""
    if not parts:
        nothing = np.empty(0)
        return Arrivals(nothing.astype(int), nothing.astype(int), *[nothing] * 5)
    columns = (field.name for field in fields(Arrivals))
    return Arrivals(*(np.concatenate([getattr(part, name) for part in parts]) for name in columns))
