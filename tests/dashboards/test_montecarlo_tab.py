"""The Monte Carlo tab without a browser: its controls run the study that the command runs."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.montecarlo import OWN, MonteCarloTab
from trackerlib.commands.study import one_row
from trackerlib.simulation.hexagon import SOUND_SPEED_MPS, TIME_RMS_S, Scenario, position_bound, sail_for
from trackerlib.simulation.study import StudyPoint


@pytest.fixture
def tab():
    tab = MonteCarloTab(session=Session())
    tab.trials.value, tab.every.value = 20, 20
    return tab


def test_opening_runs_and_draws_a_study(tab):
    tab.activate()
    assert {row["method"] for row in tab.rows} == {"all-pings", "thesis", "usual"}
    assert len(tab.views.curves["thesis"].data["abscissa"]) == 3
    assert "Simulated" in tab.words.object
    assert "times</b> as accurate" in tab.words.object
    assert len(tab.table.frame) == len(tab.rows)


def test_a_point_is_the_command_s_point(tab):
    tab.activate()
    direct = one_row(StudyPoint(2, "experiments", 25, 45, 3.0, "all-pings"), 20, 1, 5.0)
    row = next(row for row in tab.rows if row["method"] == "all-pings" and row["experiments"] == 25)
    assert row["rmse.z"] == direct["rmse.z"]
    drawn = tab.views.curves["all-pings"].data
    assert drawn["rmse"][list(drawn["abscissa"]).index(25)] == pytest.approx(direct["rmse.z"])


def test_a_moving_beacon_offers_its_velocity(tab):
    tab.scenario.value = 4
    tab.activate()
    tab.component.value = "vx"
    assert "m/s" in tab.views.error.yaxis.axis_label
    assert np.isfinite(tab.views.curves["all-pings"].data["rmse"]).all()
    tab.scenario.value = 1
    tab.run()
    assert tab.component.value == "z"


def test_a_beacon_and_a_grid_of_ones_own(tab):
    tab.scenario.value = OWN
    assert tab.place.visible
    tab.place.value, tab.methods.value = "100, 200, -900", ["all-pings"]
    tab.first.value, tab.last.value, tab.every.value, tab.held.value = 10, 20, 10, 30
    tab.activate()
    assert [(row["experiments"], row["spacing"]) for row in tab.rows] == [(10, 30), (20, 30)]
    receptions = sail_for(Scenario((100.0, 200.0, -900.0)), 10, 30)
    bound = position_bound(receptions, 3.0, SOUND_SPEED_MPS * TIME_RMS_S)
    assert tab.rows[0]["crlb.z"] == pytest.approx(bound[2])
    assert "of my own" in tab.words.object
    tab.velocity.value = "0.1, 0, 0"
    assert tab.held.value == 60
    for wrong in ("1, 2", "a, b, c", "0, 0, 5", "0, 0, nan"):
        tab.place.value = wrong
        tab.run()
        assert tab.session.failed
        assert "wanted" in tab.session.message
    tab.scenario.value = 1
    assert not tab.place.visible


def test_the_usual_least_squares_is_told_to_be_worse_at_25_m(tab):
    tab.scenario.value, tab.gps.value, tab.methods.value = 1, 25.0, ["all-pings", "usual"]
    tab.first.value, tab.last.value = 25, 25
    tab.activate()
    typical = {row["method"]: row["rmse.z"] / row["crlb.z"] for row in tab.rows}
    assert typical["usual"] > 5 > 2 > typical["all-pings"]
    assert "the usual least squares" in tab.words.object


def test_cancel_keeps_the_rows_that_are_done_and_says_so(tab, monkeypatch):
    seen = []

    def cancelled_in_the_fourth(*point):
        seen.append((len(tab.rows), tab.words.object))  # what stands on the page as each point begins
        if len(seen) == 4:
            tab.session.jobs.cancel()
        return one_row(*point)

    monkeypatch.setattr("dashboards.tabs.montecarlo.BETWEEN_DRAWINGS_S", -1.0)
    monkeypatch.setattr("dashboards.tabs.montecarlo.one_row", cancelled_in_the_fourth)
    tab.activate()
    assert [rows for rows, _ in seen] == [0, 1, 2, 3]
    assert "Simulating" in seen[0][1]
    assert "Simulating: 3 of 9 points so far." in seen[3][1]
    assert len(tab.rows) == len(tab.table.frame) == 4
    assert "Cancelled: 4 of 9 points were done and are kept." in tab.words.object
    assert "Simulating" not in tab.words.object
    assert len(tab.export()[1].splitlines()) == 2 + 4
    assert tab.resume.visible


def test_a_cancelled_study_goes_on_where_it_stopped_whatever_was_turned_since(tab, monkeypatch):
    tab.activate()
    whole = [{**row, "seconds": 0} for row in tab.rows]
    assert not tab.resume.visible
    done = []

    def cancelled_in_the_fourth(*point):
        done.append(point)
        assert not tab.resume.visible  # while it runs
        if len(done) == 4:
            tab.session.jobs.cancel()
        return one_row(*point)

    monkeypatch.setattr("dashboards.tabs.montecarlo.BETWEEN_DRAWINGS_S", -1.0)
    monkeypatch.setattr("dashboards.tabs.montecarlo.one_row", cancelled_in_the_fourth)
    tab.run()
    tab.trials.value = tab.seed.value = 7
    tab.resume.param.trigger("clicks")
    assert len(done) == len(whole)
    assert [{**row, "seconds": 0} for row in tab.rows] == whole
    assert not tab.resume.visible


def test_the_status_line_tells_which_point_is_at_work_and_is_idle_after(tab, monkeypatch):
    states = []
    monkeypatch.setattr(tab.session.jobs, "_on_state", lambda *state: states.append(state))
    tab.activate()
    assert states == [
        *(("Monte Carlo", k / 9, f"point {k + 1} of 9") for k in range(9)),
        ("", 0.0, ""),
    ]
    states.clear()
    monkeypatch.setattr(tab, "_begin", lambda points: tab.session.jobs.cancel())
    tab.run()
    assert states == [("", 0.0, "")]  # cancelled before the first


def test_a_study_cancelled_before_its_first_point_leaves_the_one_before(tab, monkeypatch):
    tab.activate()
    before = list(tab.rows)
    monkeypatch.setattr(tab, "_begin", lambda points: tab.session.jobs.cancel())
    tab.run()
    assert tab.rows == before
    assert "Cancelled: 0 of 9" in tab.words.object
    assert "times the bound" in tab.words.object


@pytest.mark.parametrize(
    ("control", "value"), [("trials", 0), ("gps", 0.0), ("speed", -1.0), ("methods", [])]
)
def test_what_makes_no_sense_is_said_and_nothing_is_lost(tab, control, value):
    tab.activate()
    rows = tab.rows
    getattr(tab, control).value = value
    tab.run()
    assert tab.session.failed
    assert "wanted" in tab.session.message
    assert tab.rows is rows


def test_the_export_is_the_command_s_table_labelled_simulated(tab):
    tab.activate()
    name, text = tab.export()
    assert name == "study.csv"
    assert text.startswith("# SIMULATED DATA\nscenario,sweep")
    assert text.count("\n") == len(tab.rows) + 2
