"""The Wet-paper chart with a receiver on its line, without a browser: emulator, files, faults in words."""

from __future__ import annotations

import os
import socket
import threading
import time
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.chart import ChartTab
from trackerlib.beacon.navigation import PositionLimits
from trackerlib.live.nmea import checksum
from trackerlib.live.session_file import read_session
from trackerlib.simulation.sail_units import degrees_minutes

RATE = 40.0


@pytest.fixture
def tab(tmp_path):
    tab = ChartTab(session=Session())
    tab.activate()
    tab.controls_.source.value = "receiver"
    tab.controls_.rate.value = RATE
    tab.controls_.folder.value = str(tmp_path)
    yield tab
    tab.close()


def until(tab, condition, seconds=30.0):
    """Lets the page's clock tick until something is so."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        tab.tick(0.1)
        tab.session.tick(0.1)
        if condition():
            return True
        time.sleep(0.05)
    return False


def connect(tab):
    tab.controls_.emulate.clicks += 1
    tab.controls_.connect.clicks += 1
    assert not tab.session.failed, tab.session.message


def test_from_the_line_to_paper_pings_and_file(tab):
    connect(tab)
    assert until(tab, lambda: tab.session.pings is not None and len(tab.session.pings) > 40), tab.live.status
    assert tab.session.pings.simulated
    assert tab.session.truth["depth_m"] == 2000.0
    number, arrival_s = tab.live.followed
    assert np.all(np.diff(number) > 0)
    spread = np.ptp(arrival_s - 2.0 * number)
    assert spread < 0.5  # of a range that changes by hundreds of metres, not of whole intervals
    assert tab.paper.count > 40
    assert "Listening" in tab.status_words.object
    path, lines = tab.live.file, tab.paper.count
    tab.controls_.connect.clicks += 1
    assert tab.live.receiver is None
    tab._try(lambda: tab._open_stored(path))
    assert tab.kind == "stored"
    assert tab.roll.simulated
    assert tab.paper.count >= lines
    tab.controls_.accept.clicks += 1
    assert len(tab.session.pings) > 35


def test_other_limits_judge_the_pings_of_a_hunt_again(tab):
    session, ties = tab.session, []  # of the receiver's clock with that of the positions: known ever better

    def comes(condition):
        return until(tab, lambda: (ties.append(tab.live.receiver.tie_s), condition())[1])

    connect(tab)
    assert until(tab, lambda: session.pings is not None and len(session.pings) > 30), tab.live.status
    ties.append(tab.live.receiver.tie_s)
    heard = len(session.pings)
    session.edit(position_limits=PositionLimits(greatest_hdop=90.0))  # refuses none, but judges all again
    assert comes(lambda: "arrivals have a position" in session.message)
    assert comes(lambda: len(session.pings) >= heard)
    heard = len(session.pings)
    before = dict(zip(session.pings.number.tolist(), session.pings.lat_deg.tolist(), strict=True))
    session.edit(antenna_offset_m=(-200.0, 0.0, 0.0))
    assert comes(lambda: session.pings.lat_deg[0] != before[int(session.pings.number[0])])
    assert comes(lambda: len(session.pings) >= heard)  # the newest may wait for a position again
    metres = 111e3 * np.array(
        [
            lat - before[n]
            for n, lat in zip(session.pings.number, session.pings.lat_deg, strict=True)
            if n in before
        ]
    )
    assert len(metres) == heard
    assert np.abs(metres).max() > 30
    session.edit(position_limits=PositionLimits(greatest_hdop=0.5))  # which no position has
    assert comes(lambda: len(session.pings) == 0)
    assert "arrivals refused: " in session.message
    assert len(tab.live.followed[0]) == 0
    for _ in range(2):
        session.undo()
    assert comes(lambda: len(session.pings) >= heard)
    again = dict(zip(session.pings.number.tolist(), session.pings.lat_deg.tolist(), strict=True))
    # The same places, but for how far the ship goes by its positions while the tie of the clocks changes.
    time_s, rows = np.unique(tab.live.roll.fixes.time_s, return_index=True)
    speed = 111e3 * np.abs(np.diff(tab.live.roll.fixes.lat_deg[rows]) / np.diff(time_s)).max()
    far = 111e3 * max(abs(again[n] - lat) for n, lat in before.items())
    assert far < 0.1 + speed * np.ptp(ties), (far, speed, ties)
    assert until(tab, lambda: session.fix is not None and len(session.fix.number) >= heard)


def test_the_menus_turn_the_receiver(tab):
    connect(tab)
    receiver = tab.live.emulator.line.line.receiver
    assert until(tab, lambda: tab.live.status.periods > 2)
    tab.controls_.attenuator.value = 12
    assert until(tab, lambda: receiver.attenuation_db == 12)
    tab.controls_.baud.value = 1200
    assert until(tab, lambda: tab.live.status.baud == 1200)
    tab.controls_.maxima.value = 4
    tab.controls_.send.clicks += 1
    assert until(tab, lambda: receiver.memory[0x63] == 8)
    tab.beside.pages.choice.value = "Terminal"
    tab.beside._keyed(SimpleNamespace(new="#PTR H\r"))
    heard = []
    tab.beside.terminal.param.watch(lambda event: heard.append(event.new), "output")
    assert until(tab, lambda: "SIMULATED" in "".join(heard))


def test_the_link_test_is_ended_by_the_key_that_ends_the_line(tab):
    connect(tab)
    assert until(tab, lambda: tab.live.status.periods > 0)
    tab.beside.pages.choice.value = "Terminal"
    heard = []
    tab.beside.terminal.param.watch(lambda event: heard.append(event.new), "output")
    tab.beside._keyed(SimpleNamespace(new="#PTR !T1234 5678\r"))
    assert until(tab, lambda: "DONE" in "".join(heard))
    assert bytes(tab.live.emulator.line.line.receiver.memory[0x80:0x86]) == b"\x12\x34\0\0\x56\x78"


def test_the_sample_interval_that_the_line_tells_is_said_and_taken(tab):
    tab.controls_.measured.clicks += 1
    assert "while a receiver is connected" in tab.session.message
    connect(tab)
    assert until(tab, lambda: tab.live.status.periods > 30)
    tab.tick(0.1)
    assert "Sample interval by this machine's clock" in tab.status_words.object
    interval_s, sigma_s = tab.live.receiver.measured_sample_interval_s
    assert 0 < sigma_s < 1e-5
    assert interval_s == pytest.approx(1e-3, abs=5 * sigma_s)
    tab.controls_.measured.clicks += 1
    assert tab.controls_.sample.value == pytest.approx(1e3 * interval_s, abs=1e-6)
    assert "±" in tab.session.message


class UdpGps:
    """SIMULATED sentences of the emulated ship's own GPS, sent to a UDP port as they become due."""

    def __init__(self, number, emulator):
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.number, self.emulator, self.gps = number, emulator, emulator.line.line.gps
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        sent = -1
        while not self.stop.wait(0.01):
            second = int(self.gps.clock())
            if second > sent:
                sent = second
                self.out.sendto(self.sentence(second), ("127.0.0.1", self.number))

    def sentence(self, second):
        clock = time.gmtime(self.gps.start_utc_s + second)
        lat, lon = self.emulator.hunt.gps(second)
        place = (
            f"{degrees_minutes(lat, 2, 4)},{'S' if lat < 0 else 'N'},{degrees_minutes(lon, 3, 4)},"
            f"{'W' if lon < 0 else 'E'}"
        )
        body = f"GPGGA,{time.strftime('%H%M%S', clock)},{place},1,08,1.2,0.0,M,0.0,M,,"
        return f"${body}*{checksum(body):02X}\r\n".encode()

    def close(self):
        self.stop.set()
        self.thread.join()
        self.out.close()


