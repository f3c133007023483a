"""The Timing tab without a browser: what its sliders draw and what its buttons do to the session."""

from __future__ import annotations

import numpy as np
import pytest
from range_demo import as_opened, opened_tab

from dashboards.session import Session
from dashboards.tabs.timing import TimingTab, numbers, sentence
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.gating import gate_reports
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.rangefiles.crossover_file import crossover_file_name, crossover_text
from trackerlib.rangefiles.run_track_file import hand_overs_csv, run_track_csv
from trackerlib.rangefiles.tfile import parse_tfile
from trackerlib.textfiles import InputError
from trackerlib.timing.correction import corrected_tracks, fit_timing, stretches


@pytest.fixture(scope="module")
def opened():
    return opened_tab(TimingTab)


@pytest.fixture
def tab(opened):
    tab = as_opened(*opened)
    tab.fit.clicks += 1
    tab.show_before.value = True
    tab.profile_page.layout.value = "middle"
    tab.causes.scope.value = next(name for name in tab.causes.scope.options if "all" in name)
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
    assert "At the sliders the gap is" in tab.sliders_words.object


def test_only_places_are_sent_while_a_slider_moves(tab):
    counts = tab.views.points.data["count"]
    tab.offset_ms.value = 1.0
    assert tab.views.points.data["count"] is counts
    assert tab.views.points.data["x0"].dtype == np.float32


def test_no_legend_leads_to_what_sliders_move(tab):
    # Bokeh builds a legend again whenever anything changes that its entries lead to.
    for fig in (tab.views.plan, tab.views.gap):
        assert len(fig.legend[0].items) >= 3
        assert not any(tab.views.points in item.references() for item in fig.legend[0].items)


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
    assert (tab.views.points.data["used"] == "outlier").tolist() == left_out.tolist()


def test_as_reported_can_be_hidden(tab):
    assert len(tab.views.before.data["x0"]) == tab.session.crossover.points
    tab.show_before.value = False
    assert len(tab.views.before.data["x0"]) == 0


def test_every_set_is_fitted_unasked_and_stands_in_a_table(tab):
    frame = tab.sets_page.table.value
    assert len(frame) == len(tab.session.gating.sets)
    assert frame["pair"].iloc[0] == "{}-{}".format(*tab.session.gating.sets[0].pair)
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


# -- the run as a whole ---------------------------------------------------------------------------


def test_the_words_lead_to_the_array_that_is_surveyed_wrong(tab):
    assert "One offset does not serve this run" in tab.run_words.object
    assert "Without array 5 the other" in tab.run_words.object
    tab.pages.choice.value = "Constancy"
    assert "Without array 5" in tab.constancy.words.object
    assert tab.constancy.arrays.frame["left out"].iloc[2] == "array 5"
    tab.pages.choice.value = "Causes"
    assert "best is timing offset and displacement of array 5" in tab.causes.words.object
    assert "Array 5 seems to lie 11" in tab.causes.words.object
    assert tab.causes.table.frame["cause"].iloc[0] == "timing offset and displacement of array 5"


def test_a_click_on_an_offset_chooses_its_set_everywhere(tab):
    tab.sets_page.by_time.source.selected.indices = [4]
    chosen = tab.session.gating.sets[tab.sets_page.by_time.source.data["row"][4]]
    assert tab.session.crossover is chosen
    assert np.array_equal(tab.views.points.data["count"], chosen.point_count)
    row = tab.sets_page.table.selection[0]
    assert tab.sets_page.table.value["pair"].iloc[row] == "{}-{}".format(*chosen.pair)


def test_a_click_in_the_table_chooses_its_set_however_it_is_sorted(tab):
    table = tab.sets_page.table
    for sorters in ([], [{"field": "offset (ms)", "dir": "asc"}]):
        table._process_events({"sorters": sorters})
        for row in (7, 11):
            # As the page tells it: in the order of the data it was sent.
            table._process_events({"indices": [row]})
            shown = tab.session.crossover
            assert table.value["pair"].iloc[row] == "{}-{}".format(*shown.pair)
            assert table.value["pass"].iloc[row] == shown.pass_number
    table._process_events({"sorters": []})


def test_an_emptied_box_gets_its_number_back(tab):
    before = tab.offset_ms.value
    tab.offset_ms.value = None
    assert tab.offset_ms.value == before
    assert not tab.session.failed


