"""Distinct places that fit the pings: many starts, robust descents, and what of them comes to rest apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackerlib.beacon.above_below import mirrored
from trackerlib.beacon.attempt import TYPICAL_DEPTH_M, Attempt, Candidate
from trackerlib.beacon.minimise import Problem, robust_descent, scale_of, settle, starts
from trackerlib.beacon.paths import depth_below_surface
from trackerlib.beacon.squared_range import linear_start
from trackerlib.residuals import residual_correlation

SAME_PLACE_SHARE = 0.02  # of the slant range: solutions closer than this are one
PRIOR_ROUNDS = 3  # after which the weight of a prior no longer changes


def candidates_of(attempt: Attempt) -> list[Candidate]:
    """Distinct places that fit, best first."""
    straight, search = attempt.quick()
    first = np.concatenate([starts(attempt.problem, attempt.extra_start), _linear_start(attempt, straight)])
    log = attempt.log
    log.begin(f"search from {len(first)} starts")
    found, scale = robust_descent(straight, first, rounds=12, steps=6, log=log)
    found = found[_distinct(attempt, found, attempt.cost(found, float(scale.min()), straight))[:6]]
    found = np.concatenate([found, _other_side(attempt, found[0])])
    log.begin(f"search on from {len(found)} place{'s' if len(found) > 1 else ''}")
    found, scale = robust_descent(search, found, rounds=8, steps=6, log=log)
    reachable = np.isfinite(search.times(found)[0]).mean(axis=1) > 0.5
    found, scale = found[reachable], scale[reachable]
    if not len(found):
        return []
    settled = []
    for k in range(len(found)):
        log.begin("settle" if len(found) == 1 else f"settle place {k + 1} of {len(found)}")
        settled.append(_settled(attempt, found[k], float(scale[k])))
    positions = np.array([candidate.position for candidate in settled])
    common = _common_scale(attempt, settled)
    cost = attempt.cost(positions, common, replace(attempt.problem, noise_s=common))
    return [replace(settled[k], cost=float(cost[k])) for k in _distinct(attempt, positions, cost)]


def _other_side(attempt: Attempt, state: np.ndarray) -> np.ndarray:
    """The mirror (0 or 1, P) of a state on the other side of the hydrophone, where that is under water."""
    start = mirrored(state, float(attempt.problem.ship[:, 2].mean()))
    return start[None] if depth_below_surface(start) > 0 else np.empty((0, len(state)))


def _settled(attempt: Attempt, state: np.ndarray, scale: float) -> Candidate:
    """Where a state comes to rest; a prior of the speed of sound is weighed by the noise found there."""
    problem, log = replace(attempt.problem, noise_s=scale), attempt.log
    for _ in range(1 if problem.slowness_sigma is None else PRIOR_ROUNDS):
        state, keep, at_rest = settle(problem, state, scale, reject=attempt.settings.reject, log=log)
        weight = keep * np.nan_to_num(problem.relative_weight(problem.times(state[None])[1]))
        misfit = problem.eliminate(state[None], weight)
        whitened = (misfit.residual * np.sqrt(misfit.weight))[0, keep]
        square = whitened @ whitened / max(keep.sum() - problem.unknowns, 1)
        scale = float(max(np.sqrt(square), problem.time_sigma_s))
        length = residual_correlation(whitened).length
        problem = replace(problem, noise_s=scale * np.sqrt(length))
    return Candidate(state, keep, at_rest, problem.noise_s)


def _linear_start(attempt: Attempt, straight: Problem) -> np.ndarray:
    """The state (0 or 1, P) that solves the equations linear in squared ranges, along straight paths."""
    ranges = straight.time * straight.paths.mean_speed(TYPICAL_DEPTH_M)
    ship = np.ascontiguousarray(straight.ship)
    level = np.ascontiguousarray(ship[:, :2])
    solved, fine = linear_start(ship, level, ranges, straight.share, attempt.motion.moving)
    if not fine or not np.isfinite(solved).all():
        return np.empty((0, straight.axes.shape[1]))
    state = np.concatenate([solved[:3], solved[4:]])
    return straight.region.clip((state @ straight.axes.T @ straight.axes)[None])


def _common_scale(attempt: Attempt, settled: list[Candidate]) -> float:
    scales = []
    for candidate in settled:
        keep, problem = candidate.keep, replace(attempt.problem, noise_s=candidate.noise_s)
        residual = problem.eliminate(candidate.position[None], keep[None].astype(float)).residual[:, keep]
        scales.append(scale_of(residual, attempt.problem.unknowns, attempt.problem.time_sigma_s)[0])
    return float(min(scales))


def _distinct(attempt: Attempt, positions: np.ndarray, cost: np.ndarray) -> list[int]:
    """Indices of places farther apart than SAME_PLACE_SHARE of the slant range, cheapest first."""
    kept: list[int] = []
    for k in np.argsort(cost):
        slant_range = attempt.problem.slant_range(positions[k])
        apart = [np.linalg.norm(positions[k] - positions[j]) for j in kept]
        if all(distance > SAME_PLACE_SHARE * slant_range for distance in apart):
            kept.append(int(k))
    return kept
