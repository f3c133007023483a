"""The Beacon fix tab without a browser: what its widgets do to the session, what it draws of a fix."""

from __future__ import annotations

import json
import threading
from dataclasses import replace

import numpy as np
import pytest

from dashboards.pictures.mercator import from_mercator
from dashboards.session import Session
from dashboards.tabs import beacon, beacon_models
from dashboards.tabs.beacon import BeaconTab
from dashboards.tabs.beacon_edits import OTHER
from dashboards.tabs.beacon_words import position_texts, sentence, table
from trackerlib.beacon.choice import usual_estimators, usual_models
from trackerlib.beacon.pings import Ping
from trackerlib.beacon.planning import Leg
from trackerlib.frames import LocalFrame
from trackerlib.receiver.hyperbola import BearingLine


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
    for label, other in zip(tab.map.alternatives.data["label"], tab.session.fix.alternatives, strict=True):
        assert f"chi-square {other.misfit:.1f} above" in label or "none more likely" in label
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
    tab.edits.leave_out()
    assert tab.session.fix_settings.left_out == {5, 8}
    assert tab.session.reasons == {5: "false return", 8: "false return"}
    assert not tab.session.fix.used[[4, 7]].any()
    tab.session.undo()
    assert tab.session.fix_settings.left_out == frozenset()
    assert tab.session.reasons == {}
    assert tab.session.fix.used[[4, 7]].all()
    tab.session.redo()
    assert tab.session.fix_settings.left_out == {5, 8}
    assert tab.session.reasons == {5: "false return", 8: "false return"}


def test_a_reason_is_typed_shown_saved_and_goes_with_its_ping(tab):
    tab.edits.reason.value = OTHER
    assert tab.edits.typed.visible
    tab.edits.typed.value = "whale <near>"
    tab.map.pings.selected.indices = [4, 9]
    tab.edits.leave_out()
    assert "whale &lt;near&gt;" in tab.edits.list.object
    assert json.loads(tab.session.to_json())["left_out"] == {"5": "whale <near>", "10": "whale <near>"}
    assert json.loads(tab.export()[1])["left_out_by_hand"]["5"] == "whale <near>"
    tab.files.layout.value = "csv"
    rows = [line.split(",") for line in tab.files.file().getvalue().decode().splitlines()]
    because = {row[0]: row[-1] for row in rows}
    assert (because["5"], because["6"]) == ("whale <near>", "")
    assert "does not fit" in because.values()
    tab.map.pings.selected.indices = [9, 10]
    tab.edits.restore()
    assert tab.session.reasons == {5: "whale <near>"}
    assert tab.session.fix.used[9]
    tab.session.undo()
    assert tab.session.reasons[10] == "whale <near>"
    tab.edits.restore_all()
    assert tab.session.fix_settings.left_out == frozenset()
    assert "No ping is left out" in tab.edits.list.object


def test_leaving_out_nothing_says_what_to_do(tab):
    tab.edits.leave_out()
    assert "Choose pings" in tab.session.message


def test_every_control_reaches_the_fix(tab):
    controls, session = tab.settings, tab.session
    wide = session.fix.sigma[2]
    controls.speed_sigma.value = 5.0
    assert session.fix.sigma[2] > wide
    controls.ship_errors.value = "white"
    assert session.fix_settings.gps_rms_m == 5.0
    assert controls.gps.visible
    controls.gps.value = "2, 3"
    assert session.fix_settings.gps_rms_m == (2.0, 3.0)
    controls.ship_errors.value = "correlated"
    assert session.fix_settings.gps_correlation_s == 60.0
    controls.gps.value = "much"
    assert session.failed
    assert controls.gps.value == "2, 3"
    controls.fit_speed.value = True
    assert session.fix_settings.estimate_sound_speed
    controls.antenna[1].value = 0.5
    assert session.fix_settings.antenna_sigma_m == (0.0, 0.5)
    controls.fit_speed.value = False
    controls.ship_errors.value = "unknown"
    assert session.fix_settings.gps_rms_m is None
    controls.water.value = False
    controls.sound_speed.value = 1484.0
    assert session.fix.sound_speed_mps == 1484.0
    controls.reject.value = False
    assert len(session.fix.rejected) == 0
    controls.max_depth.value = 1000.0
    assert "greatest depth (1000 m)" in session.fix.reason
    controls.restore_defaults()
    assert session.fix.converged
    assert controls.max_depth.value == 11_000.0


def test_at_most_nine_controls_are_in_sight(tab):
    tab.settings.water.value = False
    for tab.settings.ship_errors.value in ("unknown", "white", "correlated"):
        assert sum(one.visible for one in tab.controls()) <= 9


