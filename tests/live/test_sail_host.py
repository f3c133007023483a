"""The host against the emulated line, over TCP and a pseudo-terminal: answers, rates, and every fault in words."""

from __future__ import annotations

import pytest

from trackerlib.live.ports import open_port
from trackerlib.live.sail_host import SailHost, decode_position
from trackerlib.receiver.sail import BAUD_RATES, Fault, Maximum, ReceiverParameters
from trackerlib.simulation.hexagon import SCENARIOS
from trackerlib.simulation.sail_server import PtyLine, TcpLine
from trackerlib.simulation.sail_units import HELP_TEXT, SailLine, SimulatedHunt

NOON = 1_780_315_200.0  # 2026-06-01 12:00 UTC


class Rig:
    """An emulated line with a clock that only the test moves, and a host on it."""

    def __init__(self, served, host, line):
        self.served, self.host, self.line = served, host, line
        self.now_s = 0.0


@pytest.fixture(params=["tcp", "pty"])
def make_rig(request):
    """Makes a rig with faults."""
    opened = []

    def make(*faults, heard=None, quiet_s=0.3):
        rig = Rig(None, None, None)
        hunt = SimulatedHunt(SCENARIOS[2], seed=1)
        rig.line = SailLine(hunt, lambda: rig.now_s, faults, NOON)
        rig.served = TcpLine(rig.line, "127.0.0.1", 0) if request.param == "tcp" else PtyLine(rig.line)
        rig.served.start()
        rig.host = SailHost(open_port(rig.served.address), heard, quiet_s)
        rig.host.port.open()
        opened.append(rig)
        return rig

    yield make
    for rig in opened:
        rig.host.port.close()
        rig.served.stop()


def test_a_hunt_is_heard_over_the_line(make_rig):
    heard = []
    rig = make_rig(heard=heard.append)
    host = rig.host
    assert host.resynchronise() == 9600
    assert host.write_parameters(ReceiverParameters(2000, 3, 20)) is None
    assert host.start() is None
    assert [host.maxima(3) for _ in range(3)] == [(), (), ()]  # two buffers of zeros, then none
    found = []
    for _ in range(4):
        rig.now_s += 2.0
        maxima = host.maxima(3)
        assert len(maxima) == 3
        assert host.maxima(3) == ()  # offered once
        found.append(maxima[0].index)
    # The sum of eleven samples is largest about ten samples after the leading edge.
    truth = [1e3 * (time % 2) + 10 for time in rig.line.receiver.hunt.receptions(8).received_s[:4]]
    assert found == pytest.approx(truth, abs=2.5)
    assert host.attenuation() == 0
    assert host.set_attenuation(12) is None
    assert host.attenuation() == 12
    reading = host.position()
    assert reading.time_of_day_s == 43_200 + 8
    assert (reading.position.lat_deg, reading.position.lon_deg) == pytest.approx(
        (39.492, -67.5055), abs=0.001
    )
    assert host.link_test() is None
    assert host.help_text().startswith("Help SAIL DRIVER")
    assert HELP_TEXT[-1] in host.help_text()
    assert host.load(0x2000, bytes(range(40))) is None
    assert host.dump(0x2000, 40) == bytes(range(40))
    assert host.load(0xF000, b"\x01\x02").kind == "refused"
    assert b"".join(heard).count(b"#GPS ?L") == 0  # echo and prompt stand between
    assert b"#GPS \r\n:\x03?L 120008," in b"".join(heard)


def test_pause_and_restart(make_rig):
    rig = make_rig()
    host = rig.host
    host.write_parameters(ReceiverParameters(1500, 2, 20))
    host.start()
    rig.now_s = 1.5
    assert len(host.maxima(2)) == 2
    assert host.pause() is None
    rig.now_s = 9.0
    assert host.maxima(2) == ()
    assert host.has_parameters(ReceiverParameters(1500, 2, 20)) is True
    assert host.restart() is None
    assert host.has_parameters(ReceiverParameters()) is True


@pytest.mark.parametrize("baud", [rate for rate in BAUD_RATES if rate < 9600])
def test_every_rate_and_back(make_rig, baud):
    rig = make_rig(quiet_s=0.1)
    assert rig.host.set_baud(baud) is None
    assert (rig.line.receiver.baud, rig.line.gps.baud, rig.host.baud) == (baud, baud, baud)
    assert rig.host.attenuation() == 0
    assert rig.host.restart() is None
    assert (rig.line.receiver.baud, rig.line.gps.baud, rig.host.baud) == (9600, 9600, 9600)
    with pytest.raises(ValueError, match="wanted one of"):
        rig.host.set_baud(1000)


