"""The constancy test: Table 4 of the report, and p-values that are what they say."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from trackerlib.commands import main
from trackerlib.rangefiles.offsets_file import parse_offsets, read_offsets
from trackerlib.textfiles import InputError
from trackerlib.timing.constancy import Variances, estimated_variances, pair_effects, runs_constant
from trackerlib.timing.offsets import OffsetTable

RUN_SIZES = (7, 2, 10, 14, 8, 7, 8, 13)
REPORT = Variances(
    0.3571e-6, 0.7207e-6, 0.2430e-6
)  # (22), which the text calls seconds squared: they are ms^2


@pytest.fixture(scope="module")
def table(data) -> OffsetTable:
    """Table 1."""
    return read_offsets(data / "read-1990/offsets.csv")[0]


@pytest.fixture(scope="module")
def printed(data) -> dict[str, dict]:
    """Table 4 by run."""
    lines = (data / "read-1990/constancy.csv").read_text().splitlines()
    return {row["run"]: row for row in csv.DictReader(line for line in lines if not line.startswith("#"))}


def test_means_of_all_eight_runs_are_as_printed(table, printed):
    for test in runs_constant(table, REPORT):
        assert 1e3 * test.mean_s == pytest.approx(float(printed[test.name]["mean_offset_ms"]), abs=0.0051)


@pytest.mark.parametrize("run", ["1", "2", "7"])
def test_distance_and_p_are_as_printed_within_the_rounding_of_the_offsets(table, printed, run):
    rows = table.runs[run]
    test = next(test for test in runs_constant(table, REPORT) if test.name == run)
    wanted = float(printed[run]["distance"])
    # Each offset is printed to 0.01 ms, so the distance of the true ones may lie this far from ours.
    apart = np.abs(table.offset_s[rows] - table.offset_s[rows].mean())
    rounding = 2 * 0.005e-3 * apart.sum() / REPORT.residual
    assert test.distance == pytest.approx(wanted, abs=rounding + 0.005)
    assert test.p_value == pytest.approx(float(printed[run]["p_value"]), rel=0.06, abs=0.0051)
    assert test.dof == int(printed[run]["dof"])
    assert test.distance_over_sd == pytest.approx(float(printed[run]["distance_over_sd"]), abs=0.03)


def simulated(seed: int, pair_sigma: float = 0.0) -> OffsetTable:
    """A table with the report's variances whose pairs share one offset unless told."""
    rng = np.random.default_rng(seed)
    run = np.repeat(np.arange(8), RUN_SIZES)
    pair = rng.integers(0, 11, len(run))
    effects = (rng.normal(0, 0.36**0.5, 4)[run // 2], rng.normal(0, 0.72**0.5, 8)[run])
    offset = sum(effects) + rng.normal(0, 0.243**0.5, len(run)) + rng.normal(0, pair_sigma, 11)[pair]
    return OffsetTable(
        (run // 2).astype(str), run.astype(str), pair.astype(str), 1e-3 * offset, simulated=True
    )


def test_p_values_that_allow_for_estimated_variances_are_uniform_where_one_offset_serves():
    runs, pairs, alike = [], [], []
    for seed in range(60):
        table = simulated(seed)
        variances = estimated_variances(table)
        runs += [test.p_value_estimated for test in runs_constant(table, variances) if test.dof]
        effects = pair_effects(table, variances)
        pairs += [test.p_value_estimated for test in effects.coherence if test.dof]
        alike.append(effects.all_alike.p_value_estimated)
    for values in (np.array(runs), np.array(pairs), np.array(alike)):
        for level in (0.05, 0.2, 0.5):
            assert np.mean(values < level) == pytest.approx(
                level, abs=4 * np.sqrt(level * (1 - level) / len(values))
            )


def test_pairs_that_differ_are_found():
    table = simulated(1, pair_sigma=1.5)
    variances = estimated_variances(table)
    assert pair_effects(table, variances).all_alike.p_value_estimated < 1e-3
    assert sum(test.p_value_estimated < 0.05 for test in runs_constant(table, variances)) >= 5


def test_pair_effects_are_generalised_least_squares():
    table = simulated(2, pair_sigma=1.0)
    effects = pair_effects(table, REPORT)
    day, run = (np.equal.outer(column, np.unique(column)).astype(float) for column in (table.day, table.run))
    covariance = REPORT.residual * np.eye(69) + REPORT.day * day @ day.T + REPORT.run * run @ run.T
    columns = np.equal.outer(table.pair, np.array(effects.pair)).astype(float)
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    direct = np.linalg.lstsq(root @ columns, root @ table.offset_s, rcond=None)[0]
    assert effects.effect_s == pytest.approx(direct, abs=1e-12)


def test_a_run_of_one_pair_has_nothing_to_test():
    table = OffsetTable(
        np.array(["1"] * 2), np.array(["1", "2"]), np.array(["a", "b"]), np.array([1e-3, 2e-3])
    )
    first = runs_constant(table, REPORT)[0]
    assert (first.dof, first.distance, first.p_value, first.distance_over_sd) == (0, 0.0, 1.0, 0.0)


def test_runs_of_two_days_with_one_name_stay_two_runs():
    table, _ = parse_offsets(["day,run,pair,offset_ms", "1,1,a,1.0", "2,1,a,2.0"], "o.csv")
    assert list(table.runs) == ["1/1", "2/1"]


def test_bad_rows_are_named_and_the_rest_kept():
    table, bad = parse_offsets(
        ["day,run,pair,offset_ms", "1,1,a,1.0", "1,1,b,", "1,,c,2", "1,1,d,nan"], "o.csv"
    )
    assert len(table) == 1
    assert [record.line for record in bad] == [3, 4, 5]
    assert "offset_ms holds ''" in bad[0].why
    with pytest.raises(InputError, match="no column pair"):
        parse_offsets(["day,run,offset_ms", "1,1,2"], "o.csv")


def test_the_command_answers_and_refuses(tmp_path, data, capsys):
    assert (
        main(
            [
                "constancy",
                str(data / "read-1990/offsets.csv"),
                "--variances",
                "0.3571,0.7207,0.2430",
                "--json",
            ]
        )
        == 0
    )
    answer = json.loads(capsys.readouterr().out)
    assert answer["runs"][0]["mean_offset_ms"] == pytest.approx(0.613, abs=1e-3)
    assert not answer["estimated"]
    assert main(["constancy", str(data / "read-1990/offsets.csv")]) == 0
    out = capsys.readouterr().out
    assert "take up every day" in out
    assert "day                -   cannot be told" in out
    assert "pairs of one offset only, which have nothing to hang together with: 55" in out
    (tmp_path / "one.csv").write_text("day,run,pair,offset_ms\n1,1,a,2.0\n")
    assert main(["constancy", str(tmp_path / "one.csv")]) == 2
    assert "--variances" in capsys.readouterr().err
