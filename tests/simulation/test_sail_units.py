"""The emulated receiver: its gain, its clock, its memory, and the faults of the original."""

from __future__ import annotations

import json

import numpy as np
import pytest
from sounds import heard, pulses_at, sound_of

from trackerlib.receiver.report_receiver import ReceiverSettings, ReportReceiver
from trackerlib.receiver.sail import FIRST_BAUD
from trackerlib.simulation.beacon_levels import (
    SimulatedHunt,
    controller_maxima,
    largest_sums,
    moving_sums,
    spreading_loss,
)
from trackerlib.simulation.hexagon import SCENARIOS
from trackerlib.simulation.sail_units import SailLine
from trackerlib.simulation.sound import joined_pulses


class Clock:
    """A clock that stands until it is moved."""

    now_s = 0.0

    def __call__(self):
        return self.now_s


def line_with(*faults, **more):
    clock = Clock()
    return clock, SailLine(SimulatedHunt(SCENARIOS[1], seed=4, **more), clock, faults, 0.0)


def gains(clock, line, periods):
    """Attenuations that V shows, one a period."""
    line.answer(b"#PTR O")
    shown = []
    for _ in range(periods):
        clock.now_s += 2.0
        shown.append(line.answer(b"#PTR V")[-6:-4])
    return [int(code, 16) for code in shown]


def test_the_automatic_gain_steps_through_every_attenuation_that_it_needs():
    codes = gains(*line_with(source_level_db=212.0), 8)
    assert codes[:4] == [0x09, 0x11, 0x19, 0x21]
    assert codes[-1] == codes[-2]


def test_the_original_falls_from_9_to_0_db_for_ever():
    codes = gains(*line_with("gain-step", source_level_db=212.0), 9)
    assert codes == [0x09, 0x11, 0x01] * 3


def test_the_clock_of_the_original_lets_the_beacon_slide_a_sample_a_period():
    def indices(*faults):
        clock, line = line_with(*faults)
        line.answer(b"#PTR O--")
        found = []
        for k in range(200):
            clock.now_s = 2.001 * (k + 1) + 0.5
            found.append(int(line.answer(b"#PTR -")[-16:-12], 16))
        return np.array(found)

    slid = indices("clock") - indices()
    assert np.polyfit(np.arange(200), slid, 1)[0] == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize("cut", [1, 3, 1000])
def test_answers_do_not_depend_on_how_the_characters_came(cut):
    asked = b"#PTR V!M52 07D1\r?M50 20\r!T1234 5678 H#GPS ?L#00096x0#PTR V"
    _, line = line_with()
    said = b"".join(line.answer(asked[k : k + cut]) for k in range(0, len(asked), cut))
    assert said == line_with()[1].answer(asked)
    assert b"\r\n0050  0000 07D1 0000" in said
    assert b",\r\n0060  " in said


def test_a_dump_can_be_loaded_again():
    _, line = line_with()
    line.answer(b"#PTR !M3000 " + bytes(range(40)).hex().encode() + b"\r")
    dumped = line.answer(b"?M3000 28\r").split(b"?M3000 28\r")[1][2:-4]
    _, other = line_with()
    other.answer(b"#PTR !M" + dumped + b"\r")
    assert bytes(other.receiver.memory[0x3000:0x3028]) == bytes(range(40))


@pytest.mark.parametrize("wrong", [b"X", b"A7", b"?L", b"!Q"])
def test_an_invalid_command_unaddresses_the_unit(wrong):
    _, line = line_with()
    assert line.answer(b"#PTR " + wrong + b"V").endswith(wrong + b"V")


def test_the_lengths_of_replies_are_those_of_the_report(shared):
    protocol = json.loads((shared / "seed-data/seed002_sail_protocol.json").read_text())
    clock, line = line_with()
    assert len(line.answer(b"#PTR ")) == protocol["address_reply"]["chars"]
    line.answer(b"O")
    clock.now_s = 2.0
    assert len(line.answer(b"-")) == protocol["data_reply"]["length_for_2"]
    assert len(line.answer(b"-")) == 5
    tracker = json.loads((shared / "seed-data/seed002_tracker_defaults.json").read_text())
    assert len(line.answer(b"#GPS ?L")) - 9 >= tracker["gps_message"]["min_reply_chars"]


def test_a_restart_keeps_sampling_and_forgets_the_rest():
    clock, line = line_with()
    line.answer(b"#PTR !M52 03E8\rO#0001200#PTR R")
    assert line.receiver.baud == FIRST_BAUD
    clock.now_s = 2.0
    assert len(line.answer(b"#PTR -")) == 9 + 21


def test_the_largest_sums_keep_their_distance():
    sums = np.array([0, 9, 8, 0, 0, 0, 7, 7, 0, 3])
    assert [(one.value, one.index) for one in largest_sums(sums, 3, 2)] == [(9, 1), (7, 7), (0, 4)]
    assert moving_sums(np.ones(15, int)).tolist() == [*range(1, 12), 11, 11, 11, 11]


@pytest.mark.parametrize(
    ("peaks", "with_edges", "without"),
    [
        ({400: 900, 1000: 1500}, [1000, 400], [1000, 400]),  # in the middle both are right
        ({1000: 1500, 1990: 1600}, [1990, 150], [1990, 1000]),  # the first maximum lost
        ({1000: 1500, 1990: 1200}, [1000, 150], [1000, 1990]),  # the lesser one passed over
        ({5: 1500, 1000: 1200}, [5, 1000], [5, 1000]),
    ],
)
def test_the_original_loses_a_signal_to_a_loud_one_near_the_end_of_a_period(peaks, with_edges, without):
    sums = np.full(2000, 100)
    sums[150] = 200
    sums[list(peaks)] = list(peaks.values())
    assert [one.index for one in controller_maxima(sums, 2, 20)] == with_edges
    assert [one.index for one in largest_sums(sums, 2, 20)] == without


def test_the_fault_at_the_end_of_a_period_is_on_the_line_and_not_in_our_chain():
    """One sound, a signal at 0.5 s and a louder one at 1.985 s, through our chain and through the emulated line."""
    settings = ReceiverSettings()
    pulses = joined_pulses(pulses_at(0.5, 30), pulses_at(1.985, 40))
    levels, arrivals = heard(ReportReceiver(settings, 48_000.0), sound_of(pulses, 4.0))
    ours = arrivals.arrival_s[arrivals.period == 0]
    assert ours == pytest.approx([1.985, 0.5], abs=3e-4)
    replies = []
    for faults in ((), ("edges",)):
        clock, line = line_with(*faults)
        line.receiver.hunt.codes = lambda *asked: levels[:2000].astype(np.int64)
        line.answer(b"#PTR O--")
        clock.now_s = 2.0
        reply = line.answer(b"#PTR -")[9:].lstrip(b"-")
        replies.append([int(reply[k : k + 4], 16) for k in (4, 12)])
    right, wrong = (1e-3 * np.array(each) - 0.010 for each in replies)
    assert right == pytest.approx([1.985, 0.5], abs=5e-3)
    assert wrong[0] == pytest.approx(1.985, abs=5e-3)
    assert abs(wrong[1] - 0.5) > 0.02


def test_spreading_and_absorption():
    assert spreading_loss(1000.0) == pytest.approx(60 + 1.1, abs=0.2)


def test_an_unknown_fault_is_named():
    with pytest.raises(ValueError, match="thunder"):
        line_with("thunder")
