"""A campaign opened in the page: one choice of day, run and vehicle for every tab."""

from __future__ import annotations

import csv
import json
import shutil

import pytest

from dashboards.open_dialog import OpenDialog, RunChoice
from dashboards.session import Session
from dashboards.tabs.crossover import CrossoverTab
from dashboards.tabs.timing import TimingTab

RUNS = [
    {"day": "2 June", "run": "3", "tfile": "first.dat", "mode": 7, "vehicle": "MK 30"},
    {"day": "2 June", "run": "3", "tfile": "first.dat", "mode": 2, "vehicle": "ship"},
    {"day": "3 June", "run": "4", "tfile": "second.dat", "mode": 7, "vehicle": "MK 30"},
    {"day": "4 June", "run": "5", "tfile": "second.dat", "mode": 7, "vehicle": "MK 48"},
]


@pytest.fixture
def campaign(data, tmp_path):
    """A campaign file; the profile of its last day is none."""
    shutil.copy(data / "range-demo" / "arrays.csv", tmp_path)
    lines = (data / "range-demo" / "tfile.dat").read_text().splitlines(keepends=True)
    rows = (data / "range-demo" / "VELOCITY.DAT").read_text().splitlines(keepends=True)
    (tmp_path / "first.dat").write_text("".join(lines[:4031]))
    (tmp_path / "second.dat").write_text("".join([*lines[:31], *lines[6031:10031]]))
    (tmp_path / "VELOCITY2.DAT").write_text("".join(rows))
    (tmp_path / "VELOCITY3.DAT").write_text("".join([*rows[:8], *rows[12:]]))
    (tmp_path / "VELOCITY4.DAT").write_text("".join(rows[::-1]))
    profiles = {f"{day} June": f"VELOCITY{day}.DAT" for day in (2, 3, 4)}
    path = tmp_path / "june.json"
    path.write_text(json.dumps({"name": "June", "arrays": "arrays.csv", "profiles": profiles, "runs": RUNS}))
    return path


@pytest.fixture
def session(campaign):
    session = Session()
    session.open_path(str(campaign))
    return session


def test_its_path_opens_the_first_run_with_the_files_of_that_day(session):
    assert "day 2 June, run 3, MK 30 (mode 7): " in session.message
    assert (session.tfile.reports.source, session.profile.name, session.mode) == (
        "first.dat",
        "VELOCITY2.DAT",
        7,
    )
    assert len(session.gating.sets) > 3


def test_one_choice_of_the_run_serves_every_tab(session):
    choice, tabs = RunChoice(session), (CrossoverTab(session=session), TimingTab(session=session))
    choice.show()
    for tab in tabs:
        tab.activate()
    assert list(choice.pane.options) == [
        "day 2 June, run 3, MK 30 (mode 7)", "day 2 June, run 3, ship (mode 2)", "day 3 June, run 4, MK 30 (mode 7)",
        "day 4 June, run 5, MK 48 (mode 7)",
    ]  # fmt: skip
    choice.pane.value = 2
    assert session.tfile.reports.source == "second.dat"
    assert "gap in the depths from 175 to 300 ft" in session.message
    assert "both saw the torpedo" in tabs[0].words.object
    assert len(tabs[1].sets_page.table.value) == len(session.gating.sets)
    text = tabs[1].export()[1]
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    assert {(row["day"], row["run"]) for row in rows} == {("3 June", "4")}
    tabs[1].pages.choice.value = "Constancy"
    table = tabs[1].constancy.chosen_table()
    assert set(zip(table.day.tolist(), table.run.tolist(), strict=True)) == {("3 June", "4")}


def test_another_vehicle_of_the_same_file_is_its_run(session):
    choice = RunChoice(session)
    choice.show()
    session.mode = 2
    assert session.campaign_run.vehicle == "ship"
    assert choice.pane.value == 1
    session.mode = 8
    assert choice.pane.value is None
    choice.pane.value = 0
    assert session.mode == 7


def test_points_left_out_belong_to_their_run(session):
    session.edit(edits=session.edits.exclude(session.crossover, [1, 2], 7, "turning"))
    session.open_run(session.campaign.runs[2])
    assert len(session.edits) == 0
    session.undo()
    assert session.message == "Nothing to undo"
    session.open_run(session.campaign.runs[0])
    assert len(session.edits) == 2


def test_a_run_whose_files_are_no_use_is_told_and_the_last_one_stays(session):
    choice = RunChoice(session)
    choice.show()
    choice.pane.value = 3
    assert session.failed
    assert "day 4 June, run 5, MK 48 (mode 7): VELOCITY4.DAT, line 2: found depth 1300 ft" in session.message
    assert (choice.pane.value, session.campaign_run.run) == (0, "3")
    choice.pane.value = 2
    assert not session.failed


def test_a_campaign_whose_first_run_is_no_use_opens_the_next(campaign):
    (campaign.parent / "first.dat").unlink()
    session = Session()
    session.open_path(str(campaign))
    assert session.campaign_run.run == "4"
    (campaign.parent / "arrays.csv").write_text("")
    dialog = OpenDialog(Session())
    dialog.pane.open = True
    dialog.path.value_input = str(campaign)
    dialog._typed()
    assert dialog.pane.open
    assert "June: no run is of use; day 2 June, run 3" in dialog.session.message


def test_a_campaign_that_was_dropped_says_what_to_do(campaign):
    session = Session()
    dialog = OpenDialog(session)
    dialog.pane.open = True
    dialog.dropper.value = {"june.json": campaign.read_bytes()}
    assert "key runs[1].tfile: first.dat is beside the campaign file" in session.message
    assert "type the campaign's own path under Open" in session.message
    assert dialog.pane.open
    assert dialog.trouble.visible
    assert "first.dat is beside the campaign file" in dialog.trouble.object
    dialog.path.value_input = f" '{campaign}' "
    dialog._typed()
    assert not dialog.pane.open
    assert session.campaign.name == "June"


def test_a_dropped_campaign_of_whole_paths_is_opened(campaign):
    content = json.loads(campaign.read_text())
    folder = campaign.parent
    content["arrays"] = str(folder / "arrays.csv")
    content["profiles"] = {day: str(folder / name) for day, name in content["profiles"].items()}
    for one in content["runs"]:
        one["tfile"] = str(folder / one["tfile"])
    session = Session()
    session.open_file("june.json", json.dumps(content).encode())
    assert session.campaign_run.run == "3"


def test_other_files_are_opened_by_their_path_too_and_close_the_campaign(session, data, tmp_path):
    session.open_path(str(data / "range-demo" / "tfile.dat"))
    assert (session.campaign, session.campaign_run) == (None, None)
    assert session.day_and_run == ("unknown", "tfile mode 7")
    dialog = OpenDialog(session)
    for path, words in ((tmp_path / "none.dat", "no such file"), (tmp_path, "found a folder, wanted a file")):
        dialog.path.value_input = str(path)
        dialog._typed()
        assert words in session.message
