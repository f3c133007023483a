"""`study`: the grid of chapter IV, a table that agrees with `montecarlo`, resuming, a Dask cluster, its figures."""

from __future__ import annotations

import itertools
import json
import signal
import threading
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from trackerlib.commands import main
from trackerlib.commands.study import _show_progress, one_row
from trackerlib.simulation.figures import panels
from trackerlib.simulation.study import StudyPoint, run_study_point, study_points

SMALL = ["--scenarios", "2", "--sweeps", "experiments", "--gps-rms-m", "3", "--trials", "20", "--seed", "1"]


def study(capsys, *argv):
    code = main(["study", *map(str, argv), "--json"])
    out = capsys.readouterr()
    assert code == 0, out.err
    return json.loads(out.out)


def test_the_whole_of_chapter_iv_has_1590_points_a_method():
    points = study_points(methods=("thesis",))
    assert len(points) == len(set(points)) == 1590
    assert {(p.experiments, p.spacing) for p in points if p.scenario == 1 and p.sweep == "spacing"} == {
        (25, k) for k in range(2, 91)
    }
    with pytest.raises(ValueError, match="7"):
        study_points(scenarios=(7,))


def test_a_row_is_what_montecarlo_says(tmp_path, capsys):
    answer = study(capsys, *SMALL, "--methods", "thesis", "--out", tmp_path)
    table = pd.read_csv(tmp_path / "study.csv")
    assert len(table) == answer["points"] == 46
    point = ["--scenario", "2", "--experiments", "30", "--spacing", "45", "--gps-rms-m", "3"]
    assert main(["montecarlo", *point, "--trials", "20", "--seed", "1", "--method", "thesis", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    row = table[table.experiments == 30].iloc[0]
    for key in ("rmse", "crlb", "mean_sigma"):
        assert row[f"{key}.z"] == pytest.approx(document[key]["z"], rel=1e-12)
    assert row.coverage95 == document["coverage95"]


def test_a_killed_study_is_resumed_where_it_stopped(tmp_path, capsys):
    study(capsys, *SMALL, "--methods", "thesis", "--out", tmp_path)
    whole = (tmp_path / "study.csv").read_text()
    (tmp_path / "study.csv").write_text(whole[: len(whole) // 2])
    answer = study(capsys, *SMALL, "--methods", "thesis", "--out", tmp_path, "--resume")
    assert 15 < answer["resumed"] < 30
    again = pd.read_csv(tmp_path / "study.csv").drop(columns="seconds")
    (tmp_path / "study.csv").write_text(whole)
    pd.testing.assert_frame_equal(again, pd.read_csv(tmp_path / "study.csv").drop(columns="seconds"))


def test_progress_counts_every_point_on_a_terminal_and_those_left_after_a_resume(
    tmp_path, capsys, monkeypatch
):
    call = ["study", *SMALL, "--methods", "thesis", "--out", str(tmp_path)]
    assert main(call) == 0
    assert "points" not in capsys.readouterr().err  # no terminal
    table = tmp_path / "study.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:41]))
    rows_there: list[int] = []

    def watched(number, of):
        rows_there.append(table.read_text().count("\n") - 1)
        _show_progress(number, of)

    for extra, first, left in (["--resume"], 40, 6), ([], 0, 46):
        rows_there.clear()
        with monkeypatch.context() as patched:
            patched.setattr("sys.stderr.isatty", lambda: True, raising=False)
            patched.setattr("trackerlib.commands.study._show_progress", watched)
            assert main([*call, *extra]) == 0
        told = capsys.readouterr().err
        assert told == "".join(f"\r{k} of {left} points" for k in range(1, left + 1)) + "\n"
        assert rows_there == [
            first + k for k in range(1, left + 1)
        ]  # a point told is a row that a kill leaves


def test_other_trials_are_not_mixed_into_a_table(tmp_path, capsys):
    study(capsys, *SMALL, "--methods", "thesis", "--out", tmp_path)
    other = [*SMALL[:-1], "2", "--methods", "thesis", "--out", str(tmp_path), "--resume"]
    assert main(["study", *other]) == 2
    assert "study.csv, line 2" in capsys.readouterr().err


def test_a_page_has_the_thesis_figures_of_a_sweep_with_the_bound_in_each(tmp_path, capsys):
    for scenario, numbers in (("2", range(19, 27)), ("5", range(83, 99))):
        answer = study(capsys, *SMALL, "--scenarios", scenario, "--methods", "thesis", "--out", tmp_path)
        page = ElementTree.parse(answer["figures"][0]).getroot()
        text = ElementTree.tostring(page, encoding="unicode")
        assert all(f"4-{number}  " in text for number in numbers)
        assert f"4-{numbers[-1] + 1}  " not in text
        assert "SIMULATED" in text
    for moving in (False, True):
        assert all(any(label == "bound" for _, label in columns) for _, columns, _ in panels(moving))
    table = pd.read_csv(tmp_path / "study.csv")
    last = run_study_point(StudyPoint(5, "experiments", 50, 60, 3.0, "thesis"), 20, 1)
    wanted = np.sqrt(np.diag(carried(last) @ last.bound_covariance @ carried(last).T))
    assert table[[f"crlb_now.{axis}" for axis in "xyz"]].iloc[-1].to_numpy() == pytest.approx(wanted)
    assert table.crlb_3d_m.iloc[-1] == pytest.approx(np.linalg.norm(last.bound[:3]))


def carried(trials):
    """What makes the present position of start and velocity (3-19)."""
    return np.hstack([np.eye(3), trials.receptions.received_s[-1] * np.eye(3)])


def test_two_speeds_of_the_ship_stay_apart_in_table_pages_and_resuming(tmp_path, capsys):
    call = [*SMALL, "--methods", "thesis", "--out", tmp_path]
    fast = study(capsys, *call)
    both = study(capsys, *call, "--speed-mps", "5,1", "--resume")
    assert (fast["points"], both["points"], both["resumed"]) == (46, 92, 46)
    table = pd.read_csv(tmp_path / "study.csv")
    error = table.groupby("speed_mps")["rmse_3d_m"].median()
    assert error[1.0] > 1.5 * error[5.0]
    pages = [Path(page) for page in both["figures"][:2]]
    assert {page.name for page in pages} == {
        "scenario2_experiments_1mps.svg",
        "scenario2_experiments_5mps.svg",
    }
    assert all(f"ship at {page.stem[-4]} m/s" in page.read_text() for page in pages)


@pytest.fixture
def interruptible():
    """Ctrl-C interrupts, though a shell that starts the tests in the background has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_keeps_the_whole_rows_and_says_how_to_go_on(tmp_path, capsys, monkeypatch):
    calls = itertools.count(1)

    def interrupted(*point):
        if next(calls) == 10:  # two threads call: each has a number of its own
            while (tmp_path / "study.csv").read_text().count("\n") < 4:  # another thread writes the rows
                time.sleep(0.01)
            signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)  # as Ctrl-C does it
            time.sleep(0.2)  # or a warm study is over before the main thread looks
        return one_row(*point)

    monkeypatch.setattr("trackerlib.commands.study.one_row", interrupted)
    call = ["study", *SMALL, "--methods", "thesis", "--out", str(tmp_path)]
    assert main(call) == 130
    assert "--resume" in capsys.readouterr().err
    kept = pd.read_csv(tmp_path / "study.csv")
    assert 3 <= len(kept) < 46
    assert kept.seconds.notna().all()
    monkeypatch.undo()
    answer = study(capsys, *call[1:], "--resume")
    assert (answer["resumed"], answer["points"]) == (len(kept), 46)


def test_a_dask_cluster_gives_the_same_table(tmp_path, capsys):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, host="127.0.0.1",
        protocol="tcp",
    ) as cluster:  # fmt: skip
        study(
            capsys, *SMALL, "--methods", "thesis", "--out", tmp_path / "far", "--scheduler",
            cluster.scheduler_address,
        )  # fmt: skip
        point = ["--scenario", "2", "--experiments", "30", "--spacing", "45", "--gps-rms-m", "3"]
        call = ["montecarlo", *point, "--trials", "20", "--seed", "1", "--method", "thesis", "--json"]
        assert main([*call, "--scheduler", cluster.scheduler_address]) == 0
        alone = json.loads(capsys.readouterr().out)
    study(capsys, *SMALL, "--methods", "thesis", "--out", tmp_path / "near")
    far, near = (
        pd.read_csv(tmp_path / where / "study.csv").sort_values("experiments", ignore_index=True)
        for where in ("far", "near")
    )
    pd.testing.assert_frame_equal(far.drop(columns="seconds"), near.drop(columns="seconds"))
    assert alone["rmse"]["z"] == pytest.approx(near[near.experiments == 30].iloc[0]["rmse.z"], rel=1e-12)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (["--scenarios", "9"], "9"),
        (["--trials", "0"], "trials"),
        (["--speed-mps", "5,0"], "speed"),
        (["--scheduler", "tcp://127.0.0.1:9"], "Dask"),
    ],
)
def test_wrong_calls_are_refused(tmp_path, capsys, wrong, said):
    assert main(["study", *SMALL, *wrong, "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
