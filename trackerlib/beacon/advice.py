"""Which leg would let the pings tell a place: the shortest one, in words for the helm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackerlib.beacon.minimise import Problem
from trackerlib.beacon.observability import UNSEEN_SHARE
from trackerlib.frames import bearing_deg

TURNS_DEG = (60.0, -60.0, 90.0, -90.0, 120.0, -120.0)
SHARES = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0, 1.5, 2.0)  # of the slant range, that a leg may be long
LEAST_PINGS = 10  # on a leg
ROUND_M = 50.0


def leg_that_helps(problem: Problem, states: np.ndarray, noise_s: float) -> str:
    """What to sail so that every direction is seen from all places that fit, after the last ping heard.

    states : (S, P) those places
    noise_s : error of a time of weight one, the correlation of residuals counted in
    """
    leg = np.diff(problem.ship[-max(len(problem.ship) // 10, 2) :, :2], axis=0).sum(axis=0)
    course = bearing_deg(*leg) if np.hypot(*leg) > 1 else 0.0
    slant_range = max(problem.slant_range(state) for state in states)
    for share in SHARES:
        length = max(ROUND_M * np.ceil(share * slant_range / ROUND_M), ROUND_M)
        seen = {turn: _widest(problem, states, noise_s, course + turn, length) for turn in TURNS_DEG}
        best = min(seen, key=lambda turn: seen[turn])
        if seen[best] < UNSEEN_SHARE * slant_range:
            side, to = "starboard" if best > 0 else "port", (course + best) % 360
            return f"turn {abs(best):.0f} degrees to {side}, to {to:.0f} degrees, and sail {length:.0f} m"
    return f"sail a loop of {2 * slant_range:.0f} m on another bearing"


def _widest(
    problem: Problem, states: np.ndarray, noise_s: float, course_deg: float, length_m: float
) -> float:
    """Greatest standard error [m] of a place in any direction after a leg, at the place that it tells least of."""
    usual = np.median(np.linalg.norm(np.diff(problem.ship[:, :2], axis=0), axis=1))
    count = int(np.clip(length_m / max(usual, 0.1), LEAST_PINGS, 200))
    along = length_m * np.arange(1, count + 1)[:, None] / count
    way = np.array([np.sin(np.radians(course_deg)), np.cos(np.radians(course_deg)), 0.0])
    apart = (problem.share[-1] - problem.share[0]) / max(len(problem.share) - 1, 1)
    longer = replace(
        problem,
        ship=np.vstack([problem.ship, problem.ship[-1] + along * way]),
        time=np.concatenate([problem.time, np.full(count, problem.time[-1])]),
        share=np.concatenate([problem.share, problem.share[-1] + apart * np.arange(1, count + 1)]),
        columns=np.vstack([problem.columns, np.repeat(problem.columns[-1:], count, axis=0)]),
        noise_s=noise_s,
    )
    widest = 0.0
    for state in states:
        weight = np.nan_to_num(longer.relative_weight(longer.times(state[None])[1]))
        normal = longer.eliminate(state[None], weight).normal_matrix(problem.axes)[0]
        least = np.linalg.eigvalsh(normal)[0]
        widest = max(widest, noise_s / np.sqrt(max(least, 1e-30)))
    return widest
