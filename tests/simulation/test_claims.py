"""The thesis's conclusions, each held against rows that bear it out and rows that contradict it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from trackerlib.simulation.claims import claims, steepness
from trackerlib.simulation.study import study_points

NOISE = 0.01


def rows(error, now_bound, speed_mps=1.0, bound=None):
    """Rows of the whole study whose error in space is error(scenario, sweep, x), and the present position's bound.

    bound : (scenario, sweep, x) of the place, if the table is to have one
    """
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
        if bound is not None:
            least = bound(point.scenario, point.sweep, point.abscissa) * point.gps_rms_m
            row |= {"crlb_3d_m": least, "crlb.x": 0.3 * least, "crlb.y": 0.3 * least, "crlb.z": 0.9 * least}
            row |= {f"crlb.v{axis}": least / duration for axis in "xyz"}
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


KNEE = "Errors of a still beacon fall fast up to 20 experiments, then slowly (4.3.1, 4.4)."
BEST = "Scenario 1 is best of the still ones, as every leg has a closest point to its beacon (4.3.4)."
WORSE_THAN_STILL = "A moving beacon is known far worse than a still one (4.4)."
LONGER = "A longer collection can make the present position slightly worse (3.6, 4.4.1)."
HELPS = "More experiments help (6.1)."


def steady(power, size=lambda scenario: 1.0):
    return lambda scenario, sweep, x: size(scenario) * x**-power


def knee_upside_down(scenario, sweep, x):
    """Slow up to 20 experiments, then fast."""
    return max(x / 20, 1.0) ** -2.0


def test_a_bend_that_the_bound_has_not_either_is_the_geometry_s():
    why = held(rows(knee_upside_down, lambda x: 1.0, bound=knee_upside_down))[KNEE].why
    assert (
        "the bound of every reception falls with 0.00 before and 2.00 after, so the geometry has no such bend"
        in why
    )
    assert "1.8 legs by then" in why


def test_a_bend_that_the_bound_has_is_the_estimator_s_with_how_far_it_lies_above():
    claim = held(rows(knee_upside_down, lambda x: 1.0, bound=as_the_thesis_says))[KNEE]
    assert claim.holds is False
    assert "has it, 2.00 before and 0.20 after, so it is the estimator, whose error is " in claim.why
    below = held(rows(knee_upside_down, lambda x: 1.0, bound=lambda *at: 100 * as_the_thesis_says(*at)))[KNEE]
    assert "the search box ends there" in below.why


def test_a_bend_within_its_sigmas_is_not_decided():
    rng = np.random.default_rng(3)
    noisy = held(rows(lambda *at: np.exp(rng.normal()) / at[2], lambda x: 1.0, bound=as_the_thesis_says))[
        KNEE
    ]
    assert noisy.holds is False
    assert (
        "within three of its sigmas, so these rows do not decide; the bound of every reception has it"
        in noisy.why
    )
    assert "estimator" not in noisy.why


def test_without_a_bound_no_cause_is_told():
    found = held(rows(knee_upside_down, lambda x: 1.0))
    assert found[KNEE].why.startswith("these rows do not tell the cause; at 1 m/s")
    grows = held(rows(steady(-1.0), lambda x: 1.0))[HELPS]
    assert grows.holds is False
    assert grows.why.startswith("these rows do not tell the cause")


def sides_better(scenario):
    """Scenarios 2 and 3 are known half as badly as 1, moving ones as well as still ones or better."""
    return 1.0 if scenario in (1, 4) else 0.5


def test_a_ratio_that_the_bound_has_too_is_the_geometry_s():
    why = held(rows(steady(1.0, sides_better), lambda x: 1.0, bound=steady(1.0, sides_better)))[BEST].why
    assert "the bound of every reception gives 0.50 too, so it is the geometry and not the estimator" in why
    assert "one draw a point" in why  # half is less than one draw scatters by


def test_a_ratio_against_the_bound_is_the_estimator_s():
    def five_times_better(scenario):
        return 1.0 if scenario in (1, 4) else 0.2

    why = held(
        rows(
            steady(1.0, five_times_better),
            lambda x: 1.0,
            bound=steady(1.0, lambda scenario: min(scenario, 2) / 10),
        )
    )[BEST].why
    assert "the bound of every reception gives 2.00, so it is the estimator, whose error is " in why
    assert "to 10 times it" in why
    assert "one draw" not in why  # a factor of five is more than one draw scatters by


def test_a_moving_beacon_known_better_is_compared_at_equal_times():
    """Errors that fall with the square of the time, whatever moves: sweeps that collect longer look better."""

    def by_time(scenario, sweep, x):
        held_count = (45 if scenario < 4 else 60) if sweep == "experiments" else (25 if scenario < 4 else 30)
        return (x * held_count / 1000.0) ** -2.0

    claim = held(rows(by_time, lambda x: 1.0, bound=by_time))[WORSE_THAN_STILL]
    assert claim.holds is False
    assert "collect 1.3 times as long, and at equal times its error is 1.0 times as great" in claim.why


def test_a_present_place_that_never_gets_worse_has_its_cause_only_where_the_velocity_shows_it():
    found = held(rows(steady(1.0), lambda x: 1 / x, bound=steady(1.0)))[LONGER]
    assert "falls on all 12 curves" in found.why
    untold = held(rows(steady(1.0), lambda x: 1 / x, bound=lambda scenario, sweep, x: x))[LONGER]
    assert untold.holds is False
    assert untold.why == "these rows do not tell the cause"
