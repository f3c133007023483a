"""The usual fix, weighted least squares on slant ranges, beside ours on the same simulated surveys.

Direction and range are taken at the noisy place of the ship. A range then comes out long by g^2 (2 - u^2) / 2R on
average (u: the share of it that is level), and the direction errs with the residual. A thousand pings average the
noise away and leave that bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.squared_range import fix_squared_range
from trackerlib.simulation.hexagon import (
    SOUND_SPEED_MPS,
    TIME_RMS_S,
    Receptions,
    Scenario,
    position_bound,
    sail_hexagon,
)

STEPS = 12


@dataclass(frozen=True, eq=False)
class Comparison:
    """Errors of two ways to fix the same surveys, over the Cramer-Rao bound, worst component first of position."""

    usual_bias: float  # greatest of east, north, depth
    usual_error: float
    our_bias: float
    our_error: float
    bound_m: np.ndarray  # (3,)


def fix_usual(ship, ranges, epochs, gps_rms_m: float, range_rms_m: float, start, moving: bool) -> np.ndarray:
    """Position and velocity (P - 1,) by weighted least squares from a start, its weights renewed at each step."""
    state = np.array(start, float)
    for _ in range(STEPS):
        place = state[:3] + (epochs[:, None] * state[3:] if moving else 0.0)
        offset = place - ship
        distance = np.linalg.norm(offset, axis=1)
        slope = offset / distance[:, None]
        weight = 1 / (range_rms_m**2 + gps_rms_m**2 * np.sum(slope[:, :2] ** 2, axis=1))
        if moving:
            slope = np.hstack([slope, epochs[:, None] * slope])
        slope = slope - weight @ slope / weight.sum()
        miss = ranges - distance
        miss = miss - weight @ miss / weight.sum()
        scale = np.linalg.norm(slope, axis=0)
        scaled = slope / scale
        step = np.linalg.lstsq(scaled * np.sqrt(weight)[:, None], miss * np.sqrt(weight), rcond=None)[0]
        state += step / scale
    return state


def compare(receptions: Receptions, gps_rms_m: float, trials: int, seed: int) -> Comparison:
    """Bias and error of the usual fix and of ours on the same surveys; the usual one is started at the truth."""
    rng = np.random.default_rng(seed)
    range_rms = SOUND_SPEED_MPS * TIME_RMS_S
    moving = receptions.scenario.moving
    ship = np.repeat(receptions.ship[None], trials, axis=0)
    ship[:, :, :2] += rng.normal(0, gps_rms_m, (trials, len(receptions.ship), 2))
    ranges = receptions.range_m + rng.normal(0, range_rms, ship.shape[:2])
    truth = receptions.truth
    usual = [
        fix_usual(ship[k], ranges[k], receptions.emitted_s, gps_rms_m, range_rms, truth, moving)[:3]
        - truth[:3]
        for k in range(trials)
    ]
    ours = fix_squared_range(ship, ranges, receptions.emitted_s, gps_rms_m, range_rms, moving=moving)
    found = ours.estimate[ours.converged, :3] - truth[:3]
    bound = position_bound(receptions, gps_rms_m, range_rms)[:3]

    def worst(errors) -> tuple[float, float]:
        errors = np.asarray(errors)
        if not len(errors):
            return np.nan, np.nan
        bias = np.abs(errors.mean(axis=0)) / bound
        return float(bias.max()), float((np.sqrt(np.mean(errors**2, axis=0)) / bound).max())

    return Comparison(*worst(usual), *worst(found), bound)


def bias_over_depth(depths_m, gps_rms_m, trials: int, seed: int, receptions: int = 601) -> np.ndarray:
    """Greatest bias of the usual fix over the bound (D, G) for beacons under the hexagon's centre."""
    return np.array(
        [
            [
                compare(sail_hexagon(Scenario((0.0, 0.0, -depth)), receptions), gps, trials, seed).usual_bias
                for gps in gps_rms_m
            ]
            for depth in depths_m
        ]
    )
