"""`timing`: points left out by hand, a campaign's runs each for itself, tables that `constancy` reads."""

import csv
import json
import shutil

import numpy as np
import pytest

from trackerlib.commands import main
from trackerlib.commands.timing import one_offset
from trackerlib.crossover.edits import PointEdits, edits_csv
from trackerlib.crossover.gating import gate_reports
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.crossover_file import read_crossover
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.timing.correction import fit_timing


@pytest.fixture(scope="module")
def folder(data, tmp_path_factory):
    """The demo's first 3000 records, its tables, and the sets of its torpedo."""
    here = tmp_path_factory.mktemp("range")
    for name in ("arrays.csv", "VELOCITY.DAT"):
        shutil.copy(data / "range-demo" / name, here)
    lines = (data / "range-demo/tfile.dat").read_text().splitlines(keepends=True)
    (here / "tfile.dat").write_text("".join(lines[:3031]))
    gate = ["gate", here / "tfile.dat", "--arrays", here / "arrays.csv", "--mode", 7, "--out", here / "sets"]
    assert main([str(word) for word in gate]) == 0
    runs = [
        {"day": "6/20/85", "run": 1, "tfile": "tfile.dat", "mode": mode, "vehicle": vehicle}
        for mode, vehicle in ((7, "MK 30"), (2, "ship"))
    ]
    campaign = {"arrays": "arrays.csv", "profiles": {"6/20/85": "VELOCITY.DAT"}, "runs": runs}
    (here / "campaign.json").write_text(json.dumps(campaign))
    return here


@pytest.fixture
def run(folder, capsys):
    """Runs a command; returns exit code, answer and standard error."""

    def call(*words):
        code = main([str(word) for word in (*words, "--json")])
        said = capsys.readouterr()
        return code, json.loads(said.out) if code == 0 else None, said.err

    return call


@pytest.fixture
def timing(folder, run):
    """Runs timing on crossover files."""
    return lambda *words: run(
        "timing", "--arrays", folder / "arrays.csv", "--profile", folder / "VELOCITY.DAT", *words
    )


def log_of(folder, tmp_path, rows, mode=7):
    """An edit log that leaves some points of the first set out, and that set's file."""
    path = min((folder / "sets").iterdir())
    crossover = read_crossover(path).set
    log = tmp_path / "edits.csv"
    edits = PointEdits().exclude(crossover, [9], mode, "by mistake").restore(crossover, [9], mode)
    edits = edits.exclude(crossover, rows, mode, "turning")
    log.write_text(edits_csv(edits).replace(path.name, "tfile.dat"))
    return log, path, crossover


def test_points_left_out_in_the_tab_are_left_out_here(folder, timing, tmp_path):
    log, path, crossover = log_of(folder, tmp_path, range(8))
    code, answer, _ = timing(path, "--edits", log)
    (one,) = answer["sets"]
    out = np.arange(crossover.points) < 8
    survey, profile = (
        read_arrays(folder / "arrays.csv").survey,
        read_velocity(folder / "VELOCITY.DAT").profile,
    )
    fit = fit_timing(crossover, survey, profile, left_out=out)
    assert code == 0
    assert one["left_out_counts"] == crossover.point_count[:8].tolist()
    assert one["offset_ms"] == 1e3 * fit.offset_s
    assert one["sigma_offset_ms"] == 1e3 * fit.sigma_offset_s
    assert one["offset_ms"] != timing(path)[1]["sets"][0]["offset_ms"]
    assert timing(path, "--edits", log, "--mode", 2)[1]["sets"][0]["left_out_counts"] == []


def test_a_log_that_does_not_fit_the_sets_is_told(folder, timing, tmp_path):
    log, path, _ = log_of(folder, tmp_path, range(8))
    other = sorted((folder / "sets").iterdir())[1]
    assert "8 of 8 points left out are in none of these sets" in timing(other, "--edits", log)[2]
    log.write_text(log.read_text() + log.read_text().split("\n", 1)[1].replace(",exclude,7,", ",exclude,2,"))
    code, _, said = timing(path, "--edits", log)
    assert (code, "found points of modes 2, 7; choose the vehicle" in said) == (2, True)
    assert timing(path, "--edits", log, "--mode", 7)[0] == 0
    log.write_text("a,b\n1,2\n")
    assert "edits.csv, line 1: no column utc" in timing(path, "--edits", log)[2]


def test_all_points_left_out_is_no_offset_and_the_other_sets_go_on(folder, timing, tmp_path, capsys):
    log, path, crossover = log_of(folder, tmp_path, range(44))
    assert crossover.points == 44
    sets = sorted((folder / "sets").iterdir())[:2]
    _, answer, _ = timing(*sets, "--edits", log)
    assert answer["sets"][0]["points"] == 0 < answer["sets"][1]["points"]
    assert answer["sets"][0]["reason"].startswith("no point is left: each is excluded")
    log, path, _ = log_of(folder, tmp_path, range(8))
    words = ("timing", "--arrays", folder / "arrays.csv", "--profile", folder / "VELOCITY.DAT", path)
    main([str(word) for word in (*words, "--edits", log)])
    assert "8 left out by hand" in capsys.readouterr().out


def test_the_counts_of_offset_and_of_noise_are_both_shown(folder, timing, capsys):
    path = min((folder / "sets").iterdir())
    _, answer, _ = timing(path, "--outliers", "noise")
    (one,) = answer["sets"]
    assert one["noise_points"] < one["points"] == 44
    words = ("timing", "--arrays", folder / "arrays.csv", "--profile", folder / "VELOCITY.DAT", path)
    main([str(word) for word in (*words, "--outliers", "noise")])
    assert f"M from {one['noise_points']} points" in capsys.readouterr().out
    main([str(word) for word in words])
    assert "M from" not in capsys.readouterr().out


