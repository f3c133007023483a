"""Do the offsets of one run agree, and which array stands in the way?"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from trackerlib.timing.one_run import offsets_agree, without_each_array

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


def test_one_offset_cannot_be_compared():
    with pytest.raises(ValueError, match="two or more"):
        offsets_agree(np.ones(1), np.ones(1), np.ones(1))
