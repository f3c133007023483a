"""A fix without the bias that noisy ship positions give it.

By squared ranges, whose mean noise is known exactly, with instruments from each ping's neighbours: neither a weight
nor a slope contains the ping's own noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.beacon.attempt import Attempt, Candidate
from trackerlib.beacon.minimise import Misfit, Problem
from trackerlib.beacon.neighbours import smooth_track
from trackerlib.beacon.squared_range import NEIGHBOURS, fix_squared_range

NEIGHBOUR_SHARE = 0.1  # of the slant range: farther than this, neighbours say little of the ship's place
NO_BIAS = 0.1  # of a standard error, in any direction: least squares is kept, which wastes nothing
ROUNDS = 40  # steps within which the general equations come to rest
AT_REST = 1e-8  # of a step's square in standard errors


@dataclass(frozen=True, eq=False)
class Unbiased:
    """A state, and how sure the equations that gave it can be."""

    state: np.ndarray  # (P,)
    # (K + L, K + L) of free directions and linear unknowns; None: least squares
    covariance: np.ndarray | None = None
    bias: np.ndarray | None = None  # (P,) that the state may have, where it could not be taken out


def unbiased(attempt: Attempt, candidate: Candidate) -> Unbiased:
    """The candidate's state without the bias that noisy ship positions give, where it matters and can be found.

    The usual least squares, a bias below NO_BIAS, unknown noise and equations that come to rest nowhere keep the
    state as it is; the last two tell what bias it may have. Of unknown noise all that the residuals show may be the
    ship's.
    """
    problem, state = attempt.problem.only(candidate.keep), candidate.position
    order = np.argsort(problem.share, kind="stable")
    problem = problem.only(order)
    told = attempt.settings.gps_rms_m is not None
    if not told:
        problem = replace(problem, gps_rms_m=np.ones(2))
    if not problem.gps_rms_m.any() or attempt.settings.method == "least-squares":
        return Unbiased(state)
    weight = attempt.weight(candidate)[:, candidate.keep][:, order]
    misfit = problem.eliminate(state[None], weight)
    time_error = np.sqrt(misfit.sum_of_squares[0] / max(len(problem.time) - problem.unknowns, 1))
    stated = problem.variance(misfit.time_gradient)[0]
    scale = float(time_error / np.sqrt(np.median(stated)))
    bias, size_s = _bias(problem, state, misfit, scale)
    if size_s < NO_BIAS * time_error:
        return Unbiased(state)
    if not told:
        return Unbiased(state, bias=bias)
    spacing = np.median(np.linalg.norm(np.diff(problem.ship[:, :2], axis=0), axis=1))
    reach = NEIGHBOUR_SHARE * problem.slant_range(state)
    neighbours = int(np.clip(reach / max(spacing, 1e-3), 2, NEIGHBOURS))
    attempt.log.begin("unbiased")
    plain = problem.linear_unknowns == 1 and not problem.emission_known
    by = _by_squared_ranges if plain and attempt.motion.kind in ("still", "free") else _by_instruments
    return by(attempt, problem, state, misfit, scale, neighbours) or Unbiased(state, bias=bias)


def _bias(problem: Problem, state: np.ndarray, misfit: Misfit, scale: float) -> tuple[np.ndarray, float]:
    """The bias (P,) of least squares, to second order in the ship's noise, and how far [s] it moves the times.

    Noise makes a range long by half its variance across the ray over the range, and turns the ray by what it also
    adds to the residual.
    """
    offset = problem.places(state[None])[0] - problem.ship
    distance = np.linalg.norm(offset, axis=-1)
    ray = offset / distance[:, None]
    speed = distance / misfit.travel_time[0]
    variance = np.append((scale * problem.gps_rms_m) ** 2, 0.0)
    along = ray**2 @ variance
    longer = (variance.sum() - along) / (2 * distance * speed)
    turned = (ray * along[:, None] - ray * variance) / (distance * speed**2)[:, None]
    if len(state) > 3:
        turned = np.hstack([turned, problem.share[:, None] * turned])
    weight = misfit.weight[0]
    score = ((turned - misfit.gradient[0] * longer[:, None]).T @ weight) @ problem.axes.T
    normal = misfit.normal_matrix(problem.axes)[0]
    bias = np.linalg.pinv(normal, rcond=1e-15, hermitian=True) @ score
    return bias @ problem.axes, float(np.sqrt(max(score @ bias, 0.0)))


def _by_squared_ranges(
    attempt: Attempt, problem: Problem, state: np.ndarray, misfit: Misfit, scale: float, neighbours: int
) -> Unbiased | None:
    """By compiled equations along straight lines that take as long as the rays do; None where they fail.

    They know places below the hydrophone alone: one above it is solved upside down.
    """
    offset = misfit.linear[0, 0]
    turned = np.ones(len(state))
    turned[2::3] = 1.0 if _is_below(problem, state) else -1.0
    for _ in range(3):
        travel_time = problem.times(state[None])[0][0]
        distance = np.linalg.norm(problem.places(state[None])[0] - problem.ship, axis=-1)
        speed = distance / travel_time
        usual = float(np.median(speed))
        found = fix_squared_range(
            problem.ship[None] * turned[:3],
            (distance + speed * (problem.time - offset - travel_time))[None],
            problem.share,
            (scale * float(problem.gps_rms_m[0]), scale * float(problem.gps_rms_m[1])),
            scale * problem.time_sigma_s * usual,
            moving=attempt.motion.moving,
            neighbours=neighbours,
            correlation_s=_correlation(attempt),
        )
        if not found.converged[0]:
            return None
        before = state
        offset += found.estimate[0, 3] / usual
        state = np.concatenate([found.estimate[0, :3], found.estimate[0, 4:]]) * turned
        moved = np.array([np.linalg.norm(state - before)])
        attempt.log.note(state[None], problem.eliminate(state[None], misfit.weight), moved)
    order = [k for k in range(len(state) + 1) if k != 3] + [3]  # c0 stands last here, in seconds
    size = np.append(turned, 1 / usual)
    return Unbiased(state, found.covariance[0][np.ix_(order, order)] * np.outer(size, size))


def _by_instruments(
    attempt: Attempt, problem: Problem, state: np.ndarray, misfit: Misfit, scale: float, neighbours: int
) -> Unbiased | None:
    """By the same equations for any motion and any linear unknowns; None where they come to rest nowhere."""
    noise = np.append((scale * problem.gps_rms_m) ** 2, (scale * problem.time_sigma_s) ** 2)
    ship = np.ascontiguousarray(problem.ship)
    smooth, shared = smooth_track(ship, problem.share, noise, neighbours, _correlation(attempt))
    beside = replace(problem, ship=np.column_stack([smooth, problem.ship[:, 2]]))
    linear, still = misfit.linear[0], np.zeros(len(problem.axes))
    prior = problem.prior / (scale**2 * np.median(problem.variance(misfit.time_gradient)))
    pull = np.concatenate([still, prior])
    below = _is_below(problem, state)
    for _ in range(ROUNDS):
        distance, slope, columns, speed = _slopes(problem, state, linear)
        near, near_slope, _, near_speed = _slopes(beside, state, linear)
        longer = speed * (problem.time - distance / speed - columns @ linear[: columns.shape[1]])
        miss = -2 * distance * longer - longer**2 - noise[:2].sum() + noise[2] * speed**2
        offset = problem.places(state[None])[0] - beside.ship
        weight = 1 / _variance(offset, near, near_speed, noise)
        instrument = weight[:, None] * near_slope
        normal = instrument.T @ slope + np.diag(pull)
        right = -instrument.T @ miss - pull * np.concatenate([still, linear])
        right[: len(still)] += _common(problem, 4 * (weight * shared)[:, None] * offset[:, :2] * noise[:2])
        if not (np.isfinite(normal).all() and np.isfinite(right).all()):
            return None
        step = np.linalg.lstsq(normal, right, rcond=1e-15)[0]
        moved = step[: len(still)] @ problem.axes
        state, linear = state + moved, linear + step[len(still) :]
        at = problem.eliminate(state[None], misfit.weight)
        attempt.log.note(state[None], at, np.array([np.linalg.norm(moved)]))
        if step @ normal @ step < AT_REST:
            inverse = np.linalg.pinv(normal, rcond=1e-15)
            inside = problem.region.edge(state) is None and _is_below(problem, state) == below
            return Unbiased(state, inverse @ (instrument.T @ near_slope) @ inverse.T) if inside else None
    return None


def _is_below(problem: Problem, state: np.ndarray) -> bool:
    """Whether a state (P,) lies below the hydrophone."""
    return bool(state[2] < problem.ship[:, 2].max())


def _correlation(attempt: Attempt) -> float:
    """Correlation time of the ship's position errors, in halves of the survey; 0 for errors that have none."""
    return (attempt.settings.gps_correlation_s or 0.0) / attempt.motion.half_s


