"""The receiver on its line, for one page: connection, emulator, files, and its arrivals handed on as pings."""

from __future__ import annotations

import math
import os
import time
from collections import deque
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from dashboards.live import PingQueue
from dashboards.session import Session
from trackerlib.beacon.navigation import NavigationFixes, ShipPositions, ship_at_receptions
from trackerlib.beacon.pings import Ping
from trackerlib.live.deck_pings import RangePlacer
from trackerlib.live.navigation_feed import FeedStatus, NavigationFeed
from trackerlib.live.navigation_stream import Fix
from trackerlib.live.ports import Port, PortError, open_port
from trackerlib.live.raw_log import RawLog
from trackerlib.live.receiver_poller import PollingSettings
from trackerlib.live.receiver_session import ReceiverSession, SessionStatus, WallClock
from trackerlib.live.session_file import SessionFile
from trackerlib.receiver.following import FollowedPing, PingFollower
from trackerlib.receiver.recording import SIMULATED
from trackerlib.receiver.rolls import NO_FIXES, MarkRoll
from trackerlib.simulation.beacon_levels import SimulatedHunt
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS
from trackerlib.simulation.sail_server import TcpLine
from trackerlib.simulation.sail_units import SailLine
from trackerlib.textfiles import InputError

PATIENCE_S = 10.0  # of the receiver's clock, that a ping waits for a position
HUNTS = os.environ.get("TRACKERLIB_HUNTS", "hunts")  # folder of stored hunts
GPS_DECIMALS = 4  # of a minute, of the emulated GPS; the report's 2 are steps of 18.5 m
EMULATED_GPS_M = 3.0
BUSY_POLL_S = 0.45  # of the emulator's time, between two questions, where it is many times as fast as ours
KEPT_FIXES = 400_000
KEPT_PINGS = 1 << 17  # as many as a hunt keeps


@dataclass
class Emulator:
    """A simulated receiver and GPS of this page's own."""

    line: TcpLine
    hunt: SimulatedHunt
    rate: float

    @property
    def truth(self) -> dict:
        """Where its beacon is."""
        lat, lon, _ = self.hunt.frame.to_geodetic(np.array(self.hunt.scenario.position))
        depth_m = -self.hunt.scenario.position[2]
        return {"simulated": True, "lat_deg": float(lat), "lon_deg": float(lon), "depth_m": depth_m}


def start_emulator(scenario: int, rate: float, seed: int = 0, port: int = 0) -> Emulator:
    """An emulator that answers on this machine. Raises InputError for a port that cannot be had."""
    hunt = SimulatedHunt(SCENARIOS[scenario], seed, gps_rms_m=EMULATED_GPS_M)
    began = time.monotonic()
    line = SailLine(hunt, lambda: rate * (time.monotonic() - began), (), time.time(), GPS_DECIMALS)
    try:
        served = TcpLine(line, "127.0.0.1", port)
    except OSError as error:
        raise InputError(
            f"the emulator cannot have port {port} ({error.strerror}); choose another, or 0 for any that is free"
        ) from None
    served.start()
    return Emulator(served, hunt, rate)


def named_port(where: str) -> Port:
    """The port that a person named, not yet opened. Raises InputError."""
    try:
        return open_port(where.strip())
    except PortError as error:
        raise InputError(str(error)) from None


def hunt_file(folder: str, label: str = "") -> SessionFile | None:
    """A new session file in a folder, named by the instant; None for a folder "". Raises InputError."""
    if not folder.strip():
        return None
    path = Path(folder.strip()).expanduser()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: the hunt cannot be kept there ({error.strerror})") from None
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H%M%S")
    return SessionFile(path / f"{label}{now}.session")


def raw_log_beside(file: SessionFile | None, name: str) -> RawLog | None:
    """The day file of a line's raw bytes in the folder of a session file; None where nothing is kept."""
    return None if file is None else RawLog(file.path.parent, name)


def hunt_of_ranges(session: Session, source: str, simulated: bool = False) -> PingQueue:
    """A new hunt of the session, with the ranges of a deck unit."""
    if session.pings is not None and session.pings.simulated:  # the demo's water is not real
        session.fix_settings = replace(session.fix_settings, profile=None)
    return session.listen(source, simulated)


