"""What a moving beacon's fix says of the surface and of the instant it is known best."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from surveys import BOX, survey

from dashboards.tabs.beacon_words import movement, table
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.result import Solution
from trackerlib.commands.fix import report
from trackerlib.commands.fix_document import document
from trackerlib.simulation.beacon_survey import Errors


@pytest.fixture(scope="module")
def rising():
    """A fix of a beacon that lies still, made to rise: every number of it is then known."""
    still = fix_beacon(survey(BOX, (100.0, 50.0, -2400.0), Errors(2.0, 5e-4)))
    root = np.random.default_rng(3).normal(size=(6, 6)) * np.array([3, 3, 4, 0.01, 0.01, 0.01])[:, None]
    return replace(
        still,
        position=np.array([100.0, 50.0, -2400.0]),
        velocity=np.array([0.2, -0.1, 1.5]),
        uncertainty=replace(still.uncertainty, covariance=root @ root.T),
    )


def test_a_rising_beacon_surfaces_when_and_where_its_states_do(rising):
    up = document(rising)["surfaces"]
    rng = np.random.default_rng(1)
    state = np.concatenate([rising.position, rising.velocity])
    draws = rng.multivariate_normal(state, rising.uncertainty.covariance, 40_000)
    seconds = -draws[:, 2] / draws[:, 5]
    places = draws[:, :2] + seconds[:, None] * draws[:, 3:5]
    assert up["epoch_s"] == pytest.approx(1600.0)
    assert up["sigma_epoch_s"] == pytest.approx(np.std(seconds), rel=0.03)
    assert [up["sigma_east_m"], up["sigma_north_m"]] == pytest.approx(np.std(places, axis=0), rel=0.03)
    east, north = rising.frame.to_local(up["lat_deg"], up["lon_deg"], 0.0)[:2]
    assert [east, north] == pytest.approx([100 + 320, 50 - 160], abs=1)
    assert "surfaces" not in document(replace(rising, velocity=np.array([0.2, -0.1, -1.5])))


def test_the_words_tell_the_surface_and_the_instant_known_best(rising):
    answer = document(rising) | {"warnings": []}
    minutes = float(re.search(r"comes to the surface in ([-\d.]+)", movement(rising))[1])
    assert minutes == pytest.approx((1600 - rising.present.elapsed_s) / 60, abs=0.1)
    assert "surface" not in movement(replace(rising, velocity=np.array([0.2, -0.1, -1.5])))
    then = answer["steadiest"]
    assert 0 <= then["epoch_s"] <= rising.present.elapsed_s
    for text in (report(answer), table(rising)):
        assert f"{then['epoch_s']:.0f} s after the first ping: {then['lat_deg']:.7f}" in text


def test_what_fits_as_well_tells_how_likely_it_is(rising):
    others = tuple(Solution(41.0, -66.0, 2400.0, 0.0, 0.0, misfit) for misfit in (0.0, 3.42))
    text = report(document(replace(rising, alternatives=others)) | {"warnings": []})
    assert "depth 2400 m, none more likely\n" in text
    assert "depth 2400 m, chi-square 3.4 above the best" in text
