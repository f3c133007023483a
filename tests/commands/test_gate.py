"""`gate`: the demo run to files and back, and inputs that are no use."""

import json
from pathlib import Path

import numpy as np
import pytest

from trackerlib.commands import main
from trackerlib.crossover.noise import residual_noise
from trackerlib.crossover.smooth_track import is_curved
from trackerlib.crossover.straight_line import MIN_POINTS
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.covariance_files import read_covariances
from trackerlib.rangefiles.crossover_file import read_crossover
from trackerlib.rangefiles.m_matrix_file import read_m_matrix
from trackerlib.rangefiles.segment_file import read_segment


@pytest.fixture
def call(data, tmp_path, capsys):
    """Runs gate on the demo, or on other files; returns exit code, standard output and standard error."""

    def run(
        *more,
        tfile=data / "range-demo/tfile.dat",
        arrays=data / "range-demo/arrays.csv",
        out=tmp_path / "sets",
    ):
        argv = ["gate", tfile, "--arrays", arrays, "--mode", 7, "--out", out, *more]
        code = main([str(word) for word in argv])
        return code, *capsys.readouterr()

    return run


def test_the_demo_gives_files_that_read_back(call, data, tmp_path):
    code, out, _ = call("--json")
    answer = json.loads(out)
    survey = read_arrays(data / "range-demo/arrays.csv").survey
    assert code == 0
    assert len(answer["sets"]) == len(list((tmp_path / "sets").iterdir())) > 30
    for entry in answer["sets"]:
        crossover = read_crossover(entry["file"], survey).set
        assert list(crossover.pair) == entry["pair"] == sorted(entry["pair"])
        assert (crossover.points, crossover.pass_number) == (entry["points"], entry["pass"])
        assert crossover.range_name == "SIMULATED"
        for track, array in zip((crossover.x, crossover.y), crossover.pair, strict=True):
            assert np.linalg.norm(track - survey.position_of(array), axis=1).max() <= 4700
    assert [bad["line"] for bad in answer["bad_records"]] == [6233, 11750, 17786]
    assert answer["simulated"] is True


def test_the_report_says_the_gates_the_bad_lines_and_that_it_is_simulated(call):
    _, out, err = call()
    for words in ("SIMULATED DATA", "18585 records read", "line 6233: columns 9-15", "crossover_01_02_1.txt"):
        assert words in out
    assert "array 40 is not in the array table" in err


def test_every_set_as_the_reports_own_files(call, data, tmp_path):
    answer = json.loads(call("--json", "--report-files")[1])
    survey = read_arrays(data / "range-demo/arrays.csv").survey
    assert len(answer["report_files"]) == len(answer["sets"])
    for entry, folder in zip(answer["sets"], map(Path, answer["report_files"]), strict=True):
        crossover = read_crossover(entry["file"], survey).set
        again = read_crossover(folder / "TRPDOTRX.DAT", survey).set
        assert again.pair == crossover.pair
        assert np.array_equal(again.point_count, crossover.point_count)
        assert np.array_equal(again.x, crossover.x)
        assert np.array_equal(again.y, crossover.y)
        if entry["points"] < MIN_POINTS:
            assert not (folder / "MMATRIX.M").exists()
            continue
        noise = residual_noise(crossover.x, crossover.y, crossover.point_count)
        of_x, of_y, cross = read_covariances(folder)  # PRINCOM3's X is the second array of the pair
        assert np.allclose(of_x, noise.second)
        assert np.allclose(of_y, noise.first)
        assert np.allclose(cross, noise.cross.T)
        assert np.allclose(read_m_matrix(folder / "MMATRIX.M"), noise.gap)


def test_a_narrower_gap_makes_more_passes(call):
    wide = json.loads(call("--json", "--gap-counts", 1000)[1])["sets"]
    narrow = json.loads(call("--json", "--gap-counts", 1)[1])["sets"]
    assert len(narrow) > len(wide)
    assert sum(s["points"] for s in narrow) == sum(s["points"] for s in wide)


