"""A fix that takes pings one at a time, for a day at ten a second, in the same time each and bounded memory.

    live = LiveFix(frame, FixSettings(gps_rms_m=3))
    live.add(number, east_north_up, seconds, travel_time_s)
    live.fix()

The squared range is quadratic in the unknowns, so with instruments and weights as they were when a ping came, all
that it will ever say is in a dozen weighted sums. They are made afresh from the pings kept whenever their number
has doubled, with instruments at the fix of that time: the answer is that of all pings at once. Until there is a
first fix that can be believed, `fix_beacon` is asked, at growing intervals, and its refusals are passed on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from trackerlib.beacon import squared_sums
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.live_sums import (
    NEIGHBOURS,
    RANGE,
    RANGE_SQUARED,
    TIME,
    UP,
    LiveSums,
    absorb,
    invert_spread,
    solve_sums,
)
from trackerlib.beacon.minimise import CUT
from trackerlib.beacon.observability import UNSEEN_SHARE
from trackerlib.beacon.paths import paths_through
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import FixSettings
from trackerlib.beacon.squared_sums import ONE
from trackerlib.beacon.squared_sums import RANGE as RANGES
from trackerlib.beacon.uncertainty import Uncertainty
from trackerlib.frames import LocalFrame
from trackerlib.residuals import correlation_from

KEPT = 1 << 17  # pings kept, three and a half hours at ten a second; older ones live on in the sums
FIRST_COUNT, GROWTH = 8, 1.5  # when a first fix is tried
FEW = 200  # pings, up to which the last ones count in where instruments are taken
FARTHEST = 0.2  # of the slant range: how far one ping may move a fix
LEAST_FOLLOWED = 0.6  # share of the pings that must fit


class LiveFix:
    """The fix of one beacon from the pings heard so far.

    frame : local frame of the ship's positions
    settings : motion still or free; gps_rms_m None counts as the ship's error being part of the time's
    Raises ValueError for settings that pings one at a time cannot serve.
    """

    def __init__(
        self, frame: LocalFrame, settings: FixSettings, time_step_s: float = 0.0, simulated: bool = False
    ):
        if settings.motion not in ("still", "free") or settings.method != "all-pings":
            raise ValueError("a live fix is for every ping and a motion still or free")
        if settings.emission_known or settings.interval_s is not None:
            raise ValueError("a live fix is for an unknown emission time and times that are not folded")
        if settings.estimate_sound_speed or settings.gps_correlation_s or any(settings.antenna_sigma_m):
            raise ValueError(
                "a live fix estimates no speed of sound and knows white errors of the ship alone"
            )
        self.frame, self.settings = frame, settings
        self.count = 0
        self.reason: str | None = "no ping yet"
        self._simulated = simulated
        self._moving = settings.motion == "free"
        self._unknowns = 7 if self._moving else 4
        step_s = time_step_s if settings.sample_interval_ms is None else settings.sample_interval_ms * 1e-3
        self._time_step_s = step_s
        self._time_sigma_s = max(step_s / np.sqrt(12), 1e-6)
        self._paths = paths_through(settings.sound_speed_mps, settings.profile, settings.max_depth_m)
        self._rows = np.empty((KEPT, 5))
        self._numbers = np.empty(KEPT, np.int64)
        self._travel = np.empty(KEPT)
        self._theta: np.ndarray | None = None
        self._next_try = FIRST_COUNT
        self._next_renewal = 0
        self._sums = LiveSums(self._unknowns)
        self._absorbed = 0
        self._scale = 1.0
        self._first: BeaconFix | None = None
        self._offset_s, self._speed_mps, self._straight = (
            0.0,
            settings.sound_speed_mps,
            settings.profile is None,
        )

    # -- pings ---------------------------------------------------------------------------------

    def add(self, number: int, east_north_up, seconds: float, travel_time_s: float) -> None:
        """Takes one ping: its number, the hydrophone [m], its instant and one-way time with any constant [s].

        What is not finite is counted and left out.
        """
        place = np.asarray(east_north_up, float)
        if not (np.isfinite(place).all() and np.isfinite(seconds) and np.isfinite(travel_time_s)):
            return
        k = self.count % KEPT
        self._rows[k, :3], self._rows[k, TIME] = place, seconds
        self._travel[k], self._numbers[k] = travel_time_s, number
        self.count += 1
        if self._theta is None:
            if self.count >= self._next_try:
                self._try_first()
            return
        self._rows[k, RANGE] = self._range_of(place, seconds, travel_time_s)
        self._absorb()
        if self.count >= self._next_renewal and self.count <= KEPT:
            self._renew()

    def _try_first(self) -> None:
        """Asks the batch for a first fix that can be believed."""
        self._next_try = int(np.ceil(GROWTH * self.count))
        if self.count > KEPT:
            return
        self._first = fix = fix_beacon(self._as_pings(self.count), self.settings)
        self.reason = fix.reason
        if not fix.converged:
            return
        self._offset_s = fix.emission_offset_s
        self._speed_mps = fix.sound_speed_mps
        # The frame of the batch has its origin at the first ping; ours is told.
        lat, lon, up = fix.frame.to_geodetic(fix.position)
        place = self.frame.to_local(lat, lon, up)
        velocity = np.zeros(3) if fix.velocity is None else fix.velocity
        self._scale = self._scale_of(fix)
        place = place - self._rows[0, TIME] * velocity
        self._theta = np.concatenate([place, [0.0], velocity] if self._moving else [place, [0.0]])
        self._renew()

    def _scale_of(self, fix: BeaconFix) -> float:
        """How many times as large as told the errors of a fix are."""
        gps, time = self._variances()
        residual = fix.residual_s[fix.used] * self._speed_mps
        offset = fix.position - fix.ship[fix.used]
        level = 1 - offset[:, 2] ** 2 / np.sum(offset**2, axis=1)
        freedom = max(len(residual) - self._unknowns, 1)
        return float(np.sqrt(np.sum(residual**2 / (gps * level + time)) / freedom))

    def _as_pings(self, count: int) -> Pings:
        rows = self._rows[:count]
        lat, lon, up = self.frame.to_geodetic(rows[:, :3])
        return Pings(
            number=self._numbers[:count].copy(),
            lat_deg=lat,
            lon_deg=lon,
            up_m=up,
            travel_time_s=self._travel[:count].copy(),
            utc=np.full(count, np.datetime64("NaT", "ms")),
            clock_s=rows[:, TIME].copy(),
            time_step_s=self._time_step_s,
            simulated=self._simulated,
        )

    def _range_of(self, place, seconds, travel_time_s) -> float:
        """The straight distance that stands for a travel time: along rays, near the present fix."""
        if self._straight:
            return self._speed_mps * (travel_time_s - self._offset_s)
        beacon = self._theta[:3] + (seconds * self._theta[4:] if self._moving else 0.0)
        time = self._paths.times(beacon[None], place[None])[0][0, 0]
        distance = np.linalg.norm(beacon - place)
        return float(distance + distance / time * (travel_time_s - self._offset_s - time))

    def _renew(self) -> None:
        """Makes the sums afresh from the pings kept, with instruments at the present fix."""
        for step in range(3):
            if self._theta is None:
                return
            self._all_ranges()
            if step == 0:  # what they tell does not hang on their times, false ones among them
                every = LiveSums(self._unknowns)
                self._add_to(every, 0, self.count, cut=np.inf)
                invert_spread(every.spread, self._sums.told)
            told = self._sums.told
            self._sums = LiveSums(self._unknowns)
            self._sums.told[:] = told
            self._absorbed = 0
            self._absorb()
        self._next_renewal = 2 * self.count

    def _all_ranges(self) -> None:
        rows, travel = self._rows[: self.count], self._travel[: self.count]
        self._offset_s += self._theta[3] / self._speed_mps
        self._theta[3] = 0.0
        if self._straight:
            rows[:, RANGE] = self._speed_mps * (travel - self._offset_s)
            return
        beacon = self._theta[:3] + (
            rows[:, TIME, None] * self._theta[4:] if self._moving else np.zeros((len(rows), 3))
        )
        time = self._paths.times(beacon[None], rows[:, :3])[0][0]
        distance = np.linalg.norm(beacon - rows[:, :3], axis=1)
        rows[:, RANGE] = distance + distance / time * (travel - self._offset_s - time)

    def _absorb(self) -> None:
        """Adds to the sums every ping whose neighbours on both sides have come, and solves them."""
        ready = self.count - NEIGHBOURS
        if ready > self._absorbed:
            self._absorbed = self._add_to(self._sums, self._absorbed, ready)
        if self.count > FEW:
            self._solve(self._sums, self._absorbed)
        else:
            self._solve(self._with_the_last(), self.count)

    def _add_to(self, sums: LiveSums, first: int, last: int, cut: float = CUT) -> int:
        """Adds pings first to last (their running numbers) to the sums; `last`."""
        gps, time = self._variances()
        return absorb(
            self._rows, first, last, self.count, self._theta, gps, time, cut, self._scale, *sums.arrays
        )

    def _with_the_last(self) -> LiveSums:
        """The sums, with the last pings, whose neighbours after them have not come yet."""
        sums = self._sums.copy()
        self._add_to(sums, self._absorbed, self.count)
        return sums

    def _variances(self) -> tuple[float, float]:
        """Variances [m^2] of a ship position (each axis) and of a range, before scaling to the residuals."""
        return (self.settings.ship_rms_m or 0.0) ** 2, (self._speed_mps * self._time_sigma_s) ** 2

    def _solve(self, sums: LiveSums, seen: int) -> None:
        """Moves the fix to where the sums of so many pings seen have it."""
        theta = self._theta.copy()
        solved = solve_sums(sums.moments, theta)
        solved &= (theta[2] < self._rows[0, UP]) == (self._theta[2] < self._rows[0, UP])  # of the hydrophone
        reach = FARTHEST * np.linalg.norm(self._theta[:3] - self._rows[(self.count - 1) % KEPT, :3])
        followed = sums.tally[0] >= LEAST_FOLLOWED * seen
        if solved and followed and np.linalg.norm(theta[:3] - self._theta[:3]) < reach:
            self._theta = theta
        elif self.count <= KEPT:  # a fix that was believed too early
            self._theta, self._next_try = None, int(np.ceil(GROWTH * self.count))
            self.reason = "the pings that followed moved the first fix too far; sail on"
            if not followed:
                self.reason = "most pings that followed do not fit the first fix; sail on"
            return
        used = sums.tally[0]
        if used > self._unknowns + 3:
            self._scale = max(float(np.sqrt(sums.tally[1] / (used - self._unknowns))), 1e-3)
            invert_spread(sums.spread, self._sums.told)

    # -- the answer ----------------------------------------------------------------------------

    def fix(self) -> BeaconFix:
        """The fix of all pings so far, or the reason why there is none."""
        kept = min(self.count, KEPT)
        if self._theta is None:
            if self._first is not None:
                return replace(self._first, converged=False, reason=self.reason)
            return fix_beacon(self._as_pings(kept), self.settings)  # fewer than a first try needs
        theta, sums = self._theta.copy(), self._with_the_last()
        solved = solve_sums(sums.moments, theta)
        uncertainty = self._uncertainty(theta, sums)
        order = np.arange(self.count - kept, self.count) % KEPT
        rows = self._rows[order]
        place = theta[:3] + (rows[:, TIME, None] * theta[4:] if self._moving else 0.0)
        residual = (rows[:, RANGE] - theta[3] - np.linalg.norm(place - rows[:, :3], axis=1)) / self._speed_mps
        began = float(rows[0, TIME])
        position = theta[:3] + (began * theta[4:] if self._moving else 0.0)
        lat, lon, up = self.frame.to_geodetic(position)
        fix = BeaconFix(
            converged=True,
            reason=None,
            frame=self.frame,
            ship=rows[:, :3],
            number=self._numbers[order],
            used=np.abs(residual)
            < CUT * max(float(np.median(np.abs(residual))) * 1.4826, self._time_sigma_s),
            position=position,
            velocity=theta[4:] if self._moving else None,
            elapsed_s=rows[:, TIME] - began,
            lat_deg=float(lat),
            lon_deg=float(lon),
            depth_m=-float(up),
            residual_s=residual,
            uncertainty=uncertainty,
            emission_offset_s=self._offset_s + theta[3] / self._speed_mps,
            sound_speed_mps=self._speed_mps,
            simulated=self._simulated,
        )
        slant_range = float(np.median(np.linalg.norm(place - rows[:, :3], axis=1)))
        if not solved or uncertainty is None:
            return replace(
                fix, converged=False, reason="the pings so far do not determine the place; sail on, and turn"
            )
        widest = np.sqrt(np.linalg.eigvalsh(fix.present.covariance)[-1])
        if widest > UNSEEN_SHARE * slant_range:
            moves = f"by {widest:.0f} m" if widest < slant_range else "farther than the ship is away"
            why = f"the beacon can move {moves} one way within the noise; sail further, on another bearing"
            return replace(fix, converged=False, reason=why)
        return fix

    def _uncertainty(self, theta: np.ndarray, sums: LiveSums) -> Uncertainty | None:
        own = np.empty((self._unknowns, self._unknowns))
        squared_sums.score(sums.moments, theta, np.empty(self._unknowns), own)
        used, squares = sums.tally[:2]
        correlation = correlation_from(sums.autocorrelation(), int(used))
        freedom = used / correlation.variance_length - self._unknowns
        if freedom < 1 or not np.isfinite(own).all():
            return None
        scale = np.sqrt(np.abs(np.diag(own)))
        inverse = np.linalg.pinv(own / np.outer(scale, scale)) / np.outer(scale, scale)
        variance = squares / (used - self._unknowns) * correlation.length
        widened = (stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)) ** 2
        noise = variance * widened * inverse @ sums.spread @ inverse.T
        # The range less c0 scales with the speed of sound; the answer moves to undo it.
        c0, moments = theta[3], sums.moments
        by_speed = (
            inverse
            @ (2 * (moments[:, RANGE_SQUARED] - 2 * c0 * moments[:, RANGES] + c0**2 * moments[:, ONE]))
            / self._speed_mps
        )
        covariance = noise + self.settings.speed_sigma_mps**2 * np.outer(by_speed, by_speed)
        keep = [0, 1, 2, 4, 5, 6] if self._moving else [0, 1, 2]
        matrix = np.eye(len(keep))
        if self._moving:
            matrix[:3, 3:] = float(self._rows[(self.count - min(self.count, KEPT)) % KEPT, TIME]) * np.eye(3)
        grid = np.ix_(keep, keep)
        return Uncertainty(
            covariance=covariance[grid],
            noise_covariance=noise[grid],
            by_sound_speed=by_speed[keep],
            speed_sigma_mps=self.settings.speed_sigma_mps,
            rms_s=float(np.sqrt(sums.tally[2] / max(used, 1))) / self._speed_mps,
            correlation=correlation,
            degrees_of_freedom=float(freedom),
        ).turned(matrix)
