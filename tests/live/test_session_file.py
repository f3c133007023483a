"""A session file survives a kill, a full disk and another program, and reads back what was added."""

from __future__ import annotations

import math
import os
import signal
import sqlite3
import subprocess
import sys
import time

import pytest
from waiting import until

from trackerlib.live.hunt import hunt_of
from trackerlib.live.navigation_stream import Fix
from trackerlib.live.session_file import SessionFile, raw_of, read_session
from trackerlib.receiver.periods import Period
from trackerlib.receiver.sail import Maximum
from trackerlib.textfiles import InputError

ADDING = """
import sys, time
from pathlib import Path
from trackerlib.live.navigation_stream import Fix
from trackerlib.live.session_file import SessionFile
from trackerlib.receiver.periods import Period
from trackerlib.receiver.sail import Maximum
file = SessionFile(Path(sys.argv[1]))
file.add_settings({"sample_interval_s": 1e-3})
for k in range(100_000):
    now = time.time()
    file.add_raw("sail", now, b"-%d" % k)
    file.add_period(1, Period(k, now, (Maximum(2000, k % 2000),), 0.0, 2000))
    file.add_fix(now, Fix(float(k), 40.0, -67.0, 1.0))
    if k % 10 == 0:
        print(k, flush=True)
    time.sleep(0.005)
"""


def period(k, heard_s=0.0):
    return Period(k, heard_s, (Maximum(2000, 100 + k), Maximum(500, 900)), 3.0 if k % 2 else math.nan, 2000)


def test_what_was_added_is_read_back(tmp_path):
    path = tmp_path / "hunt.session"
    fixes = [Fix(1000.0 + k, 40.0, -67.0, math.nan if k else 1.5, math.nan) for k in range(3)]
    with SessionFile(path) as file:
        file.add_settings({"sample_interval_s": 2e-3})
        file.add_settings({"turnaround_s": 0.02})
        file.add_settings({"sample_interval_s": 1e-3})
        for k in range(3):
            file.add_raw("sail", 10.0 + k, b"\x00\xff" * k)
            file.add_period(1, period(k, 1002.0 + 2 * k))
            file.add_fix(1000.5 + k, fixes[k])
        file.add_event(1.0, "the cable was pulled")
    session = read_session(path)
    assert session.settings == {"sample_interval_s": 1e-3, "turnaround_s": 0.02}
    assert repr(session.runs[1]) == repr(tuple(period(k, 1002.0 + 2 * k) for k in range(3)))
    assert repr([fix for _, fix in session.fixes]) == repr(fixes)
    assert session.events == ((1.0, "the cable was pulled"),)
    assert [data for _, _, data in raw_of(path, "sail")] == [b"", b"\x00\xff", b"\x00\xff" * 2]
    assert session.raw_bytes == 6
    arrivals, navigation = hunt_of(session)
    assert arrivals.arrival_s[arrivals.rank == 1].tolist() == pytest.approx([0.09, 2.091, 4.092])
    # Sampling began at 1000 by the host's clock, which hears the GPS half a second late.
    assert navigation.time_s.tolist() == pytest.approx([0.5, 1.5, 2.5])


def test_a_file_is_carried_on_with_runs_of_its_own(tmp_path):
    path = tmp_path / "hunt.session"
    with SessionFile(path) as file:
        assert file.runs == 0
        file.add_period(1, period(0))
    with SessionFile(path) as file:
        assert file.runs == 1
        for k in range(5):
            file.add_period(2, period(k))
    session = read_session(path)
    assert {run: len(periods) for run, periods in session.runs.items()} == {1: 1, 2: 5}
    assert len(hunt_of(session)[0]) == 10  # the longest run, two maxima a period
    assert len(hunt_of(session, 1)[0]) == 2
    with pytest.raises(ValueError, match="wanted run 3"):
        hunt_of(session, 3)


@pytest.mark.parametrize("rows", [150, 330])
def test_a_kill_at_any_instant_loses_at_most_the_last_second(tmp_path, root, rows):
    path = tmp_path / "hunt.session"
    process = subprocess.Popen(
        [sys.executable, "-c", ADDING, str(path)], cwd=root, stdout=subprocess.PIPE, text=True
    )
    try:
        for line in process.stdout:
            if int(line) >= rows:
                break
        killed_s = time.time()
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.communicate()
    session = read_session(path)
    (periods,) = session.runs.values()
    assert [one.number for one in periods] == list(range(len(periods)))
    assert killed_s - periods[-1].heard_s < 1.0
    assert len(session.fixes) == len(periods) == len(raw_of(path))
    again = read_session(path)
    assert hunt_of(again)[0].arrival_s.tolist() == hunt_of(session)[0].arrival_s.tolist()
    assert hunt_of(again)[1].time_s.tolist() == hunt_of(session)[1].time_s.tolist()
    with SessionFile(path) as file:  # and it can be carried on
        file.add_period(file.runs + 1, period(0))
    assert len(read_session(path).runs) == 2


def test_a_reader_sees_a_file_that_is_still_written(tmp_path):
    with SessionFile(tmp_path / "s", commit_s=0.02) as file:
        for k in range(3):
            file.add_period(1, period(k))
            assert until(lambda n=k: len(read_session(tmp_path / "s").runs.get(1, ())) == n + 1)


def test_a_disk_that_fills_is_said_and_nothing_is_lost_once_there_is_room(tmp_path, monkeypatch):
    monkeypatch.setattr("trackerlib.live.session_file.RETRY_S", 0.05)
    path = tmp_path / "s"
    with SessionFile(path, commit_s=0.02) as file:
        pages = file._database.execute("PRAGMA page_count").fetchone()[0]
        file._database.execute(f"PRAGMA max_page_count = {pages + 2}")
        for k in range(50):
            file.add_raw("sail", float(k), bytes([k]) * 1000)
        assert until(lambda: file.trouble is not None)
        assert "the disk is full" in file.trouble
        file._database.execute("PRAGMA max_page_count = 1000000")
        assert until(lambda: file.trouble is None)
    assert [data[0] for _, _, data in raw_of(path)] == list(range(50))
    assert file.lost_rows == 0


def test_what_waits_while_nothing_can_be_written_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr("trackerlib.live.session_file.BACKLOG", 10)
    with SessionFile(tmp_path / "s", commit_s=5.0) as file:
        for k in range(25):
            file.add_event(float(k), "x")
        assert file.lost_rows == 15
    assert [when for when, _ in read_session(tmp_path / "s").events] == list(map(float, range(15, 25)))


def test_what_is_no_session_is_refused_in_words(tmp_path):
    (tmp_path / "text").write_text("not a database, but long enough to be looked at as one " * 20)
    other = sqlite3.connect(tmp_path / "other")
    other.execute("CREATE TABLE a (b)")
    other.close()
    with SessionFile(tmp_path / "later"):
        pass
    later = sqlite3.connect(tmp_path / "later")
    later.execute("PRAGMA user_version = 99")
    later.close()
    for name, why in (
        ("text", "another kind of file"),
        ("other", "another program"),
        ("later", "version 99"),
        ("missing", "no such file"),
        (".", "a folder"),
    ):
        with pytest.raises(InputError, match=why):
            read_session(tmp_path / name)
        if name != "missing":
            with pytest.raises(InputError, match=why):
                SessionFile(tmp_path / name)
    with pytest.raises(InputError, match="does the folder exist"):
        SessionFile(tmp_path / "no" / "folder")
