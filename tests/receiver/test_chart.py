"""The wet-paper chart: folding and marks."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.receiver.chart import ChartSettings, chart_lines, fold


def darkest(lines):
    """Column of the leading edge of each line's mark."""
    return np.argmax(lines > 100, axis=1)


def test_fold_by_hand():
    assert fold([0.5, 2.5, 4.25, -0.5], 2.0) == pytest.approx([0.5, 0.5, 0.25, 1.5])
    assert fold([2.5], 2.0, offset_s=0.75) == pytest.approx([1.75])


def test_a_mark_stands_where_its_time_falls():
    settings = ChartSettings(interval_s=2.0, columns=1000)
    assert darkest(chart_lines([0.5, 2.5, 5.0], settings)).tolist() == [250, 250, 500]


@pytest.mark.parametrize("drift_ms", [1.0, -2.0])
def test_another_interval_slants_the_line(drift_ms):
    # Pings 2 s apart folded at 2 s plus a drift walk by that drift each line.
    arrival = 1.0 + 2.0 * np.arange(100)
    settings = ChartSettings(interval_s=2.0 + drift_ms * 1e-3, columns=2000)
    folded = fold(arrival, settings.interval_s)
    assert np.allclose(np.diff(np.unwrap(folded, period=settings.interval_s)), -drift_ms * 1e-3)
    assert np.all(np.diff(darkest(chart_lines(arrival, settings))[:80]) * -drift_ms >= 0)


def test_a_line_drawn_again_looks_the_same():
    settings = ChartSettings()
    times = np.linspace(0, 3, 20)
    whole = chart_lines(times, settings)
    assert np.array_equal(whole[12:], chart_lines(times[12:], settings, first_line=12))


def test_lines_without_a_ping_are_bare_paper():
    lines = chart_lines([np.nan, 1.0], ChartSettings())
    assert lines[0].max() < 100
    assert lines[1].max() > 150
    assert chart_lines([], ChartSettings()).shape == (0, 1000)


def test_a_mark_at_the_right_edge_goes_on_at_the_left():
    line = chart_lines([1.999], ChartSettings(interval_s=2.0, columns=1000))[0]
    assert line[999] > 100
    assert line[:3].max() > 100


@pytest.mark.parametrize("setting", [{"interval_s": 0.0}, {"interval_s": 1e9}, {"columns": 3}])
def test_settings_that_make_no_sense_are_named(setting):
    with pytest.raises(ValueError, match=next(iter(setting))):
        ChartSettings(**setting)
