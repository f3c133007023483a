"""A thread that reads lines from a port, whatever else the program is doing, and keeps every byte first.

reader = LineReader(open_port("udp:10110"), RawLog(folder, "gps"))
reader.start()
for line in reader.drain(): ...
reader.status
reader.stop()
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from trackerlib.live.ports import Port, PortEnded, PortError
from trackerlib.live.raw_log import RawLog

CAPACITY = 100_000  # lines kept for an app that does not fetch them
LONGEST_LINE = 1024  # bytes without an end of line that are no line any more
QUIET_S = 2.0  # a line that has not ended by then has stopped in mid-message
FIRST_RETRY_S, LONGEST_RETRY_S = 0.25, 5.0


@dataclass(frozen=True)
class TimedLine:
    """A line without its end, and when its last byte came."""

    text: str
    utc_s: float  # seconds since 1970


@dataclass(frozen=True)
class ReaderStatus:
    """How a line is doing, for a person."""

    state: str  # "stopped", "connected", "waiting" (to connect again), "ended"
    words: str  # the latest trouble, or ""
    bytes: int
    lines: int
    dropped: int  # lines thrown away, the oldest first, because nobody fetched them
    overlong: int  # pieces without an end of line, LONGEST_LINE bytes each
    cut: int  # lines that stopped in mid-message
    reconnects: int
    raw_lost: int  # bytes that the raw log could not keep


class LineSplitter:
    """Bytes in, lines out; the ends may be of any system. What has no end for too long is dropped up to its end."""

    def __init__(self) -> None:
        self.rest = b""
        self.overlong = 0
        self._skipping = False

    def feed(self, data: bytes, whole: bool = False) -> list[bytes]:
        """Lines that ended with this data; `whole` if its end is the end of a line."""
        pieces = (self.rest + data).replace(b"\r", b"\n").split(b"\n")
        self.rest = b"" if whole else pieces.pop()
        lines = []
        for piece in pieces:
            self.overlong += len(piece) // LONGEST_LINE
            if piece and len(piece) < LONGEST_LINE and not self._skipping:
                lines.append(piece)
            self._skipping = False
        if len(self.rest) >= LONGEST_LINE:
            self.overlong += len(self.rest) // LONGEST_LINE
            self.rest, self._skipping = b"", True
        return lines


class LineReader:
    """Reads a port in a thread of its own, connects again when it is lost, and never waits for the app.

    capacity : lines kept until they are fetched
    also : told every piece of bytes and its instant, as the raw log is, before it is cut into lines
    """

    def __init__(
        self,
        port: Port,
        raw_log: RawLog | None = None,
        capacity: int = CAPACITY,
        also: Callable[[bytes, float], None] | None = None,
    ):
        self.port, self.raw_log = port, raw_log
        self._keepers = [
            keep for keep in (None if raw_log is None else raw_log.write, also) if keep is not None
        ]
        self._queue: deque[TimedLine] = deque(maxlen=capacity)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._splitter = LineSplitter()
        self._state, self._words = "stopped", ""
        self._bytes = self._lines = self._fetched = self._cut = self._reconnects = 0
        self._heard_s = time.monotonic()

    def start(self) -> None:
        """Starts reading; nothing if it already does."""
        if self._thread is None or not self._thread.is_alive():
            self._stop.clear()
            self._thread = threading.Thread(target=self._run, name=f"reader {self.port.name}", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Stops reading and closes port and log."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(5)
            self._thread = None

    def drain(self) -> list[TimedLine]:
        """The lines that came since the last call."""
        lines = []
        while self._queue:
            try:
                lines.append(self._queue.popleft())
            except IndexError:  # the thread has just dropped the last for a newer one
                break
        self._fetched += len(lines)
        return lines

    @property
    def status(self) -> ReaderStatus:
        """How the line is doing."""
        trouble = self.raw_log.trouble if self.raw_log is not None else None
        waiting = len(self._queue)
        return ReaderStatus(
            self._state,
            "; ".join(word for word in (self._words, trouble) if word),
            self._bytes,
            self._lines,
            max(self._lines - self._fetched - waiting, 0),
            self._splitter.overlong,
            self._cut,
            self._reconnects,
            self.raw_log.lost_bytes if self.raw_log is not None else 0,
        )

    def _run(self) -> None:
        retry_s = FIRST_RETRY_S
        opened_before = False
        try:
            while not self._stop.is_set():
                try:
                    self.port.open()
                    self._reconnects += opened_before
                    opened_before = True
                    self._state, self._words, retry_s = "connected", "", FIRST_RETRY_S
                    self._read()
                except PortEnded as ended:
                    self._take(b"", time.time(), whole=True)
                    self._state, self._words = "ended", str(ended)
                    return
                except PortError as error:
                    self._end_of_connection()
                    self._state, self._words = "waiting", f"{error}; trying again"
                    self._stop.wait(retry_s)
                    retry_s = min(2 * retry_s, LONGEST_RETRY_S)
            self._state = "stopped"
        finally:
            self.port.close()
            if self.raw_log is not None:
                self.raw_log.close()

    def _read(self) -> None:
        self._heard_s = time.monotonic()
        while not self._stop.is_set():
            data = self.port.read(0.1)
            if data:
                self._take(data, time.time())
            elif self._splitter.rest and time.monotonic() - self._heard_s > QUIET_S:
                self._cut_short("no more came")

    def _take(self, data: bytes, utc_s: float, whole: bool = False) -> None:
        for keep in self._keepers if data else ():
            keep(data, utc_s)
        self._heard_s = time.monotonic()
        self._bytes += len(data)
        overlong = self._splitter.overlong
        for line in self._splitter.feed(data, whole or self.port.datagrams):
            self._lines += 1
            self._queue.append(TimedLine(line.decode("latin-1"), utc_s))
        if self._splitter.overlong > overlong:
            self._words = f"{self.port.name}: floods of bytes without an end of line; is the baud rate right?"

    def _end_of_connection(self) -> None:
        if self._splitter.rest:
            self._cut_short("the connection was lost")

    def _cut_short(self, why: str) -> None:
        """Drops a line that stopped in mid-message, and says so."""
        self._cut += 1
        shown = self._splitter.rest[:40].decode("latin-1").encode("unicode_escape").decode("ascii")
        self._words = f"{self.port.name}: a line stopped in mid-message after '{shown}' ({why})"
        self._splitter.rest = b""
