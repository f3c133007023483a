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

# of elapsed time: how far the two clocks may drift apart, a miscalibrated sample interval included
CREEP = 1e-3


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
        self.last: int | None = None  # the last number given
        self._earliest = self._latest = math.nan  # between which period 0 ended
        self._at_s = math.nan
        self._least = 0  # the next buffer is of this period or a later one
        self._newest = 0  # no buffer of a later period than this has been sent
        self._nothing_s = -math.inf  # when last nothing new was ready

    def number(self, before_s: float, after_s: float) -> int | None:
        """The period of a buffer that was asked for at one instant and there at another; None if it may be of two."""
        if self.last is None:
            self._earliest = max(after_s - self.period_s, self._nothing_s)
            self._latest = self._at_s = after_s
            self.last, self._least = 0, 1
            return 0
        self._creep(after_s)
        # The next one was not ready yet, and this one was not when there was nothing.
        ended = max(
            (before_s - self._latest) / self.period_s, (self._nothing_s - self._latest) / self.period_s + 1
        )
        lowest = max(self._least, math.floor(ended))
        highest = self._newest_by(after_s)
        self._least, self._newest = lowest + 1, max(self._newest, highest)
        if highest != lowest:
            return None
        self.last = lowest
        self._latest = min(self._latest, after_s - lowest * self.period_s)
        self._earliest = min(self._earliest, self._latest)
        return lowest

    def not_ready(self, before_s: float) -> None:
        """Takes note that no new buffer was ready at an instant."""
        self._nothing_s = before_s
        if self.last is not None:
            self._creep(before_s)
            ended = before_s - (self._newest + 1) * self.period_s
            self._earliest = min(max(self._earliest, ended), self._latest)

    def lost(self, after_s: float) -> None:
        """Takes note that a buffer may have been sent by an instant that did not arrive."""
        if self.last is not None:
            self._creep(after_s)
            self._newest = max(self._newest, self._newest_by(after_s))

    def _newest_by(self, instant_s: float) -> int:
        """Number of the newest period that may have ended by an instant."""
        return math.floor((instant_s - self._earliest) / self.period_s)

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
