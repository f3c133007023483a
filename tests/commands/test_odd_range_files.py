"""What is wrong with a range's files, in `gate`, `timing`, `correct`, `constancy`: a sentence, the rest works."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from trackerlib.commands import main
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.crossover_file import read_crossover, write_crossover

METRES = 0.3048


@pytest.fixture(scope="module")
def gated(data, tmp_path_factory):
    """Crossover files of the demo's torpedo."""
    folder = data / "range-demo"
    out = tmp_path_factory.mktemp("sets")
    call = ["gate", folder / "tfile.dat", "--arrays", folder / "arrays.csv", "--mode", 7, "--out", out]
    assert main([str(word) for word in call]) == 0
    return out


@pytest.fixture
def folder(data, tmp_path):
    """The demo's files with its first 4000 records, to be spoilt."""
    for name in ("arrays.csv", "VELOCITY.DAT"):
        shutil.copy(data / "range-demo" / name, tmp_path)
    lines = (data / "range-demo/tfile.dat").read_text().splitlines(keepends=True)
    (tmp_path / "tfile.dat").write_text("".join(lines[:4031]))
    return tmp_path


@pytest.fixture
def run(folder, capsys):
    """Runs a command on the folder's files; returns exit code, answer and standard error."""

    def call(command, *words):
        files = {
            "gate": ["tfile.dat", "--mode", 7, "--arrays", "arrays.csv", "--out", "out"],
            "correct": ["tfile.dat", "--mode", 7, "--arrays", "arrays.csv", "--profile", "VELOCITY.DAT",
                        "--offset-ms", 2.85, "--out", "copy.dat"],
            "timing": ["--arrays", "arrays.csv", "--profile", "VELOCITY.DAT"],
        }[command]  # fmt: skip
        named = [folder / word if isinstance(word, str) and "." in word else word for word in files]
        named = [folder / "out" if word == "out" else word for word in named]
        code = main([str(word) for word in (command, *named, "--json", *words)])
        said = capsys.readouterr()
        return code, json.loads(said.out) if code == 0 else None, said.err

    return call


def spoil(path, change):
    """Rewrites a file's lines by a function of their list."""
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")


@pytest.mark.parametrize("command", ["gate", "correct"])
def test_a_tfile_cut_in_mid_record_loses_that_record_alone(run, folder, command):
    whole = run(command)[1]
    content = (folder / "tfile.dat").read_bytes()
    (folder / "tfile.dat").write_bytes(content[:-40])
    code, cut, _ = run(command)
    assert code == 0
    last = cut["bad_records"][-1]
    assert (last["line"], "ends at column" in last["why"]) == (4031, True)
    key = "records_read" if command == "gate" else "untouched"
    assert cut[key] in (whole[key], whole[key] + 1)  # the record that was cut is among those left as they are


@pytest.mark.parametrize("command", ["gate", "correct"])
def test_columns_shifted_by_one_are_named_and_the_other_records_used(run, folder, command):
    spoil(folder / "tfile.dat", lambda lines: [*lines[:31], " " + lines[31], *lines[32:]])
    code, answer, _ = run(command)
    assert code == 0
    assert answer["bad_records"][0]["line"] == 32
    assert "columns 9-15 (downrange) hold" in answer["bad_records"][0]["why"]
    assert answer["bad_records"][0]["why"].endswith("; the record is shifted to the right by one column")
    spoil(folder / "tfile.dat", lambda lines: [*lines[:31], *(" " + line for line in lines[32:])])
    code, _, said = run(command)
    assert code == 2
    assert "line 32: columns 9-15 (downrange)" in said
    assert "shifted to the right by one column" in said
    spoil(folder / "tfile.dat", lambda lines: [*lines[:31], *(line[2:] for line in lines[31:])])
    assert "wanted 68 columns; the record is shifted to the left by one column" in run(command)[2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lines: [*lines[:3], lines[2], *lines[3:]], "line 4: found depth 50 ft after 50 ft; wanted"),
        (lambda lines: lines[::-1], "line 2: found depth 1300 ft after 1325 ft; wanted growing depths"),
        (
            lambda lines: [
                f"{METRES * float(a):.2f} {METRES * float(b):.2f}" for a, b in map(str.split, lines)
            ],
            "(metres per second?); wanted feet per second",
        ),
        (lambda lines: ["no table"], "line 1: found 'no table'"),
    ],
    ids=["repeated", "descending", "metres", "words"],
)
@pytest.mark.parametrize("command", ["timing", "correct"])
def test_a_profile_that_is_none_is_refused_with_its_line(run, folder, gated, command, change, words):
    spoil(folder / "VELOCITY.DAT", change)
    code, _, said = run(command, *(sorted(gated.iterdir())[:1] if command == "timing" else ()))
    assert code == 2
    assert words in said
    assert not (folder / "copy.dat").exists()


