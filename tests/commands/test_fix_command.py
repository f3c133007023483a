"""The command `fix`: documents, exit codes, words."""

from __future__ import annotations

import json

import pytest

from trackerlib.commands import main

HEADER = "ping,lat_deg,lon_deg,oneway_s\n"


@pytest.fixture
def answer(capsys):
    """Runs `fix ... --json` and gives its document."""

    def run(*args):
        assert main(["fix", *map(str, args), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


def test_the_demo_survey_is_fixed_within_its_stated_errors(answer, data):
    demo = data / "beacon-demo"
    truth = json.loads((demo / "truth.json").read_text())
    document = answer(demo / "survey.csv", "--profile", demo / "soundspeed.csv", "--gps-rms-m", 2)
    assert document["converged"]
    assert document["simulated"]
    assert abs(document["depth_m"] - truth["depth_m"]) < 3 * document["sigma_depth_m"]
    metres_per_degree = 111_200
    assert abs(document["lat_deg"] - truth["lat_deg"]) * metres_per_degree < 3 * document["sigma_north_m"]
    assert len(document["rejected"]) == truth["false_returns"]
    assert document["emission_offset_s"] == pytest.approx(truth["emission_offset_s"], abs=0.02)


def test_a_refused_fix_is_a_result(answer, tmp_path):
    path = tmp_path / "few.csv"
    path.write_text(HEADER + "1,10,20,2.5\n2,10.001,20,2.6\n")
    document = answer(path)
    assert document["converged"] is False
    assert "2 usable pings" in document["reason"]
    assert document["lat_deg"] is None
    assert document["sigma_depth_m"] is None


def test_the_report_for_a_person(capsys, data):
    demo = data / "beacon-demo"
    assert main(["fix", str(demo / "survey.csv"), "--profile", str(demo / "soundspeed.csv")]) == 0
    out = capsys.readouterr().out
    assert out.startswith("SIMULATED DATA\nposition  41.25")
    assert "depth     2479 ± 25 m\nsigma     2.4 m east, 8.5 m north, 25 m depth\n" in out
    assert "sound     1484.19 ± 0.50 m/s" in out
    assert "991 of 1000 used, rms residual 0.7 ms; left out: 120, " in out


def test_a_large_sigma_is_no_power_of_ten(capsys, data):
    demo = data / "beacon-demo"
    assert main(["fix", str(demo / "survey.csv"), "--max-depth-m", "1000"]) == 0
    out = capsys.readouterr().out
    assert "No fix: the best fit lies on the edge" in out
    assert "e+" not in out


def test_options_reach_the_fix(answer, data):
    demo = data / "beacon-demo"
    plain = answer(demo / "survey.csv", "--sound-speed-mps", 1482)
    wide = answer(demo / "survey.csv", "--sound-speed-mps", 1482, "--sound-speed-sigma-mps", 10)
    assert wide["sigma_depth_m"] > plain["sigma_depth_m"]
    edge = answer(demo / "survey.csv", "--sound-speed-mps", 1482, "--max-depth-m", 900)
    assert not edge["converged"]
    assert "greatest depth (900 m)" in edge["reason"]
    kept = answer(demo / "survey.csv", "--sound-speed-mps", 1482, "--reject", "none")
    assert kept["rejected"] == []


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["none.csv"], "no such file"),
        (["PINGS", "--profile", "none.csv"], "none.csv: no such file"),
        (["PINGS", "--sound-speed-mps", "0"], "sound_speed_mps is 0; wanted 1300 to 1700"),
        (["PINGS", "--sound-speed-mps", "343"], "sound_speed_mps is 343"),
        (["PINGS", "--transponder", "M1"], "wanted M1"),
        (["PINGS", "--format", "sio"], "found no usable ping"),
    ],
)
def test_an_input_that_is_no_use_ends_with_2_and_words(args, words, tmp_path, capsys):
    path = tmp_path / "pings.csv"
    path.write_text(HEADER + "1,10,20,2.5\n")
    assert main(["fix", *(str(path) if arg == "PINGS" else arg for arg in args)]) == 2
    captured = capsys.readouterr()
    assert words in captured.err
    assert captured.out == ""


@pytest.mark.parametrize("args", [["--start", "1,2"], ["--reject", "maybe"], ["--sound-speed-mps", "fast"]])
def test_a_wrong_call_ends_with_2(args, tmp_path):
    with pytest.raises(SystemExit) as stopped:
        main(["fix", "x.csv", *args])
    assert stopped.value.code == 2


def test_bad_lines_are_told_and_the_rest_used(capsys, tmp_path, data):
    text = (data / "beacon-demo/survey.csv").read_text().splitlines()
    text[10] = "8,not a line"
    path = tmp_path / "survey.csv"
    path.write_text("\r\n".join(text))
    assert main(["fix", str(path), "--json"]) == 0
    captured = capsys.readouterr()
    assert "survey.csv, line 11: found 2 columns; wanted 6" in captured.err
    assert json.loads(captured.out)["pings"] == len(text) - 4


def test_too_few_experiments_are_named(answer, data):
    document = answer(data / "beacon-demo/survey.csv", "--method", "pairs", "--experiments", 1)
    assert document["reason"] == "experiments is 1; a fix needs 5 or more"
    document = answer(data / "beacon-demo/survey.csv", "--method", "pairs", "--experiments", 40)
    assert "make 28 experiments 35 receptions wide, 35 apart; wanted 40" in document["reason"]
