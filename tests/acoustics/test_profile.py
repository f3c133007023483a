"""Sound-speed profiles: values between and beyond the rows, means, bad tables."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from trackerlib.acoustics.profile import SoundSpeedProfile

DEPTH = np.array([0.0, 25.0, 50.0, 100.0, 400.0])
SPEED = np.array([4880.0, 4870.0, 4872.0, 4872.0, 4878.0])
PROFILE = SoundSpeedProfile(DEPTH, SPEED)


def test_speeds_and_gradients_by_hand():
    assert PROFILE.speed_at([12.5, 50, 75, 250]) == pytest.approx([4875, 4872, 4872, 4875])
    assert PROFILE.gradient_at([10, 30, 75, 200]) == pytest.approx([-0.4, 0.08, 0.0, 0.02])
    assert PROFILE.gradient_at(50.0) == pytest.approx(0.0)  # on a boundary: the layer below


def test_layers_known_at_their_middle():
    # Upper boundaries 0, 25, 50: middles 12.5, 37.5, 62.5 (VELOCITY.DAT)
    profile = SoundSpeedProfile.from_layer_middles([0, 25, 50], [4880, 4870, 4872])
    assert profile.depth.tolist() == [12.5, 37.5, 62.5]
    assert profile.speed_at(25.0) == pytest.approx(4875.0)
    # Above the first middle with the first gradient: 4880 + 0.4 x 12.5
    assert profile.speed_at(0.0) == pytest.approx(4885.0)


def test_below_the_table_with_the_mean_step_of_the_last_six_rows():
    boundary = 25.0 * np.arange(12)
    speed = 4880 + np.array([0, 5, 1, 9, 2, 3, 4, 6, 7, 8, 11, 15.0])
    profile = SoundSpeedProfile.from_layer_middles(boundary, speed)
    step = (speed[-1] - speed[-7]) / 6  # the report's (V[last] - V[last - 6]) / 6 per 25 ft
    assert profile.speed_at(profile.depth[-1] + 50) == pytest.approx(speed[-1] + 2 * step)


def test_carrying_on_is_said_aloud():
    longer = PROFILE.extended(-10.0, 900.0)
    assert len(longer.notes) == 2
    assert "below 400 ft" in longer.notes[1]
    assert PROFILE.extended(0.0, 400.0).notes == ()
    for depth in (-10.0, 37.0, 600.0, 900.0):
        assert longer.speed_at(depth) == pytest.approx(PROFILE.speed_at(depth))


@pytest.mark.parametrize(("a", "b"), [(0, 400), (10, 30), (60, 90), (30, 10), (-20, 700)])
def test_the_harmonic_mean_is_distance_over_vertical_time(a, b):
    low, high = min(a, b), max(a, b)
    time = quad(
        lambda z: 1 / PROFILE.speed_at(z), low, high, points=[d for d in DEPTH if low < d < high], limit=200
    )[0]
    if high <= 400 and low >= 0:
        assert PROFILE.harmonic_mean(a, b) == pytest.approx((high - low) / time, rel=1e-12)
    else:
        assert PROFILE.extended(low, high).harmonic_mean(a, b) == pytest.approx((high - low) / time, rel=1e-9)


def test_the_harmonic_mean_of_no_distance_is_the_speed_there():
    assert PROFILE.harmonic_mean(30.0, 30.0) == pytest.approx(PROFILE.speed_at(30.0))


@pytest.mark.parametrize(
    ("depth", "speed", "words"),
    [
        ([0, 10, 10], [1, 1, 1], "10 comes after 10"),
        ([0, 20, 10], [1, 1, 1], "10 comes after 20"),
        ([0], [1500], "two or more"),
        ([0, 10], [1500, np.nan], "must be numbers"),
        ([0, 10], [1500, -3], "speeds positive"),
    ],
)
def test_bad_tables_are_refused_in_words(depth, speed, words):
    with pytest.raises(ValueError, match=words):
        SoundSpeedProfile(np.array(depth, float), np.array(speed, float))


def test_the_unit_is_feet_or_metres():
    with pytest.raises(ValueError, match="wanted 'ft' or 'm'"):
        SoundSpeedProfile(DEPTH, SPEED, unit="fathom")
