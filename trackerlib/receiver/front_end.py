"""Attenuator, logarithmic compressor, 8-bit converter and automatic gain of the report's receiver.

Wojcik (1993), sections 5.4 to 5.6, Table 5-2 and Appendix 2. A level is a converter's code turned round, as its program
stores it: 0 at 2 mV and below, 255 at 8 V and above, about 0.28 dB a count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackerlib.compiled import compiled, warms

ATTENUATIONS_DB = (0, 3, 9, 12, 18, 24, 30)  # Table 5-2
SATURATION_V, LEAST_V = 8.0, 0.002  # at the compressor's input
DYNAMIC_RANGE_DB = 20 * math.log10(SATURATION_V / LEAST_V)  # (5-10), 72 dB
FULL_CODE = 255
DB_PER_COUNT = DYNAMIC_RANGE_DB / FULL_CODE
COUNTS_PER_OCTAVE = 10 * math.log10(2) / DB_PER_COUNT  # of power
MORE_AT_OR_ABOVE, LESS_AT_OR_BELOW = 0xE8, 0x40  # largest level of a period; thresholds of the automatic gain

GAIN_STATE = np.dtype([("step", np.int64), ("largest", np.int64), ("period", np.int64)])
_STEPS_DB = np.array(ATTENUATIONS_DB, float)


@dataclass(frozen=True)
class Attenuator:
    """How the attenuator is set: by itself once a period, or by hand."""

    automatic: bool = True
    start_db: int = 0  # where it starts, and stays if it is not automatic

    def __post_init__(self):
        if self.start_db not in ATTENUATIONS_DB:
            steps = ", ".join(map(str, ATTENUATIONS_DB))
            raise ValueError(f"start_db is {self.start_db}; wanted one of {steps}")

    @property
    def step(self) -> int:
        """Place of the starting attenuation in ATTENUATIONS_DB."""
        return ATTENUATIONS_DB.index(self.start_db)


AUTOMATIC = Attenuator()


@compiled
def next_step(step, largest):
    """Step of the attenuator after a period whose largest level was `largest`.

    The program of the report has no step from 9 to 12 dB: from 9 dB it falls through to 0. Here every step leads
    to its neighbour.
    """
    if largest >= MORE_AT_OR_ABOVE:
        return min(step + 1, len(_STEPS_DB) - 1)
    if largest <= LESS_AT_OR_BELOW:
        return max(step - 1, 0)
    return step


@compiled
def compress(power, first, state, automatic, gain_db, samples_per_period, levels, attenuations):
    """Writes levels (M,) uint8 and the attenuation of each (M,) [dB]; the gain is set as each period begins.

    power : (M,) squared envelope of values from number `first` on, full scale 1; gain_db takes full scale to dB
    above the compressor's least voltage. state : a GAIN_STATE
    """
    boundary = _period_start(state.period + 1, samples_per_period)
    largest, attenuation = state.largest, _STEPS_DB[state.step]
    for k in range(len(power)):
        if first + k >= boundary:
            if automatic:
                state.step = next_step(state.step, largest)
            largest, attenuation = 0, _STEPS_DB[state.step]
            state.period += 1
            boundary = _period_start(state.period + 1, samples_per_period)
        counts = COUNTS_PER_OCTAVE * math.log2(max(power[k], 1e-300)) + (gain_db - attenuation) / DB_PER_COUNT
        level = np.int64(min(max(counts + 0.5, 0.0), 255.0))  # (5-25) to (5-27), then the converter
        largest = max(largest, level)
        levels[k] = level
        attenuations[k] = attenuation
    state.largest = largest


@compiled
def _period_start(period, samples_per_period):
    """First sample of a period, which may hold any number of samples, whole or not."""
    return np.int64(math.ceil(period * samples_per_period - 1e-9))


def starting_attenuation(largest: int) -> int:
    """The least attenuation [dB] that keeps levels below the upper threshold; `largest` is one at 30 dB.

    The original starts at 0 dB and takes up to six periods to come to a loud signal, saturated all the while; a
    recording can be looked at first.
    """
    if not largest:
        return 0
    most = ATTENUATIONS_DB[-1]
    fits = (db for db in ATTENUATIONS_DB if largest + (most - db) / DB_PER_COUNT < MORE_AT_OR_ABOVE)
    return next(fits, most)


@warms
def _warm():
    state, power = np.zeros(1, GAIN_STATE), np.full(2, 1e-6)
    levels, attenuations = np.empty(2, np.uint8), np.empty(2)
    compress(power, 0, state[0], True, 100.0, 1.0, levels, attenuations)
