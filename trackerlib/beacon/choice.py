"""Which picture of the beacon and the water the pings support: information criteria and pings held out.

for score in compare_models(pings, usual_models(settings)):
    print(score.name, score.aicc, score.held_out_s)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.minimise import CUT
from trackerlib.beacon.motion import FREE_DIRECTIONS
from trackerlib.beacon.paths import paths_through
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, FixSettings

FOLDS = 5
NO_DIFFERENCE = 2.0  # of AICc, below which two models serve as well
SAME_MISFIT = 1.02  # ratio of misfits of pings held out within which they are the same
BLOCKS = 20  # stretches of the survey that are held out together, dealt to the folds in turn


@dataclass(frozen=True, eq=False)
class ModelScore:
    """How well one model serves."""

    name: str
    settings: FixSettings
    fix: BeaconFix
    parameters: int
    aicc: float  # above that of the best model; infinite if it gives no place
    held_out_s: float  # root-mean-square misfit [s] of pings that the fit had not seen


def usual_models(settings: FixSettings) -> dict[str, FixSettings]:
    """The motions to choose from, and the speed of sound without its profile if there is one."""
    models = {
        "lies still": replace(settings, motion="still"),
        "sinks or rises": replace(settings, motion="vertical", method="all-pings"),
        "drifts level": replace(settings, motion="horizontal", method="all-pings"),
        "moves freely": replace(settings, motion="free"),
    }
    if settings.profile is not None:
        models["lies still, one speed of sound"] = replace(settings, motion="still", profile=None)
    if settings.speed_sigma_mps and settings.method == "all-pings":
        models["lies still, speed of sound fitted"] = replace(
            settings, motion="still", estimate_sound_speed=True
        )
    return models


def usual_estimators(settings: FixSettings) -> dict[str, FixSettings]:
    """The same pings fixed in every way that the settings allow: estimators and models of the ship's errors."""
    rms_m = settings.ship_rms_m or ASSUMED_SHIP_RMS_M
    told = settings.gps_rms_m or rms_m
    correlation_s = settings.gps_correlation_s or ASSUMED_SHIP_TIME_S
    independent: dict[str, Any] = {"gps_rms_m": told, "gps_correlation_s": None}
    ways: dict[str, dict[str, Any]] = {
        "every ping, ship's error not known": {"gps_rms_m": None, "gps_correlation_s": None},
        f"every ping, {rms_m:.3g} m independent": independent,
        f"every ping, {rms_m:.3g} m over {correlation_s:g} s": independent
        | {"gps_correlation_s": correlation_s},
        f"usual least squares, {rms_m:.3g} m": independent | {"method": "least-squares"},
    }
    if not settings.emission_known and settings.motion in ("still", "free"):
        ways[f"thesis's experiments, {rms_m:.3g} m"] = {
            "method": "pairs",
            "gps_rms_m": rms_m,
            "gps_correlation_s": None,
            "estimate_sound_speed": False,
            "estimate_interval": False,
            "estimate_interval_drift": False,
            "antenna_sigma_m": (0.0, 0.0),
        }
    return {name: replace(settings, **({"method": "all-pings"} | changes)) for name, changes in ways.items()}


def compare_models(pings: Pings, models: dict[str, FixSettings]) -> tuple[ModelScore, ...]:
    """Scores of models, the best by AICc first.

    AICc counts pings by how many of them are independent. All models are scored on the pings that are no false
    return in the model that leaves out fewest, so that none gains by leaving out more.
    """
    fixes = {name: fix_beacon(pings, settings) for name, settings in models.items()}
    placed = [fix for fix in fixes.values() if fix.residual_s is not None and fix.position is not None]
    if not placed:
        return tuple(
            ModelScore(name, models[name], fix, _parameters(models[name]), np.inf, np.nan)
            for name, fix in fixes.items()
        )
    common = max((fix.used for fix in placed), key=np.sum)
    # The least correlated residuals: what a wrong model leaves is correlated because it is wrong.
    length = min(
        (fix.uncertainty.correlation.length for fix in placed if fix.uncertainty is not None), default=1.0
    )
    count = max(common.sum() / length, 1.0)
    raw = {}
    for name, fix in fixes.items():
        k = _parameters(models[name]) + 1  # and the scale of the errors
        if fix.position is None or fix.residual_s is None or count - k - 1 <= 0:
            raw[name] = np.inf
            continue
        scale = np.sqrt(np.mean(fix.residual_s[fix.used] ** 2))
        residual = np.clip(fix.residual_s[common], -CUT * scale, CUT * scale)
        raw[name] = count * np.log(np.mean(residual**2)) + 2 * k + 2 * k * (k + 1) / (count - k - 1)
    best = min(raw.values())
    scores = [
        ModelScore(
            name,
            models[name],
            fix,
            _parameters(models[name]),
            float(raw[name] - best) if np.isfinite(raw[name]) else np.inf,
            _held_out(pings, models[name], common),
        )
        for name, fix in fixes.items()
    ]
    return tuple(sorted(scores, key=lambda score: score.aicc))


