"""The montecarlo command: keys, words and refusals."""

from __future__ import annotations

import json
import re

import pytest

from trackerlib.commands import main
from trackerlib.simulation.study import coverage_words

CALL = ["montecarlo", "--scenario", "5", "--experiments", "25", "--spacing", "45", "--gps-rms-m", "3"]
CALL += ["--trials", "20", "--seed", "1"]


def test_the_document_has_every_component_and_says_it_is_simulated(capsys):
    assert main([*CALL, "--json", "--workers", "1"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["simulated"] is True
    assert answer["converged"] == answer["trials"] == 20
    for key in ("rmse", "bias", "mean_sigma", "crlb"):
        assert list(answer[key]) == ["x", "y", "z", "vx", "vy", "vz"]
    assert list(answer["rmse_now"]) == ["x", "y", "z"]
    assert answer["rmse_3d_m"] > answer["rmse_2d_m"] > 0


def test_the_report_is_in_words(capsys):
    assert main(CALL) == 0
    words = capsys.readouterr().out
    assert words.startswith("SIMULATED")
    assert "times the Cramer-Rao bound" in words
    value = r"-?[\d.]+ ± [\d.]+ m/s"
    assert re.search(rf"vz error {value}, .*; stated [\d.]+ m/s; bias {value}\n", words)
    assert "± " in words.splitlines()[-1]


def test_trials_of_which_none_converges_are_a_result(capsys):
    few = [*CALL]
    few[few.index("25")], few[few.index("45")] = "1", "3"
    assert main([*few, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["converged"] == 0
    assert answer["rmse"]["x"] is None
    assert answer["refused_why"] == [{"why": "fewer pings than the unknowns need", "count": 20}]
    assert main(few) == 0
    assert "20 refused: fewer pings" in capsys.readouterr().out


def test_noise_that_rules_the_geometry_is_refused_with_its_reason(capsys):
    slow = [*CALL, "--speed-mps", "1"]
    slow[slow.index("3")] = "25"
    assert main([*slow, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [one["count"] for one in answer["refused_why"]] == [20]
    assert "15 % of its depth" in answer["refused_why"][0]["why"]


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--trials", "0"),
        ("--experiments", "0"),
        ("--gps-rms-m", "0"),
        ("--workers", "0"),
        ("--speed-mps", "-1"),
    ],
)
def test_a_call_that_makes_no_sense_ends_with_2_and_words(option, value, capsys):
    assert main([*CALL, option, value]) == 2
    assert "wanted" in capsys.readouterr().err


def test_a_share_of_few_trials_states_what_it_does_not_know():
    assert coverage_words(1.0, 5) == "the truth lies inside 100 ± 14 % of the stated 95 % ellipsoids"
    assert coverage_words(0.95, 2000).startswith("the truth lies inside 95.00 ± 0.49 %")
