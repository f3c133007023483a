"""The Beacon fix tab without a browser: what its widgets do to the session, what it draws of a fix."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs import beacon
from dashboards.tabs.beacon import BeaconTab, position_texts, sentence, table


@pytest.fixture
def tab(monkeypatch):
    monkeypatch.setattr(beacon, "HISTORY_FIXES", 8)
    session = Session()
    session.open_beacon_demo()
    tab = BeaconTab(session=session)
    tab.activate()
    return tab


def hear(tab, count):
    """What the slider sends when it is let go."""
    tab._hear(count)


def test_the_demo_is_fixed_and_drawn_filled_with_its_ellipse(tab):
    fix = tab.session.fix
    assert fix.converged
    assert tab.map.fix.data["fill"] == [1.0]
    assert len(tab.map.ellipse.data["x"]) > 50
    assert len(tab.map.hollow_ellipse.data["x"]) == 0
    assert "The beacon lies at 41°15." in tab.sentence.object
    assert "±" in tab.sentence.object


def test_the_ellipse_on_the_map_has_the_size_it_states(tab):
    fix, ring = tab.session.fix, tab.map.ellipse.data
    stretch = 1 / np.cos(np.radians(fix.lat_deg))  # of web mercator
    across = np.hypot(np.ptp(ring["x"]), np.ptp(ring["y"])) / stretch
    assert across == pytest.approx(2 * np.hypot(fix.ellipse.semi_major_m, fix.ellipse.semi_minor_m), rel=0.1)


def test_the_truth_of_simulated_data_is_labelled_so(tab):
    assert len(tab.map.truth.data["x"]) == 1
    labels = [item.label.value for item in tab.map.map.legend.items]
    assert "truth (simulated)" in labels
    assert tab.session.simulated


def test_a_straight_leg_is_refused_in_words_with_both_mirror_solutions(tab):
    hear(tab, 300)
    assert not tab.session.fix.converged
    assert "No fix yet:" in tab.sentence.object
    assert "straight line" in tab.sentence.object
    assert len(tab.map.alternatives.data["x"]) == 2
    assert len(tab.map.fix.data["x"]) == 0
    assert tab.map.ellipse.data["x"] == []


def test_turning_the_number_of_pings_fixes_what_was_heard(tab):
    hear(tab, 700)
    assert len(tab.session.fix.number) == 700
    assert len(tab.map.pings.data["x"]) == 700


def test_left_out_pings_are_crosses_and_stay_selectable(tab):
    kinds = tab.map.pings.data["kind"]
    assert (kinds == "x").sum() == len(tab.session.fix.rejected) > 0
    tab.map.pings.selected.indices = [4, 7]
    tab._leave_out()
    assert tab.session.fix_settings.left_out == {5, 8}
    assert not tab.session.fix.used[[4, 7]].any()
    tab.session.undo()
    assert tab.session.fix_settings.left_out == frozenset()
    assert tab.session.fix.used[[4, 7]].all()
    tab.session.redo()
    assert tab.session.fix_settings.left_out == {5, 8}


def test_leaving_out_nothing_says_what_to_do(tab):
    tab._leave_out()
    assert "Choose pings" in tab.session.message


def test_every_control_reaches_the_fix(tab):
    wide = tab.session.fix.sigma[2]
    tab.speed_sigma.value = 5.0
    assert tab.session.fix.sigma[2] > wide
    tab.gps.value = "2"
    assert tab.session.fix_settings.gps_rms_m == 2.0
    tab.gps.value = ""
    assert tab.session.fix_settings.gps_rms_m is None
    tab.use_profile.value = False
    tab.sound_speed.value = 1484.0
    assert tab.session.fix.sound_speed_mps == 1484.0
    tab.reject.value = False
    assert len(tab.session.fix.rejected) == 0
    tab.max_depth.value = 1000.0
    assert "greatest depth (1000 m)" in tab.session.fix.reason
    tab._restore_defaults()
    assert tab.session.fix.converged
    assert tab.max_depth.value == 11_000.0


@pytest.mark.parametrize(("widget", "value"), [("gps", "much"), ("sound_speed", 99.0)])
def test_a_value_that_makes_no_sense_is_told_and_changes_nothing(tab, widget, value):
    before = tab.session.fix_settings
    if widget == "sound_speed":
        tab.use_profile.value = False
        before = tab.session.fix_settings
    getattr(tab, widget).value = value
    assert tab.session.failed
    assert "wanted" in tab.session.message
    assert tab.session.fix_settings is before


def test_the_history_shows_depths_with_their_bands(tab):
    tab._compute_history()
    history = tab.map.history.data
    assert len(history["number"]) >= 4
    assert np.all(np.array(history["low"]) < np.array(history["depth"]))
    # No fix is believed on the first, straight leg (380 pings).
    assert min(history["number"]) > 380


def test_play_replays_the_survey_to_its_end(tab):
    session = tab.session
    session.speed = 1000
    session.play()
    assert session.playing
    assert session.heard == 0
    for _ in range(20):
        session.tick(0.2)
    assert not session.playing
    assert session.heard == len(session.pings)
    assert session.fix.converged


def test_positions_are_given_as_people_use_them(tab):
    texts = position_texts(tab.session.fix)
    assert texts["degrees"].startswith("41.25")
    assert "°" in texts["minutes"]
    assert texts["UTM"].startswith("19N ")
    assert json.loads(texts["everything"])["converged"] is True
    assert tab.copies["UTM"].text == texts["UTM"]


def test_export_is_the_answer_of_the_command(tab):
    name, text = tab.export()
    assert name.endswith(".json")
    assert json.loads(text)["simulated"] is True


def test_a_hidden_tab_is_not_redrawn(tab):
    tab.deactivate()
    before = tab.sentence.object
    tab.session.heard = 200
    assert tab.sentence.object is before
    tab.activate()
    assert tab.sentence.object is not before


def test_an_empty_session_says_what_is_missing():
    tab = BeaconTab(session=Session())
    tab.activate()
    tab.refresh({"pings"})
    assert "No survey is open" in tab.sentence.object
    assert tab.export() is None


def test_words_are_escaped(tab):
    evil = replace(tab.session.fix, converged=False, reason="<script>alert(1)</script>")
    assert "<script>" not in sentence(evil)
    assert "<table>" in table(evil)


SURVEY = b"lat_deg,lon_deg,oneway_s\n" + b"".join(b"%.4f,20,2.%d\n" % (10 + k / 1000, k) for k in range(9))


def test_a_real_survey_does_not_inherit_the_demos_water(tab):
    assert tab.session.fix_settings.profile is not None
    tab.session.open_file("real.csv", SURVEY)
    assert tab.session.fix_settings.profile is None
    assert not tab.use_profile.value
    assert tab.use_profile.disabled
    assert tab.session.truth is None


def test_a_history_of_a_survey_no_longer_open_is_not_drawn(tab):
    tab._compute_history()
    tab.session.open_file("real.csv", SURVEY)
    assert all(count <= 9 for count in tab.map.history.data["number"])


def test_the_home_box_grows_to_hold_both_mirror_solutions(tab):
    hear(tab, 300)
    x0, x1, y0, y1 = tab.map.home.tags
    for x, y in zip(tab.map.alternatives.data["x"], tab.map.alternatives.data["y"], strict=True):
        assert x0 <= x <= x1
        assert y0 <= y <= y1


def test_a_moving_beacon_is_shown_where_it_is_now(tab):
    tab.motion.value = "free"
    fix = tab.session.fix
    assert fix.velocity is not None
    assert len(tab.map.drift.data["x"]) == 2
    assert "now" in tab.sentence.object or "No fix" in tab.sentence.object
    tab.session.undo()
    assert tab.session.fix.velocity is None
    assert len(tab.map.drift.data["x"]) == 0


def test_the_thesis_estimator_can_be_chosen(tab):
    tab.spacing.value = "20"
    tab.method.value = "pairs"
    assert tab.session.fix.method == "pairs"
    assert tab.session.fix_settings.spacing == 20
    assert tab.session.fix.converged


@pytest.mark.parametrize(("layout", "suffix"), [("gpx-1.0", ".gpx"), ("netcdf", ".nc"), ("html", ".html")])
def test_the_fix_is_saved_in_the_layout_chosen(tab, layout, suffix):
    tab.layout.value = layout
    assert tab.download.filename.endswith(suffix)
    assert len(tab._export_file().getvalue()) > 1000


def test_what_would_help_draws_the_best_leg_and_a_dragged_one_is_forecast(tab):
    tab._plan()
    assert "expected error" in tab.help_words.object
    assert len(tab.map.leg.data["x"]) == 2
    assert tab.map.attainable.data["image"][0].shape == (21, 21)
    before = tab.help_words.object
    x, y = tab.map.leg_end.data["x"][0], tab.map.leg_end.data["y"][0]
    tab.map.leg_end.data = {"x": [x + 900.0], "y": [y - 700.0]}
    assert tab.help_words.object != before
    assert tab.map.leg.data["x"][1] == pytest.approx(x + 900.0, abs=1)
    assert b"<rte>" in tab._route_file().getvalue()


def test_a_new_fix_clears_the_plan(tab):
    tab._plan()
    tab.gps.value = "4"
    assert len(tab.map.leg.data["x"]) == 0
    assert not tab.help_words.visible


def test_models_are_compared_side_by_side(tab):
    tab._compare()
    assert tab.models.visible
    assert "moves freely" in tab.models.object
    assert tab.models.object.index("lies still") < tab.models.object.index("moves freely")


def test_contours_stand_beside_the_residuals_when_chosen(tab):
    tab._catch_up()
    tab.below.value = "east, depth"
    assert tab._beside[0] is tab._contour_pane
    lines = tab.map._contour.line_renderer.data_source.data["xs"]
    assert len(lines) >= 4
    assert tab.map.contours.y_range.flipped
    tab.below.value = ""
    assert tab._beside[0] is tab._history_pane


def test_each_ping_says_how_far_it_moves_the_fix(tab):
    moves = tab.map.pings.data["moves_m"]
    used = tab.session.fix.used
    assert np.isfinite(moves[used]).all()
    assert np.isnan(moves[~used]).all()