@pytest.mark.parametrize(("widget", "value"), [("interval", "much"), ("sound_speed", 99.0)])
def test_a_value_that_makes_no_sense_is_told_and_changes_nothing(tab, widget, value):
    before = tab.session.fix_settings
    getattr(tab.settings, widget).value = value
    assert tab.session.failed
    assert "wanted" in tab.session.message
    assert tab.session.fix_settings is before


def test_the_history_shows_depths_with_their_bands(tab):
    tab._compute_history()
    history = tab.history.source.data
    assert len(history["number"]) >= 4
    assert np.all(np.array(history["low"]) < np.array(history["depth"]))
    # No fix is believed on the first, straight leg (380 pings).
    assert min(history["number"]) > 380
    assert list(tab.map.trail.data["number"]) == list(history["number"])


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


@pytest.mark.parametrize("lat_deg", [88.5, -80.5])
def test_near_a_pole_there_is_no_utm_and_all_else_is_told(tab, lat_deg):
    tab.session.fix = fix = replace(tab.session.fix, frame=LocalFrame(lat_deg, -66.0))
    assert set(position_texts(fix)) == {"degrees", "minutes", "seconds", "everything"}
    assert not tab.copies["UTM"].visible
    assert tab.copies["degrees"].visible


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


def test_a_beacon_above_the_hydrophone_is_noted(tab):
    fix = tab.session.fix
    assert "Note:" not in sentence(fix)
    assert "above the hydrophone" in sentence(replace(fix, ship=fix.ship - [0.0, 0.0, 3000.0]))


def test_words_are_escaped(tab):
    evil = replace(tab.session.fix, converged=False, reason="<script>alert(1)</script>")
    assert "<script>" not in sentence(evil)
    assert "<table>" in table(evil)


SURVEY = b"lat_deg,lon_deg,oneway_s\n" + b"".join(b"%.4f,20,2.%d\n" % (10 + k / 1000, k) for k in range(9))


def test_a_real_survey_does_not_inherit_the_demos_water(tab):
    assert tab.session.fix_settings.profile is not None
    tab.session.open_file("real.csv", SURVEY)
    assert tab.session.fix_settings.profile is None
    assert not tab.settings.water.visible
    assert tab.settings.sound_speed.visible
    assert tab.session.truth is None


def test_a_history_of_a_survey_no_longer_open_is_not_drawn(tab):
    tab._compute_history()
    tab.session.open_file("real.csv", SURVEY)
    assert all(count <= 9 for count in tab.history.source.data["number"])


def test_the_home_box_grows_to_hold_both_mirror_solutions(tab):
    hear(tab, 300)
    x0, x1, y0, y1 = tab.map.home.tags
    for x, y in zip(tab.map.alternatives.data["x"], tab.map.alternatives.data["y"], strict=True):
        assert x0 <= x <= x1
        assert y0 <= y <= y1


def test_a_moving_beacon_is_shown_where_it_is_now(tab):
    tab.settings.motion.value = "free"
    fix = tab.session.fix
    assert fix.velocity is not None
    assert len(tab.map.drift.data["x"]) == 2
    assert "now" in tab.sentence.object or "No fix" in tab.sentence.object
    tab.session.undo()
    assert tab.session.fix.velocity is None
    assert len(tab.map.drift.data["x"]) == 0


def test_the_thesis_estimator_can_be_chosen(tab):
    tab.settings.spacing.value = "20"
    tab.settings.estimator.value = "pairs"
    assert tab.session.fix.method == "pairs"
    assert tab.session.fix_settings.spacing == 20
    assert tab.session.fix.converged


@pytest.mark.parametrize(("layout", "suffix"), [("gpx-1.0", ".gpx"), ("netcdf", ".nc"), ("html", ".html")])
def test_the_fix_is_saved_in_the_layout_chosen(tab, layout, suffix):
    tab.files.layout.value = layout
    assert tab.files.button.filename.endswith(suffix)
    assert len(tab.files.file().getvalue()) > 1000


