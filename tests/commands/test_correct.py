"""`correct`: a copy whose every other byte is the original's, and positions that close on the truth."""

import hashlib
import json

import numpy as np
import pandas as pd
import pytest

from trackerlib.commands import main
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.timing.stretch import stretch


@pytest.fixture
def call(data, tmp_path, capsys):
    """Runs correct on the demo or another T-file; returns exit code, answer and standard error."""
    folder = data / "range-demo"

    def run(*more, tfile=folder / "tfile.dat", out=tmp_path / "corrected.dat"):
        argv = ["correct", tfile, "--arrays", folder / "arrays.csv", "--profile", folder / "VELOCITY.DAT"]
        code = main([str(word) for word in (*argv, "--out", out, "--json", *more)])
        said = capsys.readouterr()
        return code, json.loads(said.out) if code == 0 else None, said.err

    return run


def test_positions_of_every_array_close_on_the_truth(call, data, tmp_path):
    original = data / "range-demo/tfile.dat"
    before = original.read_bytes()
    code, answer, _ = call("--mode", 7, "--offset-ms", 2.85)
    assert code == 0
    assert original.read_bytes() == before
    truth = pd.read_csv(data / "range-demo/true_track.csv").set_index(["mode", "pc"]).loc[7]
    error = {}
    for name, path in (("before", original), ("after", tmp_path / "corrected.dat")):
        reports = read_tfile(path, mode=7).reports
        right = truth.reindex(reports.point_count)[
            ["downrange_ft", "crossrange_ft", "vertical_ft"]
        ].to_numpy()
        error[name] = (
            pd.Series(np.linalg.norm(reports.position - right, axis=1)).groupby(reports.array).median()
        )
    surveyed = [n for n in error["before"].index if n not in (5, 40)]  # 5 is surveyed wrongly, 40 not at all
    gain = (error["before"] / error["after"])[surveyed]
    assert gain.median() > 2
    assert error["after"][surveyed].median() < 4
    assert answer["largest_change_ft"] == pytest.approx(2.85e-3 * 4880, rel=0.01)


def test_nothing_but_the_positions_of_that_vehicle_changes(call, data, tmp_path):
    call("--mode", 7, "--offset-ms", 2.85)
    old = (data / "range-demo/tfile.dat").read_text().splitlines()
    new = (tmp_path / "corrected.dat").read_text().splitlines()
    assert len(old) == len(new)
    assert "CORRECTED COPY OF tfile.dat: OFFSET 2.85 MS, MODE 7" in new[0]
    assert new[0].startswith(old[0].rstrip())
    for one, other in zip(old[1:], new[1:], strict=True):
        assert (one[:8], one[33:]) == (other[:8], other[33:])
        if one[67:68] != "7" or one[5:7].strip():
            assert one == other
    reading = read_tfile(tmp_path / "corrected.dat")
    assert len(reading.header) == 31
    assert not reading.warnings
    assert reading.simulated


def test_every_record_is_counted_once(call, data):
    _, answer, _ = call("--offset-ms", 1)
    assert answer["corrected"] + answer["untouched"] == 18585
    assert answer["unplaced_arrays"] != {}


def test_one_correction_for_several_vehicles_and_none_at_all_are_remarked(call):
    assert any("each of which has a clock of its own" in one for one in call("--offset-ms", 1)[1]["warnings"])
    of_one = call("--offset-ms", 1, "--mode", 7)[1]["warnings"]
    assert not any("clock of its own" in one for one in of_one)
    assert any("the copy holds the positions as they were" in one for one in call("--mode", 7)[1]["warnings"])


