"""A deck unit on its line, without a browser: from its lines to pings, to a fix, to a file that opens again."""

from __future__ import annotations

import socket
import time
from datetime import UTC, datetime

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.chart import ChartTab
from trackerlib.frames import LocalFrame
from trackerlib.live.nmea import checksum
from trackerlib.live.session_file import read_session
from trackerlib.simulation.sail_units import degrees_minutes

FRAME, BEACON_M, SOUND_MPS = LocalFrame(39.5, -67.5), np.array([0.0, 0.0, -300.0]), 1500.0
STEP_S = 0.05  # of real time, between two positions


@pytest.fixture
def tab(tmp_path):
    tab = ChartTab(session=Session())
    tab.activate()
    tab.controls_.source.value = "deck unit"
    tab.controls_.folder.value = str(tmp_path)
    yield tab
    tab.close()


def place(k):
    """A ship that goes round the beacon, 5 m in a step: the n-th of her positions."""
    angle = 5.0 * k / 200.0
    return np.array([200.0 * np.sin(angle), 200.0 * np.cos(angle), 0.0])


def gga(utc_s, k):
    lat, lon, _ = FRAME.to_geodetic(place(k))
    clock = datetime.fromtimestamp(utc_s, UTC)
    body = (
        f"GPGGA,{clock:%H%M%S}.{clock.microsecond // 10_000:02d},{degrees_minutes(lat, 2, 5)},N,"
        f"{degrees_minutes(lon, 3, 5)},W,1,08,1.0,0.0,M,0.0,M,,"
    )
    return f"${body}*{checksum(body):02X}\r\n".encode()


def test_from_its_lines_to_pings_and_a_file(tab):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    with socket.create_server(("127.0.0.1", 0)) as unit, socket.socket(type=socket.SOCK_DGRAM) as gps:
        tab.controls_.address.value = f"tcp:127.0.0.1:{unit.getsockname()[1]}"
        tab.controls_.positions.value = f"udp:{number}"
        tab.controls_.connect.clicks += 1
        assert not tab.session.failed, tab.session.message
        assert tab.controls_.connect.label == "Disconnect"
        line, _ = unit.accept()
        sail(tab, line.sendall, lambda data: gps.sendto(data, ("127.0.0.1", number)), lambda: tab.deck.placed)
        line.close()
    tab.session.tick(0.1)
    pings, path = tab.session.pings, tab.deck.file
    assert not pings.simulated
    assert len(pings) == tab.deck.placed >= 7
    assert (
        f"{tab.deck.placer.ranges} ranges of the deck unit</b>, 1 without a reply" in tab.status_words.object
    )
    assert "1 of a range that cannot be read" in tab.status_words.object
    there = FRAME.to_local(pings.lat_deg, pings.lon_deg, np.zeros(len(pings)))
    slant_m = np.linalg.norm(np.asarray(there) - BEACON_M, axis=1)
    assert np.abs(slant_m - SOUND_MPS * pings.travel_time_s).max() < 2.0
    assert tab.paper.count == len(pings)
    assert tab.paper.lines.end == 0
    tab.controls_.connect.clicks += 1
    assert tab.controls_.connect.label == "Connect"
    assert len(read_session(path).ranges) == tab.deck.placer.ranges
    assert path.name.startswith("deck-")
    assert len(list(path.parent.glob("*-*.raw"))) == 2
    tab._try(lambda: tab._open_stored(path))
    assert len(tab.session.pings) >= len(pings)
    assert "ranges of a deck unit" in tab.session.message


def sail(tab, send_range, send_position, placed):
    """Two seconds on a circle about the beacon, a range of it at every fourth position; one lost, one spoilt."""
    slant_s = np.linalg.norm(place(0) - BEACON_M) / SOUND_MPS
    for k in range(44):
        send_position(gga(time.time(), k))
        if k % 4 == 3:
            told = {19: "--.---", 23: "8"}.get(k, f"{2 * slant_s:06.3f}")
            send_range(f"RNG: TX = 11.0 RX = 12.0 time = {told} Sec.\r\n".encode())
        tab.tick(STEP_S)
        tab.session.tick(STEP_S)
        time.sleep(STEP_S)
    end = time.monotonic() + 5
    while time.monotonic() < end and placed() < 7:
        tab.tick(0.1)
        tab.session.tick(0.1)
        time.sleep(0.02)


def test_ranges_on_the_line_of_positions_beside_a_receiver_are_pings(tab):
    tab.controls_.source.value = "receiver"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    tab.controls_.address.value = "tcp:127.0.0.1:1"  # nobody answers there
    tab.controls_.positions.value = f"udp:{number}"
    tab.controls_.connect.clicks += 1
    assert not tab.session.failed, tab.session.message
    with socket.socket(type=socket.SOCK_DGRAM) as out:

        def send(data):
            out.sendto(data, ("127.0.0.1", number))

        sail(tab, send, send, lambda: tab.live.placed)
    tab.tick(0.1)
    tab.session.tick(0.1)
    pings, path = tab.session.pings, tab.live.file
    assert len(pings) == tab.live.placed >= 7
    assert not pings.simulated
    there = FRAME.to_local(pings.lat_deg, pings.lon_deg, np.zeros(len(pings)))
    slant_m = np.linalg.norm(np.asarray(there) - BEACON_M, axis=1)
    assert np.abs(slant_m - SOUND_MPS * pings.travel_time_s).max() < 2.0
    assert f"{tab.live.placer.ranges} ranges of the deck unit" in tab.status_words.object
    assert "The fix is of ranges, which came first" in tab.status_words.object
    tab.controls_.connect.clicks += 1
    assert not tab.session.listening
    assert len(read_session(path).ranges) == tab.live.placer.ranges


def test_one_line_for_both_is_told(tab):
    tab.controls_.address.value = tab.controls_.positions.value = "udp:40123"
    tab.controls_.connect.clicks += 1
    assert tab.session.failed
    assert "leave Positions from empty" in tab.session.message
    assert not tab.deck.listening
