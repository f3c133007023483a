"""The usual fix, weighted least squares on slant ranges, beside ours on the same simulated surveys.

Direction and range are taken at the noisy place of the ship. A range then comes out long by g^2 (2 - u^2) / 2R on
average (u: the share of it that is level), and the direction errs with the residual. A thousand pings average the
noise away and leave that bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.simulation.hexagon import (
    SOUND_SPEED_MPS,
    TIME_RMS_S,
    Receptions,
    Scenario,
    Trials,
    bound_covariance,
    noisy_surveys,
    run_trials,
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


def fix_usual(ship, ranges, epochs, gps_rms_m: float, range_rms_m: float, start, moving: bool):
    """Weighted least squares from a start, its weights renewed at each step, of many surveys at once.

    ship : (T, N, 3) [m]; ranges : (T, N) [m] with any constant; epochs : (N,) [s]
    Returns position and velocity (T, P), the covariance it states (T, P, P), and whether it came to rest (T,).
    """
    state = np.repeat(np.array(start, float)[None], len(ship), axis=0)
    for _ in range(STEPS):
        place = state[:, None, :3] + (epochs[:, None] * state[:, None, 3:] if moving else 0.0)
        offset = place - ship
        distance = np.linalg.norm(offset, axis=2)
        slope = offset / distance[:, :, None]
        weight = 1 / (range_rms_m**2 + gps_rms_m**2 * np.sum(slope[:, :, :2] ** 2, axis=2))
        if moving:
            slope = np.concatenate([slope, epochs[:, None] * slope], axis=2)
        total = weight.sum(axis=1, keepdims=True)
        slope = slope - (np.einsum("tn,tnk->tk", weight, slope) / total)[:, None]
        miss = ranges - distance
        miss = miss - np.einsum("tn,tn->t", weight, miss)[:, None] / total
        scale = np.linalg.norm(slope, axis=1)[:, None]
        slope = slope / scale
        weighted = slope * weight[:, :, None]
        inverse = np.linalg.pinv(weighted.transpose(0, 2, 1) @ slope, rcond=1e-13, hermitian=True)
        pull = (weighted.transpose(0, 2, 1) @ miss[:, :, None])[:, :, 0]
        step = np.einsum("tkl,tl->tk", inverse, pull) / scale[:, 0]
        state += step
        if np.abs(step).max() < 1e-6:
            break
    covariance = inverse / (scale.transpose(0, 2, 1) * scale)
    return state, covariance, np.abs(step).max(axis=1) < 1e-3


def run_usual_trials(receptions: Receptions, gps_rms_m: float, trials: int, seed: int) -> Trials:
    """Fixes by the usual least squares of the surveys that `run_trials` fixes, started at the truth."""
    found = [
        fix_usual(
            ship, ranges, receptions.emitted_s, gps_rms_m, SOUND_SPEED_MPS * TIME_RMS_S, receptions.truth,
            receptions.scenario.moving,
        )
        for ship, ranges in noisy_surveys(receptions, gps_rms_m, trials, seed)
    ]  # fmt: skip
    estimate, covariance, converged = (np.concatenate(parts) for parts in zip(*found, strict=True))
    bound = bound_covariance(receptions, gps_rms_m, SOUND_SPEED_MPS * TIME_RMS_S)
    return Trials(receptions, estimate, covariance, converged & np.isfinite(bound).all(), bound, {})


def compare(receptions: Receptions, gps_rms_m: float, trials: int, seed: int) -> Comparison:
    """Bias and error of the usual fix and of ours on the same surveys; the usual one is started at the truth."""
    ours = run_trials(receptions, gps_rms_m, trials, seed)
    usual = run_usual_trials(receptions, gps_rms_m, trials, seed)
    bound = ours.bound[:3]

    def worst(errors: np.ndarray) -> tuple[float, float]:
        if not len(errors):
            return np.nan, np.nan
        bias = np.abs(errors.mean(axis=0)) / bound
        return float(bias.max()), float((np.sqrt(np.mean(errors**2, axis=0)) / bound).max())

    return Comparison(*worst(usual.errors[:, :3]), *worst(ours.errors[:, :3]))


def bias_over_depth(depths_m, gps_rms_m, trials: int, seed: int, receptions: int = 601) -> np.ndarray:
    """Greatest bias of the usual fix and of ours over the bound (D, G, 2), beacons under the hexagon's centre."""
    found = [
        [
            compare(sail_hexagon(Scenario((0.0, 0.0, -depth)), receptions), gps, trials, seed)
            for gps in gps_rms_m
        ]
        for depth in depths_m
    ]
    return np.array([[(one.usual_bias, one.our_bias) for one in row] for row in found])
