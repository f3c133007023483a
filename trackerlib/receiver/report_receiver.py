"""The receiver of the report, from sound to arrivals: tuned amplifier, compressor, converter, running sum, maxima.

Wojcik (1993), chapter V and Appendix 2. The stages are in `carrier`, `front_end`, `maxima`; here they stand in a row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from trackerlib.compiled import compiled, warms
from trackerlib.receiver.arrivals import Arrivals, Heard, joined
from trackerlib.receiver.carrier import (
    TUNED_STATE,
    make_carrier,
    mix_down,
    tune,
    value_starts,
    whole_values,
)
from trackerlib.receiver.front_end import (
    ATTENUATIONS_DB,
    AUTOMATIC,
    GAIN_STATE,
    LEAST_V,
    SATURATION_V,
    Attenuator,
    compress,
    starting_attenuation,
)
from trackerlib.receiver.maxima import CANDIDATE, SUM_STATE, forget, judge, sum_levels

MEASURED_GAIN = 19_275  # of the preamplifier, (5-30): volts at the detector a volt at the input
FULL_SCALE_V = SATURATION_V * 10 ** (30 / 20) / MEASURED_GAIN  # 13 mV: just fits at the greatest attenuation
BANDWIDTHS_A_PULSE = 1.2  # measured: 120 Hz for 10 ms; (5-4) has 1
MOST_MAXIMA = 100
MOST_SAMPLES = 1_000_000  # in a period
DELAY_PHASES = 32  # places within a sample interval over which the delay is measured

NOTHING = joined(())


@dataclass(frozen=True)
class ReceiverSettings:
    """What the receiver is tuned to. Raises ValueError, naming the setting, for one that makes no sense."""

    carrier_hz: float = 10_000.0
    pulse_s: float = 0.010
    interval_s: float = 2.0  # of the pings; a period may hold any number of samples, whole or not
    maxima: int = 2
    window_s: float = 0.020
    sample_interval_s: float = 0.001  # the report's own clock gives 1.0005 ms, 2.001 s for 2000 counts
    attenuator: Attenuator = AUTOMATIC
    bandwidth_hz: float | None = None  # between -3 dB points; None: 1.2 over the pulse
    full_scale_v: float = FULL_SCALE_V  # at the preamplifier, of a sample of 1

    def __post_init__(self):
        for name, least, most in (
            ("carrier_hz", 1.0, 1e6),
            ("sample_interval_s", 1e-5, 0.1),
            ("pulse_s", self.sample_interval_s, 100 * self.sample_interval_s),
            ("window_s", self.sample_interval_s, 60.0),
            (
                "interval_s",
                4 * max(self.window_s, self.pulse_s),
                min(600.0, MOST_SAMPLES * self.sample_interval_s),
            ),
            ("maxima", 1, MOST_MAXIMA),
            ("full_scale_v", 1e-9, 1e3),
        ):
            if not least <= getattr(self, name) <= most:
                raise ValueError(f"{name} is {getattr(self, name):g}; wanted {least:g} to {most:g}")

    @property
    def taps(self) -> int:
        """Levels that are added: N + 1 of (5-5), 11 for a pulse of 10 ms."""
        return round(self.pulse_s / self.sample_interval_s) + 1

    @property
    def tuned_bandwidth_hz(self) -> float:
        """Bandwidth of the two tuned stages together."""
        most = 0.5 / self.sample_interval_s
        return self.bandwidth_hz or min(BANDWIDTHS_A_PULSE / self.pulse_s, most)

    @property
    def gain_db(self) -> float:
        """From a sample of 1 to decibels above the compressor's least voltage, without attenuation."""
        return 20 * math.log10(self.full_scale_v * MEASURED_GAIN / LEAST_V)


