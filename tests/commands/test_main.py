"""The shell's way in: exit codes, one JSON document, errors in words."""

import io
import json
import runpy
import sys

import numpy as np
import pytest

from trackerlib.commands import COMMANDS, main, plain, to_json


def test_json_knows_no_nan_and_no_numpy():
    document = {"a": np.nan, "b": [np.inf, np.int64(3)], "c": np.array([1.5, -np.inf]), 4: (True, None, "é")}
    text = to_json(document)
    assert json.loads(text) == {"a": None, "b": [None, 3], "c": [1.5, None], "4": [True, None, "é"]}
    assert plain(np.bool_(True)) is True


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name, capsys):
    with pytest.raises(SystemExit) as stopped:
        main([name, "--help"])
    assert stopped.value.code == 0
    assert "--json" in capsys.readouterr().out


def test_without_a_command_all_are_listed(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--help"])
    assert stopped.value.code == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in COMMANDS)


@pytest.mark.parametrize(
    "argv", [[], ["swim"], ["gate"], ["gate", "t", "--arrays", "a", "--mode", "x", "--out", "o"]]
)
def test_a_wrong_call_is_exit_2(argv, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(argv)
    assert stopped.value.code == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    assert sentence.endswith("; --help tells the options")


def test_an_interrupt_while_a_command_loads_is_exit_130_in_words(monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("trackerlib.commands.import_module", interrupted)
    monkeypatch.setattr("sys.argv", ["trackerlib", "gate"])
    with pytest.raises(SystemExit) as stopped:
        runpy.run_module("trackerlib", run_name="__main__")
    assert stopped.value.code == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_a_terminal_that_knows_ascii_alone_gets_the_rest(monkeypatch, data):
    said = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(said, "ascii"))
    table = data / "read-1990/offsets.csv"
    monkeypatch.setattr("sys.argv", ["trackerlib", "constancy", str(table), "--variances", "0.4,0.7,0.2"])
    with pytest.raises(SystemExit) as stopped:
        runpy.run_module("trackerlib", run_name="__main__")
    assert stopped.value.code == 0
    sys.stdout.flush()
    assert b"all pairs share one offset" in said.getvalue()
    assert b"?" in said.getvalue().split(b"all pairs")[0]


def test_a_file_that_cannot_be_written_is_named(data, tmp_path, capsys):
    survey, away = str(data / "beacon-demo/survey.csv"), tmp_path / "nowhere"
    for option, name in (("--map", "map.csv"), ("--route", "leg.gpx")):
        assert main(["plan", survey, "--budget-s", "60", option, str(away / name)]) == 2
        assert f"{away / name}: No such file" in capsys.readouterr().err