def test_what_would_help_draws_candidate_legs_and_a_dragged_one_is_forecast(tab):
    tab.leg.plan()
    legs, ends = tab.map.leg.legs.data, tab.map.leg.ends.data
    assert "expected error" in tab.leg.words.object
    assert 2 <= len(legs["xs"]) <= 6
    assert list(ends["error"]) == sorted(ends["error"])
    assert tab.map.leg.attainable.data["image"][0].shape == (21, 21)
    before = tab.leg.words.object
    moved = {name: np.array(column) for name, column in ends.items()}
    moved["x"][1] += 900.0
    moved["y"][1] -= 700.0
    tab.map.leg.ends.data = moved
    assert tab.leg.words.object != before
    assert legs is not tab.map.leg.legs.data
    assert tab.map.leg.legs.data["xs"][0][1] == pytest.approx(moved["x"][1], abs=1)
    assert b"<rte>" in tab.leg.route_file().getvalue()
    assert "drag a triangle" in tab.leg.words.object
    assert "longer than the" not in tab.leg.words.object
    tab.map.leg.ends.data = moved | {"x": moved["x"] + 30_000 * (np.arange(len(moved["x"])) == 0)}
    assert "longer than the 30 min" in tab.leg.words.object


def test_the_map_shades_the_worst_of_both_mirror_places(tab):
    hear(tab, 300)
    tab.leg.plan()
    both = tab.leg._surveys
    assert len(both) == 2
    image, east, north = shaded(tab)
    ratios = []
    for row, column in ((0, 0), (20, 5), (10, 20)):
        leg = Leg(both[0].ship[-1, :2], np.array([east[column], north[row]]), tab.leg.ship_speed.value)
        each = [survey.after(leg).rms_m for survey in both]
        assert image[row, column] == pytest.approx(max(each), rel=0.02)
        ratios.append(max(each) / min(each))
    assert max(ratios) > 1.1  # the mirrors are not told alike


def shaded(tab):
    """The shading and the east and north [m] of its cells' middles, in the frame of the fix."""
    data = {name: column[0] for name, column in tab.map.leg.attainable.data.items()}
    steps = (np.arange(21) + 0.5) / 21
    x, y = data["x"] + steps * data["dw"], data["y"] + steps * data["dh"]
    place = tab.session.fix.frame.to_local(*from_mercator(x, y), 0.0)
    return data["image"], place[:, 0], place[:, 1]


def test_a_new_fix_clears_the_plan(tab):
    tab.leg.plan()
    tab.settings.ship_errors.value = "white"
    assert len(tab.map.leg.legs.data["xs"]) == 0
    assert not tab.leg.words.visible


def test_estimators_and_motions_are_compared_side_by_side(tab, monkeypatch):
    two = lambda settings: dict(list(usual_models(settings).items())[::3])  # noqa: E731
    monkeypatch.setattr(beacon_models, "usual_models", two)
    tab.models.compare()
    assert tab.beside.value == "Estimators"
    words = tab.models.estimators.object
    for name in ("ship&#x27;s error not known", "5 m independent", "usual least squares", "experiments"):
        assert name in words
    drawn = list(tab.map.compared.data["label"])
    assert drawn == list(usual_estimators(tab.session.fix_settings))
    assert len(tab.map.compared_rings.data["xs"]) == len(drawn)
    assert "no place:" not in words
    few = tab.session.pings.only(slice(0, 3))
    assert "no place:" in beacon_models.estimators_table({"of three": beacon_models.fix_beacon(few)})
    motions = tab.models.motions.object
    assert "AICc chooses “lies still”" in motions
    assert motions.index("lies still") < motions.index("moves freely")
    tab.settings.speed_sigma.value = 3.0
    assert len(tab.map.compared.data["x"]) == 0
    assert "Compare" in tab.models.estimators.object


def test_contours_stand_beside_the_residuals_when_chosen(tab):
    tab.across.value, tab.up.value = "east", "depth"
    tab.beside.value = "Contours"
    lines = tab.contours.drawn.line_renderer.data_source.data["xs"]
    assert len(lines) >= 4
    assert tab.contours.figure.y_range.flipped
    tab.beside.value = "History"
    assert [name for name, pane in tab._panes.items() if pane.visible] == ["History"]


def test_a_moving_beacon_has_contours_of_its_velocity(tab):
    assert "velocity east" not in tab.across.options
    tab.settings.motion.value = "horizontal"
    tab.across.value, tab.up.value = "velocity east", "velocity north"
    tab.beside.value = "Contours"
    assert tab.contours.figure.xaxis.axis_label == "velocity east (m/s)"
    assert np.isfinite(tab.contours.centre.data["x"]).all()
    tab.settings.motion.value = "still"
    assert tab.across.value != tab.up.value
    assert "velocity east" not in tab.across.options


def test_the_iterations_are_drawn_and_listed(tab):
    tab.beside.value = "Iterations"
    log = tab.session.fix.log
    assert len(log) > 5
    assert tab.iterations.source.data["step"] == list(range(1, len(log) + 1))
    assert tab.iterations.source.data["rms_ms"][-1] < tab.iterations.source.data["rms_ms"][0]
    assert log[-1].stage in tab.log.object


