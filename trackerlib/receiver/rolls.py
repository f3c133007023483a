"""What was heard, kept so that it can be laid on paper again at any interval: sound, marks, or logged pings.

    roll = SoundRoll("hunt.wav", sample_interval_s=1e-3)
    roll.feed(detector.feed(samples))                     # from a worker's thread
    roll.lines(settings, first, roll.whole_lines(settings), threshold=0)

A roll is fed by one thread while another draws it.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes, ship_at_receptions
from trackerlib.beacon.pings import Pings
from trackerlib.receiver.arrivals import Arrivals, Heard, joined
from trackerlib.receiver.chart import (
    MARK_DARKNESS,
    ChartSettings,
    chart_lines,
    fold,
    grained,
    left_edge,
    level_lines,
    line_of,
    mark_lines,
)
from trackerlib.receiver.front_end import DB_PER_COUNT

NO_FIXES = NavigationFixes(*[np.empty(0)] * 4)
NEAR_S = 60.0  # positions farther than this from an instant say nothing of it
MOST_PARTS = 32  # pieces of arrivals kept apart before they are put together


@dataclass(frozen=True, eq=False)
class LineValues:
    """What stands beside each of N lines of paper; NaN where it is not known."""

    level: np.ndarray  # (N,) 0 to 255, of the strongest arrival
    noise: np.ndarray  # (N,) 0 to 255
    snr_db: np.ndarray  # (N,) of the strongest arrival
    attenuation_db: np.ndarray  # (N,)
    missed: np.ndarray  # (N,) whether nothing above the threshold was heard
    lat_deg: np.ndarray  # (N,) of the ship
    lon_deg: np.ndarray


class Roll:
    """Arrivals on the clock of a stream, and where the ship was; a line of paper is one fold interval."""

    noise_is = "median level of the line"

    def __init__(self, source: str, simulated: bool = False):
        self.source, self.simulated = source, simulated
        self.until_s = 0.0  # how much of the stream is known
        self.fixes = NO_FIXES
        self._parts: list[Arrivals] = []
        self._lock = threading.Lock()

    @property
    def arrivals(self) -> Arrivals:
        """All so far, by period and rank."""
        with self._lock:
            if len(self._parts) != 1:
                self._parts = [joined(self._parts)]
            return self._parts[0]

    def add(self, arrivals: Arrivals, until_s: float) -> None:
        """More arrivals; the stream is now known until then."""
        with self._lock:
            if len(arrivals):
                self._parts.append(arrivals)
                if len(self._parts) > MOST_PARTS:
                    self._parts = [joined(self._parts)]
            self.until_s = until_s

    def whole_lines(self, settings: ChartSettings) -> int:
        """How many lines of paper are known from edge to edge."""
        return max(int((self.until_s - left_edge(settings, 0)) / settings.interval_s + 1e-9), 0)

    def where(self, settings: ChartSettings, time_s) -> tuple[np.ndarray, np.ndarray]:
        """Line of paper and time from its left edge of times of the stream (N,)."""
        return line_of(time_s, settings)

    def placed(self, settings: ChartSettings) -> tuple[Arrivals, np.ndarray, np.ndarray]:
        """The arrivals so far, and of each its line and its time from that line's left edge."""
        arrivals = self.arrivals
        return arrivals, *self.where(settings, arrivals.arrival_s)

    def time_of(self, settings: ChartSettings, line, fold_s) -> np.ndarray:
        """Time of the stream [s] of places on paper."""
        return left_edge(settings, 0) + np.asarray(line) * settings.interval_s + np.asarray(fold_s)

    def line_time(self, settings: ChartSettings, line) -> np.ndarray:
        """Time of the stream [s] that stands for a whole line."""
        return self.time_of(settings, line, settings.interval_s / 2)

    def ship(self, time_s) -> tuple[np.ndarray, np.ndarray]:
        """Latitude and longitude of the ship at times of the stream, NaN where not known."""
        if len(self.fixes.time_s) < 2:
            nothing = np.full(len(np.atleast_1d(time_s)), np.nan)
            return nothing, nothing
        time_s = np.atleast_1d(time_s)
        if not len(time_s):
            return time_s, time_s
        fixes = self.fixes
        near = (fixes.time_s > time_s.min() - NEAR_S) & (fixes.time_s < time_s.max() + NEAR_S)
        columns = (fixes.time_s, fixes.lat_deg, fixes.lon_deg, fixes.hdop)
        ship = ship_at_receptions(NavigationFixes(*(column[near] for column in columns)), time_s)
        return ship.lat_deg, ship.lon_deg

    def lines(self, settings: ChartSettings, first: int, stop: int, threshold: float = 0.0) -> np.ndarray:
        """Lines of paper (stop - first, columns); what is fainter than the threshold leaves no mark."""
        raise NotImplementedError

    def beside(
        self, settings: ChartSettings, first: int, lines: np.ndarray, threshold: float = 0.0
    ) -> LineValues:
        """What stands beside these lines (N, columns), the first of which has that number."""
        count = len(lines)
        level, snr, gain = np.full((3, count), np.nan)
        arrivals, line, _ = self.placed(settings)
        rows = np.flatnonzero((line >= first) & (line < first + count))
        rows = rows[np.argsort(arrivals.level[rows], kind="stable")]  # of each line the strongest comes last
        at = line[rows] - first
        level[at], snr[at], gain[at] = (
            arrivals.level[rows],
            arrivals.snr_db[rows],
            arrivals.attenuation_db[rows],
        )
        noise = self._noise(at, arrivals.level[rows], lines)
        snr = np.where(np.isnan(snr), (level - noise) * DB_PER_COUNT, snr)
        lat, lon = self.ship(self.line_time(settings, first + np.arange(count)))
        return LineValues(level, noise, snr, gain, ~(level >= threshold), lat, lon)

    def _noise(self, at: np.ndarray, level: np.ndarray, lines: np.ndarray) -> np.ndarray:
        """Noise (N,) of lines; `level` of arrivals on line `at`, in rising order."""
        return np.median(lines, axis=1) if len(lines) else np.empty(0)


