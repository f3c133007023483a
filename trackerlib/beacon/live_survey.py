"""The live estimator over a survey that grows, its answer laid out as the batch's: a row for every ping.

survey = LiveSurvey(pings, settings)
fix = survey.hear(pings, count)        # again whenever there are more
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackerlib.beacon.diagnosis import problem_at
from trackerlib.beacon.live import LiveFix
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix, blank_fix, frame_of
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, FixSettings
from trackerlib.beacon.uncertainty import SlowErrors, wider


class LiveSurvey:
    """LiveFix fed from a table of pings; each ping is told to it once.

    pings : those heard by now, at least one; their first place is the origin of the frame
    Raises ValueError for settings that pings one at a time cannot serve.
    """

    def __init__(self, pings: Pings, settings: FixSettings):
        frame = frame_of(pings)
        self.settings = settings
        self.told = 0  # pings told so far, those left out by hand among them
        self._live = LiveFix(frame, settings, pings.time_step_s, pings.simulated)
        self._last_s = 0.0  # instant of the last ping told

    def hear(self, pings: Pings, count: int) -> BeaconFix:
        """The fix after `count` pings, of which `pings` holds the newest; or the reason why there is none."""
        first = max(len(pings) - (count - self.told), 0)
        instant = pings.instant_s
        if first:
            instant = instant - instant[first - 1] + self._last_s
        ship = self._live.frame.to_local(pings.lat_deg, pings.lon_deg, pings.up_m)
        left_out = self.settings.left_out
        for k in range(first, len(pings)):
            number = int(pings.number[k])
            if number not in left_out:
                self._live.add(number, ship[k], float(instant[k]), float(pings.travel_time_s[k]))
        self.told, self._last_s = count, float(instant[-1])
        fix = self._spread(self._live.fix(), pings)
        if not fix.converged or self.settings.gps_rms_m is not None:
            return fix
        return self._allow_for_slow_errors(fix, pings)

    def _allow_for_slow_errors(self, fix: BeaconFix, pings: Pings) -> BeaconFix:
        """The fix with an uncertainty that slow errors of a ship's position of unknown quality give, like the batch's.

        Of the pings at hand: where older ones are gone, it is somewhat too wide.
        """
        problem, state, motion = problem_at(pings, fix, self.settings)
        misfit = problem.eliminate(state[None], np.ones((1, len(problem.time))))
        slope = misfit.gradient[0] @ problem.axes.T
        gain = slope @ np.linalg.pinv(slope.T @ slope, rcond=1e-15, hermitian=True)
        level = misfit.time_gradient[0][:, :2]
        slow = SlowErrors(ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, fix.elapsed_s[fix.used])
        moved = problem.axes.T @ slow.moved_by(level[:, :, None] * gain[:, None, :]) @ problem.axes
        first, told = motion.at(0.0), fix.uncertainty
        noise = wider(told.noise_covariance, first @ moved @ first.T)
        covariance = noise + told.speed_sigma_mps**2 * np.outer(told.by_sound_speed, told.by_sound_speed)
        return replace(fix, uncertainty=replace(told, noise_covariance=noise, covariance=covariance))

    def _spread(self, fix: BeaconFix, pings: Pings) -> BeaconFix:
        """The same fix with a row for every ping, those that were never told to it among them."""
        blank, allowed = blank_fix(pings, self.settings)
        rows = np.flatnonzero(allowed & np.isin(pings.number, fix.number))[-len(fix.number) :]
        known = slice(len(fix.number) - len(rows), None)
        used = np.zeros(len(pings), bool)
        used[rows] = fix.used[known]
        residual = None
        if fix.residual_s is not None:
            residual = np.full(len(pings), np.nan)
            residual[rows] = fix.residual_s[known]
        start = float(blank.elapsed_s[rows[0]]) if len(rows) else 0.0
        return replace(
            fix,
            ship=fix.frame.to_local(pings.lat_deg, pings.lon_deg, pings.up_m),
            number=pings.number,
            used=used,
            residual_s=residual,
            elapsed_s=blank.elapsed_s - start,
            time_s=blank.time_s,
        )