@pytest.mark.parametrize("command", ["timing", "correct"])
def test_a_profile_in_metres_is_asked_about_and_read_as_such_when_told(run, folder, gated, command):
    files = sorted(gated.iterdir())[:1] if command == "timing" else ()
    whole = run(command, *files, "--profile-speeds", "boundary")[1]
    rows = (folder / "VELOCITY.DAT").read_text().splitlines()
    metres = [f"{METRES * float(a):.4f} {METRES * float(b):.4f}" for a, b in map(str.split, rows)]
    (folder / "VELOCITY.DAT").write_text("\n".join(metres) + "\n")
    code, _, said = run(command, *files)
    assert (code, "Is the file in metres?" in said, "(--profile-speeds metres)" in said) == (2, True, True)
    answer = run(command, *files, "--profile-speeds", "metres")[1]
    pick = (lambda a: a["sets"][0]["offset_ms"]) if files else (lambda a: a["largest_change_ft"])
    assert pick(answer) == pytest.approx(pick(whole), rel=1e-3)


@pytest.mark.parametrize("command", ["timing", "correct"])
def test_a_gap_in_a_profile_is_remarked_and_bridged(run, folder, gated, command):
    files = sorted(gated.iterdir())[:2] if command == "timing" else ()
    whole = run(command, *files)[1]
    spoil(folder / "VELOCITY.DAT", lambda lines: [*lines[:8], *lines[12:]])
    code, answer, said = run(command, *files)
    assert code == 0
    assert "VELOCITY.DAT: gap in the depths from 175 to 300 ft: speed goes straight across" in said
    key = "sets" if command == "timing" else "largest_change_ft"
    if command == "timing":
        assert answer[key][0]["offset_ms"] == pytest.approx(whole[key][0]["offset_ms"], abs=0.01)
    else:
        assert answer[key] == pytest.approx(whole[key], rel=0.01)


def test_metres_for_feet_are_asked_about_wherever_they_stand(run, folder, gated, tmp_path):
    survey = read_arrays(folder / "arrays.csv").survey
    for good in (sorted(gated.iterdir())[-1], sorted(gated.iterdir())[0]):  # the latter near array 1 even so
        one = read_crossover(good, survey).set
        write_crossover(
            tmp_path / "metres.txt", CrossoverSet(one.pair, one.point_count, METRES * one.x, METRES * one.y)
        )
        code, answer, said = run("timing", tmp_path / "metres.txt", good)
        assert (code, len(answer["sets"])) == (0, 2)
        assert "metres.txt: is the crossover file in metres? 100% of the reports lie within" in said
        assert (len(answer["sets"][0]["remarks"]), answer["sets"][1]["remarks"]) == (1, [])
    rows = [f"{n},{x:.1f},{y:.1f},{z:.1f}" for n, (x, y, z) in
            zip(survey.number, METRES * survey.position, strict=True)]  # fmt: skip
    (folder / "arrays.csv").write_text("\n".join(["array,x,y,z", *rows]) + "\n")
    for command in ("gate", "correct"):
        code, answer, said = run(command)
        assert code == 0
        assert "is the array table in metres?" in said
        assert any("is the array table in metres?" in warning for warning in answer["warnings"])


def test_an_array_that_the_table_lacks_costs_its_own_sets_alone(run, folder, gated):
    files = sorted(gated.iterdir())[:4]
    lost = files[0].name.split("_")[1]
    spoil(folder / "arrays.csv", lambda lines: [one for one in lines if not one.startswith(f"{int(lost)},")])
    code, answer, said = run("timing", *gated.glob("crossover_*.txt"))
    assert code == 0
    assert len(answer["sets"]) + len(answer["failed_sets"]) == len(list(gated.iterdir()))
    assert all(int(lost) not in one["pair"] for one in answer["sets"])
    assert f"array {int(lost)} is not in the array table arrays.csv" in answer["failed_sets"][0]["why"]
    assert "is no use: array" in said
    assert run("timing", files[0])[0] == 2
    for command in ("gate", "correct"):
        code, answer, said = run(command)
        assert (code, int(lost) in map(int, answer["unplaced_arrays"])) == (0, True)
        assert f"array {int(lost)} " in said