def test_offsets_by_pair_stand_beside_each_other(tab):
    frame = tab.sets_page.pivot.frame.set_index("pair")
    by_set = {
        (s.pair, s.pass_number): f for s, f in zip(tab.session.gating.sets, tab.session.fits, strict=True)
    }
    offset, sigma = map(float, frame.loc["2-11", "pass 2 (ms)"].split("±"))
    assert offset == pytest.approx(1e3 * by_set[((2, 11), 2)].offset_s, abs=6e-4)
    assert sigma == pytest.approx(1e3 * by_set[((2, 11), 2)].sigma_offset_s, abs=6e-4)


def test_causes_of_one_set_alone(tab):
    tab.pages.choice.value = "Causes"
    tab.causes.scope.value = next(name for name in tab.causes.scope.options if "alone" in name)
    assert "is more than can be believed" in tab.causes.words.object
    assert "Of the causes alone the best is timing offset: offset 2.8" in tab.causes.words.object


def test_the_reports_own_table_gives_table_4(tab, data):
    tab.pages.choice.value = "Constancy"
    tab.constancy.source.value = "Read (1990), Table 1"
    frame = tab.constancy.runs.frame.set_index("run")
    assert list(frame.index) == [str(run) for run in range(1, 9)]
    assert frame.loc["3", "mean offset (ms)"].startswith("2.")
    assert "One offset is not enough for run" in tab.constancy.table_words.object
    tab.session.open_file("offsets.csv", (data / "read-1990" / "offsets.csv").read_bytes())
    assert "the OFFSETS.csv that is open" in tab.constancy.source.options


# -- Q, profile, edits ----------------------------------------------------------------------------


def test_q_is_drawn_about_the_estimate_with_its_ellipse(tab):
    correction = tab.session.correction
    assert tab.q.best.data["x"] == [pytest.approx(1e3 * correction.offset_s)]
    reach = np.ptp(tab.q.ring.data["x"]) / 2
    assert reach == pytest.approx(1e3 * correction.sigma_offset_s * np.sqrt(5.991), rel=5e-3)
    tab.pages.choice.value = "Q"
    tab.offset_ms.value = 2.0
    assert tab.q.now.data["x"] == [2.0]


def test_a_dragged_point_of_the_profile_is_an_edit(tab):
    tab.pages.choice.value = "Profile"
    before, offset = tab.session.profile, tab.session.correction.offset_s
    data = dict(tab.profile_page.views.points.data)
    tab.profile_page.views.points.data = {**data, "speed": data["speed"] + 40.0}
    assert tab.session.profile.speed == pytest.approx(before.speed + 40.0)
    assert tab.session.correction.offset_s != offset
    assert "edited here" in tab.profile_page.words.object
    assert "Ctrl+Z undoes" in tab.session.message
    tab.session.undo()
    assert tab.session.profile is before
    assert tab.session.correction.offset_s == pytest.approx(offset)


def test_depths_that_do_not_grow_are_told_and_not_taken(tab):
    tab.pages.choice.value = "Profile"
    before = tab.session.profile
    data = {name: column.copy() for name, column in tab.profile_page.views.points.data.items()}
    data["depth"][3] = data["depth"][4]
    tab.profile_page.views.points.data = data
    assert tab.session.failed
    assert "must grow" in tab.session.message
    assert tab.session.profile is before
    assert np.array_equal(tab.profile_page.views.points.data["depth"], before.depth)


def test_an_uploaded_profile_in_metres_is_asked_about(tab):
    tab.pages.choice.value = "Profile"
    tab.profile_page._upload(b"0 1500\n25 1499\n")
    assert "Is the file in metres?" in tab.session.message
    tab.profile_page.layout.value = "metres"
    tab.profile_page._upload(b"depth_m,speed_mps\n0,1490\n500,1485\n")
    assert tab.session.profile.depth[-1] == pytest.approx(1640.4, abs=0.1)


def test_a_profile_in_metres_that_is_opened_by_the_menu_is_told_where_to_open(tab):
    before = tab.session.profile
    with pytest.raises(InputError, match="Timing, Profile"):
        tab.session.open_file("VELOCITY.DAT", b"0 1488\n10 1487\n20 1486\n")
    assert tab.session.profile is before


def test_a_profile_that_ends_above_an_array_is_told_beside_the_offset(tab):
    assert "the profile ends" not in tab.words.object.lower()
    tab.profile_page.layout.value = "boundary"
    tab.profile_page._upload(b"depth_ft,speed_ft_per_s\n0,4880\n500,4900\n")
    assert "The profile ends at 500 ft, and arrays 3, 12 stand deeper" in tab.words.object


def test_points_left_out_in_the_other_tab_count_here_too(tab):
    session = tab.session
    before = session.correction
    session.edit(edits=session.edits.exclude(session.crossover, range(10), session.gating.mode, "noise"))
    assert session.correction.points < before.points
    assert (tab.views.points.data["used"][:10] == "left out by hand").all()
    row = tab.sets_page.table.value.loc[session.gating.sets.index(session.crossover)]
    assert row["T"] == session.correction.points


