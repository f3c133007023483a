"""`emulate-receiver` as a process: it says where it is, answers, and stops when asked."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys

import pytest

from trackerlib.commands import main
from trackerlib.live.ports import open_port
from trackerlib.live.sail_host import SailHost


@pytest.fixture
def emulate(root):
    """Starts the command; its process and first line."""
    processes = []

    def start(*options):
        argv = [sys.executable, "-u", "-m", "trackerlib", "emulate-receiver", *options]
        process = subprocess.Popen(
            argv, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
        )
        processes.append(process)
        return process, process.stdout.readline()

    yield start
    for process in processes:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    ("options", "stop"), [(("--tcp", "127.0.0.1:0"), signal.SIGINT), (("--pty",), signal.SIGTERM)]
)
def test_it_answers_and_stops_cleanly(emulate, options, stop):
    process, first = emulate(*options, "--scenario", "3", "--rate", "20", "--seed", "1")
    assert "SIMULATED" in first
    host = SailHost(open_port(re.match(r"(\S+): ", first)[1]), quiet_s=5)
    host.port.open()
    assert host.resynchronise() == 9600
    assert abs(host.position().position.lat_deg - 39.5) < 0.1
    host.port.close()
    process.send_signal(stop)
    out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (0, "", "")


def test_with_json_the_address_is_the_one_document(emulate):
    _, first = emulate("--json")
    document = json.loads(first)
    assert document["address"].startswith("tcp:127.0.0.1:")
    assert document["simulated"] is True


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--rate", "0"), "--rate"),
        (("--faults", "deaf,thunder"), "thunder"),
        (("--tcp", "ship"), "HOST:PORT"),
        (("--gps-rms-m", "nan"), "--gps-rms-m"),
    ],
)
def test_a_wrong_call_is_exit_2_in_words(options, why, capsys):
    assert main(["emulate-receiver", *options]) == 2
    assert why in capsys.readouterr().err


def test_a_port_in_use_is_exit_2(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)]
        assert main(["emulate-receiver", "--tcp", f"127.0.0.1:{port}"]) == 2
        assert handlers == [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)]
    assert "in use" in capsys.readouterr().err
