"""`gate`: the demo run to files and back, and inputs that are no use."""

import json

import numpy as np
import pytest

from trackerlib.commands import main
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.crossover_file import read_crossover


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


def test_a_narrower_gap_makes_more_passes(call):
    wide = json.loads(call("--json", "--gap-counts", 1000)[1])["sets"]
    narrow = json.loads(call("--json", "--gap-counts", 1)[1])["sets"]
    assert len(narrow) > len(wide)
    assert sum(s["points"] for s in narrow) == sum(s["points"] for s in wide)


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
