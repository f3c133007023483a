"""The Crossover tab without a browser."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from range_demo import as_opened, opened_tab

from dashboards.pictures.noise_views import ellipse
from dashboards.pictures.range_plan import overlap
from dashboards.pictures.track_views import TrackViews
from dashboards.session import Session
from dashboards.tabs.crossover import CrossoverTab, straight_lines
from dashboards.tabs.crossover_rays import EXAMPLE, EXAMPLE_OFFSET_MS, SET
from dashboards.tabs.crossover_words import sentence
from trackerlib.crossover.edits import PointEdits
from trackerlib.crossover.noise import autocorrelation
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.rangefiles.crossover_file import parse_crossover


@pytest.fixture(scope="module")
def opened():
    return opened_tab(CrossoverTab)


@pytest.fixture
def tab(opened):
    tab = as_opened(*opened)
    tab.views.points.selected.indices = []
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


# -- the range and its pairs ----------------------------------------------------------------------


def test_a_click_on_a_pair_in_plan_or_matrix_chooses_it(tab):
    for source in (tab.matrix.source, tab.plan.overlaps):
        pairs = list(zip(source.data["first"], source.data["second"], strict=True))
        source.selected.indices = [pairs.index((13, 14))]
        assert tab.session.crossover.pair == (13, 14)
        assert source.selected.indices == []
        tab.session.undo()
    assert len(tab.matrix.source.data["edge"]) == len({one.pair for one in tab.session.gating.sets})


def test_the_matrix_holds_counts_and_median_gaps(tab):
    data = tab.matrix.source.data
    row = list(zip(data["first"], data["second"], strict=True)).index((4, 5))
    own = [one for one in tab.session.gating.sets if one.pair == (4, 5)]
    assert data["points"][row] == sum(one.points for one in own)
    gap = np.median(np.concatenate([one.gap for one in own]), axis=0)
    assert data["gap"][row] == pytest.approx(np.linalg.norm(gap))


def test_an_overlap_is_where_both_circles_are():
    first, second = np.array([0.0, 0.0]), np.array([6000.0, 800.0])
    outline = np.column_stack(overlap(first, second, 4700.0))
    far = np.maximum(*(np.linalg.norm(outline - centre, axis=1) for centre in (first, second)))
    assert far == pytest.approx(4700.0, rel=1e-9)
    assert overlap(first, np.array([9500.0, 0.0]), 4700.0) is None


def test_points_selected_on_the_range_are_selected_in_the_set(tab):
    crossover = tab.session.crossover
    tracks = tab.plan.tracks.data
    rows = [k for k, count in enumerate(tracks["count"]) if count in crossover.point_count[:9]]
    tab.plan.tracks.selected.indices = rows
    assert tab.selected_counts
    assert tab.selected_counts <= set(crossover.point_count[:9].tolist())
    assert len(tab.plan.marked.data["x"]) == len(tab.selected_counts)


# -- noise, gaps, radial lines --------------------------------------------------------------------


def test_noise_is_shown_as_table_ellipses_and_correlations(tab):
    tab.pages.choice.value = "Noise"
    noise = tab._noise
    assert f"{noise.first[0, 0]:.2f}" in tab.noise_words.object
    assert f"{noise.gap[2, 2]:.2f}" in tab.noise_words.object
    keep = np.array([why == "used" for why in drawn(tab)["used"]])
    direct = autocorrelation(noise.residual_x[keep, 2], tab.session.crossover.point_count[keep])
    assert tab.noise_views._lags[2].data["first"] == pytest.approx(direct.value, nan_ok=True)
    outline = ellipse(noise.first, 0, 1)
    inverse = np.linalg.inv(noise.first[:2, :2])
    assert np.einsum("in,ij,jn->n", outline, inverse, outline) == pytest.approx(5.991, abs=1e-3)


def test_the_gap_is_drawn_against_range_depth_and_heading(tab):
    crossover = tab.session.crossover
    tab.against.value = "range to the second array"
    place = tab.session.survey.position_of(crossover.pair[1])
    assert drawn(tab)["range1"] == pytest.approx(np.linalg.norm(crossover.y - place, axis=1), rel=1e-5)
    assert {dots.glyph.x for dots in tab.views._gap_dots} == {"range1"}
    tab.against.value = "point count"


def test_headings_on_both_sides_of_180_degrees_lie_side_by_side():
    views = TrackViews()
    count = np.arange(1, 31)
    track = np.column_stack([-50.0 * count, 0.3 * (-1.0) ** count, np.full(30, -300.0)])
    views.show(CrossoverSet((1, 2), count, track, track + 1.0))
    assert np.abs(views.points.data["heading"]).min() > 170
    assert np.ptp(views.points.data["heading"]) < 5


def test_gap_vectors_reach_from_the_first_version_towards_the_second(tab):
    vectors, crossover = tab.views.vectors.data, tab.session.crossover
    assert vectors["end1"] - vectors["begin1"] == pytest.approx(-10 * crossover.gap[:, 1], abs=0.1)
    tab.vectors.value = 0.0
    assert len(tab.views.vectors.data["end1"]) == 0
    tab.vectors.value = 10.0


def test_the_teaching_example_meets_at_its_true_offset(tab):
    tab.pages.choice.value = "Rays"
    assert "lie " in tab.rays.words.object
    tab.rays.what.value = EXAMPLE
    assert "SIMULATED" in tab.rays.words.object
    tab.rays.offset_ms.value = EXAMPLE_OFFSET_MS
    assert "lie 0.0 ft apart" in tab.rays.words.object
    vector = tab.rays.picture.vector.data
    assert vector["x"][0] == pytest.approx(vector["x1"][0], abs=0.05)
    tab.rays.what.value = SET


# -- edits ----------------------------------------------------------------------------------------


def test_points_are_excluded_with_a_reason_and_put_back(tab):
    session = tab.session
    tab.views.points.selected.indices = [1, 5]
    tab.editing.reason.value = "vehicle turning"
    tab.editing.exclude_button.clicks += 1
    assert drawn(tab)["used"][[1, 5]].tolist() == ["left out: vehicle turning"] * 2
    assert drawn(tab)["markx"][1] == "x"
    marks = drawn(tab)["markg"], *(drawn(tab)[f"ink{k}"] for k in range(3))  # of the gap
    for column in marks:
        assert column[1] == column[5] != column[2]
    assert {dots.glyph.marker for dots in tab.views._gap_dots} == {"markg"}
    assert "2 points are left out by hand" in tab.words.object
    assert "vehicle turning" in tab.editing.list.object
    session.undo()
    assert session.message.startswith("Undone")
    assert "left out by hand" not in tab.words.object
    session.redo()
    assert session.message.startswith("Done again")
    tab.views.points.selected.indices = [5, 6]
    tab.editing.restore_button.clicks += 1
    assert session.left_out(session.crossover).nonzero()[0].tolist() == [1]
    tab.editing.restore_all_button.clicks += 1
    assert not session.left_out(session.crossover).any()


def test_edits_survive_the_file_opened_again_and_in_another_order(tab, data):
    session = tab.session
    tab.views.points.selected.indices = [3]
    count = int(session.crossover.point_count[3])
    tab.editing.exclude_button.clicks += 1
    lines = (data / "range-demo" / "tfile.dat").read_bytes().splitlines(keepends=True)
    session.open_file("tfile.dat", b"".join([*lines[:31], *lines[31:][::-1]]))
    left_out = session.left_out(session.crossover)
    assert session.crossover.point_count[left_out].tolist() == [count]
    assert "left out" in drawn(tab)["used"][np.flatnonzero(left_out)[0]]


def test_the_edit_log_is_a_csv_with_stable_ids_that_opens_again(tab):
    session = tab.session
    tab.views.points.selected.indices = [3]
    tab.editing.exclude_button.clicks += 1
    text = tab.editing.log_file().getvalue()
    crossover = session.crossover
    line = crossover.lines[3]
    a, b = crossover.pair
    assert f"exclude,7,{a},{b},{crossover.point_count[3]},{line[0]},{line[1]},tfile.dat".encode() in text
    edits = session.edits
    session.edits = PointEdits()
    session.open_file("edits.csv", text)
    assert session.edits == edits
    assert session.left_out(crossover).sum() == 1


def test_nothing_selected_is_said(tab):
    tab.editing.exclude_button.clicks += 1
    assert "Select points" in tab.session.message
    assert len(tab.session.edits) == 0


def test_all_points_left_out_is_a_sentence(tab):
    tab.views.points.selected.indices = list(range(tab.session.crossover.points))
    tab.editing.exclude_button.clicks += 1
    assert "every point is left out by hand" in tab.words.object
    tab.pages.choice.value = "Noise"
    assert "No noise can be told" in tab.noise_words.object
    assert not tab.session.failed, tab.session.message


def test_a_pair_with_two_points_is_drawn_without_noise(tab):
    crossover = tab.session.crossover.only(slice(0, 2))
    tab.session.crossover = crossover
    assert "So few points tell no noise" in tab.words.object
    assert not tab.session.failed, tab.session.message


def test_an_array_that_is_missing_leaves_the_rest(tab):
    lost = CrossoverSet((1, 99), np.arange(9), np.ones((9, 3)), np.zeros((9, 3)))
    tab.session.crossover = lost
    tab.pages.choice.value = "Rays"
    assert "array 99 is not in the array table" in tab.rays.words.object
    assert not tab.session.failed, tab.session.message


def test_a_repeat_can_be_chosen_the_other_way(tab):
    before = tab.session.gating.choices[0]
    tab.editing.repeat.value = 0
    tab.editing.other_report.clicks += 1
    after = tab.session.gating.choices[0]
    assert after.kept_line == before.dropped_lines[0]
    tab.session.undo()
    assert tab.session.gating.choices[0].kept_line == before.kept_line


def test_a_bend_is_told_with_both_its_causes_and_a_far_point_makes_none():
    rng, count = np.random.default_rng(3), np.arange(60)
    straight = np.column_stack([50.0 * count, 2.0 * count, np.full(60, -400.0)])
    x, y = straight + rng.normal(size=(2, 60, 3))
    x[20] += [0.0, 400.0, 0.0]
    assert bent_words(x, y) == ""
    turning = straight + np.column_stack([np.zeros(60), 0.02 * (count - 30.0) ** 2, np.zeros(60)])
    words = bent_words(x, turning + rng.normal(size=(60, 3)))
    assert words.startswith("Array 2's version bends")
    assert "turns or changes speed" in words
    assert "clock's offset" in words


def bent_words(x, y):
    """What the tab says of bends after the gaps of a set of arrays 1 and 2."""
    crossover = CrossoverSet((1, 2), np.arange(len(x)), x, y)
    gating = SimpleNamespace(sets=(crossover,), mode=7)
    words = sentence(crossover, gating, False, np.zeros(len(x), bool))
    return words.partition("in the lines. ")[2]
