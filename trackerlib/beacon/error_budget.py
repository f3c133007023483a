"""How much of each sigma of a fix comes from the ship's position, from times and from the speed of sound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.pings import Pings
from trackerlib.beacon.planning import surveys_so_far
from trackerlib.beacon.result import BeaconFix, time_sigma
from trackerlib.beacon.settings import FixSettings


@dataclass(frozen=True)
class ErrorBudget:
    """Standard errors (east, north, depth) [m] from each cause alone; their squares add up."""

    ship_position: tuple[float, float, float]
    time: tuple[float, float, float]
    sound_speed: tuple[float, float, float]


def error_budget(pings: Pings, fix: BeaconFix, settings: FixSettings) -> ErrorBudget:
    """The errors of times are what their logging step makes, scaled with the ship's where the latter are told.

    All other noise is the ship's: independent, slow and the antenna's. All three make up the sigmas stated.
    Raises ValueError for a fix without a position or uncertainty.
    """
    uncertainty = fix.uncertainty
    if uncertainty is None:
        raise ValueError(f"there is no uncertainty to share out: {fix.reason}")
    survey = surveys_so_far(pings, fix, settings)[0]
    sigma_s = time_sigma(pings, settings) if settings.gps_rms_m is None else survey.time_sigma_s
    noise = np.diag(uncertainty.noise_covariance)[:3]
    step = survey.motion.at(0.0)[:3] @ survey.motion.axes.T
    time = np.minimum(sigma_s**2 * np.diag(step @ survey.independent()[1] @ step.T), noise)
    speed = np.abs(uncertainty.by_sound_speed[:3]) * uncertainty.speed_sigma_mps

    def three(values) -> tuple[float, float, float]:
        east, north, depth = (float(value) for value in values)
        return east, north, depth

    return ErrorBudget(three(np.sqrt(noise - time)), three(np.sqrt(time)), three(speed))
