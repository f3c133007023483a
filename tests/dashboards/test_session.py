"""The session that tabs share: opening, undo, replay, saving. No server."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from dashboards.file_kinds import kind_of
from dashboards.open_dialog import TransponderChoice
from dashboards.opening import UPLOAD_LIMIT_MB
from dashboards.session import Session
from trackerlib.textfiles import InputError


@pytest.fixture
def hunt():
    session = Session()
    session.open_beacon_demo()
    return session


@pytest.fixture
def range_run():
    session = Session()
    session.open_range_demo()
    return session


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("beacon-demo/survey.csv", "survey"),
        ("beacon-demo/soundspeed.csv", "profile"),
        ("range-demo/tfile.dat", "tfile"),
        ("range-demo/VELOCITY.DAT", "velocity"),
        ("read-1990/offsets.csv", "offsets"),
        ("range-demo/arrays.csv", "arrays"),
    ],
)
def test_the_kind_of_a_file_is_seen_from_it(data, path, kind):
    assert kind_of((data / path).read_text().splitlines()) == kind


def test_the_kind_of_a_saved_session(hunt):
    assert kind_of(hunt.to_json().splitlines()) == "session"


def test_what_no_reader_reads_is_refused_in_words_and_changes_nothing(hunt):
    pings = hunt.pings
    unreadable = (b"", b"\x89PNG\r\n\x1a\n\x00", b"a shopping list\nbread\n")
    for content in (*unreadable, b'{"workbench_session": 1, "mode": "x"}'):
        with pytest.raises(InputError, match=r"^mine"):
            hunt.open_file("mine", content)
    assert hunt.pings is pings
    assert hunt.mode == 7


def test_an_upload_over_the_limit_is_refused_with_the_limit():
    class Huge(bytes):
        def __len__(self):
            return UPLOAD_LIMIT_MB * 1_000_000 + 1

    with pytest.raises(InputError, match=f"at most {UPLOAD_LIMIT_MB} MB"):
        Session().open_file("huge.dat", Huge())


def test_simulated_data_are_known_as_such(hunt, range_run):
    assert hunt.simulated
    assert range_run.simulated
    assert not Session().simulated


def test_undo_and_redo_take_back_and_repeat_edits(hunt):
    first = hunt.fix_settings
    hunt.edit(fix_settings=replace(first, left_out=frozenset({3})))
    hunt.edit(fix_settings=replace(first, left_out=frozenset({3, 4})))
    assert not hunt.fix.used[[2, 3]].any()
    hunt.undo()
    assert hunt.fix_settings.left_out == {3}
    hunt.undo()
    assert hunt.fix_settings is first
    hunt.undo()
    assert hunt.message == "Nothing to undo"
    hunt.redo()
    hunt.redo()
    assert hunt.fix_settings.left_out == {3, 4}
    hunt.redo()
    assert hunt.message == "Nothing to redo"


def test_an_edit_forgets_what_was_taken_back(hunt):
    first = hunt.fix_settings
    hunt.edit(fix_settings=replace(first, left_out=frozenset({3})))
    hunt.undo()
    hunt.edit(fix_settings=replace(first, left_out=frozenset({9})))
    hunt.redo()
    assert hunt.fix_settings.left_out == {9}


def test_the_replay_hears_pings_at_their_times(hunt):
    hunt.param.update(heard=0, speed=20)
    hunt.play()
    hunt.tick(1.0)
    elapsed = hunt.pings.elapsed_s
    assert hunt.heard == int((elapsed <= 20.0).sum())
    hunt.play()
    heard = hunt.heard
    hunt.tick(1.0)
    assert hunt.heard == heard
    hunt.speed = 1000
    hunt.play()
    for _ in range(int(elapsed[-1] / 1000) + 2):
        hunt.tick(1.0)
    assert hunt.heard == len(hunt.pings)
    assert not hunt.playing


def test_a_saved_session_brings_its_settings_back(hunt, range_run):
    for session in (hunt, range_run):
        session.param.update(max_slant_range_ft=4500.0, mode=2)
    hunt.edit(fix_settings=replace(hunt.fix_settings, left_out=frozenset({5}), max_range_m=4321.0))
    saved = hunt.to_json().encode()
    other = Session()
    other.open_beacon_demo()
    other.open_file("saved.json", saved)
    assert (other.max_slant_range_ft, other.mode) == (4500.0, 2)
    assert (other.fix_settings.left_out, other.fix_settings.max_range_m) == (frozenset({5}), 4321.0)
    assert json.loads(other.to_json())["fix_settings"] == json.loads(saved)["fix_settings"]


def test_the_chosen_set_comes_back(range_run):
    chosen = range_run.gating.sets[-1]
    range_run.crossover = chosen
    saved = range_run.to_json().encode()
    other = Session()
    other.open_range_demo()
    other.open_file("saved.json", saved)
    assert (other.crossover.pair, other.crossover.pass_number) == (chosen.pair, chosen.pass_number)


def test_gating_anew_keeps_the_chosen_set_where_it_can(range_run):
    chosen = range_run.gating.sets[1]
    range_run.crossover = chosen
    range_run.max_slant_range_ft = range_run.max_slant_range_ft - 1
    assert (range_run.crossover.pair, range_run.crossover.pass_number) == (chosen.pair, chosen.pass_number)


def test_a_large_tfile_is_read_and_gated_as_a_job(data, monkeypatch):
    small = Session()
    small.open_range_demo()
    monkeypatch.setattr("dashboards.opening.LARGE_BYTES", 1)
    monkeypatch.setattr("dashboards.session.LARGE_REPORTS", 1)
    large, begun = Session(), []
    start = large.jobs.start
    monkeypatch.setattr(
        large.jobs, "start", lambda purpose, *rest: (begun.append(purpose), start(purpose, *rest))
    )
    large.open_range_demo()
    assert begun[:2] == ["Opening tfile.dat", "Gating"]
    assert large.gating.counts == small.gating.counts
    assert large.crossover.pair == small.crossover.pair


def test_point_edits_and_options_come_back_with_the_session_file():
    session = Session()
    session.open_range_demo()
    edits = session.edits.exclude(session.crossover, [1, 2], session.gating.mode, "noise")
    session.param.update(edits=edits, timing_options={"method": "joint", "outliers": "in"})
    other = Session()
    other.open_range_demo()
    other.open_file("session.json", session.to_json().encode())
    assert other.edits == edits
    assert other.timing_options == {"method": "joint", "outliers": "in"}


def test_another_transponder_of_a_survey_is_chosen_in_the_head():
    session = Session()
    choice = TransponderChoice(session)
    rows = [f"{10 + k / 1000},20,{2 + k / 100},{'M12' if k % 3 else 'M11'}" for k in range(9)]
    content = "\n".join(["lat_deg,lon_deg,oneway_s,transponder", *rows]).encode()
    session.open_file("two.csv", content)
    assert (len(session.pings), choice.pane.value, list(choice.pane.options)) == (3, "M11", ["M11", "M12"])
    assert choice.pane.visible
    assert "another of its 2 transponders" in session.message
    choice.pane.value = "M12"
    assert (len(session.pings), session.transponder, choice.pane.value) == (6, "M12", "M12")
    session.open_beacon_demo()
    assert not choice.pane.visible


def test_a_profile_that_a_tfile_replaces_is_named(data):
    session = Session()
    for name in ("VELOCITY.DAT", "tfile.dat"):
        session.open_file(name, (data / "range-demo" / name).read_bytes())
    assert "takes the place of VELOCITY.DAT" in session.message
    assert session.profile.name != "VELOCITY.DAT"
