"""A simulated crossover set of 200 points on the demo's range, for bench_slider.py and its peer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.simulation.crossover_runs import ClockTruth, simulate_crossover

POINTS = 200
PAIR = (2, 11)


def set_of_200(survey: ArraySurvey, profile: SoundSpeedProfile) -> CrossoverSet:
    """A vehicle at 20 ft a count between two arrays, whose clock is 2.85 ms off."""
    along = np.linspace(-0.5, 0.5, POINTS)
    track = np.column_stack([13_000 + 4_000 * along, 700 * along - 1_600, np.full(POINTS, -320.0)])
    arrays = tuple(survey.position_of(number) for number in PAIR)
    crossover = simulate_crossover(
        track, np.arange(100, 100 + POINTS), arrays, profile, ClockTruth(2.85e-3), np.random.default_rng(1),
        noise_ft=2.0, wobble_ft=1.0,
    )  # fmt: skip
    return replace(crossover, pair=PAIR)
