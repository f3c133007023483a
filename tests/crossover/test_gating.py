"""Gating: each gate by hand, repeats, passes, and an account of every report."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_gates import plain_gating

from trackerlib.crossover import gate_scan
from trackerlib.crossover.gating import gate_reports, gate_slant_range, split_passes
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.repeats import predict_position
from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.tfile import read_tfile


def reports_of(rows):
    """Reports from (point count, array, position[, mode[, flagged]])."""
    rows = [(*row, *(7, False)[len(row) - 3 :]) for row in rows]
    count, array, position, mode, flagged = zip(*rows, strict=True)
    line = np.arange(32, 32 + len(rows))
    return PositionReports(
        line, np.array(count), np.array(position, float), np.array(array), np.array(mode), np.array(flagged)
    )


def survey_of(positions, placeholder=(), dates=None):
    number = np.array(list(positions))
    day = np.array([(dates or {}).get(n, "NaT") for n in positions], dtype="datetime64[D]")
    return ArraySurvey(number, np.array(list(positions.values()), float), day, np.isin(number, placeholder))


SURVEY = survey_of({0: (0, 0, -1300), 1: (7000, 0, -1300), 2: (3500, 4000, -1250), 3: (3500, -3000, -1250)})
MIDDLE = (3500.0, 0.0, -300.0)


def test_three_gates_by_hand():
    rows = [
        (10, 0, MIDDLE), (10, 1, MIDDLE),  # kept
        (11, 0, MIDDLE),  # alone
        (12, 0, MIDDLE), (12, 1, MIDDLE, 2),  # the other one is the ship
        (13, 0, MIDDLE), (13, 1, MIDDLE, 7, True),  # the other one has an edit mark
        (14, 0, (500.0, 0, -300)), (14, 1, (500.0, 0, -300)),  # 6577 ft from array 1
        (15, 0, MIDDLE), (15, 8, MIDDLE),  # array 8 is not in the table
    ]  # fmt: skip
    result = gate_reports(reports_of(rows), SURVEY, mode=7)
    counts = result.counts
    assert (counts.records_read, counts.kept_mode, counts.kept_paired) == (11, 9, 6)
    assert (counts.kept_range, counts.kept_repaired, counts.unplaced) == (4, 2, 1)
    assert result.unplaced_arrays == {8: 1}
    assert [(s.pair, s.point_count.tolist()) for s in result.sets] == [((0, 1), [10])]
    assert "array 8 is not in the array table" in result.warnings[0]


def test_slant_range_is_kept_up_to_the_limit_itself():
    at = (0.0, 0.0, -300.0)  # 1000 ft above array 0
    rows = [(1, 0, at), (1, 1, (7000.0, 0, -300))]
    assert gate_reports(reports_of(rows), SURVEY, 7, max_slant_range_ft=1000).counts.kept_range == 2
    assert gate_reports(reports_of(rows), SURVEY, 7, max_slant_range_ft=999.9).counts.kept_range == 0


def test_an_array_without_a_surveyed_position_is_within_range_of_nothing():
    survey = survey_of({0: (0, 0, -1300), 1: MIDDLE, 2: MIDDLE}, placeholder=[2])
    reports = reports_of([(5, array, MIDDLE) for array in (1, 2, 9)])
    assert gate_slant_range(reports, survey, 4700).array.tolist() == [1]


@pytest.mark.parametrize("arrays", [(0, 1), (0, 1, 2), (3, 1, 0, 2)])
def test_every_pair_of_arrays_at_a_point_count_is_kept(arrays):
    result = gate_reports(reports_of([(5, a, MIDDLE) for a in arrays]), SURVEY, 7)
    assert [s.pair for s in result.sets] == list(combinations(sorted(arrays), 2))


@pytest.mark.parametrize("count", [0, 999, 99999])
def test_array_0_and_point_counts_0_and_999_are_ordinary(count):
    result = gate_reports(reports_of([(count, 0, MIDDLE), (count, 1, MIDDLE)]), SURVEY, 7)
    assert result.sets[0].pair == (0, 1)
    assert result.sets[0].point_count.tolist() == [count]


def test_passes_split_only_where_counts_jump_by_more_than_the_gap():
    counts = np.array([5, 35, 66, 67])
    whole = CrossoverSet((1, 2), counts, np.zeros((4, 3)), np.zeros((4, 3)))
    passes = split_passes(whole, 30)
    assert [(p.pass_number, p.point_count.tolist()) for p in passes] == [(1, [5, 35]), (2, [66, 67])]


def test_placeholders_make_no_pair(data):
    survey = read_arrays(data / "nanoose_arrays.csv").survey
    rows = [(1, number, position) for number, position in zip(survey.number, survey.position, strict=True)]
    rows += [(2, 28, (45000, 1500, -300)), (2, 4, (45000, 1500, -300))]
    result = gate_reports(reports_of(rows), survey, 7)
    assert not {9, 10, 27, 28, 29} & {n for s in result.sets for n in s.pair}
    assert result.unplaced_arrays == {9: 1, 10: 1, 27: 1, 28: 2, 29: 1}
    assert "array 28 is a placeholder" in " ".join(result.warnings)


def test_a_survey_after_the_run_is_warned_about():
    survey = survey_of({0: (0, 0, -1300), 1: (7000, 0, -1300)}, dates={0: "1985-06-20", 1: "1988-01-07"})
    reports = reports_of([(1, 0, MIDDLE), (1, 1, MIDDLE)])
    assert not gate_reports(reports, survey, 7).warnings
    assert not gate_reports(reports, survey, 7, run_date=np.datetime64("1989-01-01")).warnings
    (warning,) = gate_reports(reports, survey, 7, run_date=np.datetime64("1987-05-11")).warnings
    assert warning == "array 1 was surveyed on 1988-01-07, after the run of 1987-05-11"


def test_a_mode_nobody_has_gives_no_set_and_says_so():
    result = gate_reports(reports_of([(1, 0, MIDDLE), (1, 1, MIDDLE)]), SURVEY, 2)
    assert not result.sets
    assert result.warnings == ("no report has mode 2; the file has modes 7",)


@pytest.mark.parametrize(
    ("scale_file", "scale_table", "words"), [(0.3048, 1, "T-file"), (1, 0.3048, "array")]
)
def test_metres_for_feet_are_recognised_and_asked_about(demo, scale_file, scale_table, words):
    reports, survey, _, _ = demo
    assert not any("metres" in warning for warning in gate_reports(reports, survey, 7).warnings)
    metric = replace(reports, position=scale_file * reports.position)
    table = replace(survey, position=scale_table * survey.position)
    (question,) = (w for w in gate_reports(metric, table, 7).warnings if "metres" in w)
    assert question.startswith(f"is the {words}")


# repeats


def straight_track(array, counts, offset=0.0):
    return [(int(t), array, (3000 + 40.0 * t, offset, -300.0)) for t in counts]


def test_a_repeat_is_chosen_by_its_own_track_not_by_the_other_array():
    good, false = (3200.0, 0.0, -300.0), (3200.0, 30.0, -300.0)
    rows = straight_track(0, [3, 4, 6, 7]) + straight_track(1, [3, 4, 5, 6, 7], offset=30.0)
    rows += [(5, 0, false), (5, 0, good)]  # the false one sits exactly on the other array's track
    result = gate_reports(reports_of(rows), SURVEY, 7)
    (choice,) = result.choices
    crossover = result.sets[0]
    assert crossover.x[crossover.point_count == 5].tolist() == [list(good)]
    assert (choice.array, choice.point_count, choice.kept_line, choice.dropped_lines) == (0, 5, 42, (41,))
    assert choice.kept_distance_ft == pytest.approx(0, abs=1e-9)
    assert choice.dropped_distances_ft == pytest.approx((30.0,))
    assert "4 neighbours" in choice.reason
    assert result.counts.repeats_left_out == 1


def test_neighbours_that_no_other_array_saw_help_to_choose():
    rows = straight_track(0, [3, 4, 6, 7])
    rows += [(5, 0, (3200.0, 25.0, -300.0)), (5, 0, (3200.0, 0.0, -300.0)), (5, 1, (3200.0, 25.0, -300.0))]
    (choice,) = gate_reports(reports_of(rows), SURVEY, 7).choices
    assert choice.kept_line == 37


def test_without_neighbours_the_first_report_is_kept_and_that_is_said():
    rows = [(5, 0, MIDDLE), (5, 0, (3600.0, 0.0, -300.0)), (5, 1, MIDDLE)]
    (choice,) = gate_reports(reports_of(rows), SURVEY, 7).choices
    assert choice.kept_line == 32
    assert "no other report" in choice.reason


@settings(max_examples=60, deadline=None)
@given(
    wild=st.integers(1, 9).filter(lambda k: k != 5),
    size=st.floats(-4000, 4000).filter(lambda s: abs(s) > 30),
    turn=st.floats(-0.01, 0.01),
    side=st.floats(0, 2 * np.pi),
    swap=st.booleans(),
)
def test_a_wild_neighbour_never_makes_a_choice_wrong(wild, size, turn, side, swap):
    t = np.arange(11)
    heading = turn * (t - 5)
    path = np.column_stack(
        [3500 + np.cumsum(40 * np.cos(heading)), np.cumsum(40 * np.sin(heading)), np.full(11, -300)]
    )
    false = path[5] + 20 * np.array([np.cos(side), np.sin(side), 0])
    path[wild, 1] += size
    rows = [(k, 0, path[k]) for k in t if k != 5]
    rows += [(5, 0, false), (5, 0, path[5])] if swap else [(5, 0, path[5]), (5, 0, false)]
    rows += [(5, 1, false)]
    (choice,) = gate_reports(reports_of(rows), SURVEY, 7, max_slant_range_ft=9e9).choices
    assert choice.kept_line == (43 if swap else 42)


def test_a_prediction_on_a_straight_track_is_exact_by_hand():
    counts = np.array([1, 2, 5])
    assert predict_position(4, counts, np.column_stack([counts, -counts, 0 * counts])).tolist() == [4, -4, 0]
    assert predict_position(4, counts[:1], np.ones((1, 3))).tolist() == [1, 1, 1]


# nothing is lost


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 60))
def test_every_pair_of_reports_in_range_is_in_exactly_one_set(seed, size):
    rng = np.random.default_rng(seed)
    rows = [
        (int(rng.integers(0, 80)), int(rng.integers(0, 4)), rng.uniform(0, 5000, 3) * (1, 1, -0.2))
        for _ in range(size)
    ]
    result = gate_reports(reports_of(rows), SURVEY, 7, gap_counts=5)
    near = {(c, a) for c, a, p in rows if np.linalg.norm(p - SURVEY.position[a]) <= 4700}
    seen = {c: {a for k, a in near if k == c} for c, _ in near}
    # the range gate acts on point counts that two arrays report, so nothing else can be near alone
    wanted = {(c, *pair) for c, arrays in seen.items() for pair in combinations(sorted(arrays), 2)}
    got = [(int(c), *s.pair) for s in result.sets for c in s.point_count]
    assert len(got) == len(set(got))
    assert set(got) == wanted
    for s in result.sets:
        assert np.all(np.diff(s.point_count) <= 5)


def test_order_of_the_file_does_not_matter():
    rng = np.random.default_rng(3)
    rows = (
        straight_track(0, range(40))
        + straight_track(1, range(10, 50), 5.0)
        + straight_track(2, range(20, 30), 9.0)
    )
    one = gate_reports(reports_of(rows), SURVEY, 7, max_slant_range_ft=1e5)
    two = gate_reports(
        reports_of([rows[k] for k in rng.permutation(len(rows))]), SURVEY, 7, max_slant_range_ft=1e5
    )
    assert [s.pair for s in one.sets] == [s.pair for s in two.sets]
    assert all(
        np.array_equal(a.x, b.x) and np.array_equal(a.y, b.y) for a, b in zip(one.sets, two.sets, strict=True)
    )


def test_no_report_at_all_is_no_set():
    empty = reports_of([(1, 0, MIDDLE)]).only(np.zeros(1, bool))
    result = gate_reports(empty, SURVEY, 7)
    assert result.sets == ()
    assert result.counts.kept_repaired == 0
    assert list(result.choices) == []


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 120))
def test_compiled_passes_agree_with_plain_gates(seed, size):
    rng = np.random.default_rng(seed)
    rows = [
        (
            int(rng.integers(0, 40)),
            int(rng.choice([0, 1, 2, 3, 8])),
            rng.uniform(0, 5000, 3) * (1, 1, -0.2),
            int(rng.choice([2, 7], p=[0.2, 0.8])),
            bool(rng.random() < 0.1),
        )
        for _ in range(size)
    ]
    reports = reports_of(rows)
    result = gate_reports(reports, SURVEY, 7, gap_counts=5)
    agrees_with_plain_gates(result, *plain_gating(reports, SURVEY, 7, gap=5))


def agrees_with_plain_gates(result, counts, sets, choices):
    c = result.counts
    got = (c.kept_mode, c.kept_paired, c.kept_range, c.kept_repaired, c.kept_repaired - c.repeats_left_out)
    assert got == counts
    assert [(s.pair, s.pass_number) for s in result.sets] == [(s.pair, s.pass_number) for s in sets]
    for ours, plain in zip(result.sets, sets, strict=True):
        assert np.array_equal(ours.point_count, plain.point_count)
        assert np.array_equal(ours.x, plain.x)
        assert np.array_equal(ours.y, plain.y)
    assert [(c.point_count, c.array, c.kept_line) for c in result.choices] == [c[:3] for c in choices]
    for ours, (*_, distance) in zip(result.choices, choices, strict=True):
        got = sorted([ours.kept_distance_ft, *ours.dropped_distances_ft])
        assert np.allclose(got, np.sort(distance), rtol=1e-9, atol=1e-9, equal_nan=True)


def test_stretches_of_many_threads_join_without_a_seam(demo, monkeypatch):
    reports, survey, _, _ = demo
    monkeypatch.setattr(gate_scan, "_FEWEST", 300)
    monkeypatch.setattr(gate_scan.os, "cpu_count", lambda: 7)
    vehicle = reports.only(reports.line < 4000)
    agrees_with_plain_gates(gate_reports(vehicle, survey, 7), *plain_gating(vehicle, survey, 7))


def test_a_choice_is_taken_back_by_naming_the_other_line():
    rows = straight_track(0, [3, 4, 6, 7]) + straight_track(1, [3, 4, 5, 6, 7], offset=30.0)
    rows += [(5, 0, (3200.0, 30.0, -300.0)), (5, 0, (3200.0, 0.0, -300.0))]
    (choice,) = gate_reports(reports_of(rows), SURVEY, 7).choices
    (other,) = choice.dropped_lines
    result = gate_reports(reports_of(rows), SURVEY, 7, keep_lines=[other])
    (back,) = result.choices
    assert (back.kept_line, back.dropped_lines) == (other, (choice.kept_line,))
    assert "named" in back.reason
    crossover = result.sets[0]
    assert crossover.x[crossover.point_count == 5].tolist() == [[3200.0, 30.0, -300.0]]


def test_the_last_point_count_is_not_lost():
    rows = [(t, a, MIDDLE) for t in (4, 5, 6) for a in (0, 1)]
    result = gate_reports(reports_of(rows), SURVEY, 7)
    assert result.sets[0].point_count.tolist() == [4, 5, 6]


# the demo run (simulated), against its truth


@pytest.fixture(scope="module")
def demo(data):
    folder = data / "range-demo"
    tfile = read_tfile(folder / "tfile.dat")
    survey = read_arrays(folder / "arrays.csv").survey
    truth = json.loads((folder / "truth.json").read_text())
    track = pd.read_csv(folder / "true_track.csv").set_index(["mode", "pc"])
    return tfile.reports, survey, truth, track


@pytest.mark.parametrize("mode", [2, 7])
def test_the_demo_counts_agree_with_a_plain_loop(demo, mode):
    reports, survey, _, _ = demo
    result = gate_reports(reports, survey, mode)
    at = {}
    for k in np.flatnonzero((reports.mode == mode) & ~reports.flagged):
        at.setdefault(int(reports.point_count[k]), []).append(k)
    paired = [k for group in at.values() if len(set(reports.array[group])) > 1 for k in group]
    rows = {int(n): p for n, p in zip(survey.number, survey.position, strict=True)}
    near = [
        k for k in paired
        if reports.array[k] in rows and np.linalg.norm(reports.position[k] - rows[reports.array[k]]) <= 4700
    ]  # fmt: skip
    left = {}
    for k in near:
        left.setdefault(int(reports.point_count[k]), []).append(k)
    repaired = sum(len(group) for group in left.values() if len(set(reports.array[group])) > 1)
    counts = result.counts
    assert (counts.kept_paired, counts.kept_range, counts.kept_repaired) == (len(paired), len(near), repaired)
    pairs = sum(len(list(combinations(set(reports.array[group]), 2))) for group in left.values())
    assert sum(s.points for s in result.sets) == pairs


@pytest.mark.parametrize("mode", [2, 7])
def test_no_repeat_of_the_demo_is_chosen_wrongly(demo, mode):
    """Nearest to the true position, moved as that array's neighbouring reports are (the timing offset)."""
    reports, survey, _, track = demo
    truth = track.loc[mode][["downrange_ft", "crossrange_ft", "vertical_ft"]]
    position = dict(zip(reports.line.tolist(), reports.position, strict=True))
    result = gate_reports(reports, survey, mode)
    assert len(result.choices) > 20
    of_mode = reports.only((reports.mode == mode) & ~reports.flagged)
    error = of_mode.position - truth.reindex(of_mode.point_count).to_numpy()
    for choice in result.choices:
        near = (of_mode.array == choice.array) & (np.abs(of_mode.point_count - choice.point_count) <= 8)
        here = truth.loc[choice.point_count].to_numpy() + np.nanmedian(error[near], axis=0)
        kept, *dropped = (
            np.linalg.norm(position[n] - here) for n in (choice.kept_line, *choice.dropped_lines)
        )
        assert kept < min(dropped), choice
