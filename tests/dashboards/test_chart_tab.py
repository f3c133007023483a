"""The Wet-paper chart tab without a browser."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.pictures.wet_paper import LOOKS, STRIP, VIEW, WetPaper
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
    assert tab.paper.lines.end == 0  # a log is seen whole


def feed(paper, count):
    for _ in range(count):
        paper.add(np.zeros((1, paper.columns), np.uint8))
        paper.flush()


def test_a_view_scrolled_back_stays_while_lines_come_and_every_kept_line_can_be_reached():
    paper = WetPaper(20, history=1000)
    feed(paper, 800)
    assert (paper.lines.start, paper.lines.end) == (800, 800 - VIEW)
    paper.lines.update(start=400.0, end=100.0)  # as a drag in the browser does
    feed(paper, 30)
    assert (paper.lines.start, paper.lines.end) == (400, 100)
    assert (paper.lines.reset_start, paper.lines.reset_end) == (830, 830 - VIEW)
    paper.lines.update(start=300.0, end=0.0)  # the oldest line that is kept
    feed(paper, 170)
    assert (paper.first, paper.lines.end) == (0, 0)
    feed(paper, 50)  # and the view goes along with the oldest when it is let go
    assert (paper.first, paper.lines.start, paper.lines.end) == (50, 350, 50)
    paper.lines.update(start=1050.0, end=550.0)
    feed(paper, 1)
    assert (paper.lines.start, paper.lines.end) == (1051, 1051 - VIEW)


def test_a_zoomed_view_at_the_newest_line_follows_at_its_height():
    paper = WetPaper(20, history=1000)
    feed(paper, 300)
    paper.lines.update(start=300.0, end=220.0)
    feed(paper, 20)
    assert (paper.lines.start, paper.lines.end) == (320, 240)
    paper.clear(2.0)
    feed(paper, 10)
    assert (paper.lines.start, paper.lines.end) == (60, 0)


def test_folding_again_leaves_a_view_scrolled_back_where_it_was(tab):
    tab.paper.lines.update(start=200.0, end=120.0)
    tab._nudge(1e-3)
    assert (tab.paper.lines.start, tab.paper.lines.end) == (200, 120)
    tab.session.heard = 40  # bare paper there
    assert (tab.paper.lines.start, tab.paper.lines.end) == (60, 0)


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


def test_look_and_contrast_change_colours_and_not_the_paper(tab):
    before = tab.paper.shown().copy()
    tab.controls_.look.value = "grey"
    assert (tab.paper.colours.palette, tab.paper.colours.high) == (LOOKS["grey"], 255)
    tab.controls_.contrast.value = 2.0
    assert (tab.paper.colours.palette, tab.paper.colours.high) == (LOOKS["grey"], 127.5)
    assert np.array_equal(tab.paper.shown(), before)
    assert tab._on_paper().paper.lines.max() == 255  # what leaves the page is as dark as what is seen


def test_another_number_of_lines_is_kept_and_the_newest_are_there(tab):
    whole = paper_of(tab.paper)
    tab.controls_.history.value = 500
    count = len(tab.session.pings)
    assert (tab.paper.first, tab.paper.count) == (count - 500, count)
    assert np.array_equal(tab.paper.shown(), [whole[k] for k in range(count - 500, count)])
    assert list(tab.strip.source.data["line"]) == list(range(count - 500, count))
    tab.controls_.history.value = 2000
    assert tab.paper.first == 0
    assert paper_of(tab.paper).keys() == whole.keys()


def test_clear_bares_the_paper_and_nothing_can_be_heard_of_it(tab):
    tab.controls_.clear.clicks += 1
    assert (tab.session.heard, tab.paper.count, len(tab.paper.shown())) == (0, 0, 0)
    assert not any(strip.any() for strip in tab.paper.source.data["image"])
    tab.files.hear.clicks += 1
    assert tab.session.failed
    assert "nothing on the paper to hear" in tab.session.message
    tab.controls_.at_once.clicks += 1
    assert tab.paper.count == len(tab.session.pings)
    tab.files.hear.clicks += 1
    assert tab.files.audio.visible


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


def test_it_is_laid_out_without_a_word_in_the_log(caplog):
    tab = ChartTab(session=Session())
    tab.activate()
    tab.__panel__().get_root()
    assert "sizing_mode" not in caplog.text
