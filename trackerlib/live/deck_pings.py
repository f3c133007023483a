"""Ranges of a deck unit as pings: half the two-way time, where the ship was between question and reply.

    placer = RangePlacer(turnaround_s=0.013)
    for heard_s, found in feed.poll():
        placer.hear(heard_s, found)
    placer.pings(time.time())            # those whose place is known by now
    pings_of_ranges(read_session(Path("deck.session")))

Ranges and positions are tied by the host's clock, by which both were heard; see `trackerlib.live.hunt`.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trackerlib.beacon.navigation import PositionLimits, ship_at_receptions
from trackerlib.beacon.pings import Ping, PingLog, Pings
from trackerlib.live.navigation_stream import DeckUnitRange, Fix, fixes_of
from trackerlib.live.recorded_pings import utc_at
from trackerlib.live.session_file import RecordedSession
from trackerlib.surveyfiles.reading import DEFAULT_TURNAROUND_S

PATIENCE_S = 10.0  # that a range waits for a position
KEPT_FIXES = 10_000
USUAL_LIMITS = PositionLimits()


class RangePlacer:
    """Takes ranges and positions as they come; gives each range as a ping once the ship's place is known.

    turnaround_s : of the transponder, taken off where the deck unit has not done so
    """

    def __init__(
        self,
        turnaround_s: float = DEFAULT_TURNAROUND_S,
        hydrophone_depth_m: float = 0.0,
        kept_fixes: int | None = KEPT_FIXES,
    ):
        self.turnaround_s, self.hydrophone_depth_m = turnaround_s, hydrophone_depth_m
        self.ranges = 0  # heard, with a reply or not
        self.no_reply = self.too_short = self.unplaced = 0  # of these, that gave no ping
        self._fixes: deque[Fix] = deque(maxlen=kept_fixes)
        self._late_s = math.inf  # how late the host hears a position, at least
        self._waiting: list[
            Ping
        ] = []  # without a place; `clock_s` is the host's half-way between question and reply

    def hear(self, heard_s: float, found: Fix | DeckUnitRange) -> None:
        """Takes a position or a range and when it was heard by the host's clock [s]."""
        if isinstance(found, Fix):
            self._fixes.append(found)
            self._late_s = min(self._late_s, heard_s - found.time_s)
            return
        self.ranges += 1
        if found.two_way_s is None:
            self.no_reply += 1
            return
        inside = found.two_way_s - (0.0 if found.turnaround_removed else self.turnaround_s)
        if inside <= 0:
            self.too_short += 1
            return
        half_way_s = heard_s - (inside + self.turnaround_s) / 2
        self._waiting.append(
            Ping(self.ranges, math.nan, math.nan, inside / 2, half_way_s, up_m=-self.hydrophone_depth_m)
        )

    def pings(
        self,
        now_s: float,
        limits: PositionLimits = USUAL_LIMITS,
        antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> list[Ping]:
        """The ranges that have a place by now, in order; one that waited PATIENCE_S for it is given up.

        limits, antenna_offset_m : as ship_at_receptions has them
        """
        if not self._waiting or not self._fixes:
            self._give_up(now_s)
            return []
        half_way_s = (
            np.array([ping.clock_s for ping in self._waiting]) - self._late_s
        )  # by the positions' clock
        ship = ship_at_receptions(fixes_of(self._fixes), half_way_s, limits, antenna_offset_m)
        placed, waiting = [], []
        for k, ping in enumerate(self._waiting):
            if ship.accepted[k]:
                utc = utc_at(0.0, half_way_s[k : k + 1])[0]
                placed.append(_at(ping, float(ship.lat_deg[k]), float(ship.lon_deg[k]), utc))
            else:
                waiting.append(ping)
        self._waiting = waiting
        self._give_up(now_s)
        return placed

    def _give_up(self, now_s: float) -> None:
        still = [ping for ping in self._waiting if now_s - ping.clock_s <= PATIENCE_S]
        self.unplaced += len(self._waiting) - len(still)
        self._waiting = still


def _at(ping: Ping, lat_deg: float, lon_deg: float, utc: np.datetime64) -> Ping:
    return Ping(ping.number, lat_deg, lon_deg, ping.travel_time_s, ping.clock_s, ping.up_m, utc)


def pings_of_ranges(
    session: RecordedSession, source: str = "", simulated: bool = False, hydrophone_depth_m: float = 0.0
) -> tuple[Pings, RangePlacer]:
    """Pings of the ranges that a recorded session holds, and the placer, which counts those that gave none."""
    turnaround_s = session.settings.get("turnaround_s", DEFAULT_TURNAROUND_S)
    placer, log = RangePlacer(turnaround_s, hydrophone_depth_m, None), PingLog(source, simulated)
    for heard_s, fix in session.fixes:
        placer.hear(heard_s, fix)
    for one in session.ranges:
        placer.hear(one.utc_s, one)
    for ping in placer.pings(math.inf):
        log.add(ping)
    return log.pings(), placer
