"""The Monte Carlo tab without a browser: its controls run the study that the command runs."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.montecarlo import MonteCarloTab
from trackerlib.commands.study import one_row
from trackerlib.simulation.study import StudyPoint


@pytest.fixture
def tab():
    tab = MonteCarloTab(session=Session())
    tab.trials.value, tab.every.value = 20, 20
    return tab


def test_opening_runs_and_draws_a_study(tab):
    tab.activate()
    assert {row["method"] for row in tab.rows} == {"all-pings", "thesis"}
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
