"""Why a fix must not be believed, in words that say what to do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackerlib.beacon.above_below import depth_that_helps, mirror_of, side_words
from trackerlib.beacon.advice import leg_that_helps
from trackerlib.beacon.attempt import TYPICAL_DEPTH_M, Attempt, Candidate
from trackerlib.beacon.minimise import descend
from trackerlib.beacon.motion import FREE_DIRECTIONS
from trackerlib.beacon.paths import depth_below_surface
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M
from trackerlib.rounding import rounded

FEWEST_CHANGES = 8  # pairs of pings from which impossible times are told
DRIFTING_LENGTH = 3.0  # residuals that count as one, from which a still beacon's motion is looked for
MANY_TIMES = 10  # pings for every unknown: residuals this alike are then no want of pings
ONE_DISTANCE = 2.0  # noises of a time, that all times may scatter by where the ship kept one distance
ALIKE_SHARE = 0.02  # the same, of the time that sound takes along the track
OTHER_LEG = 0.3  # of the slant range: a leg that tells places apart
SLOWEST_MPS = 0.02  # below this a beacon is not said to move
MOST_BIAS = 0.2  # standard errors by which noisy ship positions may shift a fix that is believed
MOVING_SHARE = 0.4  # of the still fit's squares: a drift that leaves less shows that the beacon moves


def impossible_times(attempt: Attempt, ship_sigma: float) -> str | None:
    """Why the times cannot be travel times of these places: most change faster than sound would let them."""
    problem = attempt.problem
    apart = max(len(problem.time) // 4, 1)
    moved = np.linalg.norm(problem.ship[apart:] - problem.ship[:-apart], axis=1)
    if attempt.motion.moving:
        moved = moved + problem.region.max_moved_m * np.abs(problem.share[apart:] - problem.share[:-apart])
    speed = problem.paths.mean_speed(TYPICAL_DEPTH_M)
    allowed = 1.5 * (moved + 10 * ship_sigma) / speed + 0.02
    changed = np.abs(problem.time[apart:] - problem.time[:-apart])
    if len(changed) < FEWEST_CHANGES or np.mean(changed > allowed) < 0.6:
        return None
    return (
        f"the times change by {np.median(changed):.3g} s where the ship's movement allows "
        f"{np.median(allowed):.3g} s; check their unit, or tell the interval if they are folded"
    )


def objection(
    attempt: Attempt, best: Candidate, fix: BeaconFix, bias: np.ndarray | None = None
) -> str | None:
    """Why this fix must not be believed, or None; bias (P,) is the one that its state may have."""
    edge = attempt.problem.region.edge(best.position)
    if edge:
        act = "widen it or check the times"
        if _one_distance(attempt, best):
            act = (
                "all times are alike within their noise, as on a circle round the beacon, which tells no depth; sail "
                "a leg straight over the middle"
            )
        return f"the best fit lies on the edge of the search region: {edge}; {act}"
    if fix.uncertainty is None:
        return _no_standard_error(attempt, fix)
    for when, instant in (("first", 0.0), ("last", 2 * attempt.motion.half_s)):
        depth = depth_below_surface(fix.at(instant)[0])
        if attempt.motion.moving and depth < -2 * np.sqrt(fix.at(instant)[1][2, 2]):
            return (
                f"at the {when} ping the beacon would have been {-depth:.0f} m above the surface; "
                "choose another motion, or check the times"
            )
    if why := _moves(attempt, best, fix):
        return why
    if unseen := fix.unobservable:
        if not unseen[-1].leg_helps:
            return unseen[-1].why
        noise_s = np.hypot(fix.uncertainty.noise_s, _assumed_noise(attempt))
        return f"{unseen[-1].why}: {leg_that_helps(attempt.problem.only(best.keep), best.position[None], noise_s)}"
    if bias is not None and (why := _shifted(attempt, best, fix, bias)):
        return why
    if not best.settled:
        return "the search did not come to rest; check the speed of sound and the times"
    if others := fix.alternatives:
        if len(others) == 1 and mirror_of(fix) is not None:
            noise_s = np.hypot(fix.uncertainty.noise_s, _assumed_noise(attempt))
            noise_m = noise_s * attempt.problem.paths.mean_speed(TYPICAL_DEPTH_M)
            return f"{side_words(fix)}; {depth_that_helps(fix, noise_m)}"
        other_leg = max(100 * round(OTHER_LEG * attempt.problem.slant_range(best.position) / 100), 100)
        return (
            f"{len(others)} other place{'s' if len(others) > 1 else ''} fit about as well; "
            f"to tell them apart turn by 60 degrees or more and sail {other_leg:.0f} m"
        )
    if not _as_steep_as_stated(attempt, best, fix):
        leg = leg_that_helps(
            attempt.problem.only(best.keep), best.position[None], 2 * fix.uncertainty.noise_s
        )
        return f"the misfit is flatter than its ellipse says, so no honest sigma can be given; {leg}"
    return None


def _assumed_noise(attempt: Attempt) -> float:
    """Error of a time [s] that a ship position of unknown error adds."""
    if attempt.settings.gps_rms_m is not None:
        return 0.0
    return ASSUMED_SHIP_RMS_M / attempt.problem.paths.mean_speed(TYPICAL_DEPTH_M)


def _no_standard_error(attempt: Attempt, fix: BeaconFix) -> str:
    settings, used = attempt.settings, int(fix.used.sum())
    if used < MANY_TIMES * attempt.problem.unknowns:
        return f"{used} pings with residuals this alike say too little for a standard error; collect more"
    cause = "check ship positions and the speed of sound, or tell the motion"
    if settings.interval_s is not None and not settings.estimate_interval:
        cause = "estimate the interval of the pinger as well"
    return (
        f"the residuals of all {used} pings hang together, so the picture behind the fix is wrong and no standard "
        f"error can be given; {cause}"
    )


def _one_distance(attempt: Attempt, best: Candidate) -> bool:
    """Whether the times differ little more than they err, though the ship moved."""
    problem = attempt.problem.only(best.keep)
    scatter_s = 1.4826 * float(np.median(np.abs(problem.time - np.median(problem.time))))
    extent_s = np.ptp(problem.ship[:, :2], axis=0).max() / problem.paths.mean_speed(TYPICAL_DEPTH_M)
    return scatter_s < min(ONE_DISTANCE * best.noise_s, ALIKE_SHARE * extent_s)


def _moves(attempt: Attempt, best: Candidate, fix: BeaconFix) -> str | None:
    """Why a beacon taken to lie still does not: residuals that hang together and that a drift takes away."""
    if attempt.motion.moving or fix.uncertainty.correlation.length < DRIFTING_LENGTH:
        return None
    problem = replace(attempt.problem.only(best.keep), axes=FREE_DIRECTIONS["free"])
    weight = attempt.weight(best)[:, best.keep]
    state, _ = descend(
        problem, np.concatenate([best.position, np.zeros(3)])[None], weight, steps=60, axes=problem.axes
    )
    free = problem.eliminate(state, weight).sum_of_squares[0]
    still = attempt.problem.eliminate(best.position[None], attempt.weight(best)).sum_of_squares[0]
    speed = float(np.linalg.norm(state[0, 3:])) / attempt.motion.half_s
    if free > MOVING_SHARE * still or speed < SLOWEST_MPS or problem.region.edge(state[0]) is not None:
        return None
    return (
        f"a beacon that moves, at {speed:.2g} m/s, leaves residuals {np.sqrt(still / free):.1f} times smaller "
        "than one that lies still; tell the motion (horizontal, vertical, free), or check ship positions and times"
    )


def _shifted(attempt: Attempt, best: Candidate, fix: BeaconFix, bias: np.ndarray) -> str | None:
    """Why a bias (P,) of the state spoils the fix, or None where it is small beside what is stated."""
    axes, to_state = attempt.problem.axes, np.linalg.inv(attempt.motion.at(0.0))
    covariance = axes @ to_state @ fix.uncertainty.covariance @ to_state.T @ axes.T
    free = axes @ bias
    errors = float(np.sqrt(free @ np.linalg.pinv(covariance, rcond=1e-15, hermitian=True) @ free))
    if errors < MOST_BIAS:
        return None
    noise_s = max(2.0, errors) * fix.uncertainty.noise_s
    leg = leg_that_helps(attempt.problem.only(best.keep), best.position[None], noise_s)
    shift = f"the best fit by some {rounded(float(np.linalg.norm(bias[:3])))} m, {errors:.1f} of its standard errors"
    if attempt.settings.gps_rms_m is None:
        return f"if the residuals are errors of the ship's position, they shift {shift}; tell that error, or {leg}"
    return f"noisy ship positions shift {shift}, and equations free of that have no sure answer here; {leg}"


def _as_steep_as_stated(attempt: Attempt, best: Candidate, fix: BeaconFix) -> bool:
    """Whether two noise sigmas along the weakest direction really cost what the ellipse says (4)."""
    to_state = np.linalg.inv(attempt.motion.at(0.0))
    values, vectors = np.linalg.eigh(to_state @ fix.uncertainty.noise_covariance @ to_state.T)
    step = 2 * np.sqrt(values[-1]) * vectors[:, -1]
    places = attempt.problem.region.clip(
        np.array([best.position, best.position + step, best.position - step])
    )
    weight = np.repeat(attempt.weight(best), 3, axis=0)
    square = attempt.problem.eliminate(places, weight).sum_of_squares
    variance = square[0] / max(best.keep.sum() - attempt.problem.unknowns, 1)
    rise = (square[1:] - square[0]) / max(variance, 1e-30) / fix.uncertainty.correlation.length
    return bool(rise.min() > 1.0)
