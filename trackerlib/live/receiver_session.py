"""A hunt as it comes in: a thread that polls receiver and GPS on one SAIL line, and keeps all it hears.

    session = ReceiverSession(open_port("/dev/ttyUSB0"), PollingSettings(sample_interval_s=1.0005e-3),
                              SessionFile(Path("hunt.session")), RawLog(Path("raw"), "sail"))
    session.start()
    news = session.poll()                 # what came since the last call, for the app
    session.set_attenuation(12); session.type(b"#PTR H"); session.terminal()
    arrivals, fixes = session.hunt()      # everything of this run so far, by one clock
    session.stop()

No trouble of the line stops it: it says in `status` what is wrong, and tries again.
"""

from __future__ import annotations

import math
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace

import numpy as np

from trackerlib.beacon.navigation import NavigationFixes
from trackerlib.live.hunt import one_clock
from trackerlib.live.navigation_stream import Fix
from trackerlib.live.ports import Port, PortError
from trackerlib.live.raw_log import RawLog
from trackerlib.live.receiver_poller import PollingSettings, ReceiverPoller
from trackerlib.live.sail_host import SailHost
from trackerlib.live.session_file import SessionFile
from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.periods import Period, arrivals_of, measured_sample_interval, receiver_start
from trackerlib.receiver.sail import (
    BAUD_RATES,
    RECEIVER,
    Fault,
    ReceiverParameters,
    address,
    set_attenuator,
)

KEPT = 200_000  # periods and fixes in memory; the file has all
NEWS = 20_000  # items for an app that does not fetch them, the oldest dropped first
TERMINAL_BYTES = 200_000
PASSED = 5  # periods had since a fault, from which it is over
FIRST_RETRY_S, LONGEST_RETRY_S = 0.25, 5.0


class WallClock:
    """Seconds since 1970, and waiting; `rate` times as fast for an emulator that is."""

    def __init__(self, rate: float = 1.0):
        self.rate = rate
        self._began, self._monotonic = time.time(), time.monotonic()

    def now(self) -> float:
        """Seconds since 1970."""
        return self._began + self.rate * (time.monotonic() - self._monotonic)

    def at(self, utc_s: float) -> float:
        """What it showed at an instant of the machine's own clock."""
        return self._began + self.rate * (utc_s - self._began)

    def wait(self, stop: threading.Event, seconds: float) -> None:
        """Waits, or until told to stop."""
        stop.wait(seconds / self.rate)


@dataclass(frozen=True)
class SessionStatus:
    """How the hunt is doing, for a person."""

    state: str  # "stopped", "listening", "waiting" (for line or receiver)
    words: str  # the trouble of line, receiver, file or raw log that is not over, or ""
    baud: int
    attenuation_db: float  # as last shown; NaN if not known
    run: int  # how often sampling began, from 1; 0 before
    periods: int  # had in this run
    missed: int  # of this run that were not had
    uncertain: int  # buffers left out because their period could not be told
    positions: int
    no_position: str  # why the GPS last had none, or ""
    faults: int
    lost: int  # rows and bytes that session file and raw log could not keep


@dataclass(frozen=True, eq=False)
class News:
    """What came since the last call."""

    run: int
    arrivals: Arrivals  # of this run, by the receiver's clock since the run began
    periods: tuple[Period, ...]
    fixes: tuple[Fix, ...]  # by UTC
    faults: tuple[str, ...]


