"""The convergence log: every stage is there, and its last step is where the fix is."""

from __future__ import annotations

import json

import numpy as np
import pytest
from surveys import BOX, LINE, survey

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.settings import FixSettings
from trackerlib.commands import main
from trackerlib.simulation.beacon_survey import Errors

BEACON = (100.0, 50.0, -2400.0)
ERRORS = Errors(gps_rms_m=3.0, time_rms_s=5e-4, false_returns=3)


@pytest.mark.parametrize(("gps_rms_m", "last"), [(None, "settle"), (3.0, "unbiased")])
def test_the_log_ends_where_the_fix_is(gps_rms_m, last):
    fix = fix_beacon(survey(BOX, BEACON, ERRORS), FixSettings(gps_rms_m=gps_rms_m))
    stages = list(dict.fromkeys(step.stage.split()[0] for step in fix.log))
    assert stages == (["search", "settle"] if last == "settle" else ["search", "settle", "unbiased"])
    assert fix.log[-1].position == pytest.approx(fix.position, abs=1e-3)
    assert fix.log[-1].pings == fix.used.sum()
    settling = [step for step in fix.log if step.stage.startswith("settle")]
    assert settling[-1].step_m < 1e-3 < settling[0].step_m
    assert all(step.iteration == k for k, step in enumerate(settling[:3], 1))


def test_the_rms_is_that_of_the_residuals():
    fix = fix_beacon(survey(BOX, BEACON, ERRORS), FixSettings())
    assert fix.log[-1].rms_ms == pytest.approx(1e3 * fix.uncertainty.rms_s, rel=1e-6)


def test_a_straight_track_and_experiments_have_one_too():
    line = fix_beacon(survey(LINE, BEACON, ERRORS), FixSettings())
    assert line.position is None
    assert any("line" in step.stage for step in line.log)
    fix = fix_beacon(survey(BOX, BEACON), FixSettings(method="pairs"))
    assert "experiments" in fix.log[-1].stage
    assert fix.log[-1].position == pytest.approx(fix.position, abs=1e-6)


def test_the_command_prints_it_when_asked(tmp_path, capsys):
    pings = survey(BOX, BEACON, ERRORS)
    rows = zip(pings.lat_deg, pings.lon_deg, pings.travel_time_s, strict=True)
    file = tmp_path / "pings.csv"
    file.write_text("lat_deg,lon_deg,oneway_s\n" + "\n".join(f"{a:.9f},{o:.9f},{t:.6f}" for a, o, t in rows))
    assert main(["fix", str(file), "--json"]) == 0
    assert "log" not in json.loads(capsys.readouterr().out)
    assert main(["fix", str(file), "--json", "--log"]) == 0
    log = json.loads(capsys.readouterr().out)["log"]
    assert log[0]["stage"].startswith("search")
    assert np.isfinite([step["east_m"] for step in log]).all()
    assert main(["fix", str(file), "--log"]) == 0
    assert capsys.readouterr().out.count("step ") == len(log)