class ReportReceiver:
    """A `Detector`: takes sound block by block, gives levels and the largest maxima of every period.

    settings, rate_hz : what to listen for, and sound samples per second (samples within -1 to 1; full scale of
    integers becomes 1)
    Raises ValueError where sound of that rate cannot carry the carrier, and for samples that are not finite.
    """

    def __init__(self, settings: ReceiverSettings, rate_hz: float):
        self.settings, self.rate_hz = settings, rate_hz
        # From a pulse's leading edge to its maximum; it is off every arrival already.
        self.delay_s = pulse_delay(settings, rate_hz)
        self._chain = _Chain(settings, rate_hz)
        self._judged = 0  # periods
        self._window = settings.window_s / settings.sample_interval_s
        self._due = self._boundary(1) + 2 * self._window + 2

    def feed(self, samples: np.ndarray) -> Heard:
        """Levels and arrivals that these samples (K,) make known: an arrival, two windows after its period's end."""
        levels = self._chain.feed(samples)
        parts = []
        while self._chain.values > self._due:
            parts.append(self._judge())
        return Heard(levels, joined(parts) if parts else NOTHING)

    def finish(self) -> Heard:
        """Arrivals of the last period. A pulse that the end of the stream cuts off is left out."""
        end = self._chain.sound_samples
        silence_s = self.delay_s + 2 * self.settings.pulse_s + 2 * self.settings.sample_interval_s
        self._chain.feed(np.zeros(math.ceil(silence_s * self.rate_hz), np.float32))
        last_s = (end + 1) / self.rate_hz - self.settings.pulse_s
        parts = []
        while self._judged * self.settings.interval_s < last_s:
            parts.append(self._judge(last_s))
        return Heard(np.empty(0, np.uint8), joined(parts))

    def _boundary(self, period: int) -> float:
        """Sample number at which the sum of a pulse is greatest that begins as that period does."""
        return (period * self.settings.interval_s + self.delay_s) / self.settings.sample_interval_s

    def _judge(self, last_s: float = math.inf) -> Arrivals:
        """Arrivals of the next period, of pulses that begin no later than `last_s`."""
        settings, chain = self.settings, self._chain
        chosen = np.empty(settings.maxima, np.int64)
        low, high = self._boundary(self._judged), self._boundary(self._judged + 1)
        count = judge(chain.candidates, chain.found, low, high, self._window, chosen)
        picked = chain.candidates[chosen[:count]]
        arrival = picked["place"] * settings.sample_interval_s - self.delay_s
        picked, arrival = picked[arrival <= last_s], arrival[arrival <= last_s]
        period = np.full(len(picked), self._judged)
        unknown = np.full(len(picked), np.nan)
        chain.found = forget(chain.candidates, chain.found, high - 2 * self._window - 2)
        self._judged += 1
        self._due = self._boundary(self._judged + 1) + 2 * self._window + 2
        return Arrivals(
            period,
            np.arange(1, len(picked) + 1),
            arrival,
            picked["level"],
            picked["attenuation"],
            unknown,
            unknown,
        )


def first_attenuation(sound: np.ndarray, settings: ReceiverSettings, rate_hz: float) -> int:
    """Attenuation [dB] to start with, from the beginning of a stream (K,): a period of it, or more."""
    chain = _Chain(replace(settings, attenuator=Attenuator(False, ATTENUATIONS_DB[-1])), rate_hz)
    return starting_attenuation(int(np.max(chain.feed(sound), initial=0)))


