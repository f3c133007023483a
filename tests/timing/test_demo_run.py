"""The simulated range run that comes with the program: its true offsets are known."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from trackerlib.commands import main
from trackerlib.crossover.gating import gate_reports
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.covariance_files import write_covariances
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.timing.correction import fit_timing
from trackerlib.timing.one_run import judge_run, offsets_agree

WRONG_ARRAY = 5  # surveyed in the wrong place on purpose


@pytest.fixture(scope="module")
def scores(data):
    """Error of every offset over its stated sigma, and whether the wrongly surveyed array took part."""
    folder = data / "range-demo"
    reports, survey = read_tfile(folder / "tfile.dat").reports, read_arrays(folder / "arrays.csv").survey
    profile = read_velocity(folder / "VELOCITY.DAT").profile
    found = []
    for vehicle in json.loads((folder / "truth.json").read_text())["vehicles"]:
        for one in gate_reports(reports, survey, vehicle["mode"]).sets:
            fit = fit_timing(one, survey, profile)
            if fit.sigma_offset_s is not None:
                drifted = vehicle["drift_ms_per_pc"] * (fit.t0 - vehicle["ref_pc"])
                error_ms = 1e3 * fit.offset_s - vehicle["delta_ms_at_ref"] - drifted
                found.append((error_ms / (1e3 * fit.sigma_offset_s), WRONG_ARRAY in one.pair))
    return np.array(found)


def test_every_offset_is_within_four_sigma(scores):
    assert len(scores) > 80
    assert np.abs(scores[scores[:, 1] == 0, 0]).max() < 4


def test_as_many_offsets_lie_within_1_96_sigma_as_95_percent_allows(scores):
    good = scores[scores[:, 1] == 0, 0]
    inside = int((np.abs(good) < 1.96).sum())
    assert inside >= stats.binom.ppf(0.025, len(good), 0.95)


def test_the_wrongly_surveyed_array_stands_out(scores):
    assert np.median(np.abs(scores[scores[:, 1] == 1, 0])) > 5


@pytest.fixture
def sets(tmp_path, data, capsys):
    folder = data / "range-demo"
    args = ["gate", folder / "tfile.dat", "--arrays", folder / "arrays.csv", "--mode", "7", "--out", tmp_path]
    assert main([*map(str, args), "--json"]) == 0
    capsys.readouterr()
    return sorted(tmp_path.glob("crossover_*.txt"))


def timing(data, *args):
    folder = data / "range-demo"
    return [
        "timing", *map(str, args), "--arrays", str(folder / "arrays.csv"), "--profile", str(folder / "VELOCITY.DAT")
    ]  # fmt: skip


def test_the_command_gives_what_the_function_gives(sets, data, capsys, tmp_path):
    out = tmp_path / "offsets.csv"
    assert main([*timing(data, *sets), "--json", "--day", "1", "--run", "2", "--out", str(out)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["simulated"] is True
    assert len(document["sets"]) == len(sets)
    rows = out.read_text().splitlines()
    assert rows[0].startswith("day,run,pair,offset_ms,sigma_offset_ms")
    assert len(rows) == 1 + len(sets)
    few = [one for one in document["sets"] if one["sigma_offset_ms"] is None]
    assert few
    assert all("too few" in one["reason"] and one["M_ft2"] is None for one in few)


def test_a_covariance_that_is_told_replaces_the_estimate(sets, data, capsys, tmp_path):
    matrix = tmp_path / "MMATRIX.M"
    matrix.write_text("4 0 0\n0 4 0\n0 0 4\n")
    assert main([*timing(data, sets[0]), "--json", "--covariance", str(matrix)]) == 0
    assert json.loads(capsys.readouterr().out)["sets"][0]["M_ft2"] == [[4, 0, 0], [0, 4, 0], [0, 0, 4]]
    write_covariances(tmp_path, 2 * np.eye(3), 3 * np.eye(3), np.zeros((3, 3)))
    assert main([*timing(data, sets[0]), "--json", "--covariance", str(tmp_path)]) == 0
    assert json.loads(capsys.readouterr().out)["sets"][0]["M_ft2"] == [[5, 0, 0], [0, 5, 0], [0, 0, 5]]


def test_the_report_for_a_person(sets, data, capsys):
    assert main(timing(data, *sets[:3], "--causes")) == 0
    assert "±" in (out := capsys.readouterr().out)
    assert "SIMULATED data" in out
    assert "what fits all sets together: timing offset\n    offset (s): 0.0028" in out


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([], "no crossover set given"),
        (["none.txt"], "none.txt: no such file"),
        (["--set", "x.txt", "one", "2"], "two array numbers"),
    ],
)
def test_wrong_calls_end_with_2_and_words(args, words, data, capsys):
    assert main(timing(data, *args)) == 2
    assert words in capsys.readouterr().err


def test_an_array_that_the_table_lacks_is_named(sets, data, capsys, tmp_path):
    bare = tmp_path / "bare.txt"
    bare.write_text("\n".join(sets[0].read_text().splitlines()[1:]) + "\n")
    assert main(timing(data, "--set", bare, 98, 99)) == 2
    assert "98" in capsys.readouterr().err


@pytest.mark.parametrize("mode", [7, 2])
def test_one_offset_serves_a_vehicle_unless_the_wrong_array_takes_part(data, mode):
    folder = data / "range-demo"
    survey = read_arrays(folder / "arrays.csv").survey
    profile = read_velocity(folder / "VELOCITY.DAT").profile
    sets = gate_reports(read_tfile(folder / "tfile.dat").reports, survey, mode).sets
    fits = [(one.pair, fit_timing(one, survey, profile)) for one in sets]
    sure = [(pair, fit) for pair, fit in fits if fit.sigma_offset_s is not None]

    def judged(chosen):
        columns = np.array([(fit.offset_s, fit.sigma_offset_s, fit.t0) for _, fit in chosen]).T
        # Vehicle 7's clock does not drift; vehicle 2's does, by 0.0002 ms a count.
        return offsets_agree(*columns, drift=mode == 2)

    good = judged([one for one in sure if WRONG_ARRAY not in one[0]])
    low, high = stats.chi2.ppf([0.025, 0.975], good.dof)
    assert good.dof > 30
    assert low < good.distance < high
    assert judged(sure).p_value < 1e-6


def test_without_the_wrong_array_one_offset_serves_and_with_it_none_does(data):
    folder = data / "range-demo"
    reports, survey = read_tfile(folder / "tfile.dat").reports, read_arrays(folder / "arrays.csv").survey
    profile = read_velocity(folder / "VELOCITY.DAT").profile
    sets = gate_reports(reports, survey, 7).sets
    verdict = judge_run(sets, [fit_timing(one, survey, profile) for one in sets])
    assert verdict.whole.p_value < 1e-12
    assert verdict.simplest is verdict.without[0]
    assert verdict.simplest.left_out == WRONG_ARRAY
    band = stats.chi2.ppf([0.025, 0.975], verdict.simplest.dof)
    assert band[0] < verdict.simplest.distance < band[1]
    assert abs(1e3 * verdict.simplest.offset_s - 2.85) < 3 * 1e3 * verdict.simplest.sigma_offset_s
    assert verdict.without[1].p_value < 1e-12
