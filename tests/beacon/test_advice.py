"""A refusal says what to do: sailing the leg it names gives a fix."""

from __future__ import annotations

import re

import pytest
from surveys import LINE, survey

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.settings import FixSettings
from trackerlib.simulation.beacon_survey import Errors

BEACON = (100.0, 600.0, -1500.0)
ERRORS = Errors(gps_rms_m=2.0, time_rms_s=5e-4)


@pytest.mark.parametrize("legs", [LINE, ((75, 3000),), ((20, 300), (80, 250)), ((20, 300), (110, 300))])
@pytest.mark.parametrize("gps_rms_m", [None, 2.0])
def test_the_leg_it_names_gives_a_fix(legs, gps_rms_m):
    settings = FixSettings(gps_rms_m=gps_rms_m)
    refused = fix_beacon(survey(legs, BEACON, ERRORS), settings)
    assert not refused.converged
    told = re.search(
        r"turn \d+ degrees to (port|starboard), to (\d+) degrees, and sail (\d+) m", refused.reason
    )
    course, length = float(told[2]), float(told[3])
    # Where the geometry is just good enough the noise decides: half as far again settles it.
    fix = fix_beacon(survey((*legs, (course, 1.5 * length)), BEACON, ERRORS), settings)
    assert fix.converged, (refused.reason, fix.reason)


ACTIONS = ("sail", "turn", "check", "tell", "collect", "widen", "estimate", "needs", "try", "choose")


def test_every_reason_tells_an_action():
    """A reason without one of these words leaves the reader alone."""
    reasons = [
        fix_beacon(survey(LINE, BEACON, ERRORS).only(slice(0, 4)), FixSettings()).reason,
        fix_beacon(survey(LINE, BEACON, ERRORS), FixSettings(motion="free")).reason,
        fix_beacon(survey(((20, 10),), BEACON, ERRORS), FixSettings()).reason,
        fix_beacon(survey(((20, 900), (110, 900)), BEACON, ERRORS), FixSettings(max_depth_m=300)).reason,
        fix_beacon(survey(((20, 900), (110, 900)), BEACON, ERRORS), FixSettings(max_range_m=100)).reason,
        fix_beacon(survey(LINE, BEACON, ERRORS), FixSettings(method="pairs")).reason,
    ]
    for reason in reasons:
        assert any(word in reason for word in ACTIONS), reason
