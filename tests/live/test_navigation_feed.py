"""A GPS by UDP or serial line beside the receiver: positions kept, refusals counted, cables pulled, one clock."""

from __future__ import annotations

import os
import pty
import socket
import tty

import pytest
from waiting import until

from trackerlib.live.hunt import one_clock
from trackerlib.live.navigation_feed import NavigationFeed
from trackerlib.live.navigation_stream import DeckUnitRange, Fix
from trackerlib.live.nmea import checksum
from trackerlib.live.ports import UdpPort, open_port
from trackerlib.live.raw_log import RawLog
from trackerlib.live.session_file import SessionFile, raw_of, read_session
from trackerlib.receiver.periods import Period
from trackerlib.receiver.sail import Maximum


def gga(clock, quality=1):
    body = f"GPGGA,{clock},4807.038,N,01131.000,E,{quality},08,0.9,545.4,M,46.9,M,,"
    return f"${body}*{checksum(body):02X}\r\n".encode()


def test_positions_ranges_and_refusals_of_datagrams(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    sent = [
        gga("120000"),
        gga("120001", 0),
        b"$GPGGA,120002*00",
        b"RNG: TX = 11.0 RX = 12.0 time = 08.807 Sec.",
    ]
    with SessionFile(tmp_path / "s") as file:
        feed = NavigationFeed(UdpPort(number), file)
        feed.start()
        assert until(lambda: feed.status.reader.state == "connected")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for datagram in sent:
                out.sendto(datagram, ("127.0.0.1", number))
        assert until(lambda: feed.status.reader.lines == len(sent))
        feed.stop()
    (_, fix), (_, deck) = feed.poll()
    assert isinstance(fix, Fix)
    assert (fix.time_s % 86_400, fix.lat_deg) == (43_200, pytest.approx(48.1173))
    assert isinstance(deck, DeckUnitRange)
    assert dict(feed.status.refused) == {"GGA: no fix": 1, "a sentence that cannot be read": 1}
    assert "wanted" in feed.status.last_refused
    assert [found for _, found in read_session(tmp_path / "s").fixes] == [fix]
    assert [data for _, _, data in raw_of(tmp_path / "s")] == sent


class Cable:
    """A GPS's serial line: a pseudo-terminal under a name that stays, as a USB converter's does."""

    def __init__(self, device):
        self.device, self.said = device, 0

    def plug_in(self):
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.device.symlink_to(os.ttyname(slave))
        return slave

    def pull(self, slave):
        self.device.unlink()
        os.close(self.master)
        os.close(slave)

    def say(self, data):
        self.said += os.write(self.master, data)


def test_a_serial_line_is_read_and_read_again_when_its_cable_was_pulled(tmp_path):
    cable = Cable(tmp_path / "ttyGPS")
    with SessionFile(tmp_path / "s") as file:
        feed = NavigationFeed(open_port(f"{cable.device}@4800"), file, RawLog(tmp_path, "gps"))
        feed.start()
        assert until(lambda: feed.status.reader.state == "waiting")
        assert "no such device" in feed.status.reader.words
        for k, rest in ((0, b""), (10, b"$GPGGA,120020,4807.0"), (30, b"")):
            slave = cable.plug_in()
            assert until(lambda: feed.status.reader.state == "connected")
            for second in range(k, k + 10):
                sentence = gga(f"1200{second:02d}")
                cable.say(sentence[:30])  # a driver gives a sentence in pieces
                cable.say(sentence[30:])
            cable.say(rest)
            assert until(lambda: feed.status.reader.bytes == cable.said), feed.status
            cable.pull(slave)
            assert until(lambda: feed.status.reader.state == "waiting")
        assert until(lambda: feed.status.positions == 30)
        heard = feed.poll()
        feed.stop()
    assert feed.status.reader.reconnects == 2
    assert feed.status.reader.cut == 1  # the sentence that the cable ended
    assert not feed.status.refused
    seconds = [fix.time_s % 60 for _, fix in heard]
    assert seconds == [*range(20), *range(30, 40)]
    assert [found for _, found in read_session(tmp_path / "s").fixes] == [fix for _, fix in heard]
    (day_file,) = tmp_path.glob("gps-*.raw")
    assert day_file.read_bytes().count(b"$GPGGA") == 31


def test_its_positions_and_the_receiver_s_arrivals_come_on_one_clock(tmp_path):
    (tmp_path / "nav.raw").write_bytes(b"".join(gga(f"1200{k:02d}") for k in range(10)))
    feed = NavigationFeed(open_port(f"file:{tmp_path / 'nav.raw'}"))
    feed.start()
    assert until(lambda: feed.status.reader.state == "ended")
    feed.stop()
    heard = [(1000.0 + k, fix) for k, (_, fix) in enumerate(feed.heard())]
    periods = [Period(k, 1003.0 + 2 * k, (Maximum(2000, 510),), 0.0, 2000) for k in range(3)]
    arrivals, fixes = one_clock(periods, heard, 1e-3)
    assert arrivals.arrival_s.tolist() == pytest.approx([0.5, 2.5, 4.5])
    assert fixes.time_s.tolist() == pytest.approx([k - 1.0 for k in range(10)])
