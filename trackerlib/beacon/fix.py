"""A beacon's position from every ping, never knowing when it first pinged.

    fix = fix_beacon(pings, FixSettings(sound_speed_mps=1507))
    print(fix)

After Wojcik (1993), chapter II, with every reception used instead of chained pairs (2-12).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from trackerlib.beacon.attempt import Attempt, Candidate, problem_of
from trackerlib.beacon.clock import pinger_clock
from trackerlib.beacon.convergence import Recorder
from trackerlib.beacon.fix_pairs import fix_experiments
from trackerlib.beacon.folds import refold
from trackerlib.beacon.motion import FREE_DIRECTIONS, motion_over
from trackerlib.beacon.objections import impossible_times, objection
from trackerlib.beacon.observability import (
    Unobservable,
    straight_track,
    unseen_beside_line,
    unseen_directions,
)
from trackerlib.beacon.on_a_line import UNREACHABLE, fix_on_a_line
from trackerlib.beacon.paths import paths_through
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import AS_LIKELY, BeaconFix, blank_fix, timed
from trackerlib.beacon.search import candidates_of
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, METHODS, FixSettings
from trackerlib.beacon.unbiased import unbiased

ONE_PLACE = 6.0  # times the ship's error: a track shorter than this is one place
ONE_PLACE_SIGMAS = 2.0  # standard errors within which two solutions are one place
SPARE_PINGS = 3  # pings beyond the number of unknowns below which a fix is refused
FOLDED_ROUNDS = 4  # fixes after which no folded time may move any more


def fix_beacon(pings: Pings, settings: FixSettings | None = None) -> BeaconFix:
    """The beacon's position with its uncertainty, or the reason why there is none.

    Times may carry any unknown constant (unless settings.emission_known), and any number of whole intervals if
    settings.interval_s is told. Errors of ship position (settings.gps_rms_m) and of time are weighed together,
    and the bias that noisy ship positions give is taken out (settings.method "least-squares" leaves it in, for
    comparison); where gps_rms_m is None all pings weigh alike.
    Either way the scale of the errors is taken from the residuals. A moving beacon's position is that at the
    first ping (3-2); `BeaconFix.at` gives others.
    """
    settings = settings or FixSettings()
    if settings.method == "pairs":
        return fix_experiments(pings, _without_false_returns(pings, settings))
    blank, allowed = blank_fix(pings, settings)
    if reason := _too_little(pings, allowed, settings):
        return replace(blank, reason=reason)
    for _ in range(FOLDED_ROUNDS if settings.interval_s else 1):
        time = blank.time_s[allowed]
        fix = _fixed(_attempt(pings, blank, allowed, settings))
        if settings.interval_s is None or fix.residual_s is None:
            break
        renewed = refold(time, fix.residual_s[allowed], settings.interval_s)
        if np.array_equal(renewed, time):
            break
        blank = timed(blank, renewed, pings, allowed, settings)
    return _with_left_out(fix, pings, settings)


def _with_left_out(fix: BeaconFix, pings: Pings, settings: FixSettings) -> BeaconFix:
    """The fix with residuals of the pings left out by hand too, where the constant in all times is one."""
    plain = not (settings.estimate_interval or settings.estimate_interval_drift)
    if fix.residual_s is None or fix.position is None or not settings.left_out or not plain:
        return fix
    by_hand = np.isin(pings.number, list(settings.left_out)) & np.isfinite(fix.ship).all(axis=1)
    by_hand &= np.isfinite(pings.travel_time_s)
    paths = paths_through(settings.sound_speed_mps, settings.profile, settings.max_depth_m)
    moved = 0.0 if fix.velocity is None else fix.elapsed_s[by_hand, None] * fix.velocity
    place = fix.position + np.zeros((by_hand.sum(), 3)) + moved
    travel_s = np.array(
        [
            paths.times(at[None], ship[None])[0][0, 0]
            for at, ship in zip(place, fix.ship[by_hand], strict=True)
        ]
    )
    travel_s *= paths.mean_speed(max(fix.depth_m, 0.0)) / fix.sound_speed_mps
    late_s = pings.travel_time_s[by_hand] - travel_s - (fix.emission_offset_s or 0.0)
    if settings.interval_s is not None:
        late_s -= settings.interval_s * np.rint(late_s / settings.interval_s)
    residual_s = fix.residual_s.copy()
    residual_s[by_hand] = late_s
    return replace(fix, residual_s=residual_s)


def _without_false_returns(pings: Pings, settings: FixSettings) -> FixSettings:
    """The settings of the thesis's experiments, which reject nothing, with what every ping together tells is false."""
    if settings.reject == "none":
        return settings
    every = fix_beacon(pings, replace(settings, method=METHODS[0]))
    return (
        replace(settings, left_out=settings.left_out | set(every.rejected)) if every.converged else settings
    )


