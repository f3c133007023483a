"""A matched filter's view of a stream: a gated carrier, the cells it is looked for in, their power block by block."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import gcd

import numpy as np

from trackerlib.receiver import demodulation as kernels

LEAST_CELLS_A_PULSE = 8
LEAST_SAMPLES_A_CELL = 4
LANES = 64  # a cell's sum is padded to whole rounds of this many samples


@dataclass(frozen=True, eq=False)
class MatchedFilter:
    """A gated carrier pulse and the cells in which it is looked for. Raises ValueError for what cannot be heard."""

    rate_hz: int
    carrier_hz: float  # rounded to a hertz; a moving ship shifts it by more
    pulse_s: float
    length: int = field(init=False)  # samples in a pulse
    cells_a_ms: int = field(init=False)
    cells: int = field(init=False)  # in a pulse
    rotation: np.ndarray = field(init=False)  # (2, M) cos and -sin of the carrier at sample n modulo M
    mixing: np.ndarray = field(init=False)  # (2, 2, width) the same over a shorter and a longer cell, padded

    def __post_init__(self):
        if self.rate_hz != int(self.rate_hz) or not 1000 <= self.rate_hz <= 10_000_000:
            raise ValueError(f"rate_hz is {self.rate_hz}; wanted a whole number, 1000 to 10000000 Hz")
        if not 100 <= self.carrier_hz < self.rate_hz / 2:
            raise ValueError(
                f"carrier_hz is {self.carrier_hz:g}; {self.rate_hz} samples a second carry 100 to "
                f"{self.rate_hz / 2:g} Hz"
            )
        shortest = max(4 / self.carrier_hz, LEAST_CELLS_A_PULSE * LEAST_SAMPLES_A_CELL / self.rate_hz)
        if not shortest <= self.pulse_s <= 1:
            raise ValueError(
                f"pulse_s is {self.pulse_s:g}; wanted {shortest:.2g} to 1 s at this rate and carrier"
            )
        rate, carrier = int(self.rate_hz), round(self.carrier_hz)
        finest = max(rate // (1000 * LEAST_SAMPLES_A_CELL), 1)
        each = min(int(np.ceil(LEAST_CELLS_A_PULSE * 1e-3 / self.pulse_s - 1e-9)), finest)
        phase = carrier * np.arange(rate // gcd(rate, carrier)) % rate  # whole numbers: exact at any sample
        rotation = np.stack([np.cos(2 * np.pi * phase / rate), -np.sin(2 * np.pi * phase / rate)])
        shorter = rate // (1000 * each)
        mixing = np.zeros((2, 2, -(-(shorter + 1) // LANES) * LANES), np.float32)
        for row in (0, 1):
            mixing[row, :, : shorter + row] = rotation[:, np.arange(shorter + row) % rotation.shape[1]]
        for name, value in (
            ("rate_hz", rate),
            ("length", round(self.pulse_s * rate)),
            ("cells_a_ms", each),
            ("cells", max(int(self.pulse_s * 1000 * each + 1e-9), 1)),
            ("rotation", rotation),
            ("mixing", mixing),
        ):
            object.__setattr__(self, name, value)

    @property
    def cells_per_s(self) -> int:
        """How many cells a second of sound makes."""
        return 1000 * self.cells_a_ms

    def start_of(self, cell: int) -> int:
        """First sample of a cell."""
        return cell * self.rate_hz // self.cells_per_s


class CellStream:
    """Sound taken block by block, kept as samples, cells and powers for as long as `behind` and `room` ask.

    `power[c - base]` belongs to the pulse-long window that ends with cell c. `scale` is that of the levels on
    paper: the level of a power of 1, and levels an octave of power.
    """

    def __init__(self, matched: MatchedFilter, behind: int, room: int, scale: tuple[float, float]):
        self.matched = matched
        self.base = -behind  # cell of the first place; nothing sounded before the stream
        self.done = 0  # first cell that is not complete
        self.filled = -matched.start_of(-behind)  # samples known from the first place on
        self._behind = behind
        longest = self.filled + matched.start_of(room) + 1
        self.buffer = np.zeros(longest + matched.mixing.shape[2], np.float32)
        self.iq = np.zeros((2, behind + room), np.float32)
        self.power = np.zeros(behind + room, np.float32)
        self.scale = np.array(scale, np.float32)
        self._limit = self.filled + matched.start_of(room) - 1  # start_of of any other base differs by one
        numbers = (matched.rate_hz, matched.cells_per_s, matched.cells, matched.cells_a_ms)
        self._fixed = (numbers, matched.mixing, matched.rotation, self.iq, self.power, self.scale)

    def take(self, samples: np.ndarray) -> tuple[int, np.ndarray]:
        """Takes as many samples (K,) as there is room for; how many, and levels of the milliseconds they complete.

        Full scale of integers becomes 1. Raises ValueError for samples that are not finite.
        """
        count = min(len(samples), self._limit - self.filled)
        place = self.buffer[self.filled : self.filled + count]
        if samples.dtype.kind == "i":
            kernels.scale_whole_numbers(samples[:count], np.float32(2.0 ** (1 - 8 * samples.itemsize)), place)
        else:
            place[:] = samples[:count]
        self.filled += count
        levels, done = kernels.advance(self.buffer, self.filled, self.base, self.done, *self._fixed)
        if done < 0:
            raise ValueError("samples are not finite numbers, or far beyond full scale")
        self.done = done
        return count, levels

    def end(self) -> None:
        """Lets silence follow the last sample."""
        self.buffer[self.filled :] = 0
        self.power[self.done - self.base :] = 0

    def forget(self, cell: int) -> None:
        """Drops what lies more than `behind` before a cell."""
        base = cell - self._behind
        shift = base - self.base
        samples = self.matched.start_of(base) - self.matched.start_of(self.base)
        self.filled -= samples
        self.buffer[: self.filled] = self.buffer[samples : samples + self.filled].copy()
        kept = self.done - base
        self.iq[:, :kept] = self.iq[:, shift : shift + kept].copy()
        self.power[:kept] = self.power[shift : shift + kept].copy()
        self.base = base
