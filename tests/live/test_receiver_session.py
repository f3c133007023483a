"""From the emulated receiver over its line to a fix, and what the app may ask for meanwhile."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from scipy.stats import chi2
from waiting import until

from trackerlib.beacon.fix import FixSettings, fix_beacon
from trackerlib.beacon.navigation import pings_of_stream, ship_at_receptions
from trackerlib.live.hunt import hunt_of, strongest
from trackerlib.live.ports import open_port
from trackerlib.live.raw_log import RawLog
from trackerlib.live.receiver_session import PASSED, PollingSettings, ReceiverSession, WallClock
from trackerlib.live.session_file import SessionFile, raw_of, read_session
from trackerlib.receiver.periods import Period
from trackerlib.receiver.sail import Fault, ReceiverParameters
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS
from trackerlib.simulation.sail_server import PtyLine, TcpLine
from trackerlib.simulation.sail_units import SailLine, SimulatedHunt

NOON = 1_780_315_200.0  # 2026-06-01 12:00 UTC
LATE = NOON + 43_200 - 300  # five minutes before midnight
LEAST_LEVEL = 120.0


class StepClock:
    """A clock that moves on only while the host waits, so that nothing depends on how busy the machine is."""

    def __init__(self, began_s=NOON, until_s=None):
        self.began_s, self.time_s = began_s, began_s
        self.until_s = None if until_s is None else began_s + until_s
        self.done = threading.Event()

    def now(self):
        return self.time_s

    def wait(self, stop, seconds):
        self.time_s += seconds
        if self.until_s is not None and self.time_s >= self.until_s:
            self.done.set()
            stop.wait()

    def elapsed(self):
        return self.time_s - self.began_s


def served_line(kind, hunt, clock, faults=()):
    line = SailLine(hunt, clock.elapsed, faults, clock.began_s, minute_decimals=4)
    return line, TcpLine(line, "127.0.0.1", 0) if kind == "tcp" else PtyLine(line)


def fix_of(arrivals, fixes, gps_rms_m, motion="still"):
    """The beacon from a hunt, as any caller would have it."""
    rows = strongest(arrivals, LEAST_LEVEL)
    ship = ship_at_receptions(fixes, arrivals.arrival_s[rows])
    pings = pings_of_stream(ship, arrivals.period[rows], simulated=True)
    settings = FixSettings(
        sound_speed_mps=SOUND_SPEED_MPS,
        sound_speed_sigma_mps=0.001,
        interval_s=2.0,
        gps_rms_m=gps_rms_m,
        sample_interval_ms=1.0,
        motion=motion,
    )
    return fix_beacon(pings, settings), pings


def surprise(fix, hunt, position):
    """How far outside the stated ellipsoid the truth lies, as a probability."""
    error = fix.position - fix.frame.to_local(*hunt.frame.to_geodetic(np.array(position)))
    return chi2.cdf(error @ np.linalg.solve(fix.uncertainty.covariance[:3, :3], error), 3)


def test_a_fault_that_is_over_is_told_no_more():
    session = ReceiverSession(open_port("tcp:127.0.0.1:9"))
    session.keep_fault(Fault("silent", "not even the echo came back"))
    for number in range(PASSED):
        assert session.status.words == "not even the echo came back"
        session.keep_period(1, Period(number, NOON + 2 * number, (), 0.0, 2000))
    assert (session.status.words, session.status.faults) == ("", 1)
    session.keep_fault(Fault("silent", "again"))
    assert session.status.words == "again"


@pytest.mark.parametrize(
    ("kind", "faults", "sample_interval_s", "began_s"),
    [("tcp", (), 1e-3, LATE), ("pty", ("clock", "gain-step"), 1.0005e-3, NOON)],
)
def test_from_receiver_to_fix_over_the_line(tmp_path, kind, faults, sample_interval_s, began_s):
    clock = StepClock(began_s, until_s=600.0)
    hunt = SimulatedHunt(SCENARIOS[2], seed=11)
    _, served = served_line(kind, hunt, clock, faults)
    settings = PollingSettings(sample_interval_s=sample_interval_s, poll_s=0.87, position_every_s=1.6)
    path = tmp_path / "hunt.session"
    with served, SessionFile(path) as file:
        session = ReceiverSession(
            open_port(served.address), settings, file, RawLog(tmp_path / "raw", "sail"), clock, quiet_s=5
        )
        session.start()
        assert clock.done.wait(100)
        session.stop()
    status = session.status
    assert (status.missed, status.uncertain, status.faults, status.words) == (0, 0, 0, "")
    assert status.periods > 290
    arrivals, fixes = session.hunt()
    assert np.isfinite(arrivals.attenuation_db).all()
    fix, pings = fix_of(arrivals, fixes, hunt.gps_rms_m)
    assert fix.converged, fix.reason
    assert len(pings) > 290
    assert surprise(fix, hunt, SCENARIOS[2].position) < 0.995
    # The file gives the same chart, and holds every byte that the day files hold.
    again, placed = hunt_of(read_session(path))
    for name in ("period", "rank", "arrival_s", "level", "attenuation_db"):
        assert np.array_equal(getattr(again, name), getattr(arrivals, name))
    for name in ("time_s", "lat_deg", "lon_deg", "hdop"):
        assert np.array_equal(getattr(placed, name), getattr(fixes, name))
    days = b"".join(raw.read_bytes() for raw in sorted((tmp_path / "raw").glob("*.raw")))
    assert days == b"".join(data for _, _, data in raw_of(path))


@pytest.fixture
def live(tmp_path):
    """Starts sessions on emulated lines, twenty times as fast as time; session, line and served line."""
    opened = []

    def start(kind, faults=(), served=None, **settings):
        clock = WallClock(rate=20.0)
        began_s = clock.now()
        line = SailLine(SimulatedHunt(SCENARIOS[2], 5), lambda: clock.now() - began_s, faults, began_s, 4)
        served = TcpLine(line, "127.0.0.1", 0) if kind == "tcp" else PtyLine(line)
        served.start()
        file = SessionFile(tmp_path / "live.session")
        session = ReceiverSession(
            open_port(served.address), PollingSettings(**settings), file, clock=clock, quiet_s=0.3
        )
        session.start()
        opened.append((session, served, file))
        assert until(lambda: session.status.periods >= 2), session.status
        return session, line, served

    yield start
    for session, served, file in opened:
        session.stop()
        served.stop()
        file.close()


def kept_period_samples(path):
    """Samples a period by the settings that a session file holds by now, None without any."""
    return read_session(path).settings.get("parameters", {}).get("period_samples")


@pytest.mark.parametrize("kind", ["tcp", "pty"])
def test_the_app_turns_knobs_while_the_hunt_goes_on(live, kind):
    session, line, _ = live(kind)
    session.set_attenuation(12)
    assert until(lambda: session.status.attenuation_db == 12)
    assert not line.receiver.automatic
    run = session.status.run
    session.set_parameters(ReceiverParameters(1000, 3, 15))
    assert until(lambda: session.status.run == run + 1 and session.status.periods >= 2)
    assert line.receiver.attenuation_db == 12  # told again with the rest
    assert until(lambda: 3 in session.poll().arrivals.rank)
    session.set_baud(1200)
    assert until(lambda: session.status.baud == 1200)
    before = session.status
    assert until(lambda: session.status.periods > before.periods)
    assert until(lambda: session.status.positions > before.positions)
    session.restart_receiver()
    assert until(lambda: session.status.baud == 9600 and session.status.run > before.run)
    assert line.receiver.memory[0x52:0x54] == (1000).to_bytes(2, "big")
    assert until(lambda: kept_period_samples(session.file.path) == 1000)  # written by a thread of its own


def test_a_terminal_pane_talks_to_both_units(live):
    session, _, _ = live("tcp", gps_on_line=False)
    heard = b""

    def hears(what):
        nonlocal heard
        heard += session.terminal()
        return what in heard

    for text, answer in (
        (b"#PTR H", b"SIMULATED RECEIVER"),
        (b"?M52 2\r", b"0052  07D0"),
        (b"#GPS ?L", b"#GPS \r\n:\x03?L "),
        (b"?L", b"#GPS \r\n:\x03?L "),  # goes on talking to the unit that was named last
    ):
        heard = b""
        session.type(text)
        assert until(lambda want=answer: hears(want)), (text, heard[-300:])
    session.type(b"#PTR !M52 03E8\r")  # what a person changes by hand is put back
    run = session.status.run
    assert until(lambda: session.status.run == run + 1)


def test_knobs_refuse_what_the_receiver_cannot_do(live):
    session, _, _ = live("tcp")
    with pytest.raises(ValueError, match="wanted one of"):
        session.set_attenuation(6)
    with pytest.raises(ValueError, match="wanted one of"):
        session.set_baud(1000)
    with pytest.raises(ValueError, match="sample_interval_s"):
        PollingSettings(sample_interval_s=1.0)


def test_a_line_that_is_pulled_and_put_back_goes_on_counting(live):
    session, line, served = live("tcp")
    served.stop()
    assert until(lambda: session.status.state == "waiting")
    assert "tcp:" in session.status.words
    news = session.poll()
    assert news.faults
    again = TcpLine(line, served.host, served.port)
    with again:
        before = session.status
        assert until(lambda: session.status.state == "listening" and session.status.periods > before.periods)
        after = session.status
        session.stop()
    assert after.run == before.run
    assert after.missed + after.uncertain > 0
    assert session.status.state == "stopped"


def test_a_receiver_that_was_reset_is_told_everything_again(live):
    session, line, _ = live("pty", parameters=ReceiverParameters(1200, 4, 25), attenuation=3)
    session.set_baud(2400)
    assert until(lambda: session.status.baud == 2400)
    run = session.status.run
    line.receiver.reset()
    assert until(lambda: session.status.run > run and session.status.periods > 0)
    assert (line.receiver.baud, session.status.baud, line.gps.baud) == (9600, 9600, 9600)
    assert line.receiver.memory[0x63] == 8
    assert line.receiver.attenuation_db == 3


def test_arrivals_of_a_line_full_of_faults_are_never_of_a_wrong_period(tmp_path):
    clock = StepClock(until_s=120.0)
    hunt = SimulatedHunt(SCENARIOS[2], seed=3)
    _, served = served_line("tcp", hunt, clock, ("parity", "echo", "no-fix"))
    with served:
        session = ReceiverSession(
            open_port(served.address), PollingSettings(poll_s=0.43), clock=clock, quiet_s=5
        )
        session.start()
        assert clock.done.wait(100)
        session.stop()
    assert session.status.faults > 5
    arrivals, fixes = session.hunt()
    rows = strongest(arrivals, LEAST_LEVEL)
    assert len(rows) > 30
    truth = hunt.receptions(120).received_s
    # All on one clock: each is a whole number of pings and one common shift away from the truth.
    shift = np.median(arrivals.arrival_s[rows] - truth[arrivals.period[rows]])
    assert np.abs(arrivals.arrival_s[rows] - truth[arrivals.period[rows]] - shift).max() < 0.004
    assert (np.abs(fixes.lat_deg - 39.5) < 0.1).all()


def test_nothing_listens_there(tmp_path):
    session = ReceiverSession(open_port("/dev/ttyNotThere"))
    session.start()
    assert until(lambda: session.status.state == "waiting")
    session.stop()
    assert "no such device" in session.status.words
    assert len(session.hunt()[0]) == 0
