"""The Timing tab without a browser: what its sliders draw and what its buttons do to the session."""

from __future__ import annotations

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.timing import TimingTab, numbers, sentence
from trackerlib.timing.correction import corrected_tracks, fit_timing, stretches


@pytest.fixture
def tab():
    session = Session()
    session.open_range_demo()
    tab = TimingTab(session=session)
    tab.activate()
    return tab


def drawn(tab, letter):
    data = tab.views.points.data
    return np.column_stack([data[f"{letter}{axis}"] for axis in range(3)])


def test_opening_shows_the_fit_of_the_chosen_set(tab):
    correction = tab.session.correction
    assert correction.points > 50
    assert tab.offset_ms.value == pytest.approx(1e3 * correction.offset_s)
    assert "Transit times were too short by 2.8" in tab.words.object
    assert "±" in tab.words.object


def test_the_set_chosen_elsewhere_is_the_set_here(tab):
    other = tab.session.gating.sets[3]
    tab.session.param.update(correction=None, crossover=other)
    assert np.array_equal(tab.views.points.data["count"], other.point_count)
    assert tab.chosen.value == 3


def test_a_set_chosen_here_is_the_set_everywhere(tab):
    tab.chosen.value = 5
    assert tab.session.crossover is tab.session.gating.sets[5]
    direct = fit_timing(tab.session.crossover, tab.session.survey, tab.session.profile)
    assert tab.session.correction.offset_s == direct.offset_s


def test_sliders_stretch_both_tracks_as_the_library_does(tab):
    tab.offset_ms.value = 4.0
    tab.drift_ms.value = 0.01
    session = tab.session
    both = stretches(session.crossover, session.survey, session.profile)
    x, y = corrected_tracks(session.crossover, *both, 4e-3, 1e-5, session.correction.t0)
    assert np.abs(drawn(tab, "x") - x).max() < 0.01
    assert np.abs(drawn(tab, "y") - y).max() < 0.01
    assert np.abs(tab.views.points.data["gap0"] - (x - y)[:, 0]).max() < 0.01
    assert "At the sliders the gap is" in tab.words.object


def test_only_places_are_sent_while_a_slider_moves(tab):
    counts = tab.views.points.data["count"]
    tab.offset_ms.value = 1.0
    assert tab.views.points.data["count"] is counts
    assert tab.views.points.data["x0"].dtype == np.float32


def test_zero_shows_the_tracks_as_reported_and_fit_goes_back(tab):
    fitted = tab.offset_ms.value
    tab.zero.clicks += 1
    assert np.abs(drawn(tab, "x") - tab.session.crossover.x).max() < 0.01
    tab.fit.clicks += 1
    assert tab.offset_ms.value == pytest.approx(fitted)


def test_the_fit_closes_the_gap_better_than_any_slider(tab):
    def rms():
        keep = ~tab.session.correction.excluded
        return np.sqrt(np.mean(np.sum((drawn(tab, "x") - drawn(tab, "y"))[keep] ** 2, axis=1)))

    best = rms()
    for shift in (-0.3, 0.3):
        tab.offset_ms.value = 1e3 * tab.session.correction.offset_s + shift
        assert rms() > best


def test_outliers_are_marked_and_stay_in_the_picture(tab):
    left_out = tab.session.correction.excluded
    assert (tab.views.points.data["used"] == "left out").tolist() == left_out.tolist()


def test_as_reported_can_be_hidden(tab):
    assert len(tab.views.before.data["x0"]) == tab.session.crossover.points
    tab.show_before.value = False
    assert len(tab.views.before.data["x0"]) == 0


def test_every_set_can_be_fitted_into_a_table(tab):
    tab.fit_all.clicks += 1
    assert len(tab.table.frame) == len(tab.session.gating.sets)
    name, text = tab.export()
    assert name == "offsets.csv"
    assert text.startswith("# SIMULATED DATA\nday,run,pair,offset_ms")
    assert len(text.splitlines()) == 2 + len(tab.session.gating.sets)


def test_a_set_with_too_few_points_says_so(tab):
    small = min(range(len(tab.session.gating.sets)), key=lambda k: tab.session.gating.sets[k].points)
    tab.chosen.value = small
    assert "too few for a sigma" in tab.words.object


def test_another_vehicle_brings_other_sets(tab):
    tab.session.mode = 2
    tab.session.gate()
    assert len(tab.chosen.options) == len(tab.session.gating.sets)
    assert tab.session.crossover in tab.session.gating.sets


def test_an_empty_session_says_what_is_missing():
    tab = TimingTab(session=Session())
    tab.activate()
    assert "Nothing to correct yet" in tab.words.object
    assert tab.export() is None


def test_a_far_offset_widens_the_slider(tab):
    tab._put(25.0, 0.0)
    assert tab.offset_ms.end >= 25.0
    assert tab.offset_ms.value == 25.0


def test_sentence_and_numbers_round_value_and_sigma_together(tab):
    correction = tab.session.correction
    assert "ms</b>" in sentence(tab.session.crossover, correction)
    assert "ms/count" in numbers(correction)