def straight(folder, name, counts, depth=-300.0, spread=40.0, pair=(1, 2)):
    """A set of a straight track between arrays 1 and 2 of the demo, as a file."""
    survey = read_arrays(folder / "arrays.csv").survey
    middle = (survey.position_of(1) + survey.position_of(2)) / 2
    counts = np.asarray(counts)
    x = np.column_stack([middle[0] + spread * counts, middle[1] + 900 + 0.0 * counts, 0.0 * counts + depth])
    noise = np.random.default_rng(1).normal(0, 0.5, x.shape)
    write_crossover(
        folder / name, CrossoverSet(pair, counts, x + noise, x + np.array([3.0, 1.0, 0.0]) - noise)
    )
    return folder / name


def test_targets_below_the_array_are_asked_about_and_timed(run, folder):
    deep = straight(folder, "deep.txt", range(40), depth=-2000.0)
    code, answer, said = run("timing", deep, straight(folder, "fine.txt", range(40)))
    assert code == 0
    assert "deep.txt: 100.0% of the reports lie deeper than their own array" in said
    assert "(arrays 1, 2); their rays go down" in said
    assert "fine.txt: " not in said
    assert all(one["sigma_offset_ms"] for one in answer["sets"])
    spoil(
        folder / "tfile.dat",
        lambda lines: lines[:31] + [one[:26] + "-2000.0" + one[33:] for one in lines[31:]],
    )
    for command in ("gate", "correct"):
        code, answer, _ = run(command)
        assert code == 0
        assert any("lie deeper than their own array" in warning for warning in answer["warnings"])


@pytest.mark.parametrize("command", ["timing", "correct"])
def test_a_profile_that_ends_above_an_array_is_remarked_and_depths_in_metres_asked_about(
    run, folder, gated, command
):
    files = sorted(gated.iterdir())[:1] if command == "timing" else ()
    rows = (folder / "VELOCITY.DAT").read_text().splitlines()
    (folder / "VELOCITY.DAT").write_text("\n".join(rows[:40]) + "\n")
    code, _, said = run(command, *files)
    assert code == 0
    assert "the profile ends at 987.5 ft, and arrays 1, 2" in said
    assert "metres" not in said
    rows = [f"{METRES * float(depth):.2f} {speed}" for depth, speed in map(str.split, rows)]
    (folder / "VELOCITY.DAT").write_text("\n".join(rows) + "\n")
    assert (
        "speed goes on with the mean step of the last rows. Are its depths in metres?"
        in run(command, *files)[2]
    )


def test_a_profile_that_begins_far_below_the_surface_is_remarked(run, folder, gated):
    good = sorted(gated.iterdir())[0]
    assert "the profile begins" not in run("timing", good)[2]
    spoil(folder / "VELOCITY.DAT", lambda lines: lines[4:])
    assert (
        "the profile begins at 112.5 ft: above it speed goes on with the first gradient"
        in run("timing", good)[2]
    )


def test_turned_rays_are_counted_and_take_no_part(run, folder, capsys):
    (folder / "VELOCITY.DAT").write_text("0 5400\n1200 4600\n2400 4600\n")
    some = straight(folder, "some.txt", range(60), depth=-20.0, spread=60.0)
    code, answer, _ = run("timing", some)
    (one,) = answer["sets"]
    assert code == 0
    assert 0 < one["in_shadow"] <= 60
    assert one["points"] + len(one["excluded_counts"]) == 60
    far = straight(folder, "far.txt", range(100, 140), depth=-20.0, spread=100.0)
    call = ["timing", far, some, "--arrays", folder / "arrays.csv", "--profile", folder / "VELOCITY.DAT"]
    assert main([str(word) for word in call]) == 0
    assert (
        "no offset: no point is left: each is excluded, or no direct ray reaches it"
        in capsys.readouterr().out
    )
    code, answer, said = run("correct")
    assert code == 0
    assert answer["in_shadow"] > 0
    assert f"no direct ray joins {answer['in_shadow']} reports to their array" in said


def test_a_pair_with_two_points_has_an_offset_and_no_sigma(run, folder):
    two = straight(folder, "two.txt", [5, 9])
    code, answer, _ = run("timing", two, straight(folder, "fine.txt", range(40)))
    few, many = answer["sets"]
    assert code == 0
    assert (few["points"], few["sigma_offset_ms"], few["M_ft2"]) == (2, None, None)
    assert "2 points are too few for a sigma" in few["reason"]
    assert many["sigma_offset_ms"] > 0