def test_a_receiver_that_restarted_is_found_again_with_its_gps(make_rig):
    rig = make_rig(quiet_s=0.1)
    rig.host.set_baud(1200)
    rig.line.receiver.reset()
    found = rig.host.resynchronise()
    if rig.host.port.has_baud:  # a network has no rate to lose
        assert found == 9600
        assert rig.line.gps.baud == 9600
    assert not isinstance(rig.host.position(), Fault)
    assert not isinstance(rig.host.attenuation(), Fault)


def test_a_receiver_that_a_wrong_rate_left_deaf_needs_its_button(make_rig):
    rig = make_rig("deaf", quiet_s=0.05)
    rig.host.type(b"#0001000")
    fault = rig.host.attenuation()
    assert fault.kind == "no answer"
    assert "reset button" in rig.host.resynchronise().words
    assert not isinstance(rig.host.position(), Fault)  # the GPS still hears
    rig.line.receiver.reset()
    assert rig.host.resynchronise() == 9600


def test_a_wrong_rate_does_not_deafen_the_mended_receiver(make_rig):
    rig = make_rig()
    rig.host.type(b"#0001000")
    assert rig.host.attenuation() == 0


@pytest.mark.parametrize(
    ("fault", "kinds", "quiet_s"),
    [
        ("echo", {"garbled"}, 5.0),
        ("parity", {"garbled"}, 5.0),
        ("no-fix", set(), 5.0),
        ("stop", {"stopped", "no answer", "silent"}, 0.1),
        ("flood", {"flood", "garbled", "stopped", "no answer", "silent"}, 0.1),
    ],
)
def test_faults_of_the_line_are_results_and_it_goes_on(make_rig, fault, kinds, quiet_s):
    rig = make_rig(fault, quiet_s=quiet_s)
    rig.host.start()
    good = 0
    for _ in range(40):
        rig.now_s += 2.0
        for answer in (rig.host.maxima(2), rig.host.position()):
            if isinstance(answer, Fault):
                assert answer.kind in kinds
                assert answer.words
            elif isinstance(answer, tuple):
                good += len(answer) == 2 and isinstance(answer[0], Maximum)
            else:
                assert answer.position is None or abs(answer.position.lat_deg - 39.5) < 0.1
    assert good >= 20


def test_a_line_that_is_gone_is_said(make_rig):
    rig = make_rig()
    rig.served.stop()
    rig.host.port.close()
    assert rig.host.maxima(2).kind == "gone"
    assert rig.host.resynchronise().kind == "gone"


def test_a_terminal_talks_as_it_likes(make_rig):
    rig = make_rig()
    assert rig.host.type(b"#PTR ") == b"#PTR \r\n:\x03"
    assert rig.host.type(b"V") == b"V01\r\n:\x03"
    assert rig.host.attenuation() == 0  # addressed anew


@pytest.mark.parametrize(
    ("body", "lat", "lon"),
    [
        (b" 145642,4130.50,S,07030.25,E,1,05,1.5,000,M,00000,M", -41.508333, 70.504167),
        (b" 145642,4130.5012,N,07030.2512,W,2,05,1.5,000,M,00000,M", 41.508353, -70.504187),
    ],
)
def test_hemispheres_and_longer_fractions_of_a_minute_are_read(body, lat, lon):
    reading = decode_position(body)
    assert (reading.position.lat_deg, reading.position.lon_deg) == pytest.approx((lat, lon), abs=1e-6)
    assert reading.time_of_day_s == 53_802


def test_the_report_s_empty_gps_buffer_is_no_position():
    reading = decode_position(b" 145642,0000.00,N,00000.00,E,0,0,000,000,M,0000,M")
    assert (reading.position, reading.no_position) == (None, "no fix")


@pytest.mark.parametrize("body", [b"", b" 145642,0000.00,N", b" 1456x2,4130.50,S,07030.25,E,1,05,1.5,000,M"])
def test_a_garbled_gps_answer_is_a_fault(body):
    assert decode_position(body).kind == "garbled"
