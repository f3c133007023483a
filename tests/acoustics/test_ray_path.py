"""The drawn ray ends where the fitted one does."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.ray_path import ray_path
from trackerlib.acoustics.rays import fit_rays

PROFILE = SoundSpeedProfile(np.array([0.0, 120.0, 500.0, 1400.0]), np.array([4890.0, 4870.0, 4865.0, 4880.0]))


@pytest.mark.parametrize(("target", "array"), [(300.0, 1300.0), (50.0, 1350.0), (1390.0, 700.0)])
def test_the_path_joins_array_and_target(target, array):
    ray = fit_rays(PROFILE, 4000.0, target, array)
    along, depth = ray_path(PROFILE, float(ray.ray_parameter), array, target)
    assert along[0] == 0
    assert along[-1] == pytest.approx(4000.0, abs=1e-6)
    assert (depth[0], depth[-1]) == (array, target)
    assert (np.diff(along) > 0).all()


def test_in_water_of_one_speed_it_is_straight():
    still = SoundSpeedProfile.constant(4900.0)
    ray = fit_rays(still, 3000.0, 100.0, 1100.0)
    along, depth = ray_path(still, float(ray.ray_parameter), 1100.0, 100.0)
    assert along / 3000.0 == pytest.approx((1100.0 - depth) / 1000.0)
