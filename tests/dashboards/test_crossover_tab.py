"""The Crossover tab without a browser."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.crossover import CrossoverTab, straight_lines
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.rangefiles.crossover_file import parse_crossover


@pytest.fixture
def tab():
    session = Session()
    session.open_range_demo()
    tab = CrossoverTab(session=session)
    tab.activate()
    assert not session.failed, session.message
    return tab


def drawn(tab):
    return tab.views.points.data


def test_the_chosen_set_is_drawn_and_told(tab):
    chosen = tab.session.crossover
    assert drawn(tab)["count"].tolist() == chosen.point_count.tolist()
    assert np.allclose(drawn(tab)["x0"], chosen.x[:, 0], atol=0.01)
    assert np.allclose(drawn(tab)["gap2"], chosen.gap[:, 2], atol=0.01)
    a, b = chosen.pair
    assert (
        f"Arrays {a} and {b} both saw the torpedo (mode 7) at {chosen.points} point counts"
        in tab.words.object
    )
    assert "simulated" in tab.words.object


def test_every_gate_stands_with_its_count(tab):
    counts = tab.session.gating.counts
    for number in (
        counts.records_read,
        counts.kept_mode,
        counts.kept_paired,
        counts.kept_range,
        counts.kept_repaired,
    ):
        assert f"{number:,}" in tab.gates.object
    assert "line 6233" in tab.remarks.object
    assert "array 40 is not in the array table" in tab.remarks.object


def test_a_pair_and_a_pass_can_be_chosen_and_are_shared(tab):
    other = next(one for one in tab.session.gating.sets if one.pass_number == 2)
    tab.pair.value = other.pair
    assert tab.session.crossover.pair == other.pair
    assert tab.session.crossover.pass_number == 1
    tab.passing.value = next(k for k, one in enumerate(tab.session.gating.sets) if one is other)
    assert tab.session.crossover is other
    assert drawn(tab)["count"].tolist() == other.point_count.tolist()
    assert "pass 2 of" in tab.words.object


def test_next_and_previous_walk_all_sets(tab):
    tab.session.crossover = tab.session.gating.sets[0]
    seen = [tab.session.crossover]
    assert tab.earlier.disabled
    while not tab.later.disabled:
        tab.later.clicks += 1
        seen.append(tab.session.crossover)
    assert seen == list(tab.session.gating.sets)


def test_undo_takes_back_a_choice_and_a_gate(tab):
    before, points = tab.session.crossover, tab.session.gating.counts.kept_range
    tab.later.clicks += 1
    tab.max_slant_range.value = 3000.0
    assert tab.session.gating.counts.kept_range < points
    tab.session.undo()
    assert tab.session.gating.counts.kept_range == points
    assert tab.max_slant_range.value == 4700.0
    tab.session.undo()
    assert (tab.session.crossover.pair, tab.session.crossover.pass_number) == (
        before.pair,
        before.pass_number,
    )


def test_another_vehicle_has_other_sets(tab):
    torpedo = tab.session.gating.counts
    tab.vehicle.value = 2
    assert tab.session.gating.mode == 2
    assert tab.session.gating.counts.kept_mode != torpedo.kept_mode
    assert "ship (mode 2)" in tab.gates.object
    tab.vehicle.value = 5
    assert tab.session.gating is not None
    assert not tab.session.failed


def test_a_vehicle_nobody_paired_is_told_in_words(tab):
    tab.max_slant_range.value = 100.0
    assert tab.session.gating.sets == ()
    assert "No two arrays" in tab.words.object
    assert len(drawn(tab)["count"]) == 0
    tab.defaults.clicks += 1
    assert tab.session.gating.sets
    assert len(drawn(tab)["count"])


def test_a_number_out_of_bounds_is_told_and_not_taken(tab):
    tab.max_slant_range.value = 50.0
    assert tab.session.failed
    assert tab.session.max_slant_range_ft == 4700.0
    assert tab.max_slant_range.value == 4700.0


def test_a_selection_is_told_by_its_point_counts(tab):
    tab.views.points.selected.indices = [4, 2, 3]
    counts = tab.session.crossover.point_count[2:5]
    assert tab.selected_counts == frozenset(counts.tolist())
    assert f"3 selected</b>, counts {counts[0]} to {counts[-1]}" in tab.selection.object
    tab.later.clicks += 1
    assert tab.selected_counts == frozenset()
    assert tab.selection.object == ""


def test_all_three_figures_share_one_source(tab):
    for figure in (tab.views.plan, tab.views.side, tab.views.gap):
        assert any(renderer.data_source is tab.views.points for renderer in figure.renderers)


def test_lines_end_at_the_first_and_last_count(tab):
    t = np.array([3, 4, 5, 9])
    x = np.column_stack([40.0 * t, 2.0 * t, -300 + 0 * t])
    ends = straight_lines(CrossoverSet((1, 2), t, x, x + np.array([0, 10, 0])))
    assert ends[0] == pytest.approx(x[[0, -1]])
    assert ends[1] == pytest.approx(x[[0, -1]] + np.array([0, 10, 0]))
    assert straight_lines(CrossoverSet((1, 2), t[:1], x[:1], x[:1])) is None


def test_a_wild_position_does_not_set_the_frame(tab):
    t = np.arange(20)
    x = np.column_stack([40.0 * t, 2.0 * t, -300 + 0 * t])
    y = x.copy()
    y[5] += 9000
    tab.session.crossover = CrossoverSet((1, 2), t, x, y)
    assert tab.views.gap.y_range.start > -100
    assert tab.views.home.tags[1] < 1000
    assert tab.views.side.y_range.end < 0
    assert "1 point lies far off" in tab.words.object
    assert [k for k, mark in enumerate(drawn(tab)["markx"]) if mark == "x"] == [5]


def test_a_set_of_one_point_is_drawn(tab):
    tab.session.crossover = CrossoverSet((1, 2), np.array([7]), np.ones((1, 3)), np.zeros((1, 3)))
    assert not tab.session.failed, tab.session.message
    assert "at 1 point count" in tab.words.object
    assert "not known" in tab.words.object


def test_the_export_reads_back(tab):
    name, text = tab.export()
    back = parse_crossover(text.encode(), name).set
    assert back.pair == tab.session.crossover.pair
    assert back.range_name == "SIMULATED"
    assert np.array_equal(back.x, tab.session.crossover.x)


def test_without_a_run_it_says_what_to_open():
    tab = CrossoverTab(session=Session())
    tab.activate()
    assert "No range run is open" in tab.words.object
    assert tab.export() is None


def test_a_hidden_tab_waits(tab):
    tab.deactivate()
    before = drawn(tab)["count"].tolist()
    tab.session.crossover = tab.session.gating.sets[0]
    assert drawn(tab)["count"].tolist() == before
    tab.activate()
    assert drawn(tab)["count"].tolist() == tab.session.gating.sets[0].point_count.tolist()
