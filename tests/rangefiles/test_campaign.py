"""Campaign files: JSON and TOML, errors by key, and one selection from T-files to the table of offsets."""

import csv
import json
import shutil

import pytest

from trackerlib.commands import main
from trackerlib.rangefiles.campaign import read_campaign, write_campaign
from trackerlib.textfiles import InputError

RUN = {"day": 1, "run": "3", "tfile": "tfile.dat", "mode": 7, "vehicle": "MK 30"}
CAMPAIGN = {"name": "June", "arrays": "arrays.csv", "profiles": {"1": "VELOCITY.DAT"}, "runs": [RUN]}


@pytest.fixture
def folder(data, tmp_path):
    """The demo run with its first 3000 records."""
    for name in ("arrays.csv", "VELOCITY.DAT"):
        shutil.copy(data / "range-demo" / name, tmp_path)
    lines = (data / "range-demo/tfile.dat").read_text().splitlines(keepends=True)
    (tmp_path / "tfile.dat").write_text("".join(lines[:3031]))
    return tmp_path


def written(folder, content, name="campaign.json"):
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_day_settles_the_profile_and_a_run_may_have_its_own(folder):
    shutil.copy(folder / "VELOCITY.DAT", folder / "OTHER.DAT")
    other = {**RUN, "run": 4, "profile": "OTHER.DAT"}
    campaign = read_campaign(written(folder, {**CAMPAIGN, "runs": [RUN, other]}))
    assert [one.profile.name for one in campaign.runs] == ["VELOCITY.DAT", "OTHER.DAT"]
    assert (campaign.runs[0].day, campaign.runs[0].vehicle, campaign.name) == ("1", "MK 30", "June")
    assert [one.run for one in campaign.select(runs=["4"]).runs] == ["4"]


def test_toml_says_the_same(folder):
    toml = (
        'name = "June"\narrays = "arrays.csv"\n[profiles]\n1 = "VELOCITY.DAT"\n'
        '[[runs]]\nday = 1\nrun = "3"\ntfile = "tfile.dat"\nmode = 7\nvehicle = "MK 30"\n'
    )
    assert read_campaign(written(folder, toml, "c.toml")) == read_campaign(written(folder, CAMPAIGN))


def test_a_day_may_be_a_date_and_have_strokes(folder, capsys):
    toml = 'arrays = "arrays.csv"\n[profiles]\n1985-06-20 = "VELOCITY.DAT"\n[[runs]]\nday = 1985-06-20\n'
    path = written(folder, toml + 'run = 3\ntfile = "tfile.dat"\nmode = 7\n', "c.toml")
    assert read_campaign(path).runs[0].day == "1985-06-20"
    odd = {**RUN, "day": "6/20/85", "run": "../x"}
    path = written(folder, {**CAMPAIGN, "profiles": {"6/20/85": "VELOCITY.DAT"}, "runs": [odd]})
    assert main(["gate", "--campaign", str(path), "--out", str(folder / "sets")]) == 0
    (made,) = (folder / "sets").iterdir()
    assert any(made.glob("crossover_*.txt"))


def test_what_is_of_one_run_needs_one_run(folder, capsys):
    path = written(folder, {**CAMPAIGN, "runs": [RUN, {**RUN, "mode": 2}]})
    call = ["gate", "--campaign", str(path), "--out", str(folder / "sets")]
    assert main([*call, "--keep-line", "40"]) == 2
    assert "are of one run, found 2; choose it with --day, --run, --mode" in capsys.readouterr().err
    assert main([*call, "--keep-line", "40", "--mode", "2"]) == 0
    assert [one.name for one in (folder / "sets").iterdir()] == ["day_1_run_3_mode_2"]
    assert main([*call, "--header-records", "20"]) == 2
    assert "header records itself" in capsys.readouterr().err


def test_what_is_written_is_read_back(folder):
    campaign = read_campaign(written(folder, CAMPAIGN))
    write_campaign(folder / "again.json", campaign)
    assert read_campaign(folder / "again.json") == campaign


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{", "wanted a campaign in JSON"),
        ("[1]", "found list"),
        ({**CAMPAIGN, "runs": []}, "key runs: found"),
        ({**CAMPAIGN, "runs": [RUN, 3]}, r"key runs\[2\]: found 3"),
        ({**CAMPAIGN, "runs": [{**RUN, "colour": 1}]}, r"key runs\[1\].colour: no such key"),
        ({**CAMPAIGN, "runs": [{"day": 1}]}, r"key runs\[1\].run: is missing"),
        ({**CAMPAIGN, "runs": [{**RUN, "mode": "seven"}]}, r"runs\[1\].mode: found 'seven', wanted a whole"),
        ({**CAMPAIGN, "runs": [{**RUN, "tfile": 7}]}, r"runs\[1\].tfile: found 7, wanted the name of a file"),
        ({**CAMPAIGN, "profiles": {}}, r"runs\[1\].profile: found None, wanted the name of a file"),
        (
            {**CAMPAIGN, "profile": "VELOCITY.DAT"},
            "key profile: no such key; there are arrays, name, profiles, runs",
        ),
        (
            {**CAMPAIGN, "runs": [{**RUN, "day": None}]},
            r"runs\[1\].day: found None, wanted a name or a number",
        ),
        ({**CAMPAIGN, "runs": [{**RUN, "run": ""}]}, r"runs\[1\].run: found '', wanted a name or a number"),
        ({**CAMPAIGN, "runs": [RUN, RUN]}, r"key runs\[2\]: day 1, run 3, mode 7 again"),
    ],
)
def test_a_campaign_that_is_none_is_refused_with_its_key(folder, content, words):
    with pytest.raises(InputError, match=words):
        read_campaign(written(folder, content))


def test_gate_and_timing_run_all_of_it(folder, capsys):
    path = written(folder, {**CAMPAIGN, "runs": [RUN, {**RUN, "mode": 2, "run": 4}]})
    assert main(["gate", "--campaign", str(path), "--out", str(folder / "sets"), "--json"]) == 0
    gated = json.loads(capsys.readouterr().out)["runs"]
    assert [one["run"] for one in gated] == ["3", "4"]
    sets = [one for run in gated for one in run["sets"]]
    assert main(["timing", "--campaign", str(path), "--out", str(folder / "offsets.csv"), "--json"]) == 0
    timed = json.loads(capsys.readouterr().out)["sets"]
    assert [(one["pair"], one["day"]) for one in timed] == [(one["pair"], "1") for one in sets]
    with (folder / "offsets.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(sets) > 3
    assert {row["run"] for row in rows} == {"3", "4"}
    assert {"day", "run", "pair", "offset_ms"} <= rows[0].keys()


def test_a_campaign_and_a_file_are_not_both_taken(folder, capsys):
    path = written(folder, CAMPAIGN)
    assert main(["gate", "x.dat", "--campaign", str(path), "--out", str(folder)]) == 2
    assert main(["gate", "--out", str(folder)]) == 2
    assert main(["timing", "x.txt", "--campaign", str(path)]) == 2
    assert main(["timing", "x.txt"]) == 2
    assert "wanted" in capsys.readouterr().err
