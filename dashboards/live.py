"""Pings on their way from a reader's thread to one page."""

from __future__ import annotations

import threading
from collections import deque

from trackerlib.beacon.pings import Ping

MOST_WAITING = 100_000  # pings; the oldest go, and are counted


class PingQueue:
    """A bounded queue of one page: any thread pushes, the page's own periodic callback drains.

    It knows nothing of the page, so a reader that outlives it keeps nothing of it alive.
    """

    def __init__(self, most: int = MOST_WAITING):
        self._waiting: deque[Ping] = deque()
        self._most = most
        self._lock = threading.Lock()
        self.lost = 0  # pings that came while the queue was full

    def push(self, ping: Ping) -> None:
        """Hands on one ping, from any thread, without waiting."""
        with self._lock:
            if len(self._waiting) >= self._most:
                self._waiting.popleft()
                self.lost += 1
            self._waiting.append(ping)

    def drain(self) -> list[Ping]:
        """All pings that wait, the oldest first."""
        with self._lock:
            waiting = list(self._waiting)
            self._waiting.clear()
        return waiting
