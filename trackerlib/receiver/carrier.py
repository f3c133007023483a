"""From sound to the envelope of one carrier: a complex value every sample interval, then the tuned response.

A sample interval (1 ms) holds a whole number of cycles of the usual carrier, so the in-phase and quadrature
parts are one small matrix product a block: no filter runs at the rate of the sound. Where it does not hold one, the
frame of each value still turns with its first sound sample, which leaves the magnitude as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackerlib.compiled import compiled, compiled_with, warms

# Only this kernel may reorder a sum: it is what lets it run on vectors. Every value goes through the same loop
# whatever the cut of the blocks, so its last bit does not depend on that.
_reordered = compiled_with("reassoc", "contract")

TUNED_STATE = np.dtype([(name, np.float64) for name in ("i1", "q1", "i2", "q2")])


@dataclass(frozen=True, eq=False)
class Carrier:
    """What the kernels need to know of a carrier in sound of some rate."""

    samples_per_value: float  # sound samples in a sample interval, not always whole
    cosine: np.ndarray  # (L,) float32, of the carrier since the first sample of a value
    sine: np.ndarray  # (L,) float32
    pole: np.ndarray  # (2,) complex: of a tuned stage, over a value of the lesser and of the greater length

    @property
    def shortest(self) -> int:
        """Fewest sound samples that a value is made of; at most one more."""
        return len(self.cosine) - 1


def make_carrier(carrier_hz: float, rate_hz: float, sample_interval_s: float, bandwidth_hz: float) -> Carrier:
    """Tables for a carrier; raises ValueError where the sound cannot carry it."""
    if not 0 < bandwidth_hz <= 0.5 / sample_interval_s:
        raise ValueError(
            f"bandwidth_hz is {bandwidth_hz:g}; wanted above 0, at most {0.5 / sample_interval_s:g}"
        )
    if carrier_hz + bandwidth_hz / 2 >= rate_hz / 2 or carrier_hz <= bandwidth_hz / 2:
        raise ValueError(
            f"found {rate_hz:g} samples per second, which carry sounds below {rate_hz / 2:g} Hz; "
            f"a carrier of {carrier_hz:g} Hz, {bandwidth_hz:g} Hz wide, needs more "
            f"than {2 * carrier_hz + bandwidth_hz:g}"
        )
    per_value = sample_interval_s * rate_hz
    if per_value < 2:
        raise ValueError(f"found {per_value:g} sound samples a sample interval, wanted 2 or more")
    shortest = math.floor(per_value + 1e-6)
    cycles = carrier_hz / rate_hz
    angle = 2 * np.pi * np.mod(cycles * np.arange(shortest + 1), 1.0)
    turn = np.exp(-2j * np.pi * np.mod(cycles * np.array([shortest, shortest + 1]), 1.0))
    return Carrier(
        per_value,
        np.cos(angle).astype(np.float32),
        np.sin(angle).astype(np.float32),
        stage_pole(bandwidth_hz, sample_interval_s) * turn,
    )


def stage_pole(bandwidth_hz: float, sample_interval_s: float) -> float:
    """Pole of each of two equal resonators whose cascade is `bandwidth_hz` wide between its -3 dB points.

    A resonator seen from its carrier is a low-pass of one pole. The carrier itself passes with gain one.
    """
    c, cosine = math.sqrt(2), math.cos(math.pi * bandwidth_hz * sample_interval_s)
    return ((c - cosine) - math.sqrt((c - cosine) ** 2 - (c - 1) ** 2)) / (c - 1)


@compiled
def value_start(value, samples_per_value):
    """Number of the sound sample that a value begins with; the tolerance absorbs the product's rounding."""
    return np.int64(np.ceil(value * samples_per_value - 1e-6))


@compiled
def whole_values(first, length, samples_per_value):
    """How many values, from number `first` on, lie whole in `length` sound samples that begin with it."""
    begin = value_start(first, samples_per_value)
    count = np.int64(length / samples_per_value) + 1
    while count > 0 and value_start(first + count, samples_per_value) > begin + length:
        count -= 1
    return count


@compiled
def value_starts(first, count, samples_per_value):
    """Sound sample that each value begins with, and the one after the last (count + 1,), from that of `first`."""
    starts = np.empty(count + 1, np.int64)
    origin = value_start(first, samples_per_value)
    for k in range(count + 1):
        starts[k] = value_start(first + k, samples_per_value) - origin
    return starts


@_reordered
def mix_down(sound, starts, cosine, sine, iq):
    """Writes the carrier's amplitude, in phase and in quadrature, in each sample interval to iq (M, 2).

    sound : float32; starts : (M + 1,) of `value_starts`
    """
    for k in range(len(iq)):
        piece = sound[starts[k] : starts[k + 1]]
        i, q = np.float32(0), np.float32(0)
        for j in range(len(piece)):
            i += piece[j] * cosine[j]
            q += piece[j] * sine[j]
        iq[k, 0] = 2 * i / len(piece)
        iq[k, 1] = 2 * q / len(piece)


@compiled
def tune(iq, starts, shortest, state, pole, power):
    """Squared envelope (M,) after the two tuned stages, of values iq (M, 2).

    starts : (M + 1,) of `value_starts`; shortest, pole : of the `Carrier`; state : a TUNED_STATE
    Right within half a sampling rate of the carrier (500 Hz). Beyond, the mean over a sample interval stands for
    the resonators: whole multiples of that rate vanish, the rest is down by 13 dB and more, then by these stages.
    """
    gain = 1 - abs(pole[0])
    i1, q1, i2, q2 = state.i1, state.q1, state.i2, state.q2
    for k in range(len(power)):
        i1, q1 = i1 + gain * iq[k, 0], q1 + gain * iq[k, 1]
        i2, q2 = i2 + gain * i1, q2 + gain * q1
        power[k] = i2 * i2 + q2 * q2
        turn = pole[starts[k + 1] - starts[k] - shortest]  # decays, into the frame of the next value
        i1, q1 = turn.real * i1 - turn.imag * q1, turn.real * q1 + turn.imag * i1
        i2, q2 = turn.real * i2 - turn.imag * q2, turn.real * q2 + turn.imag * i2
    state.i1, state.q1, state.i2, state.q2 = i1, q1, i2, q2


@warms
def _warm():
    carrier = make_carrier(10_000.0, 48_000.0, 1e-3, 120.0)
    tuned, power, iq = np.zeros(1, TUNED_STATE), np.empty(2), np.empty((2, 2), np.float32)
    starts = value_starts(0, whole_values(0, 96, carrier.samples_per_value), carrier.samples_per_value)
    mix_down(np.zeros(96, np.float32), starts, carrier.cosine, carrier.sine, iq)
    tune(iq, starts, carrier.shortest, tuned[0], carrier.pole, power)