def test_how_it_is_fitted_can_be_chosen_and_undone(tab):
    tab.method.value = "joint"
    assert tab.session.correction.method == "joint"
    tab.session.undo()
    assert tab.session.correction.method == "report"
    assert tab.method.value == "report"


# -- applying -------------------------------------------------------------------------------------


def test_the_corrected_copy_and_the_merged_track_read_back(tab):
    tab.pages.choice.value = "Apply"
    assert "the step where one array hands the track to the next shrinks from" in tab.apply_page.words.object
    session = tab.session
    copy = parse_tfile(tab.apply_page.tfile_copy().getvalue(), "copy.dat", header_records=None)
    assert "CORRECTED COPY" in copy.header[0]
    assert "SIMULATED" in copy.header[0]
    gated = gate_reports(copy.reports, session.survey, 7)
    assert abs(np.median(gated.sets[0].gap, axis=0)).max() < 2
    assert np.array_equal(copy.reports.position[copy.reports.mode == 2], session.tfile.reports.position[
        session.tfile.reports.mode == 2])  # fmt: skip
    text = tab.apply_page.run_file(run_track_csv).getvalue().decode()
    assert text.startswith("# SIMULATED DATA\n# tracker workbench")
    assert len(text.splitlines()) == 3 + len(tab.apply_page.run.track)
    hand_overs = tab.apply_page.run_file(hand_overs_csv).getvalue().decode()
    assert len(hand_overs.splitlines()) == 3 + len(tab.apply_page.run.hand_overs)


# -- bad input ------------------------------------------------------------------------------------


def a_set(counts, depth=-300.0):
    counts = np.asarray(counts)
    x = np.column_stack([8000 + 40.0 * counts, 1500 + 900.0 + 0 * counts, np.full(len(counts), depth)])
    return CrossoverSet((1, 2), counts, x, x + np.array([3.0, 1.0, 0.0]))


def test_two_points_give_an_offset_without_sigma(tab):
    tab.session.param.update(correction=None, crossover=a_set([3, 4]))
    assert "too few for a sigma" in tab.words.object
    assert not tab.session.failed, tab.session.message


def test_all_points_left_out_is_a_sentence(tab):
    session = tab.session
    rows = range(session.crossover.points)
    session.edit(edits=session.edits.exclude(session.crossover, rows, session.gating.mode, "all"))
    assert "No offset can be told" in tab.words.object
    assert tab.numbers.object == ""
    assert not session.failed, session.message
    session.undo()
    assert "Transit times were too short" in tab.words.object


def test_a_target_below_the_array_and_rays_that_turn_are_told(tab):
    tab.session.param.update(correction=None, crossover=a_set(range(40), depth=-1300.0))
    tab.pages.choice.value = "Profile"
    assert not tab.session.failed, tab.session.message
    assert "lie deeper than the array" in tab.profile_page.words.object
    steep = SoundSpeedProfile(np.array([0.0, 1200.0]), np.array([5400.0, 4600.0]))
    tab.session.param.update(profile=steep, crossover=a_set(range(90), depth=-20.0))
    assert "Refraction turns the rays away" in tab.words.object or "No offset can be told" in tab.words.object
    tab.profile_page.which.value = 1
    assert "No direct ray reaches" in tab.profile_page.words.object
    tab.profile_page.which.value = 0
    assert not tab.session.failed, tab.session.message


def test_an_array_that_the_table_lacks_is_named_where_the_answer_would_stand(tab):
    lost = CrossoverSet((1, 99), np.arange(9), np.zeros((9, 3)), np.ones((9, 3)))
    tab.session.param.update(correction=None, crossover=lost)
    assert "array 99 is not in the array table" in tab.words.object
    tab.session.param.update(correction=None, crossover=tab.session.gating.sets[0])
    assert "Transit times" in tab.words.object


def test_sets_opened_from_files_need_no_tfile(data):
    session = Session()
    source = Session()
    source.open_range_demo()
    folder = data / "range-demo"
    for name in ("arrays.csv", "VELOCITY.DAT"):
        session.open_file(name, (folder / name).read_bytes())
    for one in source.gating.sets[:4]:
        session.open_file(crossover_file_name(one), crossover_text(one).encode())
    tab = TimingTab(session=session)
    tab.activate()
    assert not session.failed, session.message
    assert len(tab.sets_page.table.value) == 4
    assert "One offset serves the run" in tab.run_words.object
    tab.pages.choice.value = "Apply"
    assert "sets alone hold no whole run" in tab.apply_page.words.object
