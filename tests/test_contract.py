"""The commands answer in the form others rely on, as a script beside the repository checks it."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    "command", ["fix", "montecarlo", "study", "gate", "timing", "listen", "emulate-receiver"]
)
def test_the_contract_has_nothing_to_complain_of(command, root, shared):
    script = shared / "contract/check.py"
    ran = subprocess.run(
        [sys.executable, script, command], cwd=root, capture_output=True, text=True, timeout=300
    )
    short = [line for line in ran.stdout.splitlines() if not line.startswith("ok ")]
    assert ran.returncode == 0, "\n".join([*short, ran.stderr])
    assert not short
