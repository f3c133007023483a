"""Lines of a GPS, a gyro, an echo sounder or a deck unit, made into fixes that a beacon fix can use.

stream = NavigationStream()
for line in reader.drain():
    stream.feed(line.text, line.utc_s)
ship_at_receptions(stream.fixes(), arrival_s)
"""

from __future__ import annotations

import math
import re
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.live.nmea import Message, SentenceError, decode, instant_near, instant_on

KEPT = 1_000_000  # fixes: a day at ten a second and more
LONGEST_TWO_WAY_S = 1000.0  # as for logs of ranges; a beacon replies within seconds
HEADING_AGE_S = 2.0  # a heading older than this is not the ship's any more


@dataclass(frozen=True)
class Fix:
    """One position of the antenna."""

    time_s: float  # UTC, seconds since 1970
    lat_deg: float
    lon_deg: float
    hdop: float = math.nan  # NaN if not told
    heading_rad: float = math.nan  # of the bow from true north, NaN if not known


@dataclass(frozen=True)
class DeckUnitRange:
    """A reply that a deck unit timed."""

    utc_s: float  # when its line came
    two_way_s: float | None  # None: no reply
    turnaround_removed: bool  # the range line has it taken off, host mode does not


class NavigationStream:
    """Takes lines one by one; keeps positions, headings, depths and ranges, and counts what it could not use.

    A position whose sentence has no date gets the day nearest to the last dated one, else to when its line came.
    """

    def __init__(self, checksum_required: bool = True, kept: int = KEPT):
        self.checksum_required = checksum_required
        self.refused: Counter[str] = Counter()  # why, and how often
        self.last_refused = ""  # the latest in full
        self.depth_m: float | None = None
        self.course_true_deg: float | None = None
        self.speed_mps: float | None = None
        self.dated_by = "when the lines came"
        self.ranges: deque[DeckUnitRange] = deque(maxlen=kept)
        self._fixes: deque[Fix] = deque(maxlen=kept)
        self._reference_s: float | None = None
        self._heading_rad, self._heading_s = math.nan, -math.inf

    def feed(self, text: str, utc_s: float) -> Fix | DeckUnitRange | None:
        """Takes a line that came at an instant; the fix or range that it brought, if one."""
        try:
            deck = decode_deck_unit(text, utc_s)
        except SentenceError as error:
            self._refuse("a range that cannot be read", str(error))
            return None
        if deck is not None:
            self.ranges.append(deck)
            return deck
        try:
            message = decode(text, self.checksum_required)
            return None if message is None else self._take(message, utc_s)
        except SentenceError as error:
            self._refuse("a sentence that cannot be read", str(error))
        except ValueError as error:
            self._refuse("a time that is none", str(error))
        return None

    def fixes(self) -> NavigationFixes:
        """All positions kept, in the order they came."""
        return fixes_of(self._fixes)

    def _take(self, message: Message, utc_s: float) -> Fix | None:
        if message.heading_true_deg is not None:
            self._heading_rad, self._heading_s = math.radians(message.heading_true_deg), utc_s
        for name in ("depth_m", "course_true_deg", "speed_mps"):
            if getattr(message, name) is not None:
                setattr(self, name, getattr(message, name))
        instant = self._instant(message, utc_s)
        if message.no_position is not None:
            self._refuse(f"{message.kind}: {message.no_position}", f"{message.kind}: {message.no_position}")
            return None
        if message.position is None:
            return None
        if instant is None:
            self._refuse(f"{message.kind}: a position without a time", f"{message.kind} without a time")
            return None
        heading = self._heading_rad if utc_s - self._heading_s <= HEADING_AGE_S else math.nan
        place = message.position
        hdop = math.nan if place.hdop is None else place.hdop
        fix = Fix(instant, place.lat_deg, place.lon_deg, hdop, heading)
        self._fixes.append(fix)
        return fix

    def _instant(self, message: Message, utc_s: float) -> float | None:
        """When the message is of; what later ones are dated by."""
        if message.time_of_day_s is None:
            return None
        if message.date is not None:
            instant = instant_on(message.date, message.time_of_day_s)
            self.dated_by = message.kind
        else:
            reference = utc_s if self._reference_s is None else self._reference_s
            instant = instant_near(message.time_of_day_s, reference)
        if message.date is not None or self._reference_s is not None:
            self._reference_s = instant
        return instant

    def _refuse(self, why: str, words: str) -> None:
        self.refused[why] += 1
        self.last_refused = words


def fixes_of(fixes: Iterable[Fix]) -> NavigationFixes:
    """Single fixes as columns."""
    rows = [(fix.time_s, fix.lat_deg, fix.lon_deg, fix.hdop, fix.heading_rad) for fix in fixes]
    columns = np.array(rows, float).reshape(-1, 5).T
    heading = columns[4] if np.isfinite(columns[4]).any() else None
    return NavigationFixes(columns[0], columns[1], columns[2], columns[3], heading)


def decode_deck_unit(text: str, utc_s: float) -> DeckUnitRange | None:
    """The range of an EdgeTech deck unit's line; None if it is another line. SentenceError for a time that is none.

    Logging mode, `RNG: TX = 11.0 RX = 12.0 time = 08.807 Sec.`, has the turnaround time taken off and dashes for no
    reply; host mode, `IN 08807 mS`, has it in.
    """
    found = re.search(r"RNG:.*time\s*=\s*(\S+)\s*Sec", text, re.IGNORECASE)
    if found:
        if re.fullmatch(r"[-.]*-[-.]*", found[1]):
            return DeckUnitRange(utc_s, None, turnaround_removed=True)
        if not re.fullmatch(r"\d+\.\d+", found[1]):
            raise SentenceError(f"deck unit's time is {found[1]!r}; wanted seconds such as 08.807, or dashes")
        return DeckUnitRange(utc_s, _two_way(float(found[1])), turnaround_removed=True)
    found = re.fullmatch(r"\s*IN\s+(\d{1,6})\s*mS\s*", text)
    if found:
        return DeckUnitRange(utc_s, _two_way(int(found[1]) * 1e-3), turnaround_removed=False)
    return None


def _two_way(seconds: float) -> float:
    if not 0 < seconds < LONGEST_TWO_WAY_S:
        raise SentenceError(
            f"deck unit's time is {seconds:g} s; wanted more than 0, below {LONGEST_TWO_WAY_S:g}"
        )
    return seconds