def test_a_set_without_an_offset_has_no_row_that_constancy_could_take_for_one(run, folder, gated, capsys):
    (folder / "VELOCITY.DAT").write_text("0 5400\n1200 4600\n2400 4600\n")
    far = straight(folder, "far.txt", range(100, 140), depth=-20.0, spread=100.0)
    table = folder / "offsets.csv"
    code, answer, _ = run("timing", far, *sorted(gated.iterdir())[:3], "--day", 1, "--run", 1, "--out", table)
    points = [one["points"] for one in answer["sets"]]
    assert (code, points[0], len(points)) == (0, 0, 4)
    assert "no point is left" in answer["sets"][0]["reason"]
    usable = sum(count > 0 for count in points)
    assert usable > 0
    assert main(["constancy", str(table), "--variances", "0.4,0.7,0.2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["offsets"] == usable


def test_a_campaign_goes_on_past_a_run_whose_files_are_no_use(folder, capsys):
    (folder / "bad.DAT").write_text("0 4880\n25 4870\n20 4869\n")
    runs = [{"day": 1, "run": 1, "tfile": "tfile.dat", "mode": 7},
            {"day": 2, "run": 2, "tfile": "tfile.dat", "mode": 7, "vehicle": "MK 30"},
            {"day": 1, "run": 3, "tfile": "none.dat", "mode": 2}]  # fmt: skip
    campaign = {
        "name": "June",
        "arrays": "arrays.csv",
        "profiles": {"1": "VELOCITY.DAT", "2": "bad.DAT"},
        "runs": runs,
    }
    path = folder / "campaign.json"
    path.write_text(json.dumps(campaign))
    table = folder / "offsets.csv"
    assert main(["timing", "--campaign", str(path), "--out", str(table), "--json"]) == 0
    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert {one["run"] for one in answer["sets"]} == {"1"}
    assert [one["run"] for one in answer["failed_runs"]] == ["2", "3"]
    assert "day 2, run 2, MK 30 (mode 7): bad.DAT, line 3: found depth 20 ft after 25 ft" in said.err
    assert "none.dat: no such file; the other runs go on" in said.err
    assert main(["gate", "--campaign", str(path), "--out", str(folder / "sets")]) == 0
    assert "day 1, run 3, mode 2 is no use: " in capsys.readouterr().out
    assert main(["timing", "--campaign", str(path), "--day", "1", "--run", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["failed_runs"] == []
    assert main(["timing", "--campaign", str(path), "--day", "7"]) == 2
    assert "no run is of day 7; there are day 1, run 1" in capsys.readouterr().err
    path.write_text(json.dumps({**campaign, "runs": runs[1:]}))
    assert main(["timing", "--campaign", str(path)]) == 2
    assert "campaign June: no run is of use" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        (
            "day,run,pair,offset_ms\n1,1,1-2,3.1\n1,1,2-3,fast\n1,2,1-2,2.9\n",
            0,
            "line 3: offset_ms holds 'fast'",
        ),
        ("day,run,pair,offset_ms\n1,1,1-2,3.1\n1,1,2-3\n1,2,1-2,2.9\n", 0, "line 3: offset_ms holds ''"),
        ("day,run,pair,offset_ms\n1,1,1-2,1e300\n1,1,1-2,3.1\n", 0, "line 2: offset_ms holds '1e300'"),
        ("day,run,pair,offset_ms\n", 2, "found no offset"),
        ("day,run,offset_s\n1,1,2\n", 2, "line 1: no column pair, offset_ms"),
    ],
)
def test_a_table_of_offsets_is_used_as_far_as_it_can_be(tmp_path, capsys, text, code, words):
    (tmp_path / "offsets.csv").write_text(text)
    assert main(["constancy", str(tmp_path / "offsets.csv"), "--variances", "0.4,0.7,0.2"]) == code
    assert words in capsys.readouterr().err


def test_offsets_that_leave_no_variance_are_refused_in_words(tmp_path, capsys):
    (tmp_path / "offsets.csv").write_text("day,run,pair,offset_ms\n1,1,1-2,3\n1,2,1-2,3.1\n")
    assert main(["constancy", str(tmp_path / "offsets.csv")]) == 2
    assert "take up every offset, and no residual variance is left" in capsys.readouterr().err
    for told in ("inf,1,1", "1,1,0", "1,1"):
        with pytest.raises(SystemExit):
            main(["constancy", str(tmp_path / "offsets.csv"), "--variances", told])
    assert main(["constancy", str(tmp_path / "offsets.csv"), "--variances", "0,0,1"]) == 0
