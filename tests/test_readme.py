"""What README tells a newcomer to type is what the program takes."""

from __future__ import annotations

import re
import shlex
from importlib import import_module

import pytest

from trackerlib.commands import COMMANDS, parser_of

PROGRAM = ".venv/bin/python -m trackerlib "


@pytest.fixture
def blocks(root):
    """The indented blocks of README, each without its indent."""
    found, block = [], []
    for line in [*(root / "README.md").read_text(encoding="utf-8").splitlines(), ""]:
        if line.startswith("    "):
            block.append(line[4:])
        elif block:
            found.append("\n".join(block))
            block = []
    return found


def test_every_command_is_shown_with_options_that_it_has(blocks):
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    calls = [shlex.split(line, comments=True)[3:] for line in lines if line.startswith(PROGRAM)]
    for call in calls:
        parser_of(call).parse_args(call)  # SystemExit where an option is wrong
    assert {call[0] for call in calls} == set(COMMANDS)


def test_the_python_of_a_fix_runs_as_it_stands(blocks, root, monkeypatch, capsys):
    monkeypatch.chdir(root)
    (block,) = (block for block in blocks if "fix_beacon(" in block)
    exec(compile(block, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("SIMULATED: 41.25")


def test_the_python_of_a_recording_runs_as_it_stands(blocks, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (block,) = (block for block in blocks if "write_hunt(" in block)
    exec(compile(block.replace("hunt.seconds", "4.0"), "README.md", "exec"), {})
    assert {path.name for path in tmp_path.iterdir()} == {"hunt.wav", "hunt.nmea"}


@pytest.mark.parametrize("room", ["beacon", "receiver"])
def test_the_map_of_a_large_room_names_every_file_once(room, root):
    lines = import_module(f"trackerlib.{room}").__doc__.split("Where to look:")[1].strip().splitlines()
    columns = "\n".join(line.strip().split("  ", 1)[1] for line in lines)
    named = re.findall(r"[a-z_]+", re.sub(r"\(.*?\)", "", columns))
    files = {path.stem for path in (root / "trackerlib" / room).glob("*.py")} - {"__init__"}
    assert sorted(named) == sorted(files)
