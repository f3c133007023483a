"""The wet-paper chart: folding and marks."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.receiver.chart import ChartSettings, chart_lines, fold, level_lines


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


def levels_with_marks(times_s, seconds, sample_interval_s=1e-3):
    """Levels of a stream that is bare but for marks of one sample."""
    levels = np.zeros(round(seconds / sample_interval_s), np.uint8)
    levels[np.floor(np.asarray(times_s) / sample_interval_s + 1e-6).astype(int)] = 200
    return levels


@pytest.mark.parametrize("interval_s", [2.0, 2.0001, 1.9998, 2.0013, 1.99])
@pytest.mark.parametrize("columns", [500, 2000, 2500])
def test_levels_slant_evenly_at_any_interval_and_do_not_drift(interval_s, columns):
    times = 1.0 + 2.0 * np.arange(1000)
    levels = levels_with_marks(times, 2002.0)
    settings = ChartSettings(interval_s=interval_s, columns=columns)
    lines = level_lines(levels, settings)
    line = np.floor(times / interval_s).astype(int)
    for time, number in zip(times, line, strict=True):
        if number >= len(lines):
            continue
        expected = (time - number * interval_s) / interval_s * columns
        shown = np.flatnonzero(lines[number] == 200)
        # A sample of 1 ms is wider than a column where there are 2500 of them.
        nearest = np.min(np.abs((shown - expected + columns / 2) % columns - columns / 2))
        assert nearest <= 1 + columns * 1e-3 / interval_s, (number, expected, shown)
    assert len(lines) == int(2002.0 / interval_s)


def test_a_tenth_of_a_millisecond_is_a_column_in_ten_lines():
    lines = level_lines(levels_with_marks(1.0 + 2.0 * np.arange(500), 1001.0), ChartSettings(2.0001, 2000))
    column = np.argmax(lines, axis=1)
    assert column[0] - column[499] == pytest.approx(0.0001 * 499 / 2.0001 * 2000, abs=1)


def test_the_offset_falls_on_the_left_edge_and_paper_before_the_first_sample_is_bare():
    lines = level_lines(levels_with_marks([0.3, 2.3, 4.3], 7.0), ChartSettings(2.0, 1000, offset_s=0.3))
    assert np.argmax(lines, axis=1).tolist() == [0, 0, 0, 0]
    assert lines[:, 0].tolist() == [0, 200, 200, 200]


def test_a_column_shows_the_darkest_of_its_samples():
    line = level_lines(np.arange(100, dtype=np.uint8), ChartSettings(0.1, 50))[0]
    assert line.tolist() == list(range(1, 100, 2))
