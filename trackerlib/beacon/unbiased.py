"""A fix without the bias that noisy ship positions give it."""

from __future__ import annotations

import numpy as np

from trackerlib.beacon.attempt import Attempt, Candidate
from trackerlib.beacon.squared_range import NEIGHBOURS, fix_squared_range

NEIGHBOUR_SHARE = 0.1  # of the slant range: farther than this, neighbours say little of the ship's place


def unbiased(attempt: Attempt, candidate: Candidate) -> np.ndarray:
    """The candidate's state (P,) without the bias that noisy ship positions give, where it can be found.

    By squared ranges along straight lines that take as long as the rays do. Restricted motions and unknown
    noise keep the state as it is.
    """
    problem, state = attempt.problem.only(candidate.keep), candidate.position
    problem = problem.only(np.argsort(problem.share, kind="stable"))
    if not problem.gps_rms_m or problem.emission_known or attempt.motion.kind not in ("still", "free"):
        return state
    weight = attempt.weight(candidate)
    misfit = attempt.problem.eliminate(state[None], weight)
    time_error = np.sqrt(misfit.sum_of_squares[0] / max(len(problem.time) - problem.unknowns, 1))
    gradient = problem.times(state[None])[1][0, :, :2]
    stated = problem.time_sigma_s**2 + problem.gps_rms_m**2 * (gradient**2).sum(axis=1)
    scale = time_error / np.sqrt(np.median(stated))
    spacing = np.median(np.linalg.norm(np.diff(problem.ship[:, :2], axis=0), axis=1))
    reach = NEIGHBOUR_SHARE * problem.slant_range(state)
    neighbours = int(np.clip(reach / max(spacing, 1e-3), 2, NEIGHBOURS))
    offset = misfit.offset[0]
    attempt.log.begin("unbiased")
    for _ in range(3):
        travel_time = problem.times(state[None])[0][0]
        distance = np.linalg.norm(problem.places(state[None])[0] - problem.ship, axis=-1)
        speed = distance / travel_time
        found = fix_squared_range(
            problem.ship[None],
            (distance + speed * (problem.time - offset - travel_time))[None],
            problem.share,
            scale * problem.gps_rms_m,
            scale * problem.time_sigma_s * float(np.median(speed)),
            moving=attempt.motion.moving,
            neighbours=neighbours,
        )
        if not found.converged[0]:
            return candidate.position
        before = state
        offset += found.estimate[0, 3] / float(np.median(speed))
        state = np.concatenate([found.estimate[0, :3], found.estimate[0, 4:]])
        moved = np.array([np.linalg.norm(state - before)])
        attempt.log.note(state[None], attempt.problem.eliminate(state[None], weight), moved)
    return state
