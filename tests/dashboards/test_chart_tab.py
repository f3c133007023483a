"""The Wet-paper chart tab without a browser."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.pictures.wet_paper import STRIP, WetPaper
from dashboards.session import Session
from dashboards.tabs.chart import ChartTab
from trackerlib.receiver.chart import ChartSettings, chart_lines


@pytest.fixture
def tab():
    session = Session()
    session.open_beacon_demo()
    tab = ChartTab(session=session)
    tab.activate()
    return tab


def paper_of(picture: WetPaper) -> dict[int, np.ndarray]:
    """Lines by number, as the browser was told."""
    lines = {}
    for strip, top in zip(picture.source.data["image"], picture.source.data["y"], strict=True):
        for row in range(STRIP):
            if 0 <= top + row < picture.count:
                lines[int(top) + row] = strip[row]
    return lines


def test_every_ping_heard_is_a_line(tab):
    assert tab.paper.count == len(tab.session.pings)
    shown = paper_of(tab.paper)
    expected = chart_lines(tab.session.pings.arrival_s, tab.settings)
    assert len(shown) == len(expected)
    assert all(np.array_equal(shown[k], expected[k]) for k in shown)


def test_lines_patched_one_by_one_are_the_same_paper():
    lines = chart_lines(np.linspace(0, 40, 173), ChartSettings(columns=60))
    slow, fast = WetPaper(60, history=100), WetPaper(60, history=100)
    fast.add(lines)
    fast.flush(whole=True)
    for k in range(0, len(lines), 3):
        slow.add(lines[k : k + 3])
        slow.flush()
    ours, theirs = paper_of(slow), paper_of(fast)
    assert ours.keys() == theirs.keys()
    assert len(ours) >= 100
    assert all(np.array_equal(ours[k], lines[k]) and np.array_equal(theirs[k], lines[k]) for k in ours)


def test_the_newest_line_is_at_the_bottom(tab):
    assert tab.paper.lines.start == len(tab.session.pings)  # start of a range is drawn at the bottom
    assert tab.paper.lines.end < tab.paper.lines.start


def test_the_replay_adds_lines_and_going_back_draws_again(tab):
    tab.session.heard = 40
    assert tab.paper.count == 40
    tab.session.heard = 55
    assert tab.paper.count == 55
    assert sorted(paper_of(tab.paper)) == list(range(55))


def test_nudging_the_interval_folds_the_whole_paper_again(tab):
    before = paper_of(tab.paper)[500]
    tab._nudge(1e-3)
    assert tab.settings.interval_s == pytest.approx(2.001)
    assert tab.paper.across.end == pytest.approx(2.001)
    assert not np.array_equal(before, paper_of(tab.paper)[500])


def test_an_interval_that_makes_no_sense_is_told_and_changes_nothing(tab):
    tab.controls_.interval.value = 0.0
    assert tab.session.failed
    assert "interval_s is 0; wanted" in tab.session.message
    assert tab.settings.interval_s == 2.0


def test_pings_left_out_of_the_fix_are_struck_through(tab):
    marks = tab.paper.marks.data
    assert list(marks["number"]) == list(tab.session.fix.rejected)
    assert np.all((marks["x"] >= 0) & (marks["x"] < 2))


def test_it_says_what_the_marks_are(tab):
    assert "holds times, not sound" in tab.words.object
    assert "SIMULATED" in tab.words.object


def test_export_labels_simulated_data(tab):
    name, text = tab.export()
    assert name == "arrivals.csv"
    assert text.startswith("# SIMULATED DATA")
    assert len(text.splitlines()) == 3 + len(tab.session.pings)


def test_an_empty_session_says_what_is_missing():
    tab = ChartTab(session=Session())
    tab.activate()
    assert "No survey is open" in tab.words.object
    assert tab.export() is None