def test_bearing_lines_of_the_chart_lie_across_the_closest_approach(tab):
    line = BearingLine(41.25, -66.5, 90.0, 10.0, 0.5, distance_m=800.0, sigma_m=20.0)
    tab.session.bearing_lines = (line,)
    (xs,), (ys,) = tab.map.bearings.lines.data["xs"], tab.map.bearings.lines.data["ys"]
    stretch = 1 / np.cos(np.radians(41.25))
    assert abs(xs[2] - xs[0]) == pytest.approx(1600 * stretch, rel=0.01)
    assert np.ptp(ys) < 1
    assert tab.map.bearings._entry.visible
    crossing = BearingLine(41.26, -66.49, 180.0, 10.0, 0.5)
    tab.session.bearing_lines = (line, crossing)
    assert tab.map.bearings.fix.converged
    assert len(tab.map.bearings.ellipse.data["x"]) > 10
    tab.session.bearing_lines = ()
    assert not tab.map.bearings._entry.visible


def test_a_click_in_the_legend_hides_its_layer(tab):
    legend = tab.map.map.legend[0]
    assert legend.click_policy == "hide"
    hidden = {item.label.value: followers(legend, item.renderers[0]) for item in legend.items}
    layers = {renderer for renderers in hidden.values() for renderer in renderers}
    marks = {item.renderers[0] for item in legend.items}
    assert layers | marks >= {one for one in tab.map.map.renderers if hasattr(one, "glyph")}
    for words in ("ship", "fix", "95 % ellipse", "earlier fixes", "candidate legs, forecast ellipse"):
        assert hidden[words]


def followers(legend, mark):
    """What follows the visibility of a legend's mark."""
    clicks = legend.js_event_callbacks["legend_item_click"]
    return {one for click in clicks if click.args["mark"] is mark for one in click.args["shown"]}


def test_the_live_estimator_replays_beside_the_batch(tab):
    session, batch = tab.session, tab.session.fix
    tab.settings.ship_errors.value = "white"
    tab.settings.gps.value = "1"
    batch = session.fix
    tab.settings.estimator.value = "live"
    assert session.live
    assert np.abs(session.fix.position - batch.position).max() < 0.3 * batch.sigma.max()
    assert len(session.fix.number) == len(session.pings)
    assert not session.failed
    assert np.isfinite(tab.map.pings.data["moves_m"][session.fix.used]).all()
    session.speed = 1000
    session.play()
    said = set()
    while session.playing:
        session.tick(0.2)
        said.add(tab.sentence.object[:10])
    assert len(said) == 2  # refusals first, then places
    assert session.fix.converged
    assert len(tab.map.trail.data["x"]) > 1
    session.undo()
    assert not session.live


def test_the_live_estimator_says_what_it_cannot_do(tab):
    tab.settings.estimator.value = "live"
    tab.settings.motion.value = "vertical"
    assert "a live fix is for" in tab.sentence.object


def test_pings_come_live_from_a_thread(tab):
    session, pings = tab.session, tab.session.pings
    queue = session.listen("receiver on COM3", simulated=True)
    assert "Listening to receiver on COM3" in tab.sentence.object
    assert session.pings is None

    def push():
        for k in range(len(pings)):
            queue.push(
                Ping(int(pings.number[k]), pings.lat_deg[k], pings.lon_deg[k], pings.travel_time_s[k],
                     float(pings.instant_s[k]), pings.up_m[k])
            )  # fmt: skip

    reader = threading.Thread(target=push)
    reader.start()
    while reader.is_alive() or session.heard < len(pings):
        session.tick(0.2)
    assert session.heard == len(pings)
    assert session.fix.converged
    assert session.simulated
    assert "The beacon lies at" in tab.sentence.object
    assert tab.play.label == "Stop listening"
    tab.edits.session.edit(fix_settings=replace(session.fix_settings, left_out=frozenset({5})))
    assert not session.fix.used[4]
    session.stop_listening()
    assert tab.play.label == "Play"
    queue.push(Ping(9999, 41.0, -66.0, 1.0, 1e6))
    session.tick(0.2)
    assert session.heard == len(pings)
    assert not session.failed


def test_each_ping_says_how_far_it_moves_the_fix(tab):
    moves = tab.map.pings.data["moves_m"]
    used = tab.session.fix.used
    assert np.isfinite(moves[used]).all()
    assert np.isnan(moves[~used]).all()
