"""What is asked of receiver and GPS, in which order, and what is done when they do not answer. No thread here.

    poller = ReceiverPoller(host, PollingSettings(), time.time, keeper)
    poller.look_afresh()
    while True: poller.step()

The attenuation is polled after each buffer, for the data reply does not carry it; what it shows then holds for
the next period, after the step that followed the buffer.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from trackerlib.live.navigation_stream import Fix
from trackerlib.live.nmea import instant_near
from trackerlib.live.sail_host import SailHost
from trackerlib.receiver.periods import Period, PeriodCounter
from trackerlib.receiver.sail import AUTOMATIC_GAIN, Fault, Maximum, ReceiverParameters, set_attenuator

PATIENCE = 3  # faults in a row after which the line is looked at afresh
UNSURE = 8  # buffers in a row of unknown period, after which counting begins anew
SILENT_PERIODS, SILENT_ANSWERS = 4.5, 8  # without a buffer, after which the receiver is told to start


@dataclass(frozen=True)
class PollingSettings:
    """What the receiver is told, and how it is asked; ValueError names a setting that makes no sense."""

    parameters: ReceiverParameters = field(default_factory=ReceiverParameters)
    sample_interval_s: float = 1e-3  # calibrated: the original's crystal may give 1.0005e-3
    attenuation: int | str = AUTOMATIC_GAIN
    poll_s: float = 0.2  # between two questions for a buffer
    position_every_s: float = 0.5  # at least this between two questions for a position
    gps_on_line: bool = True

    def __post_init__(self):
        set_attenuator(self.attenuation)
        for name, low, high in (
            ("sample_interval_s", 1e-5, 0.1),
            ("poll_s", 0.0, 60.0),
            ("position_every_s", 0.0, 3600.0),
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} is {getattr(self, name):g}; wanted {low:g} to {high:g}")

    @property
    def period_s(self) -> float:
        """Length of a period [s]."""
        return self.parameters.period_samples * self.sample_interval_s


class Keeper(Protocol):
    """Who is told what was heard."""

    def keep_period(self, run: int, period: Period) -> None:
        """A buffer came."""

    def keep_fix(self, heard_s: float, fix: Fix) -> None:
        """A position came."""

    def keep_fault(self, fault: Fault) -> None:
        """Something went wrong."""


class ReceiverPoller:
    """Asks one line, step by step, and tells a keeper what it hears.

    now : the host's clock, seconds since 1970
    runs : how many runs there have been before
    """

    def __init__(
        self,
        host: SailHost,
        settings: PollingSettings,
        now: Callable[[], float],
        keeper: Keeper,
        runs: int = 0,
    ):
        self.host, self.settings, self.now, self.keeper = host, settings, now, keeper
        self.run = runs  # how often sampling began
        self._begun = False
        self.uncertain = 0  # buffers of this run whose period could not be told
        self.attenuation_db = math.nan
        self.no_position = ""
        self.counter = PeriodCounter(settings.period_s)
        self._shown_after = -1  # the period after which the attenuation was shown
        self._in_a_row = self._empty = self._unsure = 0
        self._buffer_s = self._asked_position_s = -math.inf
        self._utc_s: float | None = None

    def look_afresh(self) -> Fault | None:
        """Finds the receiver, tells it what it has forgotten, and starts it if it does not sample."""
        found = self.host.resynchronise()
        if isinstance(found, Fault):
            return self._fault(found)
        known = self.host.has_parameters(self.settings.parameters)
        if isinstance(known, Fault):
            return self._fault(known)
        silent = self._silent()
        self._in_a_row = 0
        if known and self._begun and not silent:
            return None
        self.host.maxima(self.settings.parameters.maxima)  # a buffer from before is of no known period
        fault = None if known else self.host.write_parameters(self.settings.parameters)
        fault = fault or self.host.set_attenuation(self.settings.attenuation) or self.host.start()
        if fault is not None:
            return self._fault(fault)
        self._begin_run()
        return None

    def step(self) -> Fault | None:
        """One round of questions; a fault if the receiver cannot be found any more."""
        if (
            self.settings.gps_on_line
            and self.now() - self._asked_position_s >= self.settings.position_every_s
        ):
            self._asked_position_s = self.now()
            self._ask_position()
        self._ask_maxima()
        if self._in_a_row >= PATIENCE or self._silent():
            return self.look_afresh()
        return None

    def _begin_run(self) -> None:
        self.run += 1
        self._begun = True
        self.uncertain = self._unsure = self._empty = 0
        self.counter = PeriodCounter(self.settings.period_s)
        self._buffer_s = self.now()
        self._ask_attenuation(-1)

    def _silent(self) -> bool:
        waited = self.now() - self._buffer_s
        return self._empty >= SILENT_ANSWERS and waited > SILENT_PERIODS * self.settings.period_s

    def _ask_maxima(self) -> None:
        before = self.now()
        found = self.host.maxima(self.settings.parameters.maxima)
        after = self.now()
        if isinstance(found, Fault):
            self.counter.lost(after)
            self._fault(found)
        elif not found:
            self._in_a_row = 0
            self._empty += 1
            self.counter.not_ready(before)
        else:
            self._in_a_row = self._empty = 0
            self._buffer_s = after
            self._take(found, before, after)

    def _take(self, maxima: tuple[Maximum, ...], before: float, after: float) -> None:
        number = self.counter.number(before, after)
        if number is None:
            self.uncertain, self._unsure = self.uncertain + 1, self._unsure + 1
            self._shown_after = -2
            if self._unsure >= UNSURE:
                self._begin_run()
            return
        self._unsure = 0
        attenuation = self.attenuation_db if self._shown_after == number - 1 else math.nan
        samples = self.settings.parameters.period_samples
        self.keeper.keep_period(self.run, Period(number, after, maxima, attenuation, samples))
        self._ask_attenuation(number)

    def _ask_attenuation(self, after: int) -> None:
        found = self.host.attenuation()
        if isinstance(found, Fault):
            self._shown_after = -2
            self._fault(found)
        else:
            self.attenuation_db, self._shown_after = float(found), after

    def _ask_position(self) -> None:
        found = self.host.position()
        if isinstance(found, Fault):
            self.no_position = found.words
            self.keeper.keep_fault(found)
            return
        heard = self.now()
        # The GPS tells no date: midnight is between two fixes less than half a day apart.
        self._utc_s = instant_near(found.time_of_day_s, heard if self._utc_s is None else self._utc_s)
        self.no_position = found.no_position or ""
        if found.position is not None:
            place = found.position
            hdop = math.nan if place.hdop is None else place.hdop
            self.keeper.keep_fix(heard, Fix(self._utc_s, place.lat_deg, place.lon_deg, hdop))

    def _fault(self, fault: Fault) -> Fault:
        self._in_a_row += 1
        self.keeper.keep_fault(fault)
        return fault
