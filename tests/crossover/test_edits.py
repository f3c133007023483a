"""Points left out by hand stay left out however the file is read again."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.crossover.edits import PointEdits, edits_csv, parse_edits
from trackerlib.crossover.gating import gate_reports
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.tfile import parse_tfile
from trackerlib.textfiles import InputError


def a_set(counts=(3, 5, 9, 10)):
    counts = np.array(counts)
    track = np.column_stack([counts, 2 * counts, -counts]).astype(float)
    lines = np.column_stack([40 + counts, 80 + counts])
    return CrossoverSet((4, 55), counts, track, track + 1, source="run.dat", lines=lines)


def test_a_point_left_out_is_known_by_its_count_not_its_row():
    edits = PointEdits().exclude(a_set(), [1, 3], 7, "turning")
    assert edits.excluded(a_set(), 7).tolist() == [False, True, False, True]
    assert edits.excluded(a_set((5, 10, 11)), 7).tolist() == [True, True, False]
    assert not edits.excluded(a_set(), 2).any()
    assert edits.kept(a_set(), 7).point_count.tolist() == [3, 9]
    assert edits.kept(a_set(), 7).lines.tolist() == [[43, 83], [49, 89]]


def test_restoring_puts_back_only_what_was_left_out():
    edits = PointEdits().exclude(a_set(), [1, 3], 7, "turning").restore(a_set(), [0, 1], 7)
    assert edits.excluded(a_set(), 7).tolist() == [False, False, False, True]
    assert [edit.action for edit in edits.log] == ["exclude", "exclude", "restore"]


def test_the_log_reads_back_as_it_was():
    edits = PointEdits().exclude(a_set(), [1, 3], 7, "turning, or so").restore(a_set(), [1], 7)
    back, bad = parse_edits(edits_csv(edits).splitlines(), "edits.csv")
    assert back == edits
    assert bad == ()
    assert back.log[0].first_line == 45
    assert back.log[0].second_line == 85


def test_rows_and_files_that_are_none_are_told():
    text = edits_csv(PointEdits().exclude(a_set(), [1], 7, "")).splitlines()
    edits, bad = parse_edits([*text, "now,forget,7,4,55,9,,,x,"], "edits.csv")
    assert len(edits) == 1
    assert bad[0].line == 3
    with pytest.raises(InputError, match=r"edits.csv, line 1: no column action"):
        parse_edits(["utc,mode"], "edits.csv")


def test_edits_survive_a_file_put_in_another_order(data):
    folder = data / "range-demo"
    lines = (folder / "tfile.dat").read_text().splitlines()
    survey = read_arrays(folder / "arrays.csv").survey
    head, records = lines[:31], lines[31:]
    turned = "\n".join([*head, *records[::-1]]) + "\n"
    first = gate_reports(parse_tfile("\n".join(lines).encode(), "a").reports, survey, 7).sets[1]
    again = gate_reports(parse_tfile(turned.encode(), "b").reports, survey, 7).sets[1]
    edits = PointEdits().exclude(first, [10, 20], 7, "noise")
    assert again.point_count[edits.excluded(again, 7)].tolist() == first.point_count[[10, 20]].tolist()
    assert np.array_equal(first.x, again.x)
    assert records[first.lines[10, 0] - 32][63:65] == f"{first.pair[0]:2d}"
    assert records[::-1][again.lines[10, 1] - 32][63:65] == f"{first.pair[1]:2d}"
