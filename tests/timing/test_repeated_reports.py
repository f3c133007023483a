"""Choosing among repeated reports pulls no offset towards zero; choosing the nearest to the other array does."""

import numpy as np
import pytest

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.gating import gate_reports
from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.timing.correction import fit_timing
from trackerlib.timing.stretch import stretch

OFFSET_S, NOISE_FT, RUNS, POINTS = 3e-3, 1.5, 40, 80
PROFILE = SoundSpeedProfile(np.array([0.0, 1500.0]), np.array([4880.0, 4850.0]), "ft", "simulated")
PLACE = np.array([[0.0, 0.0, -1300.0], [5000.0, 0.0, -1290.0]])
SURVEY = ArraySurvey(np.array([1, 2]), PLACE, np.full(2, "NaT", "datetime64[D]"), np.zeros(2, bool))


def simulated_run(seed, spread):
    """Every array reports every point count twice, the second time with this spread (ft), in a shuffled file."""
    rng = np.random.default_rng(seed)
    count = np.arange(100, 100 + POINTS)
    truth = np.column_stack([1200 + 30.0 * (count - 100), np.full(POINTS, 900.0), np.full(POINTS, -300.0)])
    early = [truth - OFFSET_S * stretch(truth, place, PROFILE).velocity for place in PLACE]
    position = [track + rng.normal(0, size, track.shape) for track in early for size in (NOISE_FT, spread)]
    order = rng.permutation(4 * POINTS)
    return PositionReports(
        line=np.arange(32, 32 + 4 * POINTS),
        point_count=np.tile(count, 4)[order],
        position=np.concatenate(position)[order],
        array=np.repeat([1, 1, 2, 2], POINTS)[order],
        mode=np.full(4 * POINTS, 7, np.int8),
        flagged=np.zeros(4 * POINTS, bool),
    )


def nearest_to_the_other_array(reports):
    """As KEYGATE chose (Read 1990, appendix E), for comparison: the two that are nearest to one another."""
    keep = []
    for count in np.unique(reports.point_count):
        first, second = (
            np.flatnonzero((reports.point_count == count) & (reports.array == number)) for number in (1, 2)
        )
        gap = reports.position[first][:, None] - reports.position[second][None]
        i, j = np.unravel_index(np.argmin(np.linalg.norm(gap, axis=2)), (2, 2))
        keep += [first[i], second[j]]
    return reports.only(np.array(keep))


@pytest.mark.parametrize("spread", [NOISE_FT, 5.0])
def test_the_offset_is_not_pulled_towards_zero(spread):
    runs = [simulated_run(seed, spread) for seed in range(RUNS)]
    error = {}
    for rule, change in (("own track", lambda run: run), ("other array", nearest_to_the_other_array)):
        gated = [gate_reports(change(run), SURVEY, 7) for run in runs]
        if rule == "own track":
            assert all(len(one.choices) == 2 * POINTS for one in gated)
        offset = [fit_timing(one.sets[0], SURVEY, PROFILE).offset_s for one in gated]
        error[rule] = np.array(offset) - OFFSET_S
    own = error["own track"]
    assert abs(own.mean()) < 4 * own.std() / np.sqrt(RUNS) < 0.02e-3
    assert error["other array"].mean() < -0.1e-3
