"""Simulated surveys that several tests of beacon fixes share."""

from __future__ import annotations

import numpy as np

from trackerlib.beacon.paths import StraightPaths
from trackerlib.frames import LocalFrame
from trackerlib.simulation.beacon_survey import Errors, sail, simulate_survey

FRAME = LocalFrame(41.0, -66.0)
BOX = ((20, 1500), (110, 1500), (200, 1500), (290, 1500))
LINE = ((75, 6000),)
ELBOW = ((20, 1800), (100, 1500))


def survey(
    legs, beacon, errors=None, *, seed=0, speed_mps=1500.0, interval_s=20.0, start=(-900.0, -700.0), **options
):
    """Pings heard along legs (course in degrees, length in metres) from `start`."""
    track = sail(np.array(legs, float), np.array(start), 2.5, interval_s)
    return simulate_survey(
        track,
        np.array(beacon, float),
        StraightPaths(speed_mps),
        FRAME,
        np.random.default_rng(seed),
        errors or Errors(),
        emission_offset_s=0.8,
        interval_s=interval_s,
        **options,
    )


def error_of(fix, beacon):
    """East, north, up [m] of a fix minus the truth, in the fix's own frame."""
    truth = fix.frame.to_local(*(float(value) for value in FRAME.to_geodetic(np.array(beacon, float))))
    return fix.position - truth
