"""Pictures of the receiver behind the chart: misses and false alarms, the front end and its words."""

import numpy as np
import pytest

from dashboards.pictures.receiver_views import DetectionView, LevelView
from trackerlib.receiver.cells import MatchedFilter
from trackerlib.receiver.detection_curve import detection_curve
from trackerlib.receiver.front_end import Attenuator
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
    assert report.figure.x_range.end == 255
