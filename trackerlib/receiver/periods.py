"""Buffers of maxima put in order of period, as arrivals by the receiver's own clock.

    counter = PeriodCounter(period_s=2.0)
    counter.number(before_s, after_s)      # the period that a buffer is of, or None if that cannot be told
    arrivals_of(periods, sample_interval_s=1.0005e-3)

The receiver numbers nothing. A buffer becomes ready when its period ends and is offered once, so the host counts
periods by when it got each buffer. Indices are whole samples of the receiver's clock: its sample interval is a
calibrated number (2000 counts of the original are 2.001 s), and times are only as good as it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.sail import SUM_SAMPLES, Maximum

CREEP = (
    1e-3  # of elapsed time: how far the two clocks may drift apart, a miscalibrated sample interval included
)


@dataclass(frozen=True)
class Period:
    """The maxima of one repetition period."""

    number: int  # since sampling began, from 0
    heard_s: float  # when the host had it, by its clock, seconds since 1970
    maxima: tuple[Maximum, ...]  # largest first
    attenuation_db: float  # during the period; NaN if not known
    period_samples: int


class PeriodCounter:
    """Tells the number of the period of each buffer from when it came, however late and with however many lost."""

    def __init__(self, period_s: float):
        self.period_s = period_s
        self.last: int | None = None
        self._earliest = self._latest = math.nan  # between which period 0 ended
        self._at_s = math.nan
        self._lost = False

    def number(self, before_s: float, after_s: float) -> int | None:
        """The period of a buffer that was asked for at one instant and there at another; None if it may be of two."""
        if self.last is None:
            self.last, self._at_s = 0, after_s
            self._earliest, self._latest = after_s - self.period_s, after_s
            return 0
        self._creep(after_s)
        lowest = max(self.last + 1, math.floor((before_s - self._latest) / self.period_s))
        highest = math.floor((after_s - self._earliest) / self.period_s)
        if highest != lowest:
            self._lost = True
            return None
        self.last, self._lost = lowest, False
        self._latest = min(self._latest, after_s - lowest * self.period_s)
        self._earliest = min(self._earliest, self._latest)
        return lowest

    def not_ready(self, before_s: float) -> None:
        """Takes note that no new buffer was ready at an instant."""
        if self.last is not None and not self._lost:
            self._creep(before_s)
            ended = before_s - (self.last + 1) * self.period_s
            self._earliest = min(max(self._earliest, ended), self._latest)

    def lost(self) -> None:
        """Takes note that a buffer may have been sent that did not arrive."""
        self._lost = True

    def _creep(self, now_s: float) -> None:
        slack = CREEP * max(now_s - self._at_s, 0.0)
        self._earliest -= slack
        self._latest += slack
        self._at_s = max(now_s, self._at_s)


def arrivals_of(periods: Sequence[Period], sample_interval_s: float) -> Arrivals:
    """Arrivals by the receiver's clock, in seconds since sampling began; levels are mean samples of the sums.

    sample_interval_s : calibrated
    An index is that of the last of SUM_SAMPLES samples, so the leading edge is that many less one before it.
    """
    rows = [
        (one.number, rank, one.number * one.period_samples + maximum.index - (SUM_SAMPLES - 1), maximum.value,
         one.attenuation_db)
        for one in periods
        for rank, maximum in enumerate(one.maxima, 1)
    ]  # fmt: skip
    number, rank, sample, value, attenuation = np.array(rows, float).reshape(-1, 5).T
    unknown = np.full(len(number), np.nan)
    return Arrivals(
        number.astype(int),
        rank.astype(int),
        sample * sample_interval_s,
        value / SUM_SAMPLES,
        attenuation,
        unknown,
        unknown,
    )


def receiver_start(periods: Sequence[Period], sample_interval_s: float) -> float:
    """When period 0 began by the host's clock [s]; NaN without a period.

    No buffer can be had before its period has ended, so the earliest one, counted back, tells it best.
    """
    starts = [one.heard_s - (one.number + 1) * one.period_samples * sample_interval_s for one in periods]
    return min(starts, default=math.nan)


def measured_sample_interval(periods: Sequence[Period]) -> tuple[float, float]:
    """Sample interval by the host's clock [s] and its standard error, from when buffers came; NaN from fewer than 3.

    A check of the calibration, not one: over an hour of polls a fifth of a second apart it is good to about 1 in
    10^5, where 2.001 s instead of 2 s is 5 in 10^4.
    """
    if len(periods) < 3:
        return math.nan, math.nan
    samples = np.array([(one.number + 1) * one.period_samples for one in periods], float)
    heard = np.array([one.heard_s for one in periods])
    samples, heard = samples - samples.mean(), heard - heard.mean()
    spread = float(samples @ samples)
    slope = float(samples @ heard) / spread
    scatter = heard - slope * samples
    return slope, math.sqrt(float(scatter @ scatter) / (len(heard) - 2) / spread)
