"""The thesis's conclusions, each held against rows that bear it out and rows that contradict it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackerlib.simulation.claims import claims, steepness
from trackerlib.simulation.study import study_points

NOISE = 0.01


def rows(error, now_bound, speed_mps=1.0):
    """Rows of the whole study whose error in space is error(scenario, sweep, x), and the present position's bound."""
    rng = np.random.default_rng(1)
    made = []
    for point in study_points(methods=("thesis",), gps_rms_m=(3.0, 25.0)):
        size = error(point.scenario, point.sweep, point.abscissa) * point.gps_rms_m
        size *= 1 + NOISE * rng.standard_normal()
        row = {name: getattr(point, name) for name in ("scenario", "sweep", "experiments", "spacing")}
        row |= {"gps_rms_m": point.gps_rms_m, "speed_mps": speed_mps, "rmse_3d_m": size}
        duration = 2.0 * point.experiments * point.spacing
        for axis, share in zip("xyz", (0.3, 0.3, 0.9), strict=True):
            row |= {f"rmse.{axis}": size * share, f"rmse.v{axis}": size * share / duration}
            row |= {f"rmse_now.{axis}": 1.1 * size * share, f"crlb_now.{axis}": now_bound(point.abscissa)}
        made.append(row)
    return pd.DataFrame(made)


def held(table):
    return {claim.words: claim for claim in claims(table)}


def as_the_thesis_says(scenario, sweep, x):
    """Fast to the knee, slow past it, fast again past the place that scenarios 2 and 3 are passed at."""
    knee = {"experiments": 20, "spacing": 35} if scenario <= 3 else {"experiments": 30, "spacing": 45}
    passed = {2: {"experiments": 40, "spacing": 65}, 3: {"experiments": 45, "spacing": 75}}.get(scenario)
    size = (1 if scenario == 1 else 2) * (1 if scenario <= 3 else 1 if scenario == 5 else 4)
    size *= min(x / knee[sweep], 1.0) ** -2 * max(x / knee[sweep], 1.0) ** -0.2
    return size * (max(x / passed[sweep], 1.0) ** -4 if passed else 1.0)


def test_a_study_as_the_thesis_describes_it_bears_out_every_conclusion():
    found = held(rows(as_the_thesis_says, lambda x: 1.0 + 0.001 * x))
    assert len(found) == 17
    wrong = [str(claim) for claim in found.values() if not claim.holds]
    assert not wrong


def test_a_plain_power_law_has_no_knee_and_no_gain_past_a_place():
    found = held(rows(lambda scenario, sweep, x: 1 / x, lambda x: 1 / x))
    bends = [claim for words, claim in found.items() if "then slowly" in words or "helps, past" in words]
    assert len(bends) == 8
    assert not [str(claim) for claim in bends if claim.holds]
    worse = next(claim for words, claim in found.items() if "longer collection" in words)
    assert worse.holds is False
    assert "0 of 12 curves" in worse.found


def test_what_does_not_hold_says_why_with_the_ship_s_way():
    words = "The leg over the beacon helps, past 40 experiments (4.3.2)."
    claim = held(rows(lambda scenario, sweep, x: 1 / x, lambda x: 1 / x, speed_mps=5.0))[words]
    assert "at 5 m/s the ship is there after 3500 m, and has sailed 18000 m by then" in str(claim)


def test_rows_of_one_scenario_leave_the_others_not_told():
    table = rows(as_the_thesis_says, lambda x: 1.0)
    found = held(table[table.scenario == 2])
    untold = [words for words, claim in found.items() if claim.holds is None]
    assert len(untold) == 9
    assert not any("beacon 2" in words or "leg over" in words for words in untold)


def test_steepness_is_a_power_with_its_sigma():
    x = np.arange(5.0, 40.0)
    noise = 0.02 * np.random.default_rng(2).standard_normal(len(x))
    power, sigma = steepness(x, 7 * x**-1.3 * np.exp(noise))
    assert power == pytest.approx(1.3, abs=3 * sigma)
    assert 0.003 < sigma < 0.01
    assert np.isnan(steepness(x[:3], x[:3])[0])
