"""Profiles for a range from the files that people have."""

from __future__ import annotations

import pytest

from trackerlib.rangefiles.range_profile import parse_range_profile
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.textfiles import InputError


def test_the_three_layouts_give_feet(data):
    content = (data / "range-demo" / "VELOCITY.DAT").read_bytes()
    direct = read_velocity(data / "range-demo" / "VELOCITY.DAT").profile
    assert parse_range_profile(content, "v").profile.depth.tolist() == direct.depth.tolist()
    assert parse_range_profile(content, "v", "boundary").profile.depth[0] == 0
    metres = parse_range_profile(b"depth_m,speed_mps\n0,1500\n304.8,1524\n", "p.csv", "metres").profile
    assert metres.unit == "ft"
    assert metres.depth == pytest.approx([0, 1000])
    assert metres.speed == pytest.approx([4921.26, 5000.0], abs=0.01)


def test_metres_for_feet_are_recognised_and_asked_about():
    with pytest.raises(InputError, match=r"v, line 1: .*metres per second\?.*Is the file in metres\?"):
        parse_range_profile(b"0 1500\n25 1499\n", "v")


def test_descending_depths_are_told_with_their_line():
    with pytest.raises(InputError, match="line 3: found depth 20 ft after 25 ft"):
        parse_range_profile(b"0 4900\n25 4899\n20 4898\n", "v")
