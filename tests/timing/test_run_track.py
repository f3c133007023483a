"""One correction for a whole run: its track comes to the truth, hand-overs close, single-array parts move too."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.crossover.gating import gate_mode_and_flag
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.timing.run_track import correct_run

OFFSET_S = 2.85e-3  # the demo's truth for vehicle 7


@pytest.fixture(scope="module")
def demo(data):
    folder = data / "range-demo"
    reports = gate_mode_and_flag(read_tfile(folder / "tfile.dat").reports, 7)
    survey = read_arrays(folder / "arrays.csv").survey
    reports = reports.only(reports.array != 5)  # surveyed wrong on purpose
    truth = np.loadtxt(folder / "true_track.csv", delimiter=",", comments="#", skiprows=1)
    return reports, survey, read_velocity(folder / "VELOCITY.DAT").profile, truth[truth[:, 0] == 7]


def error_of(run, truth) -> np.ndarray:
    """Distance of the merged track from the truth at every count both have."""
    place = {int(count): row[2:5] for count, row in zip(truth[:, 1], truth, strict=True)}
    return np.array(
        [
            np.linalg.norm(p - place[int(c)])
            for c, p in zip(run.point_count, run.track, strict=True)
            if int(c) in place
        ]
    )


def test_the_whole_track_comes_to_the_truth(demo):
    reports, survey, profile, truth = demo
    before = error_of(correct_run(reports, survey, profile, 4700.0, 0.0), truth)
    run = correct_run(reports, survey, profile, 4700.0, OFFSET_S)
    after = error_of(run, truth)
    assert np.median(before) > 10
    assert np.median(after) < 0.3 * np.median(before)
    assert (run.arrays == 1).any()
    assert len(after) > 3000


def test_jumps_at_hand_overs_close(demo):
    reports, survey, profile, _ = demo
    run = correct_run(reports, survey, profile, 4700.0, OFFSET_S)
    before, after = run.mean_jump
    assert before > 15
    assert after < 0.15 * before
    firsts = [one.first for one in run.hand_overs]
    assert firsts == sorted(firsts)
    assert correct_run(reports, survey, profile, 4700.0, 0.0).mean_jump == pytest.approx((before, before))


def test_no_array_within_range_is_refused(demo):
    reports, survey, profile, _ = demo
    with pytest.raises(ValueError, match="within range of an array"):
        correct_run(reports, survey, profile, 10.0, OFFSET_S)