class ReceiverSession:
    """Polls one line until it is stopped. Its methods may be called from any thread.

    clock : the host's, told apart for emulators that run faster than time
    """

    def __init__(
        self,
        port: Port,
        settings: PollingSettings | None = None,
        file: SessionFile | None = None,
        raw_log: RawLog | None = None,
        clock: WallClock | None = None,
        quiet_s: float = 0.5,
    ):
        self.file, self.raw_log, self.clock = file, raw_log, clock or WallClock()
        self._host = SailHost(port, self._hear, quiet_s)
        runs = file.runs if file is not None else 0
        self._poller = ReceiverPoller(self._host, settings or PollingSettings(), self.clock.now, self, runs)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()
        self._requests: deque[Callable[[], Fault | None]] = deque()
        self._terminal: deque[int] = deque(maxlen=TERMINAL_BYTES)
        self._periods: deque[Period] = deque(maxlen=KEPT)
        self._fixes: deque[tuple[float, Fix]] = deque(maxlen=KEPT)
        self._news: deque[tuple[int, Period | Fix | str]] = deque(maxlen=NEWS)
        self._state, self._words = "stopped", ""
        self._since_fault = 0  # periods had
        self._run, self._faults = runs, 0
        self._typed_to = RECEIVER
        self._measured = math.nan, math.nan  # sample interval and its error
        self._measured_of = runs, 0  # run and periods it was measured from
        self._began_s = math.nan  # when the run began by the host's clock
        self._late_s = math.nan  # how late positions come

    @property
    def settings(self) -> PollingSettings:
        """What the receiver is told."""
        return self._poller.settings

    # -- for the app ---------------------------------------------------------------------------

    def start(self) -> None:
        """Starts polling; nothing if it already does."""
        if self._thread is None or not self._thread.is_alive():
            self._stop.clear()
            self._keep_settings()
            self._thread = threading.Thread(target=self._poll_until_stopped, name="receiver", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Stops polling and closes line and raw log, not the session file; the receiver goes on sampling."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(10)
            self._thread = None

    def poll(self) -> News:
        """What came since the last call."""
        items = [self._news.popleft() for _ in range(len(self._news))]
        run = self._run
        periods = tuple(item for of, item in items if isinstance(item, Period) and of == run)
        return News(
            run,
            arrivals_of(periods, self.settings.sample_interval_s),
            periods,
            tuple(item for _, item in items if isinstance(item, Fix)),
            tuple(item for _, item in items if isinstance(item, str)),
        )

    def hunt(self) -> tuple[Arrivals, NavigationFixes]:
        """Arrivals of this run and all positions, both in seconds of the receiver's clock since the run began."""
        with self._lock:
            periods, fixes = tuple(self._periods), tuple(self._fixes)
        return one_clock(periods, fixes, self.settings.sample_interval_s)

    @property
    def tie_s(self) -> float:
        """What makes UTC of a position seconds of the receiver's clock since the run began; NaN before a period.

        As in `hunt`, but without looking at everything heard; it falls a little while better ties come.
        """
        return self._late_s - self._began_s

    @property
    def measured_sample_interval_s(self) -> tuple[float, float]:
        """Sample interval by the host's clock and its standard error, of this run; NaN before there are periods.

        Looked at anew once a tenth more periods have come.
        """
        run, had = self._run, len(self._periods)
        if (run, had) != self._measured_of and (
            run != self._measured_of[0] or had > 1.1 * self._measured_of[1]
        ):
            with self._lock:
                periods = tuple(self._periods)
            self._measured_of, self._measured = (run, had), measured_sample_interval(periods)
        return self._measured

    @property
    def status(self) -> SessionStatus:
        """How it is doing."""
        file, raw_log, poller = self.file, self.raw_log, self._poller
        troubles = [self._words, file.trouble if file else None, raw_log.trouble if raw_log else None]
        had, last = len(self._periods), poller.counter.last
        return SessionStatus(
            self._state,
            "; ".join(words for words in troubles if words),
            self._host.baud,
            poller.attenuation_db,
            self._run,
            had,
            0 if last is None or had == KEPT else max(last + 1 - had, 0),
            poller.uncertain,
            len(self._fixes),
            poller.no_position,
            self._faults,
            (file.lost_rows if file else 0) + (raw_log.lost_bytes if raw_log else 0),
        )

    def set_attenuation(self, step: int | str) -> None:
        """Attenuation by hand [dB], or AUTOMATIC_GAIN, once the line is free. ValueError for another step."""
        set_attenuator(step)
        self._use(replace(self.settings, attenuation=step))
        self._requests.append(lambda: self._host.set_attenuation(step))

    def set_parameters(self, parameters: ReceiverParameters) -> None:
        """Period, number of maxima and window, once the line is free; a new run begins."""
        self._requests.append(lambda: self._change_parameters(parameters))

    def set_baud(self, baud: int) -> None:
        """Another rate, once the line is free. ValueError for one that would deafen the original."""
        if baud not in BAUD_RATES:
            raise ValueError(f"found {baud} baud; wanted one of {', '.join(map(str, BAUD_RATES))}")
        self._requests.append(lambda: self._host.set_baud(baud))

    def restart_receiver(self) -> None:
        """Restarts the receiver, once the line is free, and tells it everything anew."""
        self._requests.append(lambda: self._host.restart() or self._poller.look_afresh())

    def type(self, text: bytes) -> None:
        """Sends the characters of a terminal once the line is free; what comes back is in `terminal`."""
        self._requests.append(lambda: self._type(text))

    def terminal(self) -> bytes:
        """All characters heard on the line since the last call, echoes included."""
        return bytes(self._terminal.popleft() for _ in range(len(self._terminal)))

    def take_fix(self, heard_s: float, fix: Fix) -> None:
        """Takes a position of another line, which keeps it in the file itself.

        heard_s : by `clock`
        """
        with self._lock:
            self._fixes.append((heard_s, fix))
            self._late_s = np.fmin(self._late_s, heard_s - fix.time_s)
        self._news.append((self._run, fix))

    # -- in the thread -------------------------------------------------------------------------

    def _poll_until_stopped(self) -> None:
        retry_s = FIRST_RETRY_S
        while not self._stop.is_set():
            try:
                self._host.port.open()
                fault = self._poller.look_afresh()
                if fault is None:
                    retry_s = FIRST_RETRY_S
                    self._state, self._words = "listening", ""
                    self._listen()
            except PortError as error:
                self.keep_fault(Fault("gone", str(error)))
            self._host.port.close()
            if not self._stop.is_set():
                self._state = "waiting"
                self._stop.wait(retry_s)
                retry_s = min(2 * retry_s, LONGEST_RETRY_S)
        self._state = "stopped"
        if self.raw_log is not None:
            self.raw_log.close()

    def _listen(self) -> None:
        """Polls until the line is gone or the receiver is not found any more."""
        while not self._stop.is_set():
            while self._requests:
                fault = self._requests.popleft()()
                if fault is not None:
                    self.keep_fault(fault)
            lost = self._poller.step()
            if lost is not None:
                return
            self.clock.wait(self._stop, self.settings.poll_s)

    def _change_parameters(self, parameters: ReceiverParameters) -> Fault | None:
        self._use(replace(self.settings, parameters=parameters))
        return self._poller.look_afresh()

    def _type(self, text: bytes) -> Fault | None:
        named = re.findall(rb"#(\w{3})", text)
        if not text.startswith(b"#"):  # between two texts of a person the line was used for polling
            text = address(self._typed_to) + text
        self._typed_to = named[-1].decode("ascii") if named else self._typed_to
        said = self._host.type(text)
        return said if isinstance(said, Fault) else self._poller.look_afresh()

    def _use(self, settings: PollingSettings) -> None:
        self._poller.settings = settings
        self._keep_settings()

    def _hear(self, data: bytes) -> None:
        """Keeps bytes before anything interprets them."""
        utc_s = time.time()
        if self.raw_log is not None:
            self.raw_log.write(data, utc_s)
        if self.file is not None:
            self.file.add_raw(self._host.port.name, utc_s, data)
        self._terminal.extend(data)

    def keep_period(self, run: int, period: Period) -> None:
        """Keeps what the poller heard."""
        with self._lock:
            if run != self._run:
                self._periods.clear()
                self._run, self._began_s = run, math.nan
            self._periods.append(period)
            self._began_s = np.fmin(self._began_s, receiver_start([period], self.settings.sample_interval_s))
        self._since_fault += 1
        if self._since_fault == PASSED:
            self._words = ""
        self._news.append((run, period))
        if self.file is not None:
            self.file.add_period(run, period)

    def keep_fix(self, heard_s: float, fix: Fix) -> None:
        """Keeps what the poller heard."""
        self.take_fix(heard_s, fix)
        if self.file is not None:
            self.file.add_fix(heard_s, fix)

    def keep_fault(self, fault: Fault) -> None:
        """Keeps what went wrong, in words."""
        self._faults += 1
        self._words, self._since_fault = fault.words, 0
        self._news.append((self._run, fault.words))
        if self.file is not None:
            self.file.add_event(time.time(), f"{fault.kind}: {fault.words}")

    def _keep_settings(self) -> None:
        if self.file is not None:
            self.file.add_settings(asdict(self.settings) | {"port": self._host.port.name})
