"""Positions and ranges from a port of NMEA or deck-unit lines, kept as they come, for an app that looks now and then.

feed = NavigationFeed(open_port("udp:10110"), file, RawLog(Path("raw"), "gps"))
feed.start()
feed.poll(), feed.status
one_clock(periods, feed.heard(), sample_interval_s)
feed.stop()
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from trackerlib.live.line_reader import LineReader, ReaderStatus, TimedLine
from trackerlib.live.navigation_stream import KEPT, DeckUnitRange, Fix, NavigationStream
from trackerlib.live.ports import Port
from trackerlib.live.raw_log import RawLog
from trackerlib.live.session_file import SessionFile

NEWS = 20_000  # fixes and ranges for an app that does not fetch them, the oldest dropped first
PAUSE_S = 0.05


@dataclass(frozen=True)
class FeedStatus:
    """How a feed is doing, for a person."""

    name: str  # of its port
    reader: ReaderStatus
    positions: int
    refused: tuple[tuple[str, int], ...]  # why sentences gave nothing, and how often
    last_refused: str  # the latest in full


class NavigationFeed:
    """Reads a port in one thread and makes sense of its lines in another, so that neither waits for the app.

    host_time : by which clock things are told as heard, from seconds since 1970; an emulator's may run faster
    """

    def __init__(
        self,
        port: Port,
        file: SessionFile | None = None,
        raw_log: RawLog | None = None,
        checksum_required: bool = True,
        host_time: Callable[[float], float] = float,
    ):
        self.file, self.name, self._host_time = file, port.name, host_time
        keep_raw = None if file is None else lambda data, utc_s: file.add_raw(port.name, utc_s, data)
        self._reader = LineReader(port, raw_log, also=keep_raw)
        self._stream = NavigationStream(checksum_required)
        self._heard: deque[tuple[float, Fix]] = deque(maxlen=KEPT)
        self._news: deque[tuple[float, Fix | DeckUnitRange]] = deque(maxlen=NEWS)
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Starts reading; nothing if it already does."""
        if self._thread is None or not self._thread.is_alive():
            self._stop.clear()
            self._reader.start()
            self._thread = threading.Thread(target=self._run, name="navigation", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Stops reading, after the last line that has come."""
        self._reader.stop()
        self._stop.set()
        if self._thread is not None:
            self._thread.join(5)
            self._thread = None

    def poll(self) -> tuple[tuple[float, Fix | DeckUnitRange], ...]:
        """What came since the last call, each with when it was heard by the host's clock [s]."""
        return tuple(self._news.popleft() for _ in range(len(self._news)))

    def heard(self) -> tuple[tuple[float, Fix], ...]:
        """All positions kept, each with when it was heard by the host's clock [s]."""
        with self._lock:
            return tuple(self._heard)

    @property
    def status(self) -> FeedStatus:
        """How it is doing."""
        with self._lock:
            refused = tuple(self._stream.refused.most_common())
            last = self._stream.last_refused
            return FeedStatus(self.name, self._reader.status, len(self._heard), refused, last)

    def _run(self) -> None:
        while not self._stop.wait(PAUSE_S):
            self._take(self._reader.drain())
        self._take(self._reader.drain())

    def _take(self, lines: list[TimedLine]) -> None:
        for line in lines:
            heard_s = self._host_time(line.utc_s)
            with self._lock:
                found = self._stream.feed(line.text, heard_s)
                if isinstance(found, Fix):
                    self._heard.append((heard_s, found))
            if found is not None:
                self._news.append((heard_s, found))
            if self.file is None:
                continue
            if isinstance(found, Fix):
                self.file.add_fix(heard_s, found)
            elif found is not None:
                self.file.add_range(heard_s, found)
