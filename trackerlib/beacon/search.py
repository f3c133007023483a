"""Distinct places that fit the pings: many starts, robust descents, and what of them comes to rest apart."""

from __future__ import annotations

import numpy as np

from trackerlib.beacon.attempt import TYPICAL_DEPTH_M, Attempt, Candidate
from trackerlib.beacon.minimise import Problem, robust_descent, scale_of, settle, starts
from trackerlib.beacon.squared_range import linear_start

SAME_PLACE_SHARE = 0.02  # of the slant range: solutions closer than this are one


def candidates_of(attempt: Attempt) -> list[Candidate]:
    """Distinct places that fit, best first."""
    straight, search = attempt.quick()
    first = np.concatenate([starts(attempt.problem, attempt.extra_start), _linear_start(attempt, straight)])
    log = attempt.log
    log.begin(f"search from {len(first)} starts")
    found, scale = robust_descent(straight, first, rounds=12, steps=6, log=log)
    found = found[_distinct(attempt, found, attempt.cost(found, float(scale.min()), straight))[:6]]
    log.begin(f"search on from {len(found)} place{'s' if len(found) > 1 else ''}")
    found, scale = robust_descent(search, found, rounds=8, steps=6, log=log)
    reachable = np.isfinite(search.times(found)[0]).mean(axis=1) > 0.5
    found, scale = found[reachable], scale[reachable]
    if not len(found):
        return []
    settled = []
    for k in range(len(found)):
        log.begin("settle" if len(found) == 1 else f"settle place {k + 1} of {len(found)}")
        settled.append(settle(attempt.problem, found[k], scale[k], reject=attempt.settings.reject, log=log))
    positions = np.array([position for position, _, _ in settled])
    cost = attempt.cost(positions, _common_scale(attempt, settled), attempt.problem)
    kept = _distinct(attempt, positions, cost)
    return [Candidate(settled[k][0], settled[k][1], settled[k][2], float(cost[k])) for k in kept]


def _linear_start(attempt: Attempt, straight: Problem) -> np.ndarray:
    """The state (0 or 1, P) that solves the equations linear in squared ranges, along straight paths."""
    ranges = straight.time * straight.paths.mean_speed(TYPICAL_DEPTH_M)
    ship = np.ascontiguousarray(straight.ship)
    solved, fine = linear_start(ship, ship[:, :2], ranges, straight.share, attempt.motion.moving)
    if not fine or not np.isfinite(solved).all():
        return np.empty((0, straight.axes.shape[1]))
    state = np.concatenate([solved[:3], solved[4:]])
    return straight.region.clip((state @ straight.axes.T @ straight.axes)[None])


def _common_scale(attempt: Attempt, settled) -> float:
    scales = []
    for position, keep, _ in settled:
        residual = attempt.problem.eliminate(position[None], keep[None].astype(float)).residual[:, keep]
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
