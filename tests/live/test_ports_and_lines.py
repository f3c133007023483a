"""Reader threads: nothing lost while the app is blocked, raw bytes first, every trouble in words."""

from __future__ import annotations

import os
import pty
import socket
import subprocess
import sys
import time

import pytest
from waiting import until

from trackerlib.live.line_reader import LineReader, LineSplitter
from trackerlib.live.ports import PortError, SerialPort, TcpPort, UdpPort, open_port
from trackerlib.live.raw_log import RawLog, read_day

NOON, MIDNIGHT = 1_780_315_200.0, 1_780_358_400.0  # 2026-06-01 12:00 and 2026-06-02 00:00 UTC


# Another process, so that the app that is blocked does not block it.
SENDING = """
import socket, sys, time
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
began = time.monotonic()
for k in range(2000):
    time.sleep(max(0.0, began + k * 1e-3 - time.monotonic()))
    out.sendto(b"$GPXXX,%05d," % k + b"x" * 60 + b"\\r\\n", ("127.0.0.1", int(sys.argv[1])))
"""


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def reading():
    """Starts readers, and stops them at the end."""
    readers = []

    def start(port, *more):
        reader = LineReader(port, *more)
        reader.start()
        readers.append(reader)
        return reader

    yield start
    for reader in readers:
        reader.stop()


def test_at_1_khz_of_udp_lines_none_is_lost_while_the_app_is_blocked(reading, tmp_path):
    number = free_port(socket.SOCK_DGRAM)
    reader = reading(UdpPort(number), RawLog(tmp_path, "nav"))
    assert until(lambda: reader.status.state == "connected")
    sent = [f"$GPXXX,{k:05d},{'x' * 60}" for k in range(2000)]
    sender = subprocess.Popen([sys.executable, "-c", SENDING, str(number)])
    got = []
    while sender.poll() is None:
        blocked = time.monotonic()
        while time.monotonic() - blocked < 0.5:  # the app thinks, and does not let go
            sum(range(2000))
        got += reader.drain()
    assert until(lambda: reader.status.lines == len(sent))
    got += reader.drain()
    assert [line.text for line in got] == sent
    assert reader.status.dropped == 0
    (raw,) = tmp_path.glob("*.raw")
    assert raw.read_bytes() == b"".join(text.encode() + b"\r\n" for text in sent)


def test_a_queue_that_nobody_empties_is_bounded_and_says_what_it_dropped(reading, tmp_path):
    (tmp_path / "long.txt").write_text("".join(f"{k}\n" for k in range(500)))
    reader = reading(open_port(f"file:{tmp_path / 'long.txt'}"), None, 100)
    assert until(lambda: reader.status.state == "ended")
    assert [line.text for line in reader.drain()] == [str(k) for k in range(400, 500)]
    assert reader.status.dropped == 400


def test_a_file_is_played_back_at_its_pace_to_its_last_line(reading, tmp_path):
    (tmp_path / "nav.raw").write_bytes(b"one\r\ntwo\rthree\n\nfour")
    began = time.monotonic()
    reader = reading(open_port(f"file:{tmp_path / 'nav.raw'}@100"))
    assert until(lambda: reader.status.state == "ended")
    assert time.monotonic() - began > 0.15
    assert [line.text for line in reader.drain()] == ["one", "two", "three", "four"]


def test_a_pulled_cable_is_told_and_connected_again(reading):
    with socket.create_server(("127.0.0.1", 0)) as server:
        reader = reading(TcpPort(*server.getsockname()))
        first, _ = server.accept()
        first.sendall(b"before\n$GPGGA,12")
        assert until(lambda: reader.status.lines == 1)
        first.close()
        assert until(lambda: reader.status.state == "waiting")
        second, _ = server.accept()
        second.sendall(b"after\n")
        assert until(lambda: reader.status.lines == 2)
        second.close()
    assert [line.text for line in reader.drain()] == ["before", "after"]
    status = reader.status
    assert (status.cut, status.reconnects) == (1, 1)


def test_an_unplugged_serial_device_is_told_in_words(reading):
    master, slave = pty.openpty()
    reader = reading(SerialPort(os.ttyname(slave)))
    assert until(lambda: reader.status.state == "connected")
    os.write(master, b"$GPGGA,1\r\n")
    assert until(lambda: reader.status.lines == 1)
    os.close(slave)
    os.close(master)
    assert until(lambda: reader.status.state == "waiting")
    assert "no such device" in reader.status.words or "is the cable in" in reader.status.words


