"""What is wrong with a range's files, in the Crossover and Timing tabs: a sentence where it is seen, the rest works."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.crossover import CrossoverTab
from dashboards.tabs.timing import TimingTab
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.rangefiles.crossover_file import crossover_text
from trackerlib.textfiles import InputError

METRES = 0.3048


@pytest.fixture(scope="module")
def tabs():
    """Both tabs on one session."""
    session = Session()
    made = CrossoverTab(session=session), TimingTab(session=session)
    for tab in made:
        tab.activate()
    return made


@pytest.fixture
def opened(tabs, data):
    """Both tabs, and a function that opens spoilt files of the demo, of its first 4000 records."""
    session = tabs[0].session
    folder = data / "range-demo"
    whole = (folder / "tfile.dat").read_bytes().splitlines(keepends=True)
    lines = whole[:4031]
    session.param.update(max_slant_range_ft=4700.0, mode=7, message="", failed=False)
    for name in ("arrays.csv", "VELOCITY.DAT"):
        session.open_file(name, (folder / name).read_bytes())

    def spoilt(change=lambda lines: lines):
        session.open_file("tfile.dat", b"".join(change(lines)))
        return tabs

    spoilt.session, spoilt.lines = session, lines
    return spoilt


def works(crossover_tab, timing_tab) -> bool:
    """Whether sets are shown and timed."""
    session = crossover_tab.session
    assert "both saw the " in crossover_tab.words.object
    return session.correction.points > 0 and len(timing_tab.sets_page.table.value) > 0


def test_a_tfile_cut_in_mid_record_loses_that_record_alone(opened):
    crossover_tab, timing_tab = opened(lambda lines: [*lines[:-1], lines[-1][:40]])
    assert "1 bad lines, the first is line 4031: the record ends at column 40" in opened.session.message
    assert "line 4031" in crossover_tab.remarks.object
    assert works(crossover_tab, timing_tab)


def test_columns_shifted_by_one_are_named(opened):
    crossover_tab, timing_tab = opened(lambda lines: [*lines[:31], b" " + lines[31], *lines[32:]])
    assert "line 32: columns 9-15 (downrange) hold" in opened.session.message
    assert works(crossover_tab, timing_tab)
    before = opened.session.tfile
    with pytest.raises(
        InputError, match="found no position record after 31 lines of header; line 32: columns"
    ):
        opened(lambda lines: [*lines[:31], *(b" " + line for line in lines[31:])])
    assert opened.session.tfile is before


def test_metres_for_feet_are_asked_about_in_both_tabs(opened):
    def in_metres(lines):
        def feet(line):
            return b"  ".join(b"%7.1f" % (METRES * float(line[a : a + 7])) for a in (8, 17, 26))

        return [*lines[:31], *(line[:8] + feet(line) + line[33:] for line in lines[31:])]

    crossover_tab, _ = opened(in_metres)
    assert "is the T-file in metres?" in crossover_tab.remarks.object
    crossover_tab, timing_tab = opened()
    one = opened.session.gating.sets[-1]
    small = CrossoverSet(one.pair, one.point_count, METRES * one.x, METRES * one.y)
    opened.session.open_file("crossover_metres.txt", crossover_text(small).encode())
    for tab in (crossover_tab, timing_tab):
        assert "Is the crossover file in metres?" in tab.words.object
    assert not opened.session.failed


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: [*rows[:3], rows[2], *rows[3:]], "line 4: found depth 50 ft after 50 ft"),
        (lambda rows: rows[::-1], "line 2: found depth 1300 ft after 1325 ft"),
    ],
)
def test_a_profile_that_is_none_is_refused_and_the_last_one_kept(opened, data, change, words):
    _, timing_tab = opened()
    rows = (data / "range-demo/VELOCITY.DAT").read_text().splitlines()
    before = opened.session.profile
    with pytest.raises(InputError, match=words):
        opened.session.open_file("VELOCITY.DAT", "\n".join(change(rows)).encode())
    timing_tab.profile_page._upload("\n".join(change(rows)).encode())
    assert words in opened.session.message
    assert opened.session.profile is before


def test_a_gap_in_a_profile_is_remarked_where_it_is_opened_and_drawn(opened, data):
    crossover_tab, timing_tab = opened()
    rows = (data / "range-demo/VELOCITY.DAT").read_text().splitlines()
    whole = opened.session.correction.offset_s
    opened.session.open_file("VELOCITY.DAT", "\n".join([*rows[:8], *rows[12:]]).encode())
    told = "gap in the depths from 175 to 300 ft: speed goes straight across"
    assert told in opened.session.message
    timing_tab.pages.choice.value = "Profile"
    assert told in timing_tab.profile_page.words.object
    assert opened.session.correction.offset_s == pytest.approx(whole, abs=2e-5)
    assert works(crossover_tab, timing_tab)


def test_an_array_that_the_table_lacks_leaves_the_other_pairs(opened, data):
    crossover_tab, timing_tab = opened()
    lost = opened.session.gating.sets[0].pair[0]
    rows = (data / "range-demo/arrays.csv").read_text().splitlines()
    kept = [row for row in rows if not row.startswith(f"{lost},")]
    opened.session.open_file("arrays.csv", "\n".join(kept).encode())
    assert f"array {lost} is not in the array table" in crossover_tab.remarks.object
    assert all(lost not in one.pair for one in opened.session.gating.sets)
    assert works(crossover_tab, timing_tab)


def test_targets_below_their_array_are_asked_about_in_both_tabs(opened):
    deep = opened(lambda lines: [*lines[:31], *(one[:26] + b"-2000.0" + one[33:] for one in lines[31:])])
    assert "lie deeper than their own array" in deep[0].remarks.object
    for tab in deep:
        assert "100.0% of the reports lie deeper than their own array" in tab.words.object
    assert opened.session.correction.points > 0


def test_every_point_of_every_set_left_out_is_a_sentence_in_both_tabs(opened):
    crossover_tab, timing_tab = opened()
    session = opened.session
    edits = session.edits
    for one in session.gating.sets:
        edits = edits.exclude(one, range(one.points), session.gating.mode, "all")
    session.edit(edits=edits)
    assert "every point is left out by hand" in crossover_tab.words.object
    assert "No offset can be told" in timing_tab.words.object
    assert "The run cannot be judged: 0 sets have an offset" in timing_tab.run_words.object
    for page in ("Q", "Profile", "Sets", "Constancy", "Causes", "Apply"):
        timing_tab.pages.choice.value = page
    assert not session.failed, session.message
    assert timing_tab.export()[1].count("\n") == 2  # the remark and the header: no set has an offset
    session.undo()
    assert works(crossover_tab, timing_tab)


def test_a_pair_with_two_points_beside_others(opened):
    crossover_tab, timing_tab = opened()
    two = opened.session.gating.sets[0].only(slice(0, 2))
    opened.session.open_file("crossover_two.txt", crossover_text(two).encode())
    assert "So few points tell no noise" in crossover_tab.words.object
    assert "2 points are too few for a sigma" in timing_tab.words.object
    assert np.isfinite(opened.session.correction.offset_s)
    assert not opened.session.failed


def test_a_crossover_file_with_a_spoilt_line_is_still_one(opened):
    crossover_tab, timing_tab = opened()
    lines = crossover_text(opened.session.gating.sets[0]).splitlines()
    opened.session.open_file(
        "crossover_spoilt.txt", "\n".join([*lines[:3], lines[3][:30], *lines[4:]]).encode()
    )
    assert "1 bad lines, the first is line 4: found" in opened.session.message
    assert works(crossover_tab, timing_tab)


def test_a_corrected_copy_says_that_its_positions_were_corrected_before(opened):
    both = opened(lambda lines: [b"CORRECTED COPY of run.dat\n", *lines[1:]])
    assert "corrected before: CORRECTED COPY of run.dat" in opened.session.message
    assert works(*both)