def free_udp_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_positions_of_a_line_of_their_own_place_the_pings(tab):
    number = free_udp_port()
    tab.controls_.positions.value = f"udp:{number}"
    tab.controls_.emulate.clicks += 1
    tab.controls_.connect.clicks += 1
    assert not tab.session.failed, tab.session.message
    assert not tab.live.receiver.settings.gps_on_line
    assert until(tab, lambda: tab.live.feed_status.reader.state == "connected")
    tab.tick(0.1)
    assert "Nothing has come yet" in tab.status_words.object
    gps = UdpGps(number, tab.live.emulator)
    try:
        gps.out.sendto(b"$GPGGA,120002*00", ("127.0.0.1", number))
        assert until(tab, lambda: tab.session.pings is not None and len(tab.session.pings) > 25), (
            tab.live.status
        )
        gps.out.sendto(b"RNG: TX = 11.0 RX = 12.0 time = 03.807 Sec.\r\n", ("127.0.0.1", number))
        assert until(tab, lambda: tab.live.placer.ranges == 1)
        tab.tick(0.1)
        assert "The fix is of arrivals, which came first; ranges are only kept" in tab.status_words.object
    finally:
        gps.close()
    assert tab.live.placed == 0
    assert until(tab, lambda: tab.live.feed_status.positions == tab.live.status.positions, 5)
    assert f"Positions from udp:{number}" in tab.status_words.object
    assert "1 of a sentence that cannot be read" in tab.status_words.object
    path, pings = tab.live.file, tab.session.pings
    second = (pings.utc.astype("datetime64[ms]").astype(float) * 1e-3) - gps.gps.start_utc_s
    there = np.array([gps.emulator.hunt.gps(round(s)) for s in second])
    off_m = 111e3 * np.hypot(pings.lat_deg - there[:, 0], 0.77 * (pings.lon_deg - there[:, 1]))
    assert np.median(off_m) < 60  # of the ship's way in the seconds that this fast clock is late by
    tab.controls_.connect.clicks += 1
    assert tab.live.feed is None
    recorded = read_session(path)
    assert len(recorded.fixes) > 50
    assert len(recorded.ranges) == 1
    assert (path.parent / f"SIMULATED-positions-{datetime.now(UTC):%Y-%m-%d}.raw").stat().st_size > 1000
    tab._try(lambda: tab._open_stored(path))
    tab.controls_.accept.clicks += 1
    assert len(tab.session.pings) > 20


