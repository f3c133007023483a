"""One fix on its way: what is minimised, a place that fits, and that place as a fix nobody has judged yet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.beacon.clock import PingerClock, pinger_clock
from trackerlib.beacon.convergence import Recorder
from trackerlib.beacon.minimise import Problem, Region, biweight_cost
from trackerlib.beacon.motion import Motion
from trackerlib.beacon.paths import StraightPaths, paths_through
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix, Solution, time_sigma
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, FixSettings
from trackerlib.beacon.uncertainty import AntennaErrors, SlowErrors, Uncertainty, uncertainty_of

SEARCH_PINGS = 300  # the search looks at no more pings than this, evenly chosen; the fix at all
TYPICAL_DEPTH_M = 2000.0  # to which the search takes the mean of a profile's speed


def problem_of(
    pings: Pings, blank: BeaconFix, allowed: np.ndarray, settings: FixSettings, motion: Motion
) -> Problem:
    """What is minimised for the pings allowed (N,) of a survey, in the frame of a fix of it and with its times."""
    ship, time = blank.ship[allowed], blank.time_s[allowed]
    paths = paths_through(settings.sound_speed_mps, settings.profile, settings.max_depth_m)
    gps_rms_m = settings.gps_axes_m
    region = Region(
        ship[:, :2].mean(axis=0),
        settings.max_range_m,
        settings.max_depth_m,
        settings.max_speed_mps * motion.half_s,
    )
    return Problem(
        ship=ship,
        time=time,
        paths=paths,
        region=region,
        gps_rms_m=np.zeros(2) if gps_rms_m is None else gps_rms_m,
        time_sigma_s=time_sigma(pings, settings),
        columns=pinger_clock(pings, time, allowed, settings).columns,
        share=motion.shares(blank.elapsed_s[allowed]),
        axes=motion.axes,
        slowness_sigma=settings.speed_sigma_mps / paths.mean_speed(TYPICAL_DEPTH_M)
        if settings.estimate_sound_speed
        else None,
    )


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place that fits."""

    position: np.ndarray  # (P,) state
    keep: np.ndarray  # (n,) of the allowed pings
    settled: bool
    noise_s: float  # of a time of weight one, the correlation of residuals counted in
    cost: float = np.inf


