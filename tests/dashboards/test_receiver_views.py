"""Pictures of the receiver behind the chart: misses and false alarms, the front end and its words."""

import numpy as np
import pytest

from dashboards.pictures.receiver_views import DetectionView, FrontEndView, LevelView
from dashboards.tabs.front_end_words import design_words
from trackerlib.receiver.cells import MatchedFilter
from trackerlib.receiver.detection_curve import detection_curve
from trackerlib.receiver.front_end import Attenuator
from trackerlib.receiver.front_end_design import FrontEnd, source_impedance
from trackerlib.receiver.level_curve import level_curve
from trackerlib.receiver.report_receiver import ReceiverSettings


def test_both_detectors_show_misses_and_false_alarms_against_their_threshold():
    modern, report = DetectionView(), LevelView()
    curve = detection_curve(MatchedFilter(8000, 2000, 0.01), [1e-1, 1e-2], [9, 12], pulses=20)
    levels = level_curve(
        ReceiverSettings(interval_s=0.5, attenuator=Attenuator(False, 0)), 24_000, [9, 12], periods=20
    )
    modern.show(curve)
    report.show(levels)
    for view, across, alarms in (
        (modern, 10 * np.log10(curve.threshold), curve.false_alarm),
        (report, levels.level, levels.false_alarm),
    ):
        data = view.lines.data
        assert [what.split(",")[0] for what in data["what"]] == ["false alarms", "misses", "misses"]
        assert all(np.array_equal(xs, across) for xs in data["xs"])
        assert np.nan_to_num(data["ys"][0]) == pytest.approx(alarms)
        assert np.nan_to_num(data["ys"][2]) == pytest.approx((curve if view is modern else levels).miss[1])
        assert "threshold" in view.figure.xaxis[0].axis_label
        assert len({len(column) for column in view.dots.data.values()}) == 1
    assert np.nan_to_num(modern.dots.data["y"])[:2] == pytest.approx(curve.false_alarm_found)
    assert (report.figure.x_range.start, report.figure.x_range.end) == (0, 255)


def test_the_attenuator_shows_what_its_shunts_take_off():
    view, design = FrontEndView(), FrontEnd()
    view.show(design)
    steps = view.steps.data
    assert steps["step"] == [3, 9, 12, 18, 24, 30]
    assert steps["taken"] == pytest.approx([3, 9, 10.2, 18, 24, 28.0], abs=0.05)
    # In the circuit the coupling's bias loads the attenuator a little.
    left = float(design.gain_db(design.carrier_hz)) - np.array(steps["gain"])
    assert left == pytest.approx(steps["taken"], abs=0.1)


def test_source_impedance_is_drawn_against_frequency():
    view = FrontEndView()
    view.show(FrontEnd(carrier_hz=12_000.0))
    data = view.ohms.data
    assert data["ohm"] == pytest.approx(np.abs(source_impedance(1e3 * data["khz"])))
    assert np.all((data["least"] < data["ohm"]) & (data["ohm"] < data["most"]))
    assert view.at_carrier.data["ohm"] == pytest.approx([1693.1 * 10 / 12], rel=1e-3)
    view.show(FrontEnd())
    assert view.at_carrier.data["ohm"] == pytest.approx([1693.1], abs=0.1)


def test_the_words_name_the_slips():
    words = design_words(FrontEnd())
    for each in (
        "24.0 + 31.0 + 33.9 dB", "1693 Ω", "0.6 nV/√Hz (5.3 if", "0.011 dB (0.42 if", "−11.9 dB",
        "478 kΩ (printed 560)",
        "67 dB in 100 Hz (printed 87", "73.5 dB for 1.7 mV (printed 58", "36.3 nV/√Hz (printed 31)",
        "27.6 nV/√Hz (printed 28)", "takes off 10.2 dB", "takes off 28.0 dB",
    ):  # fmt: skip
        assert each in words