def test_a_line_of_positions_that_cannot_be_had_is_told_in_words(tab):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("0.0.0.0", 0))
        number = taken.getsockname()[1]
        tab.controls_.positions.value = f"udp:{number}"
        connect(tab)
        assert until(tab, lambda: tab.live.feed_status.reader.state == "waiting")
        tab.tick(0.1)
        assert f"udp:{number}: cannot listen" in tab.status_words.object
        assert "trying again" in tab.status_words.object
    assert until(tab, lambda: tab.live.feed_status.reader.state == "connected")
    tab.controls_.connect.clicks += 1
    for where, words in (("udp:ship", "wanted 1 to 65535"), (tab.controls_.address.value, "own line")):
        tab.controls_.positions.value = where
        tab.controls_.connect.clicks += 1
        assert tab.session.failed
        assert words in tab.session.message
        assert tab.live.receiver is None


def test_a_port_that_is_taken_is_told_in_a_sentence(tab):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        tab.controls_.emulator_port.value = taken.getsockname()[1]
        tab.controls_.emulate.clicks += 1
    assert tab.session.failed
    assert "cannot have port" in tab.session.message


def test_a_device_that_is_not_there_is_told_and_tried_again(tab):
    tab.controls_.address.value = "/dev/ttyNotThere"
    tab.controls_.connect.clicks += 1
    assert until(tab, lambda: tab.live.status.state == "waiting", 10)
    tab.tick(0.1)
    assert "no such device" in tab.status_words.object


def test_a_folder_without_permission_is_told(tab, tmp_path):
    (tmp_path / "file").write_text("")
    tab.controls_.folder.value = str(tmp_path / "file" / "hunts")
    tab.controls_.address.value = "tcp:127.0.0.1:1"
    tab.controls_.connect.clicks += 1
    assert tab.session.failed
    assert "cannot be kept there" in tab.session.message
    assert tab.live.receiver is None


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has a device that is always full")
def test_a_disk_that_fills_is_said_while_the_hunt_goes_on(tab, tmp_path):
    for day in (datetime.now(UTC), datetime.now(UTC) + timedelta(days=1)):
        (tmp_path / f"SIMULATED-sail-{day:%Y-%m-%d}.raw").symlink_to("/dev/full")
    connect(tab)
    assert until(tab, lambda: "raw log" in tab.status_words.object), tab.live.status
    tab.live.receiver.file._database.execute("PRAGMA max_page_count = 1")  # no page more than it has
    assert until(tab, lambda: tab.live.file.name in tab.live.status.words), tab.live.status
    heard, lines = tab.live.status.periods, tab.paper.count
    assert until(tab, lambda: tab.live.status.periods > heard + 10 and tab.paper.count > lines + 5)
    tab.tick(0.1)
    words = tab.status_words.object
    assert "Listening" in words
    assert words.count("the disk is full") == 2
    assert "bytes or rows could not be kept" in words
    tab.controls_.connect.clicks += 1
    assert "rows of what was heard could not be kept" in tab.session.message
    assert (
        len(read_session(tab.live.file).runs.get(1, ())) <= heard
    )  # a whole file, of what there was room for


def test_an_emulator_that_stops_leaves_the_page_up(tab):
    connect(tab)
    assert until(tab, lambda: tab.live.status.periods > 2)
    tab.live.emulator.line.stop()
    assert until(tab, lambda: tab.live.status.state == "waiting")
    assert "tcp:" in tab.status_words.object


def test_typing_without_a_receiver_says_what_to_do():
    tab = ChartTab(session=Session())
    tab.activate()
    tab.beside._keyed(SimpleNamespace(new="#PTR H\r"))
    assert "No receiver is connected" in tab.session.message