class _Chain:
    """Every stage up to the local maxima of the running sum, with the state of each."""

    def __init__(self, settings: ReceiverSettings, rate_hz: float):
        interval = settings.sample_interval_s
        self.values = 0  # sample intervals that have been taken whole
        self.sound_samples = 0
        self.candidates, self.found = np.zeros(0, CANDIDATE), 0
        self._begun = np.empty(0, np.float32)  # sound of an interval that is not whole yet
        self._carrier = make_carrier(settings.carrier_hz, rate_hz, interval, settings.tuned_bandwidth_hz)
        self._tuned, self._gain = np.zeros(1, TUNED_STATE), np.zeros(1, GAIN_STATE)
        self._gain["step"] = settings.attenuator.step
        self._sum, self._ring = np.zeros(1, SUM_STATE), np.zeros(settings.taps, np.int64)
        self._automatic, self._gain_db = settings.attenuator.automatic, settings.gain_db
        self._period = settings.interval_s / interval
        self._room(int(self._period + 4 * settings.window_s / interval) + 64)

    def feed(self, samples: np.ndarray) -> np.ndarray:
        """Levels (M,) uint8 of the sample intervals that are whole now."""
        sound = np.ascontiguousarray(samples, np.float32)
        if samples.dtype.kind == "i":
            sound = sound * np.float32(2.0 ** (1 - 8 * samples.itemsize))
        self.sound_samples += len(sound)
        if len(self._begun):
            sound = np.concatenate([self._begun, sound])
        carrier = self._carrier
        most = int(len(sound) / carrier.samples_per_value) + 1
        if self.found + most // 2 + 1 > len(self.candidates):
            self._room(most + int(self._period))
        levels = np.empty(most, np.uint8)
        count, used, self.found, finite = _advance(
            sound,
            self.values,
            carrier.cosine,
            carrier.sine,
            carrier.pole,
            carrier.samples_per_value,
            self._tuned,
            self._gain,
            self._automatic,
            self._gain_db,
            self._period,
            levels,
            self._sum,
            self._ring,
            self.candidates,
            self.found,
        )
        if not finite:
            raise ValueError("found samples that are not finite numbers, wanted sound within -1 and 1")
        self._begun = sound[used:].copy()
        self.values += count
        return levels[:count]

    def _room(self, values: int) -> None:
        """Makes room for the maxima of that many samples more: at most one in two is one."""
        more = np.zeros(self.found + values // 2 + 1, CANDIDATE)
        more[: self.found] = self.candidates[: self.found]
        self.candidates = more


@compiled
def _advance(
    sound,
    first,
    cosine,
    sine,
    pole,
    samples_per_value,
    tuned,
    gain,
    automatic,
    gain_db,
    samples_per_period,
    levels,
    summed,
    ring,
    candidates,
    found,
):
    """All stages on one block; returns sample intervals done, sound samples used, candidates found, if all is finite.

    What is not finite stays in the tuned stages, so that the last value tells.
    """
    count = whole_values(first, len(sound), samples_per_value)
    starts = value_starts(first, count, samples_per_value)
    iq, power, attenuations = np.empty((count, 2), np.float32), np.empty(count), np.empty(count)
    mix_down(sound, starts, cosine, sine, iq)
    tune(iq, starts, len(cosine) - 1, tuned[0], pole, power)
    compress(power, first, gain[0], automatic, gain_db, samples_per_period, levels, attenuations)
    found = sum_levels(levels[:count], attenuations, first, summed[0], ring, candidates, found)
    return count, starts[count], found, count == 0 or np.isfinite(power[count - 1])


@lru_cache(maxsize=64)
def pulse_delay(settings: ReceiverSettings, rate_hz: float) -> float:
    """Seconds from a pulse's leading edge to the maximum of its sum, measured on the chain itself.

    A maximum lies where the sum gains at its new end what it loses at its old one, where the envelope is equally
    high one pulse apart; noise, gain and compressor bear on both alike, so that one delay serves all.
    """
    interval, pulse = settings.sample_interval_s, settings.pulse_s
    steady = replace(
        settings,
        attenuator=Attenuator(automatic=False),
        full_scale_v=SATURATION_V / MEASURED_GAIN / 4,
    )
    chain = _Chain(steady, rate_hz)
    apart = 6 * settings.taps
    start_s = (
        apart * np.arange(DELAY_PHASES) + settings.taps + np.arange(DELAY_PHASES) / DELAY_PHASES
    ) * interval
    sample = np.arange(math.ceil(apart * (DELAY_PHASES + 1) * interval * rate_hz))
    which = np.clip(np.searchsorted(start_s * rate_hz, sample + 1) - 1, 0, DELAY_PHASES - 1)
    since = sample - start_s[which] * rate_hz
    gate = np.clip(since + 0.5, 0, 1) * np.clip(pulse * rate_hz - since + 0.5, 0, 1)
    chain.feed(gate * np.cos(2 * np.pi * settings.carrier_hz * since / rate_hz))
    found = chain.candidates[: chain.found]
    delays = []
    for start in start_s / interval:
        near = found[(found["place"] > start) & (found["place"] < start + apart - 1)]
        delays.append(near["place"][np.argmax(near["total"])] - start)
    return float(np.mean(delays)) * interval


@warms
def _warm():
    receiver = ReportReceiver(ReceiverSettings(), 48_000.0)
    receiver.feed(np.zeros(4800, np.float32))
    receiver.finish()
