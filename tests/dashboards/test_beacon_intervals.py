"""95 % intervals in the Beacon fix tab: worked out when asked for, saved with the fix, gone with it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dashboards.jobs import Cancelled
from dashboards.session import Session
from dashboards.tabs.beacon import BeaconTab
from dashboards.tabs.beacon_intervals import words
from trackerlib.beacon.intervals import PLACE, Interval, profile_intervals


@pytest.fixture
def tab():
    session = Session()
    session.open_beacon_demo()
    session.heard = 700
    tab = BeaconTab(session=session)
    tab.activate()
    return tab


def test_they_stand_beside_the_ellipse_and_go_into_the_files(tab):
    assert not tab.intervals.words.visible
    tab.intervals.compute()
    fix, found = tab.session.fix, tab.intervals.found
    heard = tab.session.pings.only(slice(0, 700))
    assert found == profile_intervals(heard, fix, tab.session.fix_settings)
    shown = tab.intervals.words.object
    assert "by profile likelihood" in shown
    for k, name in enumerate(PLACE):
        assert str(found[name]) in shown
        assert f"± {1.96 * fix.sigma[k]:.2g} m" in shown
    answer = json.loads(tab.export()[1])
    assert answer["interval95_m"]["depth"] == [found["depth"].low_m, found["depth"].high_m]
    tab.files.layout.value = "html"
    assert f"95 % interval, depth: {found['depth']}" in tab.files.file().getvalue().decode()


def test_resampled_residuals_tell_how_far_they_are_and_can_be_cancelled(tab):
    session, told = tab.session, []

    def cancelled(purpose, share, text):
        if purpose == "Intervals":
            told.append((share, text))
            if share > 0.15:
                raise Cancelled

    usual, session.jobs._on_state = session.jobs._on_state, cancelled
    tab.intervals.way.value = "resampled residuals"
    tab.intervals.compute()
    assert told == [(0.0, "sample 0 of 400"), (0.1, "sample 40 of 400"), (0.2, "sample 80 of 400")]
    assert tab.intervals.found is None
    assert not tab.intervals.words.visible
    session.jobs._on_state = usual
    tab.intervals.compute()
    assert "by resampled residuals" in tab.intervals.words.object


def test_they_vanish_when_the_fix_changes(tab):
    tab.intervals.compute()
    tab.settings.speed_sigma.value = 3.0
    assert tab.intervals.found is None
    assert not tab.intervals.words.visible
    assert "interval95_m" not in json.loads(tab.export()[1])


def test_of_a_refusal_there_are_none_and_of_experiments_neither(tab):
    tab.session.heard = 200
    tab.intervals.compute()
    assert "there is none yet" in tab.session.message
    tab.session.heard = 1000
    tab.settings.estimator.value = "pairs"
    tab.intervals.compute()
    assert tab.session.failed
    assert "No interval: intervals are for the fix of all pings" in tab.session.message
    assert tab.intervals.found is None


def test_an_open_side_and_a_warning_are_words(tab):
    open_above = {name: Interval(-3.0, np.inf) for name in PLACE}
    shown = words(tab.session.fix, "profile likelihood", open_above, "the misfit is <bent>")
    assert "-3.0 m or more" in shown
    assert "&lt;bent&gt;" in shown