def _common(problem: Problem, mean: np.ndarray) -> np.ndarray:
    """What correlated errors add to the equations of the free directions on average; mean (n, 2) east, north."""
    level = np.column_stack([mean, np.zeros(len(mean))])
    if problem.axes.shape[1] > 3:
        level = np.hstack([level, problem.share[:, None] * level])
    return problem.axes @ level.sum(axis=0)


def _variance(offset: np.ndarray, distance: np.ndarray, speed: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Variance (n,) [m^4] of the misses of squared ranges; noise (3,): of east, north [m^2] and of times [s^2]."""
    ranges = noise[2] * speed**2
    places = 4 * offset[:, :2] ** 2 @ noise[:2] + 2 * np.sum(noise[:2] ** 2)
    return places + 4 * distance**2 * ranges + 2 * ranges**2


def _slopes(problem: Problem, state: np.ndarray, linear: np.ndarray):
    """Distances (n,), slopes (n, K + L) of their squares by all unknowns, the clock's columns, and speeds (n,)."""
    times, gradient = problem.times(state[None])
    slower = 1.0 if problem.slowness_sigma is None else 1 + linear[-1]
    distance = np.linalg.norm(problem.places(state[None])[0] - problem.ship, axis=-1)
    speed = distance / (slower * times[0])
    by_unknown = np.hstack([slower * gradient[0] @ problem.axes.T, problem.columns_at(times)[0]])
    return distance, 2 * (distance * speed)[:, None] * by_unknown, problem.columns, speed
