"""The receiver's SAIL protocol, byte by byte: what is sent, what may come back, what is made of it."""

from __future__ import annotations

import csv
import json

import pytest

from trackerlib.receiver import sail
from trackerlib.receiver.sail import Exchange, Fault, Maximum, ReceiverParameters, Reply

TWO = b"-0A3F00C801DC0400\r\n:\x03"


def hear(command, heard, **more):
    """What an exchange says, fed one byte at a time."""
    exchange = Exchange(command, **more)
    for byte in heard:
        said = exchange.feed(bytes([byte]))
        if said is not None:
            return said
    return exchange.expire()


def test_the_commands_are_those_of_the_report(shared):
    protocol = json.loads((shared / "seed-data/seed002_sail_protocol.json").read_text())
    assert sail.address(sail.RECEIVER) == protocol["address"].encode() + b" "
    assert sail.baud_change(9600) == protocol["baud_change"]["example"].encode()
    assert {str(baud) for baud in sail.BAUD_RATES} == set(protocol["baud_change"]["codes"])
    assert len(TWO) == protocol["data_reply"]["length_for_2"]
    with (shared / "seed-data/seed002_table5_2_attenuators.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            attenuation = -int(row["attenuation_dB"])
            assert sail.set_attenuator(attenuation).decode() == row["sail_command"]
            assert sail.decode_attenuator(row["port_a_code_hex"].encode()) == attenuation
    assert dict(ReceiverParameters(2001, 4, 30).writes()) == {
        0x52: b"\x07\xd1",
        0x63: b"\x08",
        0x74: b"\x00\x1e",
    }
    assert sail.load_command(0x52, b"\x07\xd0") == b"!M52 07D0\r"


@pytest.mark.parametrize("call", [lambda: sail.baud_change(1000), lambda: sail.set_attenuator(6)])
def test_what_the_receiver_has_no_code_for_is_never_sent(call):
    with pytest.raises(ValueError, match="wanted one of"):
        call()


@pytest.mark.parametrize(
    "numbers", [{"period_samples": 70_000}, {"maxima": 9}, {"window_samples": 0}, {"window_samples": 2000}]
)
def test_parameters_the_receiver_cannot_take_are_named(numbers):
    with pytest.raises(ValueError, match=next(iter(numbers))):
        ReceiverParameters(**numbers)


def test_a_data_reply_gives_values_and_indices():
    reply = hear(sail.READ_MAXIMA, TWO)
    assert reply == Reply(b"-", b"0A3F00C801DC0400")
    assert sail.decode_maxima(reply.body, 2) == (Maximum(0x0A3F, 0xC8), Maximum(0x01DC, 0x400))


@pytest.mark.parametrize("body", [b"", b"0000000000000000", b"000000C800000400"])
def test_a_buffer_that_is_not_ready_or_never_filled_gives_no_maxima(body):
    assert sail.decode_maxima(body, 2) == ()


@pytest.mark.parametrize("cut", range(1, 21))
def test_pieces_of_any_length_make_the_same_reply(cut):
    exchange = Exchange(sail.READ_MAXIMA)
    assert exchange.feed(TWO[:cut]) is None
    assert exchange.feed(TWO[cut:] + b"more") == hear(sail.READ_MAXIMA, TWO)
    assert exchange.rest == b"more"


@pytest.mark.parametrize("missed", range(5))
def test_an_echo_with_one_character_missed_loses_no_answer(missed):
    command = b"#PTR "
    reply = hear(command, command[:missed] + command[missed + 1 :] + sail.PROMPT)
    assert (reply.body, reply.echo_missed) == (b"", True)


def test_a_return_in_the_command_is_not_taken_for_the_prompt():
    command = sail.load_command(0x52, b"\x07\xd0")
    assert hear(command, command + sail.PROMPT) == Reply(command, b"")
    assert hear(command, command[:-1] + sail.PROMPT).body == b""


@pytest.mark.parametrize(
    ("heard", "kind"),
    [(b"", "silent"), (b"-", "no answer"), (TWO[:9], "stopped"), (b"-" + b"7" * 5000, "flood")],
)
def test_an_answer_that_does_not_end_says_how(heard, kind):
    fault = hear(sail.READ_MAXIMA, heard)
    assert fault.kind == kind
    assert "'-'" in fault.words


def with_parity(text: bytes) -> bytes:
    return bytes(byte | 0x80 * (byte.bit_count() % 2) for byte in text)


def test_even_parity_is_stripped_and_wrong_parity_refused():
    sound = TWO[:1] + with_parity(TWO[1:])
    reply = hear(sail.READ_MAXIMA, sound)
    assert (reply.body, reply.even_parity) == (TWO[1:-4], True)
    wrong = bytearray(sound)
    wrong[3] ^= 0x80
    assert hear(sail.READ_MAXIMA, bytes(wrong)).kind == "garbled"


@pytest.mark.parametrize(
    "decode",
    [
        lambda: sail.decode_maxima(b"0A3F00C801DC04", 2),
        lambda: sail.decode_maxima(b"x0A3F00C801DC040", 2),
        lambda: sail.decode_attenuator(b"31"),
        lambda: sail.decode_attenuator(b"0"),
        lambda: sail.decode_dump(b"\r\n0050 07 D0", 0x50, 3),
        lambda: sail.decode_dump(b"\r\n0051 07D0", 0x50, 2),
    ],
)
def test_a_garbled_answer_is_a_fault_that_says_what_was_wanted(decode):
    fault = decode()
    assert isinstance(fault, Fault)
    assert "wanted" in fault.words


def test_the_bit_that_toggles_with_the_timer_is_masked():
    assert sail.decode_attenuator(b"59") == 12
    assert sail.decode_attenuator(b"58") == 12


def test_a_command_without_a_prompt_ends_with_its_echo():
    command = sail.baud_change(1200)
    assert hear(command, command, prompted=False) == Reply(command, b"")
    assert hear(command, b"#00x1200", prompted=False).kind == "garbled"


def test_a_dump_is_read_across_lines():
    body = b"\r\n000E  07D0,\r\n0010  0014 00"
    assert sail.decode_dump(body, 0x0E, 5) == bytes.fromhex("07D0001400")