@dataclass(frozen=True, eq=False)
class Attempt:
    """One fix on its way: its problem, and what turns a candidate into a fix."""

    problem: Problem
    motion: Motion
    blank: BeaconFix
    allowed: np.ndarray
    settings: FixSettings
    extra_start: np.ndarray | None
    log: Recorder
    clock: PingerClock
    heading_rad: np.ndarray | None = None  # (N,)

    def quick(self) -> tuple[Problem, Problem]:
        """The problem with few enough pings to search with, along straight paths and as it is.

        Straight paths are good enough to find the right valleys, at a tenth of the cost of rays.
        """
        count = len(self.problem.time)
        chosen = np.unique(np.linspace(0, count - 1, min(count, SEARCH_PINGS)).astype(int))
        few = replace(self.problem.only(chosen), slowness_sigma=None)
        return replace(few, paths=StraightPaths(few.paths.mean_speed(TYPICAL_DEPTH_M))), few

    def cost(self, positions: np.ndarray, scale: float, problem: Problem) -> np.ndarray:
        """Robust chi-square (S,) at positions (S, 3), each with its own best emission offset."""
        weight = np.ones((len(positions), len(problem.time)))
        residual = problem.eliminate(positions, weight).residual
        if not problem.emission_known:
            residual = residual - np.median(residual, axis=1, keepdims=True)
        return biweight_cost(residual, scale)

    def weight(self, candidate: Candidate) -> np.ndarray:
        """Weights (1, n) of the pings at a candidate, zero at those left out."""
        gradient = self.problem.times(candidate.position[None])[1]
        return candidate.keep * np.nan_to_num(self.problem.relative_weight(gradient))

    def ship_errors(self, keep: np.ndarray) -> SlowErrors | None:
        """Slow errors of the ship's position at the pings used, assumed or told; None where they are told as white."""
        told, correlation_s = self.settings.gps_axes_m, self.settings.gps_correlation_s
        elapsed_s = self.blank.elapsed_s[self.allowed][keep]
        if told is None:
            return SlowErrors(ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, elapsed_s)
        return None if correlation_s is None else SlowErrors(told, correlation_s, elapsed_s)

    def antenna_errors(self, keep: np.ndarray) -> AntennaErrors | None:
        """The error of the antenna offset at the pings used; None where there is none."""
        level_m, vertical_m = self.settings.antenna_sigma_m
        if not level_m and not vertical_m:
            return None
        return AntennaErrors(
            level_m, vertical_m, None if self.heading_rad is None else self.heading_rad[self.allowed][keep]
        )

    def describe(
        self,
        candidate: Candidate,
        state: np.ndarray | None = None,
        covariance: np.ndarray | None = None,
    ) -> BeaconFix:
        """The candidate as a fix that nobody has judged yet.

        state : (P,) if not its own, with the covariance that the equations behind it have, see `Unbiased`
        """
        problem = self.problem
        state = candidate.position if state is None else state
        misfit = problem.eliminate(state[None], self.weight(candidate))
        first = self.motion.at(0.0)
        position = (first @ state)[:3]
        lat, lon, up = self.blank.frame.to_geodetic(position)
        mean_speed = problem.paths.mean_speed(max(-float(up), 0.0))
        uncertainty = uncertainty_of(
            misfit,
            candidate.keep,
            axes=problem.axes,
            floor_s=problem.time_sigma_s,
            mean_speed_mps=mean_speed,
            speed_sigma_mps=self.settings.speed_sigma_mps,
            ship_errors=self.ship_errors(candidate.keep),
            least=covariance,
            antenna=self.antenna_errors(candidate.keep),
        )
        residual = np.full(len(self.allowed), np.nan)
        residual[self.allowed] = misfit.residual[0]
        used = self.allowed.copy()
        used[self.allowed] = candidate.keep
        return replace(
            self.blank,
            position=position,
            velocity=(first @ state)[3:] if self.motion.moving else None,
            lat_deg=float(lat),
            lon_deg=float(lon),
            depth_m=-float(up),
            used=used,
            residual_s=residual,
            uncertainty=None if uncertainty is None else uncertainty.turned(first),
            **self._linear_unknowns(misfit.linear[0], mean_speed, uncertainty),
        )

    def _linear_unknowns(self, linear: np.ndarray, told_mps: float, uncertainty: Uncertainty | None) -> dict:
        """What a fix says of the pinger's clock and of the speed of sound."""
        unknown = np.full((len(linear), len(linear)), np.nan)
        covariance = unknown if uncertainty is None else uncertainty.linear_covariance
        emission = self.clock.emission(linear, covariance)
        speed_mps, sigma_mps = told_mps, self.settings.speed_sigma_mps
        if self.problem.slowness_sigma is not None:
            speed_mps = told_mps / (1 + float(linear[-1]))
            sigma_mps = speed_mps**2 / told_mps * float(np.sqrt(covariance[-1, -1]))
        return {
            "emission_offset_s": emission.offset_s,
            "emission": emission,
            "sound_speed_mps": speed_mps,
            "sigma_sound_speed_mps": sigma_mps,
        }

    def solution(self, state: np.ndarray, misfit: float) -> Solution:
        """A state (P,) as a place at the first ping, `misfit` above the best one."""
        position = (self.motion.at(0.0) @ state)[:3]
        lat, lon, up = self.blank.frame.to_geodetic(position)
        return Solution(
            float(lat), float(lon), -float(up), float(position[0]), float(position[1]), float(misfit)
        )
