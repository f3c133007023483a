"""Model choice: the motion that made the pings wins, on AICc and on pings held out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackerlib.beacon.choice import ModelScore, compare_models, usual_models, verdict
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.settings import FixSettings
from trackerlib.frames import LocalFrame
from trackerlib.simulation.hexagon import SOUND_SPEED_MPS, TIME_RMS_S, Scenario, sail_hexagon

FRAME = LocalFrame(12.0, 45.0)
SETTINGS = FixSettings(gps_rms_m=3.0, sample_interval_ms=1.0, sound_speed_sigma_mps=0.0)


def heard(velocity, seed=0, receptions=561):
    points = sail_hexagon(Scenario((200.0, 300.0, -1500.0), velocity), receptions)
    rng = np.random.default_rng(seed)
    ship = points.ship + np.c_[rng.normal(0, 3, (receptions, 2)), np.zeros(receptions)]
    lat, lon, up = FRAME.to_geodetic(ship)
    time = points.range_m / SOUND_SPEED_MPS + rng.normal(0, TIME_RMS_S, receptions)
    return Pings(
        np.arange(1, receptions + 1), lat, lon, up * 0, time, np.full(receptions, np.datetime64("NaT", "ms")),
        clock_s=points.emitted_s, simulated=True,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("velocity", "name"),
    [
        ((0.0, 0.0, 0.0), "lies still"),
        ((0.0, 0.0, 0.6), "sinks or rises"),
        ((0.4, -0.3, 0.0), "drifts level"),
        ((0.4, -0.3, 0.5), "moves freely"),
    ],
)
def test_the_motion_that_made_the_pings_wins(velocity, name):
    scores = compare_models(heard(velocity), usual_models(SETTINGS))
    by_name = {score.name: score for score in scores}
    assert by_name[name].aicc < 6  # a richer model may win by chance, never by much
    richer = {score.name for score in scores if score.aicc < 6}
    poorer = {"lies still"} if any(velocity) else set()
    assert not richer & poorer
    held = {score.name: score.held_out_s for score in scores}
    assert held[name] < 1.02 * np.nanmin(list(held.values()))


def test_a_wrong_motion_is_far_worse():
    scores = {score.name: score for score in compare_models(heard((0.4, -0.3, 0.5)), usual_models(SETTINGS))}
    assert scores["lies still"].aicc > 100
    assert scores["lies still"].held_out_s > 1.5 * scores["moves freely"].held_out_s


def test_too_few_pings_score_nothing():
    pings = heard((0.0, 0.0, 0.0)).only(slice(0, 5))
    scores = compare_models(pings, usual_models(SETTINGS))
    assert all(np.isinf(score.aicc) for score in scores)
    assert verdict(scores).startswith("No model")


@pytest.mark.parametrize(
    ("models", "words"),
    [
        ((("moves", 6, 0.0, 1e-3), ("lies still", 3, 40.0, 1.5e-3)), "“moves”, and pings held out agree (1 ms)"),
        ((("moves", 6, 0.0, 1e-3), ("lies still", 3, 1.2, 1.01e-3)), "of those that serve as well (“moves”)"),
        ((("moves", 6, 0.0, 1.5e-3), ("lies still", 3, 9.0, 1e-3)), "choose “lies still” (1 ms against 1.5 ms)"),
        ((("moves", 6, 0.0, np.nan), ("lies still", 3, 9.0, 1e-3)), "“moves”; pings held out cannot tell"),
    ],
)  # fmt: skip
def test_the_verdict_says_where_the_two_criteria_disagree(models, words):
    scores = tuple(
        ModelScore(name, SETTINGS, None, parameters, aicc, held) for name, parameters, aicc, held in models
    )
    sentence = verdict(scores)
    assert words in sentence
    assert ("disagree" in sentence) == ("against" in words)


def test_folded_times_are_scored_too():
    pings = heard((0.0, 0.0, 0.0))
    folded = replace(pings, travel_time_s=np.mod(pings.travel_time_s, 0.5))
    scores = compare_models(folded, {"still": replace(SETTINGS, interval_s=0.5)})
    assert scores[0].held_out_s < 0.01
