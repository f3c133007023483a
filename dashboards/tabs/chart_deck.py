"""A deck unit on its line, for one page: its ranges handed on as pings, where the ship was, and kept."""

from __future__ import annotations

import time
from pathlib import Path

from dashboards.session import Session
from dashboards.tabs.chart_live import hunt_file, hunt_of_ranges, named_port, raw_log_beside
from trackerlib.live.deck_pings import RangePlacer
from trackerlib.live.navigation_feed import FeedStatus, NavigationFeed
from trackerlib.textfiles import InputError


class LiveDeck:
    """At most one deck unit at a time; `poll` is called from the page's own tick.

    Positions come on the same line, or on one of their own.
    """

    def __init__(self, session: Session):
        self.session = session
        self.placer: RangePlacer | None = None
        self.file: Path | None = None
        self.placed = 0  # pings given to the hunt
        self._feeds: list[NavigationFeed] = []  # the unit's, and that of the positions if they have one
        self._queue = None

    @property
    def listening(self) -> bool:
        """Whether a unit is connected."""
        return bool(self._feeds)

    @property
    def status(self) -> tuple[FeedStatus, ...]:
        """How the lines are doing, the unit's first."""
        return tuple(feed.status for feed in self._feeds)

    def connect(self, where: str, positions: str, turnaround_s: float, folder: str) -> None:
        """Begins to listen. Raises InputError for an address or folder that makes no sense.

        positions : the line that positions come from, "" for the unit's own
        turnaround_s : of the transponder, in the times of the unit's host mode
        folder : where the hunt is kept, "" for nowhere
        """
        self.disconnect()
        ports = [named_port(where)] + ([named_port(positions)] if positions.strip() else [])
        if len({port.name for port in ports}) < len(ports):
            raise InputError(
                f"{ports[0].name} is the deck unit's own line; leave Positions from empty for that"
            )
        file = hunt_file(folder, "deck-")
        if file is not None:
            file.add_settings({"port": ports[0].name, "turnaround_s": turnaround_s})
        self.file = None if file is None else file.path
        self.placer, self.placed = RangePlacer(turnaround_s, self.session.fix_settings.hydrophone_depth_m), 0
        for port, name in zip(ports, ("deck-unit", "positions"), strict=False):
            self._feeds.append(NavigationFeed(port, file, raw_log_beside(file, name)))
            self._feeds[-1].start()

    def poll(self) -> None:
        """Takes what came, and hands on the ranges whose place is known."""
        if self.placer is None or not self._feeds:
            return
        for feed in self._feeds:
            for heard_s, found in feed.poll():
                self.placer.hear(heard_s, found)
        where = self.session.position_limits, self.session.antenna_offset_m
        for ping in self.placer.pings(time.time(), *where):
            if self._queue is None:
                self._queue = hunt_of_ranges(self.session, f"deck unit on {self._feeds[0].name}")
            self._queue.push(ping)
            self.placed += 1

    def disconnect(self) -> str:
        """Stops listening; what was heard stays. What could not be kept, in words, or ""."""
        for feed in self._feeds:
            feed.stop()
        self.poll()
        file = self._feeds[0].file if self._feeds else None
        self._feeds = []
        if self._queue is not None:
            self.session.stop_listening()
            self._queue = None
        if file is None:
            return ""
        file.close()
        lost = file.lost_rows
        return f"{file.path}: {lost} rows of what was heard could not be kept" if lost else ""