def test_a_device_that_stops_in_mid_message_and_one_that_floods(reading, monkeypatch):
    monkeypatch.setattr("trackerlib.live.line_reader.QUIET_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:
        reader = reading(TcpPort(*server.getsockname()))
        there, _ = server.accept()
        there.sendall(b"$GPGGA,12")
        assert until(lambda: reader.status.cut == 1)
        assert "stopped in mid-message after '$GPGGA,12'" in reader.status.words
        there.sendall(b"\xff" * 50_000 + b"\n$GPGGA,again\n")
        assert until(lambda: reader.status.lines == 1)
        assert "floods" in reader.status.words
        there.close()
    assert [line.text for line in reader.drain()] == ["$GPGGA,again"]
    assert reader.status.overlong >= 24


@pytest.mark.parametrize("cut", [1, 7, 1000])
def test_lines_do_not_depend_on_how_the_bytes_were_cut(cut):
    text = b"a\r\nb\r\n\r\nccc\nd\re\n"
    splitter = LineSplitter()
    lines = []
    for k in range(0, len(text), cut):
        lines += splitter.feed(text[k : k + cut])
    assert lines == [b"a", b"b", b"ccc", b"d", b"e"]


def test_a_port_in_use_no_permission_and_no_device_are_said_in_words(monkeypatch):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        with pytest.raises(PortError, match="in use by another program"):
            UdpPort(taken.getsockname()[1]).open()
    with pytest.raises(PortError, match="nobody listens there"):
        TcpPort("127.0.0.1", free_port()).open()
    with pytest.raises(PortError, match="no such device"):
        SerialPort("/dev/ttyNotThere").open()
    master, slave = pty.openpty()
    first = SerialPort(os.ttyname(slave))
    first.open()
    with pytest.raises(PortError, match="in use by another program"):
        SerialPort(os.ttyname(slave)).open()
    first.close()
    os.close(master)
    os.close(slave)

    def forbidden(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("trackerlib.live.ports.serial.Serial", forbidden)
    with pytest.raises(PortError, match="no permission"):
        SerialPort("/dev/ttyS0").open()


@pytest.mark.parametrize("where", ["", "udp:70000", "tcp:ship", "udp:x"])
def test_an_address_that_makes_no_sense_is_refused(where):
    with pytest.raises(PortError, match="wanted"):
        open_port(where)


def test_the_raw_log_has_a_file_a_utc_day_and_says_when_each_piece_came(tmp_path):
    log = RawLog(tmp_path, "tcp:ship:4001")
    log.write(b"noon", NOON)
    log.write(b"just after", NOON + 0.001)
    log.write(b"later", NOON + 60)
    log.write(b"tomorrow", MIDNIGHT)
    log.close()
    first, second = sorted(tmp_path.glob("*.raw"))
    assert (first.name, second.name) == ("tcp_ship_4001-2026-06-01.raw", "tcp_ship_4001-2026-06-02.raw")
    assert list(read_day(first).pieces()) == [(NOON, b"noonjust after"), (NOON + 60, b"later")]
    assert list(read_day(second).pieces()) == [(MIDNIGHT, b"tomorrow")]
    again = RawLog(tmp_path, "tcp:ship:4001")
    again.write(b"!", MIDNIGHT + 1)
    again.close()
    assert read_day(second).content == b"tomorrow!"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has a device that is always full")
def test_a_disk_that_fills_is_said_and_the_lines_still_come(reading, tmp_path):
    (tmp_path / "nav-2026-06-01.raw").symlink_to("/dev/full")
    log = RawLog(tmp_path, "nav")
    log.write(b"12345", NOON)
    log.write(b"678", NOON + 1)
    assert "the disk is full" in log.trouble
    assert log.lost_bytes == 8
    (tmp_path / "three.txt").write_text("1\n2\n3\n")
    today = time.strftime("%Y-%m-%d", time.gmtime())
    (tmp_path / f"gps-{today}.raw").symlink_to("/dev/full")
    reader = reading(open_port(f"file:{tmp_path / 'three.txt'}"), RawLog(tmp_path, "gps"))
    assert until(lambda: reader.status.state == "ended")
    assert [line.text for line in reader.drain()] == ["1", "2", "3"]
    assert "the disk is full" in reader.status.words
    assert reader.status.raw_lost == 6