def test_segments_are_written_and_read_back(call, tmp_path):
    answer = json.loads(call("--json", "--segments")[1])
    assert len(answer["segments"]) == len(list((tmp_path / "sets").glob("segment_*.txt"))) > 50
    for entry in answer["segments"]:
        segment = read_segment(entry["file"]).segment
        assert (segment.array, len(segment.point_count)) == (entry["array"], entry["points"])
        assert not is_curved(segment.position, segment.point_count, 1e-7)


def test_a_choice_among_repeats_is_taken_back_by_its_line(call):
    choice = json.loads(call("--json")[1])["repeats"][0]
    (other,) = choice["dropped_lines"]
    back = json.loads(call("--json", "--keep-line", other)[1])["repeats"][0]
    assert (back["kept_line"], back["dropped_lines"]) == (other, [choice["kept_line"]])


def test_choices_are_told_with_the_lines_that_take_them_back(call):
    choice = json.loads(call("--json")[1])["repeats"][0]
    (other,) = choice["dropped_lines"]
    told = f"count {choice['point_count']}: line {choice['kept_line']} kept and not {other}: nearest to the array's"
    assert told in call()[1]
    assert (
        f"line {other} kept and not {choice['kept_line']}: this line was named"
        in call("--keep-line", other)[1]
    )


def test_a_line_to_keep_that_chooses_nothing_is_told(call):
    (other,) = json.loads(call("--json")[1])["repeats"][0]["dropped_lines"]
    code, out, err = call("--keep-line", 99999, "--keep-line", other, "--json")
    assert code == 0
    assert "--keep-line 99999 chose nothing" in err
    assert f"--keep-line {other} " not in err
    assert any("--keep-line 99999 chose nothing" in one for one in json.loads(out)["warnings"])


def test_a_vehicle_of_whom_every_report_bears_an_edit_mark_is_told(call, data, tmp_path):
    lines = (data / "range-demo/tfile.dat").read_text().splitlines()[:200]
    (tmp_path / "marked.dat").write_text(
        "\n".join(lines[:31] + [one[:5] + "ED" + one[7:] for one in lines[31:]])
    )
    code, _, err = call(tfile=tmp_path / "marked.dat")
    assert (code, "every report of mode 7 bears an edit mark" in err) == (0, True)


def test_columns_shifted_by_one_are_found_out(call, data, tmp_path):
    lines = (data / "range-demo/tfile.dat").read_text().splitlines()
    (tmp_path / "shifted.dat").write_text("\n".join(lines[:31] + [" " + line for line in lines[31:]]))
    code, _, err = call(tfile=tmp_path / "shifted.dat")
    assert code == 2
    assert "line 32: columns 9-15 (downrange) hold ' 49473.', wanted feet" in err


def test_files_of_an_earlier_call_are_told(call, tmp_path):
    call("--gap-counts", 1)
    assert "left" in call("--gap-counts", 1000)[2]


def test_a_file_cut_in_the_middle_of_a_record_keeps_the_rest(call, data, tmp_path):
    (tmp_path / "cut.dat").write_bytes((data / "range-demo/tfile.dat").read_bytes()[:700_000])
    code, out, _ = call("--json", tfile=tmp_path / "cut.dat")
    last = json.loads(out)["bad_records"][-1]
    assert code == 0
    assert "ends at column" in last["why"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tfile": "none.dat"}, "no such file"),
        ({"arrays": "none.csv"}, "no such file"),
        ({"more": ("--header-records", "-1")}, "header count is -1"),
        ({"more": ("--header-records", "99999")}, "wanted 99999 of header"),
        ({"more": ("--max-slant-range-ft", "nan")}, "wanted feet above 0"),
        ({"more": ("--day", "1")}, "wanted --campaign FILE with them"),
        ({"more": ("--gap-counts", "0")}, "wanted 1 or more"),
        ({"more": ("--run-date", "soon")}, "date is 'soon'"),
        ({"out": "/dev/null/sets"}, "/dev/null"),
    ],
)
def test_an_input_that_is_no_use_is_exit_2_in_words(call, options, words):
    options = dict(options)
    code, out, err = call(*options.pop("more", ()), **options)
    assert (code, out) == (2, "")
    assert words in err