def test_the_copy_gates_again_to_sets_without_an_offset(call, data, tmp_path, capsys):
    call("--mode", 7, "--offset-ms", 2.85)
    tables = ("--arrays", data / "range-demo/arrays.csv", "--profile", data / "range-demo/VELOCITY.DAT")
    gate = ("gate", tmp_path / "corrected.dat", *tables[:2], "--mode", 7, "--out", tmp_path / "sets")
    assert main([str(word) for word in gate]) == 0
    surveyed = [path for path in (tmp_path / "sets").iterdir() if "_05_" not in path.name]
    capsys.readouterr()
    assert main([str(word) for word in ("timing", *surveyed, *tables, "--json")]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert len(answer["sets"]) > 25
    assert abs(answer["one_offset"]["constant"]["mean_offset_ms"]) < 0.02
    assert answer["one_offset"]["constant"]["p_value"] > 0.01


def test_a_drift_turns_about_t0(call, data, tmp_path):
    call("--mode", 7, "--offset-ms", 1, "--drift-ms-per-count", 0.002, "--t0", 3000)
    survey = read_arrays(data / "range-demo/arrays.csv").survey
    profile = read_velocity(data / "range-demo/VELOCITY.DAT").profile
    old, new = (
        read_tfile(p, mode=7).reports for p in (data / "range-demo/tfile.dat", tmp_path / "corrected.dat")
    )
    these = old.array == 3
    direction = stretch(old.position[these], survey.position_of(3), profile).velocity
    g = 1e-3 + 2e-6 * (old.point_count[these] - 3000)
    assert new.position[these] == pytest.approx(old.position[these] + g[:, None] * direction, abs=0.0501)


def test_a_calibration_turns_and_moves_the_tracks_of_its_array(call, data, tmp_path):
    turn = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    answer = {"arrays": [{"array": 3, "rotation": turn, "intercept_ft": [10.0, 20.0, 30.0]}]}
    (tmp_path / "calibrate.json").write_text(json.dumps(answer))
    call("--mode", 7, "--calibration", tmp_path / "calibrate.json")
    old, new = (
        read_tfile(p, mode=7).reports for p in (data / "range-demo/tfile.dat", tmp_path / "corrected.dat")
    )
    these = old.array == 3
    assert these.sum() > 100
    expected = old.position[these] @ np.array(turn).T + [10, 20, 30]
    assert new.position[these] == pytest.approx(expected, abs=1e-6)
    assert np.array_equal(new.position[~these], old.position[~these])


def test_a_position_that_has_no_room_is_left_and_told(call, data, tmp_path):
    far = {"arrays": [{"array": 3, "rotation": np.eye(3).tolist(), "intercept_ft": [9e5, 0.0, -99_999.0]}]}
    (tmp_path / "far.json").write_text(json.dumps(far))
    _, answer, err = call("--mode", 7, "--calibration", tmp_path / "far.json")
    assert "needs more than 7 columns" in err
    assert answer["bad_records"][-1]["why"].endswith("left as it was")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "line 1"),
        ("[]", "no list 'arrays'"),
        ('{"arrays": [{"array": 1}]}', r"arrays[1]: key 'rotation' is missing"),
        ('{"arrays": [{"array": 1, "rotation": [1], "intercept_ft": [0,0,0]}]}', "rotation 3 x 3"),
        (
            '{"arrays": [{"array": 1, "rotation": [[1,0,0],[0,1,0],[0,0,1]], "intercept_ft": [NaN,0,0]}]}',
            "arrays[1]: found a number that is none",
        ),
        (
            '{"arrays": [{"array": 1, "rotation": [[2,0,0],[0,1,0],[0,0,1]], "intercept_ft": [0,0,0]}]}',
            "no rotation",
        ),
    ],
)
def test_a_calibration_that_is_none_is_refused_in_words(call, tmp_path, text, words):
    (tmp_path / "calibrate.json").write_text(text)
    code, _, err = call("--calibration", tmp_path / "calibrate.json")
    assert code == 2
    assert words in err
    assert not (tmp_path / "corrected.dat").exists()


def test_the_original_is_never_the_target(call, data, tmp_path):
    (tmp_path / "t.dat").write_bytes((data / "range-demo/tfile.dat").read_bytes())
    code, _, err = call("--offset-ms", 1, tfile=tmp_path / "t.dat", out=tmp_path / "t.dat")
    assert (code, "the T-file itself" in err) == (2, True)
    code, _, err = call("--drift-ms-per-count", 1)
    assert (code, "needs --t0" in err) == (2, True)