def verdict(scores: tuple[ModelScore, ...]) -> str:
    """Which model the pings choose, in one sentence; where AICc and pings held out disagree, it says so.

    scores : of `compare_models`, the best by AICc first
    """
    placed = [score for score in scores if np.isfinite(score.aicc)]
    if not placed:
        return "No model gives a place, so there is none to choose."
    near = [score for score in placed if score.aicc < NO_DIFFERENCE]
    chosen = min(near, key=lambda score: score.parameters)
    words = f"AICc chooses “{chosen.name}”"
    if len(near) > 1:
        others = ", ".join(f"“{score.name}”" for score in near if score is not chosen)
        words += f", of those that serve as well ({others}) the one with fewest unknowns"
    seen = [score for score in placed if np.isfinite(score.held_out_s)]
    if chosen not in seen:
        return f"{words}; pings held out cannot tell, as some fits without them have no place."
    best = min(seen, key=lambda score: score.held_out_s)
    ms = [f"{1e3 * score.held_out_s:.3g} ms" for score in (best, chosen)]
    if chosen.held_out_s <= SAME_MISFIT * best.held_out_s:
        return f"{words}, and pings held out agree ({ms[1]})."
    return (
        f"{words}, but pings held out choose “{best.name}” ({ms[0]} against {ms[1]}): they disagree, "
        "so the choice is open until more is heard."
    )


def _parameters(settings: FixSettings) -> int:
    return len(FREE_DIRECTIONS[settings.motion]) + settings.linear_unknowns


def _held_out(pings: Pings, settings: FixSettings, scored: np.ndarray) -> float:
    """Misfit [s] of pings by fits that had not seen their stretch of the survey; NaN if any fit has no place."""
    block = np.arange(len(pings)) * BLOCKS // max(len(pings), 1)
    squares, count = 0.0, 0
    for fold in range(FOLDS):
        hidden = block % FOLDS == fold
        told = replace(settings, left_out=settings.left_out | {int(n) for n in pings.number[hidden]})
        fix = fix_beacon(pings, told)
        if fix.position is None or fix.emission_offset_s is None:
            return np.nan
        rows = np.flatnonzero(hidden & scored)
        velocity = np.zeros(3) if fix.velocity is None else fix.velocity
        place = fix.position + fix.elapsed_s[rows, None] * velocity
        paths = paths_through(settings.sound_speed_mps, settings.profile, settings.max_depth_m)
        told_mps = paths.mean_speed(max(-float(fix.position[2]), 0.0))
        time = paths.times(place[None], fix.ship[rows])[0][0] * told_mps / fix.sound_speed_mps
        miss = pings.travel_time_s[rows] - time - _emitted(fix, settings, rows)
        if settings.interval_s:
            miss = miss - settings.interval_s * np.rint(miss / settings.interval_s)
        squares += float(np.nansum(miss**2))
        count += int(np.isfinite(miss).sum())
    return float(np.sqrt(squares / max(count, 1)))


def _emitted(fix: BeaconFix, settings: FixSettings, rows: np.ndarray) -> np.ndarray:
    """What the pinger's clock adds to the times of some pings, but for whole intervals."""
    emission = fix.emission
    if emission is None or emission.interval_s is None:
        return np.full(len(rows), fix.emission_offset_s)
    count = (fix.elapsed_s[rows] - fix.elapsed_s[fix.used][0]) / settings.interval_s
    drift = (emission.drift_ppm_per_hour or 0.0) * 1e-6 * settings.interval_s**2 / 3600
    return emission.offset_s + count * (emission.interval_s - settings.interval_s) + count**2 / 2 * drift