class SoundRoll(Roll):
    """Every level of a detector that listens to sound, and its arrivals.

    held_s : for how long after its levels an arrival may become known; a line waits for its arrivals until `finish`
    """

    def __init__(
        self, source: str, simulated: bool = False, sample_interval_s: float = 1e-3, held_s: float = 0.0
    ):
        super().__init__(source, simulated)
        self.sample_interval_s = sample_interval_s
        self._held_s = held_s
        self._levels, self._count = np.zeros(1 << 16, np.uint8), 0

    def finish(self) -> None:
        """The sound has ended: nothing is held back any more."""
        self.until_s = self._count * self.sample_interval_s

    def feed(self, heard: Heard) -> None:
        """What a detector found in one more block."""
        with self._lock:
            count = self._count + len(heard.levels)
            if count > len(self._levels):
                more = np.zeros(2 * count, np.uint8)
                more[: self._count] = self._levels[: self._count]
                self._levels = more
            self._levels[self._count : count] = heard.levels
            self._count = count
        self.add(heard.arrivals, max(count * self.sample_interval_s - self._held_s, 0.0))

    def lines(self, settings, first, stop, threshold=0.0):
        step = self.sample_interval_s
        begin = max(int(left_edge(settings, first) / step) - 1, 0)
        end = int(np.ceil(left_edge(settings, stop) / step)) + 1
        levels = self._levels[begin : min(end, self._count)]
        lines = level_lines(levels, settings, step, first, begin)[: stop - first]
        if threshold:
            lines = np.where(lines < threshold, 0, lines).astype(np.uint8)
        return grained(lines, first)

    def beside(self, settings, first, lines, threshold=0.0):
        if threshold:  # the noise is that of the sound, not of what the threshold left of it
            lines = self.lines(settings, first, first + len(lines))
        return super().beside(settings, first, lines, threshold)


class MarkRoll(Roll):
    """Arrivals without the sound between them, as the receiver's line gives: marks as dark as their levels."""

    noise_is = "faintest maximum of the period"

    def lines(self, settings, first, stop, threshold=0.0):
        arrivals, line, _ = self.placed(settings)
        rows = np.flatnonzero((line >= first) & (line < stop) & (arrivals.level >= threshold))
        return mark_lines(
            line[rows] - first,
            arrivals.arrival_s[rows],
            arrivals.level[rows],
            max(stop - first, 0),
            settings,
            first,
        )

    def _noise(self, at, level, lines):
        noise, loudest = np.full((2, len(lines)), np.nan)
        noise[at[::-1]] = level[::-1]
        loudest[at] = level
        return np.where(noise < loudest, noise, np.nan)


class PingRoll(Roll):
    """Pings of a survey log, a line each whatever the time between them: times without levels."""

    noise_is = "not in a survey log"

    def __init__(self, pings: Pings):
        super().__init__(pings.source, pings.simulated)
        self.pings = pings
        number, unknown = np.arange(len(pings)), np.full(len(pings), np.nan)
        level = np.full(len(pings), MARK_DARKNESS)
        ones = np.ones(len(pings), int)
        self.add(
            Arrivals(number, ones, pings.arrival_s, level, unknown, unknown, unknown),
            float(pings.arrival_s[-1]) if len(pings) else 0.0,
        )

    def whole_lines(self, settings):
        return len(self.pings)

    def where(self, settings, time_s):
        folded = fold(time_s, settings.interval_s, settings.offset_s)
        return np.searchsorted(self.pings.arrival_s, np.asarray(time_s) - 1e-9), folded

    def placed(self, settings):
        arrivals = self.arrivals
        folded = fold(arrivals.arrival_s, settings.interval_s, settings.offset_s)
        return arrivals, np.arange(len(folded)), folded

    def time_of(self, settings, line, fold_s):
        arrival = self.pings.arrival_s[line]
        off = np.asarray(fold_s) - fold(arrival, settings.interval_s, settings.offset_s)
        return arrival + np.mod(off + settings.interval_s / 2, settings.interval_s) - settings.interval_s / 2

    def line_time(self, settings, line):
        return self.pings.arrival_s[line]

    def ship(self, time_s):
        row = np.clip(np.searchsorted(self.pings.arrival_s, time_s), 0, len(self.pings) - 1)
        return self.pings.lat_deg[row], self.pings.lon_deg[row]

    def lines(self, settings, first, stop, threshold=0.0):
        return chart_lines(self.pings.arrival_s[first:stop], settings, first_line=first)

    def beside(self, settings, first, lines, threshold=0.0):
        rows = slice(first, first + len(lines))
        unknown = np.full(len(lines), np.nan)
        missed = np.isnan(self.pings.arrival_s[rows])
        return LineValues(
            unknown, unknown, unknown, unknown, missed, self.pings.lat_deg[rows], self.pings.lon_deg[rows]
        )
