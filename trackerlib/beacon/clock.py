"""The pinger's clock: when it emitted each ping, as numbers that are linear in the times heard.

Emission i comes at To + i T + i^2 D / 2. To is unknown unless times are true travel times; the interval T is told,
and its error and drift D can be estimated with the place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.pings import Pings
from trackerlib.beacon.settings import FixSettings


@dataclass(frozen=True, eq=False)
class PingerClock:
    """Which emission each of n pings was, and which linear unknowns its instant has."""

    count: np.ndarray  # (n,) emissions since that of the first ping used
    interval_s: float | None  # as told
    terms: int  # of offset, interval, drift: how many are unknown

    @property
    def _half(self) -> float:
        """Counts are scaled to this, so that the columns are of one size."""
        return max(float(np.ptp(self.count)) / 2, 1.0)

    def _powers(self, count: np.ndarray) -> np.ndarray:
        x = (count - (np.min(self.count) + self._half)) / self._half
        return np.stack([np.ones_like(x), x, x**2 / 2], axis=-1)[..., : self.terms]

    @property
    def columns(self) -> np.ndarray:
        """What one unit of each unknown adds to the times (n, terms)."""
        return self._powers(self.count)

    def emission(self, linear: np.ndarray, covariance: np.ndarray) -> Emission:
        """What the linear unknowns (terms or more,) and their covariance say of the clock, in its own words."""
        linear, covariance = linear[: self.terms], covariance[: self.terms, : self.terms]
        offset = float(self._powers(np.zeros(1))[0] @ linear)
        if self.terms < 2 or self.interval_s is None:
            return Emission(offset)
        middle = (np.min(self.count) + self._half) / self._half
        at_first = np.array([0.0, 1.0, -middle])[: self.terms] / self._half  # slope of the columns at count 0
        interval = self.interval_s + float(at_first @ linear)
        sigma = float(np.sqrt(at_first @ covariance @ at_first))
        if self.terms < 3:
            return Emission(offset, interval, sigma)
        per_hour = 1e6 * 3600 / (self._half * self.interval_s) ** 2
        return Emission(
            offset, interval, sigma, per_hour * float(linear[2]), per_hour * float(np.sqrt(covariance[2, 2]))
        )


@dataclass(frozen=True)
class Emission:
    """When pings came out, as a fix tells it."""

    offset_s: float  # the constant in the time of the first ping used
    interval_s: float | None = None  # at the first ping used; None: not estimated
    sigma_interval_s: float | None = None
    drift_ppm_per_hour: float | None = None  # of the interval, parts per million of it an hour
    sigma_drift_ppm_per_hour: float | None = None


def pinger_clock(pings: Pings, time_s: np.ndarray, allowed: np.ndarray, settings: FixSettings) -> PingerClock:
    """The clock behind the pings allowed (N,), their times time_s (n,) in order again."""
    terms = settings.clock_terms
    if settings.interval_s is None:
        return PingerClock(np.zeros(len(time_s)), None, terms)
    emitted = instants(pings, settings)[allowed] - (time_s if pings.timed else 0.0)
    return PingerClock(np.rint((emitted - emitted[:1]) / settings.interval_s), settings.interval_s, terms)


def instants(pings: Pings, settings: FixSettings) -> np.ndarray:
    """Instants (N,) [s] of the pings as logged, or by their numbers where only an interval is told."""
    if settings.interval_s and not pings.timed:
        return settings.interval_s * (pings.number - pings.number[:1])
    return pings.instant_s


def emission_instants(
    pings: Pings, time_s: np.ndarray, allowed: np.ndarray, settings: FixSettings
) -> np.ndarray:
    """Instants (N,) of emission since that of the first ping used, where those of reception are logged.

    Elsewhere the instants as they are. Reception less travel time is emission but for a constant, so no place is
    needed to tell it; pings that are not used are given the median travel time.
    time_s : (n,) times of the pings allowed (N,), in order again
    """
    logged = instants(pings, settings)
    if not pings.at_reception or not len(time_s):
        return logged
    travel = np.full(len(logged), float(np.median(time_s)))
    travel[allowed] = time_s
    emitted = logged - travel
    emitted = emitted - emitted[allowed][0]
    if settings.interval_s is not None:
        emitted[allowed] = settings.interval_s * np.rint(emitted[allowed] / settings.interval_s)
    return emitted
