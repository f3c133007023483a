"""Do the offsets of one run agree, and which array stands in the way?"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.timing.correction import fit_timing
from trackerlib.timing.one_run import judge_run, offsets_agree, without_each_array

PAIRS = [(a, b) for a in range(1, 6) for b in range(a + 1, 6)]


def test_distances_of_one_offset_are_chi_square():
    rng = np.random.default_rng(1)
    sigma = rng.uniform(0.02, 0.3, 12)
    count = np.arange(12.0)
    p = [offsets_agree(rng.normal(2.85, sigma), sigma, count).p_value for _ in range(400)]
    assert stats.kstest(p, "uniform").pvalue > 0.01
    drifting = [offsets_agree(rng.normal(0.1 * count, sigma), sigma, count, True).p_value for _ in range(400)]
    assert stats.kstest(drifting, "uniform").pvalue > 0.01


def test_a_drift_is_found_with_its_sigma():
    count, sigma = np.linspace(0, 900, 7), np.full(7, 0.01)
    found = offsets_agree(1 + 2e-3 * count, sigma, count, drift=True)
    assert found.drift_s_per_count == pytest.approx(2e-3)
    assert found.offset_s == pytest.approx(1 + 2e-3 * found.mean_count)
    assert found.sigma_drift_s_per_count == pytest.approx(0.01 / np.sqrt(np.sum((count - 450) ** 2)))
    assert not offsets_agree(1 + 2e-3 * count, sigma, count).agree


def test_the_array_that_stands_in_the_way_comes_first():
    offset = np.array([3.8 if 4 in pair and 1 in pair else 2.0 if 4 in pair else 2.85 for pair in PAIRS])
    offset = offset + np.random.default_rng(2).normal(0, 0.02, len(PAIRS))
    sigma, count = np.full(len(PAIRS), 0.02), np.arange(len(PAIRS), dtype=float)
    assert not offsets_agree(offset, sigma, count).agree
    best, second, *_ = without_each_array(PAIRS, offset, sigma, count)
    assert best.left_out == 4
    assert best.agree
    assert best.offsets == 6
    assert not second.agree


def test_three_arrays_at_once_tell_two_gaps_and_not_three():
    """Sets of three arrays that see all of one straight track: one offset's sigma and its distance stay true."""
    depth = np.array([0.0, 2000.0])
    profile = SoundSpeedProfile(depth, 4870 + 0.02 * depth)
    place = np.array([[0.0, 0, -1300], [6000.0, 300, -1250], [3000.0, 5200, -1350]])
    survey = ArraySurvey(np.arange(1, 4), place, np.full(3, "NaT", "datetime64[D]"), np.zeros(3, bool))
    count = np.arange(60)
    track = np.array([1800.0, 900.0, -400.0]) + np.outer(count, [35.0, 20.0, 0.0])
    rng, score, distance = np.random.default_rng(3), [], []
    for _ in range(120):
        seen = [track + rng.normal(0, 1.5, track.shape) for _ in place]
        sets = [CrossoverSet((a + 1, b + 1), count, seen[a], seen[b]) for a, b in combinations(range(3), 2)]
        whole = judge_run(sets, [fit_timing(one, survey, profile) for one in sets]).whole
        score.append(whole.offset_s / whole.sigma_offset_s)
        distance.append(whole.distance / whole.dof)
    assert np.std(score) < 1.03
    assert np.mean(distance) == pytest.approx(1.0, abs=0.25)


def test_one_offset_cannot_be_compared():
    with pytest.raises(ValueError, match="two or more"):
        offsets_agree(np.ones(1), np.ones(1), np.ones(1))