def _too_little(pings: Pings, allowed: np.ndarray, settings: FixSettings) -> str | None:
    """Why the pings allowed (N,) cannot give a fix, whatever they say."""
    needed = len(FREE_DIRECTIONS[settings.motion]) + settings.linear_unknowns + SPARE_PINGS
    if allowed.sum() < needed:
        return f"{int(allowed.sum())} usable pings; with fewer than {needed} the unknowns fit anything, so collect more"
    if settings.motion != "still" and not pings.timed and settings.interval_s is None:
        return "a moving beacon needs the instant of each ping: a column utc or time_s, or the interval"
    return None


def _attempt(pings: Pings, blank: BeaconFix, allowed: np.ndarray, settings: FixSettings) -> Attempt:
    motion = motion_over(settings.motion, blank.elapsed_s)
    return Attempt(
        problem=problem_of(pings, blank, allowed, settings, motion),
        motion=motion,
        blank=blank,
        allowed=allowed,
        settings=settings,
        extra_start=None
        if settings.start is None
        else blank.frame.to_local(*settings.start[:2], -settings.start[2]),
        log=Recorder(motion.at(0.0)),
        clock=pinger_clock(pings, blank.time_s[allowed], allowed, settings),
        heading_rad=pings.heading_rad,
    )


def fix_history(
    pings: Pings, settings: FixSettings | None = None, first: int = 1, step: int = 1
) -> Iterator[tuple[int, BeaconFix]]:
    """How many pings had been heard, and the fix the ship would have had then, every `step` pings."""
    for count in range(first, len(pings) + 1, step):
        yield count, fix_beacon(pings.only(slice(0, count)), settings)


def _fixed(attempt: Attempt) -> BeaconFix:
    """The fix of an attempt, with its log."""
    return replace(_judged(attempt), log=tuple(attempt.log.steps))


def _judged(attempt: Attempt) -> BeaconFix:
    track = straight_track(attempt.problem.ship)
    told = attempt.settings.ship_rms_m
    ship_sigma = ASSUMED_SHIP_RMS_M if told is None else told
    if track.length_m < ONE_PLACE * max(ship_sigma, 1.0):
        why = (
            f"the ship stayed within {track.length_m:.0f} m: from one place nothing can be told but changes of "
            "range; sail two legs on different bearings"
        )
        return replace(attempt.blank, reason=why)
    if why := impossible_times(attempt, max(ship_sigma, 1.0)):
        return replace(attempt.blank, reason=why)
    if track.is_straight(max(ship_sigma, 0.1)):
        if not attempt.motion.moving:
            return fix_on_a_line(attempt, track)
        beside = unseen_beside_line(track)
        return replace(attempt.blank, reason=beside[0].why, unobservable=beside)
    unseen: tuple[Unobservable, ...] = ()
    candidates = candidates_of(attempt)
    if not candidates:
        return replace(attempt.blank, reason=UNREACHABLE)
    best = candidates[0]
    attempt = replace(attempt, problem=replace(attempt.problem, noise_s=best.noise_s))
    better = unbiased(attempt, best)
    fix = attempt.describe(best, better.state, better.covariance)
    if fix.uncertainty is not None:
        slant_range = attempt.problem.slant_range(best.position)
        for instant in (0.0, 2 * attempt.motion.half_s)[: 1 + attempt.motion.moving]:
            place, covariance = fix.at(instant)
            below_m = track.centre[2] - place[2]
            unseen = unseen or unseen_directions(covariance, slant_range, track, below_m)
    others = tuple(
        attempt.solution(other.position, worse)
        for other in candidates[1:]
        if (worse := _worse(other, best, fix)) < AS_LIKELY
        and not _inside(attempt, other, fix)
        and attempt.problem.region.edge(other.position) is None
    )
    fix = replace(fix, unobservable=unseen, alternatives=others)
    reason = objection(attempt, best, fix, better.bias)
    return replace(fix, converged=reason is None, reason=reason)


def _worse(other: Candidate, best: Candidate, fix: BeaconFix) -> float:
    """Chi-square of a candidate above the best one's, residuals that hang together counted once."""
    length = 1.0 if fix.uncertainty is None else fix.uncertainty.correlation.length
    return (other.cost - best.cost) / length


def _inside(attempt: Attempt, other: Candidate, fix: BeaconFix) -> bool:
    """Whether a candidate lies within what the fix states anyway, and so is no other place."""
    apart = (attempt.motion.at(0.0) @ other.position)[:3] - fix.position
    return fix.sigma is not None and bool((np.abs(apart) < ONE_PLACE_SIGMAS * fix.sigma).all())