def test_a_log_goes_with_the_t_file_of_its_run(folder, run, tmp_path):
    log, _, _ = log_of(folder, tmp_path, range(8))
    campaign = ("timing", "--campaign", folder / "campaign.json", "--edits", log)
    _, answer, said = run(*campaign)
    assert [len(one["left_out_counts"]) for one in answer["sets"] if one["left_out_counts"]] == [8]
    assert "in none of these sets" not in said
    log.write_text(log.read_text().replace("tfile.dat", "other.dat"))
    assert "8 of 8 points left out are in none" in run(*campaign)[2]


def test_the_runs_of_a_campaign_are_judged_each_for_itself(folder, run, capsys):
    code, answer, _ = run("timing", "--campaign", folder / "campaign.json", "--causes")
    assert code == 0
    survey, profile = (
        read_arrays(folder / "arrays.csv").survey,
        read_velocity(folder / "VELOCITY.DAT").profile,
    )
    reports = read_tfile(folder / "tfile.dat").reports
    assert [(one["mode"], one["vehicle"]) for one in answer["runs"]] == [(7, "MK 30"), (2, "ship")]
    for one in answer["runs"]:
        sets = gate_reports(reports, survey, one["mode"]).sets
        assert one["one_offset"] == one_offset(sets, [fit_timing(each, survey, profile) for each in sets])
    assert all(one["causes"] for one in answer["runs"])
    assert main(["timing", "--campaign", str(folder / "campaign.json")]) == 0
    said = capsys.readouterr().out
    assert said.index("day 6/20/85, run 1, mode 7") < said.index("day 6/20/85, run 1, mode 2")
    assert said.count("one offset for all sets") == 2
    _, answer, _ = run("timing", "--campaign", folder / "campaign.json", "--mode", 2)
    assert {one["mode"] for one in answer["sets"]} == {2}


def test_two_vehicles_of_one_run_are_two_runs_to_constancy_and_stay_simulated(folder, run, tmp_path):
    table = tmp_path / "offsets.csv"
    run("timing", "--campaign", folder / "campaign.json", "--out", table)
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["run"], row["mode"]) for row in rows} == {("1 mode 7", "7"), ("1 mode 2", "2")}
    _, answer, _ = run("constancy", table)
    assert {one["run"] for one in answer["runs"]} == {"1 mode 7", "1 mode 2"}
    assert answer["simulated"] is True


def test_tables_of_several_runs_are_taken_together(folder, run, timing, tmp_path):
    tables = [tmp_path / f"run{n}.csv" for n in (1, 2)]
    for n, table in enumerate(tables):
        timing(*(folder / "sets").iterdir(), "--day", 1, "--run", n, "--out", table)
    code, answer, _ = run("constancy", *tables, "--variances", "0.4,0.7,0.2")
    assert (code, [one["run"] for one in answer["runs"]]) == (0, ["0", "1"])
    assert answer["simulated"] is True
    assert "named twice" in run("constancy", tables[0], tables[0])[2]


def test_a_set_named_twice_counts_once(folder, timing):
    path = min((folder / "sets").iterdir())
    code, answer, said = timing(path, path)
    assert (code, len(answer["sets"]), "is named twice" in said) == (0, 1, True)


def test_arrays_told_the_other_way_round_are_the_same_pair(folder, timing, tmp_path):
    path = min((folder / "sets").iterdir())
    rows = [line.split() for line in path.read_text().splitlines()[1:]]
    turned = [" ".join((row[0], *row[4:7], *row[1:4])) for row in rows]
    (tmp_path / "turned.txt").write_text("\n".join(turned) + "\n")
    (one,) = timing("--set", tmp_path / "turned.txt", 2, 1)[1]["sets"]
    (other,) = timing(path)[1]["sets"]
    assert one["pair"] == other["pair"] == [1, 2]
    for key in ("offset_ms", "sigma_offset_ms", "mean_before_ft", "mean_after_ft"):
        assert one[key] == pytest.approx(other[key], rel=1e-9), key


def test_no_file_that_is_read_is_written_over(folder, run, timing, tmp_path):
    path = shutil.copy(min((folder / "sets").iterdir()), tmp_path / "set.txt")
    before = path.read_bytes()
    for words in (("--out", path), ("--out", folder / "arrays.csv")):
        code, _, said = timing(path, "--day", 1, "--run", 1, *words)
        assert (code, "itself; wanted another file" in said) == (2, True)
    assert path.read_bytes() == before
    for name in ("tfile.dat", "VELOCITY.DAT", "campaign.json"):
        code, _, said = run("timing", "--campaign", folder / "campaign.json", "--out", folder / name)
        assert (code, "itself; wanted another file" in said) == (2, True)


@pytest.mark.parametrize(
    "text", ["nan 0 0\n0 1 0\n0 0 1\n", "inf 0 0\n0 1 0\n0 0 1\n", "0 0 0\n0 0 0\n0 0 0\n"]
)
def test_a_covariance_that_is_none_is_refused(folder, timing, tmp_path, text):
    (tmp_path / "M").write_text(text)
    code, _, said = timing(min((folder / "sets").iterdir()), "--covariance", tmp_path / "M")
    assert code == 2
    assert "M" in said
    assert "wanted" in said
