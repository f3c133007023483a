"""Long work off the event loop: one job a purpose at a time, the newest wins, any can be cancelled."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

log = logging.getLogger("workbench")

# Kernels let go of Python's lock, so two threads are enough for all sessions of two cores; what takes long has
# two of its own, so that an answer never waits for it.
POOL = ThreadPoolExecutor(max_workers=2, thread_name_prefix="work")
LONG_POOL = ThreadPoolExecutor(max_workers=2, thread_name_prefix="long-work")
TOLD_EVERY_MS = 100  # a page is told how far a job is; each time takes it some 20 ms of the event loop


class Cancelled(Exception):
    """The analyst cancelled the job."""


class Progress:
    """What a job calls to tell how far it is: `progress(0.4, "set 12 of 30")`. Raises Cancelled.

    `progress.meanwhile(show)` has `show()` called under the document's lock while the job goes on.
    """

    def __init__(self, tell: Callable[[float, str], None], meanwhile: Callable[[Callable[[], None]], None]):
        self._tell = tell
        self.meanwhile = meanwhile
        self._cancelled = threading.Event()

    def cancel(self) -> None:
        """Makes the next call raise Cancelled."""
        self._cancelled.set()

    def __call__(self, share: float, text: str = "") -> None:
        if self._cancelled.is_set():
            raise Cancelled
        self._tell(share, text)


class Jobs:
    """The jobs of one browser session.

    `start(purpose, work, done)` runs `work(progress)` in a thread and then `done(result)` under the
    document's lock. While a purpose is at work, only the newest further request for it is kept.
    Without a served document (tests, notebooks without a server) everything runs at once, in line.
    """

    # The page's own, told once: asked for later, another page's may be the current one.
    document = None

    def __init__(self, on_state: Callable[[str, float, str], None], on_error: Callable[[Exception], None]):
        self._on_state = on_state  # purpose ("" when idle), share done, text
        self._on_error = on_error
        self._running: dict[str, Progress] = {}
        self._waiting: dict[str, tuple] = {}
        self._futures: dict[str, Future] = {}

    @property
    def busy(self) -> bool:
        """Whether anything is at work."""
        return bool(self._running)

    def cancel(self) -> None:
        """Cancels what is at work and forgets what waits."""
        self._waiting.clear()
        for progress in self._running.values():
            progress.cancel()
        for future in list(self._futures.values()):
            future.cancel()  # what no thread has taken up yet never runs

    def start(
        self,
        purpose: str,
        work: Callable[[Progress], object],
        done: Callable[[object], None],
        long: bool = False,
    ) -> None:
        """Runs some work for a purpose; see the class. What takes many seconds is `long`."""
        if self.document is None:
            self._in_line(purpose, work, done)
        elif purpose in self._running:
            self._waiting[purpose] = (work, done, long)
        else:
            self._in_thread(self.document, purpose, work, done, long)

    def _in_line(self, purpose, work, done) -> None:
        self._running[purpose] = Progress(
            lambda share, text: self._on_state(purpose, share, text), lambda show: show()
        )
        try:
            result = work(self._running[purpose])
        except Cancelled:
            return
        except Exception as error:
            self._on_error(error)
            return
        finally:
            self._running.pop(purpose, None)
            self._on_state("", 0.0, "")
        done(result)

    def _in_thread(self, document, purpose, work, done, long) -> None:
        newest: list[tuple[float, str]] = []  # what the page has yet to be told, one or none
        lock = threading.Lock()

        def tell(share: float, text: str) -> None:
            with lock:
                awaited = bool(newest)
                newest[:] = [(share, text)]
            if not awaited:  # a timeout may only be asked for in the event loop
                document.add_next_tick_callback(
                    partial(document.add_timeout_callback, tell_newest, TOLD_EVERY_MS)
                )

        def tell_newest() -> None:
            with lock:
                share, text = newest.pop()
            show_if_at_work(partial(self._on_state, purpose, share, text))

        def meanwhile(show: Callable[[], None]) -> None:
            document.add_next_tick_callback(partial(show_if_at_work, show))

        def show_if_at_work(show: Callable[[], None]) -> None:
            if self._running.get(purpose) is progress:  # it may be done by now
                show()

        progress = self._running[purpose] = Progress(tell, meanwhile)
        future = self._futures[purpose] = (LONG_POOL if long else POOL).submit(work, progress)

        def finish() -> None:
            self._running.pop(purpose, None)
            self._futures.pop(purpose, None)
            if not self._running:
                self._on_state("", 0.0, "")
            error = Cancelled() if future.cancelled() else future.exception()
            if isinstance(error, Cancelled):
                self._on_state("", 0.0, f"{purpose}: cancelled")
            elif error is not None:
                self._on_error(error)
            else:
                done(future.result())
            if purpose in self._waiting:
                self.start(purpose, *self._waiting.pop(purpose))

        def ended(_future) -> None:
            if document.session_context is not None:  # the page may be gone by now
                document.add_next_tick_callback(finish)

        future.add_done_callback(ended)