def test_the_whole_track_is_written_too(tmp_path, data, capsys):
    folder = data / "range-demo"
    call = [
        "correct", str(folder / "tfile.dat"), "--arrays", str(folder / "arrays.csv"), "--profile",
        str(folder / "VELOCITY.DAT"), "--offset-ms", "2.85", "--out", str(tmp_path / "copy.dat"), "--track",
        str(tmp_path / "track.csv"), "--json",
    ]  # fmt: skip
    assert main(call) == 2
    assert "--track needs --mode" in capsys.readouterr().err
    assert main([*call, "--mode", "7"]) == 0
    answer = json.loads(capsys.readouterr().out)
    lines = (tmp_path / "track.csv").read_text().splitlines()
    assert lines[0] == "# SIMULATED DATA"
    assert len(lines) == answer["track_points"] + 3
    assert answer["mean_jump_after_ft"] < 0.5 * answer["mean_jump_before_ft"]


def test_a_calibration_is_in_the_track_too_and_every_hand_over_is_written(tmp_path, data, call):
    shift = {"arrays": [{"array": 3, "rotation": np.eye(3).tolist(), "intercept_ft": [0.0, 0.0, 500.0]}]}
    (tmp_path / "calibrate.json").write_text(json.dumps(shift))
    tables = {}
    for name, more in (("as_surveyed", ()), ("moved", ("--calibration", tmp_path / "calibrate.json"))):
        files = ("--track", tmp_path / f"{name}.csv", "--hand-overs", tmp_path / f"{name}_jumps.csv")
        _, answer, _ = call("--mode", 7, "--offset-ms", 2.85, *files, *more)
        tables[name] = pd.read_csv(tmp_path / f"{name}.csv", comment="#").set_index("point_count").z_ft
    step = (tables["moved"] - tables["as_surveyed"]).abs()
    assert step.max() == pytest.approx(500, abs=1)
    jumps = pd.read_csv(tmp_path / "moved_jumps.csv", comment="#")
    assert len(jumps) == answer["hand_overs"] > 30
    of_three = jumps.pair.str.split("-").map(lambda pair: "3" in pair)
    assert jumps.jump_after_ft[of_three].min() > 400 > jumps.jump_after_ft[~of_three].max()


def test_an_output_without_a_folder_is_refused_before_anything_is_written(call, tmp_path):
    code, _, err = call("--mode", 7, "--offset-ms", 1, "--track", tmp_path / "none/track.csv")
    assert (code, f"there is no folder {tmp_path / 'none'}" in err) == (2, True)
    assert not (tmp_path / "corrected.dat").exists()


@pytest.mark.parametrize(
    ("option", "name", "words"),
    [
        ("--track", "tfile.dat", "--track is {}, the T-file itself"),
        ("--out", "arrays.csv", "--out is {}, the array table itself"),
        ("--track", "VELOCITY.DAT", "--track is {}, the profile itself"),
        ("--track", "copy.dat", "--track is {}, the file of --out too"),
    ],
)
def test_no_file_that_is_read_is_written_over(tmp_path, data, capsys, option, name, words):
    for one in ("tfile.dat", "arrays.csv", "VELOCITY.DAT"):
        (tmp_path / one).write_bytes((data / "range-demo" / one).read_bytes())
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    argv = ["correct", tmp_path / "tfile.dat", "--arrays", tmp_path / "arrays.csv", "--mode", 7, "--profile",
            tmp_path / "VELOCITY.DAT", "--out", tmp_path / "copy.dat", option, tmp_path / name]  # fmt: skip
    assert main([str(word) for word in argv]) == 2
    assert words.format(tmp_path / name) in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_copy_tells_what_was_done_to_which_file(call, data, tmp_path):
    call("--mode", 7, "--offset-ms", 2.8512345, "--profile-speeds", "boundary")
    said = (tmp_path / "corrected.dat").read_text().splitlines()[0]
    digest = hashlib.sha256((data / "range-demo/tfile.dat").read_bytes()).hexdigest()
    assert (
        "OFFSET 2.8512345 MS, MODE 7, PROFILE VELOCITY.DAT (SPEEDS AT THE DEPTHS), ARRAYS arrays.csv" in said
    )
    assert f"SHA-256 OF THE ORIGINAL {digest}" in said
    _, answer, _ = call("--offset-ms", 1, tfile=tmp_path / "corrected.dat", out=tmp_path / "again.dat")
    assert any("were corrected before: CORRECTED COPY OF tfile.dat" in one for one in answer["warnings"])