@dataclass
class _Following:
    """What is known of one run of the receiver."""

    run: int
    follower: PingFollower
    heard: deque[FollowedPing] = field(
        default_factory=lambda: deque(maxlen=KEPT_PINGS)
    )  # to be judged again by other limits
    waiting: list[FollowedPing] = field(default_factory=list)  # of these, for a position
    number: list[int] = field(default_factory=list)  # of the pings handed on
    arrival_s: list[float] = field(default_factory=list)
    unplaced: int = 0  # pings for which there was no position

    def take(self, pings: list[FollowedPing], feeding: bool) -> None:
        """Pings that wait for a position from now on, where they are given to the hunt."""
        self.heard.extend(pings if feeding else ())
        self.waiting += pings


class LiveReceiver:
    """At most one receiver at a time; `poll` is called from the page's own tick."""

    def __init__(self, session: Session):
        self.session = session
        self.emulator: Emulator | None = None
        self.receiver: ReceiverSession | None = None
        self.feed: NavigationFeed | None = None  # of positions, where they have a line of their own
        self.roll: MarkRoll | None = None
        self.threshold, self.feeding = 0.0, True
        self.said = b""  # of the line, since the terminal last asked
        self.file: Path | None = None
        self.placer: RangePlacer | None = None  # of ranges that come on the line of the positions
        self.placed = 0  # of these, given to the hunt
        self._followed: _Following | None = None
        self._queue = None
        self._of_ranges = False  # whether the hunt is of ranges; they and arrivals lack different constants
        self._simulated = False
        self._where, self._interval_s = "", 2.0
        self._fixes: list[tuple[float, float, float, float]] = []
        self._judged_by: tuple = ()  # limits, offset and depth, of the pings handed on

    # -- begin and end -------------------------------------------------------------------------

    def emulate(self, scenario: int, rate: float, port: int = 0) -> Emulator:
        """Starts an emulator in the place of the one before."""
        self.stop_emulator()
        self.emulator = start_emulator(scenario, rate, port=port)
        return self.emulator

    def stop_emulator(self) -> None:
        """Stops the emulator, if there is one."""
        if self.emulator is not None:
            self.emulator.line.stop()
            self.emulator = None

    def connect(
        self,
        where: str,
        settings: PollingSettings,
        interval_s: float,
        rate: float,
        folder: str,
        positions: str = "",
        turnaround_s: float = 0.0,
    ) -> None:
        """Begins to poll a receiver. Raises InputError for an address, folder or setting that makes no sense.

        interval_s : of the pinger; rate : of the receiver's time against ours, 1 but for emulators
        folder : where the hunt is kept, "" for nowhere
        positions : the line that positions come from, "" for the receiver's own
        turnaround_s : of the transponder whose ranges come on that line too, if any do
        """
        self.disconnect()
        port, beside = named_port(where), named_port(positions) if positions.strip() else None
        if beside is not None and beside.name == port.name:
            raise InputError(f"{port.name} is the receiver's own line; leave Positions from empty for that")
        mine = self.emulator is not None and self.emulator.line.address == where.strip()
        self._simulated, self._where, self._interval_s = mine, where.strip(), interval_s
        if rate > 1:
            settings = replace(settings, poll_s=BUSY_POLL_S, position_every_s=1.0)
        settings = replace(settings, gps_on_line=beside is None)
        label, clock = f"{SIMULATED}-" if mine else "", WallClock(rate)
        file = hunt_file(folder, label)
        self.file = None if file is None else file.path
        raw_log = raw_log_beside(file, f"{label}sail")
        self.receiver = ReceiverSession(port, settings, file, raw_log, clock)
        if beside is not None:
            raw_log = raw_log_beside(file, f"{label}positions")
            self.feed = NavigationFeed(beside, file, raw_log, host_time=clock.at)
            self.placer = RangePlacer(turnaround_s, self.session.fix_settings.hydrophone_depth_m)
            if file is not None:
                file.add_settings({"turnaround_s": turnaround_s})
        self._followed, self._queue, self._fixes = None, None, []
        self._of_ranges, self.placed = False, 0
        self._new_roll()
        self._label_file()
        self.receiver.start()
        if self.feed is not None:
            self.feed.start()
        if not mine:
            self.receiver.type(b"#PTR H")  # an emulator says there that it is one

    def _label_file(self) -> None:
        """Says in the session file that what it holds is simulated."""
        if self._simulated and self.receiver.file is not None:
            self.receiver.file.add_event(time.time(), f"{SIMULATED}: an emulated receiver")

    def disconnect(self) -> str:
        """Stops polling; what was heard stays. What could not be kept, in words, or ""."""
        words = ""
        if self.feed is not None:
            self.feed.stop()
            self.feed = None
        if self.receiver is not None:
            self.receiver.stop()
            file = self.receiver.file
            if file is not None:
                file.close()
                if file.lost_rows:
                    words = f"{file.path}: {file.lost_rows} rows of what was heard could not be kept"
            self.receiver = None
            if self._queue is not None:
                self.session.stop_listening()
                self._queue = None
        return words

    def close(self) -> None:
        """Ends everything."""
        self.disconnect()
        self.stop_emulator()

    @property
    def status(self) -> SessionStatus | None:
        """How the receiver is doing; None without one."""
        return None if self.receiver is None else self.receiver.status

    @property
    def feed_status(self) -> FeedStatus | None:
        """How the line that positions come from is doing; None if that is the receiver's own."""
        return None if self.feed is None else self.feed.status

    @property
    def which_hunt(self) -> str:
        """Which of ranges and arrivals the beacon fix is given, in words; "" before there is one."""
        if self._queue is None:
            return ""
        given, kept = ("ranges", "arrivals") if self._of_ranges else ("arrivals", "ranges")
        return f"The fix is of {given}, which came first; {kept} are only kept, for their times lack another constant."

    @property
    def followed(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers and times of arrival of the pings handed on in this run."""
        if self._followed is None:
            return np.empty(0, int), np.empty(0)
        return np.array(self._followed.number, int), np.array(self._followed.arrival_s)

    @property
    def unplaced(self) -> int:
        """Pings of this run that were heard while the ship's position was not known."""
        return 0 if self._followed is None else self._followed.unplaced

    def utc_of(self, stream_s: float) -> np.datetime64 | None:
        """UTC of a time by the receiver's clock; None if it cannot be told."""
        tie = math.nan if self.receiver is None else self.receiver.tie_s
        return None if math.isnan(tie) else np.datetime64(round(1e3 * (stream_s - tie)), "ms")

    # -- what comes ----------------------------------------------------------------------------

    def poll(self) -> bool:
        """Takes what came; whether a new run began, on new paper."""
        if self.receiver is None:
            return False
        said = self.receiver.terminal()
        self.said = (self.said + said)[-20_000:]
        if b"SIMULATED" in said and not self._simulated:
            self._simulated = self.roll.simulated = True
            self._label_file()
        self._take_beside()
        news = self.receiver.poll()
        begun = bool(news.periods) and (self._followed is None or news.run != self._followed.run)
        if begun:
            again = self._followed is not None
            self._followed = _Following(news.run, PingFollower(self._interval_s, self.threshold))
            if again:
                self._new_roll()
                hunt = "the hunt of ranges goes on" if self._of_ranges else "a new hunt"
                if not self._of_ranges:
                    self._queue = None
                self.session.say(f"The receiver began to sample anew: new paper, and {hunt}")
        self._fixes += [(fix.time_s, fix.lat_deg, fix.lon_deg, fix.hdop) for fix in news.fixes]
        del self._fixes[:-KEPT_FIXES]
        if news.periods:
            last = news.periods[-1]
            until = (last.number + 1) * last.period_samples * self.receiver.settings.sample_interval_s
            self.roll.fixes = self._positions()
            self.roll.add(news.arrivals, until)
            self._followed.take(self._followed.follower.feed(news.arrivals), self.feeding)
        if self._followed is not None and (self._followed.waiting or self._judged_by != self.session.placing):
            self.roll.fixes = self._positions()
            self._hand_on(self._followed)
        return begun

    def _take_beside(self) -> None:
        """Takes what came on the line of the positions, and hands on the ranges whose place is known."""
        if self.feed is None:
            return
        for heard_s, found in self.feed.poll():
            self.placer.hear(heard_s, found)
            if isinstance(found, Fix):
                self.receiver.take_fix(heard_s, found)
        where = self.session.position_limits, self.session.antenna_offset_m
        for ping in self.placer.pings(self.receiver.clock.now(), *where):
            if not self.feeding or (self._queue is not None and not self._of_ranges):
                continue
            if self._queue is None:
                self._queue = hunt_of_ranges(self.session, f"deck unit on {self.feed.name}", self._simulated)
                self._of_ranges = True
            self._queue.push(ping)
            self.placed += 1

    def _new_roll(self) -> None:
        self.roll = MarkRoll(f"receiver on {self._where}", self._simulated)

    def _positions(self) -> NavigationFixes:
        """Positions by the receiver's clock."""
        tie = self.receiver.tie_s
        if not self._fixes or not np.isfinite(tie):
            return NO_FIXES
        time_s, lat, lon, hdop = np.array(self._fixes).T
        return NavigationFixes(time_s + tie, lat, lon, hdop)

    def _hand_on(self, following: _Following) -> None:
        """Gives the hunt the pings whose place is known by now."""
        if not self.feeding or self._of_ranges:
            following.waiting.clear()
            return
        self._judge_again(following)
        ship, still = self._ship_at(following.waiting), []
        for k, ping in enumerate(following.waiting):
            if ship.accepted[k]:
                if self._queue is None:
                    self._begin_hunt()
                self._queue.push(self._placed(following, ping, ship, k))
            elif self._may_yet(ping):
                still.append(ping)
            else:
                following.unplaced += 1
        following.waiting = still

    def _judge_again(self, following: _Following) -> None:
        """Makes the hunt's pings afresh where limits, offset or depth were turned since."""
        before, self._judged_by = self._judged_by, self.session.placing
        if self._queue is None or before == self._judged_by:
            return
        heard = list(following.heard)
        ship = self._ship_at(heard)
        following.number.clear()
        following.arrival_s.clear()
        again = [self._placed(following, ping, ship, k) for k, ping in enumerate(heard) if ship.accepted[k]]
        refused = [ping for ping, accepted in zip(heard, ship.accepted, strict=True) if not accepted]
        following.waiting = [ping for ping in refused if self._may_yet(ping)]
        following.unplaced = len(refused) - len(following.waiting)
        self.session.hear_again(self._queue, again)
        self.session.say("; ".join([f"{len(again)} of {len(heard)} arrivals have a position", *ship.words]))

    def _may_yet(self, ping: FollowedPing) -> bool:
        """Whether a position may still come for a ping."""
        return ping.arrival_s > self.roll.until_s - PATIENCE_S

    def _ship_at(self, pings: list[FollowedPing]) -> ShipPositions:
        """Where the ship was at some pings, by the limits and the offset told."""
        times = np.array([ping.arrival_s for ping in pings])
        fixes = self.roll.fixes
        near = fixes.time_s > times.min(initial=np.inf) - PATIENCE_S
        few = NavigationFixes(*(c[near] for c in (fixes.time_s, fixes.lat_deg, fixes.lon_deg, fixes.hdop)))
        return ship_at_receptions(few, times, self.session.position_limits, self.session.antenna_offset_m)

    def _placed(self, following: _Following, ping: FollowedPing, ship: ShipPositions, row: int) -> Ping:
        """A ping with its place, noted among those handed on."""
        number = ping.emission + 1
        following.number.append(number)
        following.arrival_s.append(ping.arrival_s)
        return Ping(
            number,
            float(ship.lat_deg[row]),
            float(ship.lon_deg[row]),
            ping.travel_s(self._interval_s),
            ping.emission * self._interval_s,
            up_m=-self.session.fix_settings.hydrophone_depth_m,
            utc=self.utc_of(ping.arrival_s),
        )

    def _begin_hunt(self) -> None:
        """A new hunt of the session, with what is known of the water and the clock."""
        session, settings = self.session, self.session.fix_settings
        if self.emulator is not None and self._simulated:
            settings = replace(
                settings,
                profile=None,
                sound_speed_mps=SOUND_SPEED_MPS,
                gps_rms_m=None,  # positions hang on how promptly the line answers: slow errors are allowed for
                gps_correlation_s=None,
                interval_s=None,
                estimate_interval=False,
                estimate_interval_drift=False,
                method="all-pings",
                motion="free" if self.emulator.hunt.scenario.moving else "still",
                sample_interval_ms=1e3 * self.receiver.settings.sample_interval_s,
            )
        elif session.pings is not None and session.pings.simulated:
            settings = replace(settings, profile=None)  # the demo's water is not that of a real hunt
        session.fix_settings = settings
        self._queue = session.listen(self.roll.source, self._simulated)
        if self.emulator is not None and self._simulated:
            session.truth = self.emulator.truth
