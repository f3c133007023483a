"""A beacon fixed from experiments, as the thesis did, on a logged survey.

Wojcik (1993), chapters II and III: pairs of receptions, errors in all measurements, a box to search in. The
covariance stated is not his D^-1, which takes experiments that share a reception for independent, but the
spread that the errors of the receptions really give it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.beacon.above_below import depth_that_helps, mirrored, side_words
from trackerlib.beacon.convergence import Step
from trackerlib.beacon.observability import straight_track, unseen_beside_line, unseen_directions
from trackerlib.beacon.pairs import (
    LEAST_EXPERIMENTS,
    PairFixes,
    SearchBox,
    experiments,
    fix_pairs,
    shared_covariance,
)
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import AS_LIKELY, BeaconFix, Solution, blank_fix, time_sigma
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, FixSettings
from trackerlib.beacon.uncertainty import Uncertainty
from trackerlib.residuals import ResidualCorrelation

TYPICAL_DEPTH_M = 2000.0  # to which the mean of a profile's speed is first taken
FIRST_DEPTH_M = 2500.0  # (4-6)


@dataclass(frozen=True, eq=False)
class _Receptions:
    """Receptions that may be used, and the experiments made of them."""

    rows: np.ndarray  # (R,) their pings
    pairs: np.ndarray  # (N, 2) rows of these, first and second reception of each experiment
    heard: np.ndarray  # (H,) rows that are in an experiment
    ship: np.ndarray  # (R, 3) [m], about the survey's origin
    elapsed: np.ndarray  # (R,) emission times [s]
    time: np.ndarray  # (R,) [s]
    centre: np.ndarray  # (3,) mean place of the ship, from which the box counts [m]
    gps_rms_m: float


@dataclass(frozen=True, eq=False)
class _Rest:
    """Where the search came to rest, and what it was told."""

    state: np.ndarray  # (3 or 6,) about the centre [m], [m/s]
    converged: bool
    misfit: float
    per_speed: np.ndarray  # how the state changes with the speed of sound [m per m/s]
    noise: np.ndarray  # covariance of the state, where errors are as told
    speed_mps: float
    at_edge: bool
    log: tuple[Step, ...]


def fix_experiments(pings: Pings, settings: FixSettings) -> BeaconFix:
    """The fix of the thesis's estimator, with the uncertainty that its shared receptions really give.

    Nothing is rejected here: every reception of every experiment counts. A profile enters by its mean speed down to
    the beacon. Ship position error is ASSUMED_SHIP_RMS_M where it is not told; the scale comes from the misfit.
    """
    blank, allowed = blank_fix(pings, settings)
    blank = replace(blank, used=np.zeros(len(pings), bool))
    moving = settings.motion != "still"
    pairs, reason = _experiments_of(int(np.count_nonzero(allowed)), settings)
    if not reason and moving and not pings.timed and settings.interval_s is None:
        reason = "a moving beacon needs the instant of each ping: a column utc or time_s, or the interval"
    if reason:
        return replace(blank, reason=reason)
    heard = _receptions(blank, allowed, pairs, settings)
    track = straight_track(heard.ship[heard.heard])
    if track.is_straight(max(heard.gps_rms_m, 0.1)):
        unseen = unseen_beside_line(track)
        return replace(blank, reason=unseen[0].why, unobservable=unseen)
    time_rms_s = time_sigma(pings, settings)
    rest = _search(heard, blank, time_rms_s, settings)
    if not rest.converged:
        where = (
            "on the edge of the search region; widen it" if rest.at_edge else "nowhere; try more experiments"
        )
        return replace(
            blank,
            reason=f"the search came to rest {where}, or check the times and the speed of sound",
            log=rest.log,
        )
    rest, other = _both_sides(heard, blank, rest, time_rms_s, settings)
    fix = _fixed(blank, allowed, heard, rest, settings)
    if other is not None:
        fix = replace(fix, alternatives=(_solution(heard, blank, other, rest),))
    slant_range = float(np.median(np.linalg.norm(fix.position - heard.ship[heard.heard], axis=1)))
    for instant in (0.0, float(heard.elapsed[-1])):
        place, covariance = fix.at(instant)
        unseen = unseen_directions(covariance, slant_range, track, track.centre[2] - place[2])
        if unseen:
            return replace(fix, converged=False, reason=unseen[-1].why, unobservable=unseen)
    if other is not None:
        noise_m = fix.uncertainty.rms_s * rest.speed_mps
        return replace(fix, converged=False, reason=f"{side_words(fix)}; {depth_that_helps(fix, noise_m)}")
    return fix


def _experiments_of(receptions: int, settings: FixSettings) -> tuple[np.ndarray, str]:
    """Experiments (N, 2) as the settings ask, and why there cannot be as many, "" if there can."""
    moving = settings.motion != "still"
    least_count, least_spacing = LEAST_EXPERIMENTS[moving]
    spacing = settings.spacing or max(min(least_spacing, receptions // 8), 1)
    step = settings.step or spacing
    most = max((receptions - 1 - spacing) // step + 1, 0) if receptions > spacing else 0
    fewest = (6 if moving else 3) + 2
    count = min(settings.experiments or most, most)
    wanted = max(settings.experiments or 0, fewest)
    if count < fewest <= most:
        return np.empty((0, 2), int), f"experiments is {count}; a fix needs {fewest} or more"
    if count < wanted:
        return np.empty((0, 2), int), (
            f"{receptions} usable pings make {most} experiments {spacing} receptions wide, {step} apart; "
            f"wanted {wanted}, so collect more or choose a smaller spacing "
            f"(the thesis's least are {least_count} experiments at spacing {least_spacing})"
        )
    return experiments(count, spacing, step), ""


def _receptions(
    blank: BeaconFix, allowed: np.ndarray, pairs: np.ndarray, settings: FixSettings
) -> _Receptions:
    rows, heard = np.flatnonzero(allowed), np.unique(pairs)
    ship = blank.ship[rows]
    return _Receptions(
        rows,
        pairs,
        heard,
        ship,
        blank.elapsed_s[rows],
        blank.time_s[rows],
        centre=np.array([*ship[heard, :2].mean(axis=0), 0.0]),
        gps_rms_m=ASSUMED_SHIP_RMS_M if settings.ship_rms_m is None else settings.ship_rms_m,
    )


def _search(heard: _Receptions, blank: BeaconFix, time_rms_s: float, settings: FixSettings) -> _Rest:
    """The search, again where a profile's mean speed changes with the depth that was found."""
    moving, profile = settings.motion != "still", settings.profile
    box = SearchBox(settings.max_range_m, settings.max_depth_m, settings.max_speed_mps)
    start = _start(heard, blank, settings)
    places = (heard.ship - heard.centre)[None]

    def rest_at(speed: float, by: float = 0.0) -> PairFixes:
        """With a speed of sound more, errors of time told at the speed without it."""
        return fix_pairs(
            places, ((speed + by) * heard.time)[None], heard.elapsed, heard.pairs, heard.gps_rms_m,
            speed * time_rms_s, moving=moving, box=box, start=start,
        )  # fmt: skip

    depth, speed = TYPICAL_DEPTH_M, settings.sound_speed_mps
    place, log = np.array(start), []
    for _ in range(1 if profile is None else 3):
        if profile is not None:
            speed = float(profile.extended(0.0, settings.max_depth_m).harmonic_mean(0.0, depth))
        fixes = rest_at(speed)
        log.append(_step(fixes, place, heard, speed))
        place = fixes.estimate[0, :3]
        if fixes.converged[0]:
            depth = float(np.clip(-place[2], 1.0, settings.max_depth_m))
    state, converged = fixes.estimate[0], bool(fixes.converged[0])
    spread = np.full((len(state),) * 2, np.nan)
    if converged:
        spread = shared_covariance(
            places[0],
            speed * heard.time,
            heard.elapsed,
            heard.pairs,
            state,
            heard.gps_rms_m,
            speed * time_rms_s,
        )
    return _Rest(
        state,
        converged,
        float(fixes.misfit[0]),
        per_speed=rest_at(speed, by=1.0).estimate[0] - state if converged else np.full(len(state), np.nan),
        noise=spread,
        speed_mps=speed,
        at_edge=bool((np.abs(state) > 0.999 * np.abs(box.limits(len(state))[0])).any()),
        log=tuple(log),
    )


def _both_sides(
    heard: _Receptions, blank: BeaconFix, rest: _Rest, time_rms_s: float, settings: FixSettings
) -> tuple[_Rest, _Rest | None]:
    """The better of a rest and what lies beyond the hydrophone, and the other where it is as likely."""
    level = float(heard.ship[heard.heard, 2].mean())
    if not -settings.max_depth_m < mirrored(rest.state, level)[2] < 0:
        return rest, None
    side = 1.0 if rest.state[2] > level else -1.0  # the search looks below the hydrophone, or upside down
    ship = (heard.ship - [0.0, 0.0, level]) * [1.0, 1.0, side]
    room = settings.max_depth_m + level if side > 0 else -level
    there = _search(
        replace(heard, ship=ship),
        blank,
        time_rms_s,
        replace(settings, profile=None, sound_speed_mps=rest.speed_mps, max_depth_m=room, start=None),
    )
    if not there.converged:
        return rest, None
    turned = np.resize([1.0, 1.0, side], len(there.state))
    there = replace(
        there,
        state=there.state * turned + level * (np.arange(len(turned)) == 2),
        per_speed=there.per_speed * turned,
        noise=there.noise * np.outer(turned, turned),
    )
    best, other = sorted([rest, there], key=lambda one: one.misfit)
    return best, other if _worse(heard, other, best) < AS_LIKELY else None


def _worse(heard: _Receptions, other: _Rest, best: _Rest) -> float:
    """Chi-square of a rest above that of the best, in the noise that the best shows."""
    return (other.misfit - best.misfit) * (len(heard.pairs) - len(best.state)) / max(best.misfit, 1e-30)


def _solution(heard: _Receptions, blank: BeaconFix, other: _Rest, best: _Rest) -> Solution:
    east, north, up = other.state[:3] + heard.centre
    lat, lon, height = blank.frame.to_geodetic(np.array([east, north, up]))
    return Solution(
        float(lat), float(lon), -float(height), float(east), float(north), _worse(heard, other, best)
    )


def _start(heard: _Receptions, blank: BeaconFix, settings: FixSettings) -> tuple[float, float, float]:
    """Where the search begins, about the centre [m]: (4-6), or where the settings say."""
    if settings.start is None:
        return 0.0, 0.0, -min(FIRST_DEPTH_M, settings.max_depth_m / 2)
    east, north, up = blank.frame.to_local(*settings.start[:2], -settings.start[2]) - heard.centre
    return float(east), float(north), float(up)


def _fixed(
    blank: BeaconFix, allowed: np.ndarray, heard: _Receptions, rest: _Rest, settings: FixSettings
) -> BeaconFix:
    """The fix of a search that converged, with residuals of every usable ping."""
    freedom = len(heard.pairs) - len(rest.state)
    position = rest.state[:3] + heard.centre
    velocity = rest.state[3:] if len(rest.state) > 3 else None
    where_at = position + (0.0 if velocity is None else heard.elapsed[:, None] * velocity)
    late = heard.time - np.linalg.norm(where_at - heard.ship, axis=1) / rest.speed_mps
    offset = float(np.mean(late[heard.heard]))
    residuals, used = np.full(len(allowed), np.nan), np.zeros(len(allowed), bool)
    residuals[heard.rows] = late - offset
    used[heard.rows[heard.heard]] = True
    noise = rest.misfit / freedom * rest.noise  # the factor is 1 where errors are as told (2-72), (2-73)
    uncertainty = Uncertainty(
        covariance=noise + settings.speed_sigma_mps**2 * np.outer(rest.per_speed, rest.per_speed),
        noise_covariance=noise,
        by_sound_speed=rest.per_speed,
        speed_sigma_mps=settings.speed_sigma_mps,
        rms_s=float(np.sqrt(np.mean(residuals[used] ** 2))),
        correlation=ResidualCorrelation(),
        degrees_of_freedom=float(freedom),
    )
    lat, lon, up = blank.frame.to_geodetic(position)
    return replace(
        blank,
        offered=used | ~allowed,
        converged=True,
        position=position,
        velocity=velocity,
        lat_deg=float(lat),
        lon_deg=float(lon),
        depth_m=-float(up),
        used=used,
        residual_s=residuals,
        uncertainty=uncertainty,
        emission_offset_s=offset,
        log=rest.log,
        sound_speed_mps=rest.speed_mps,
        sigma_sound_speed_mps=settings.speed_sigma_mps,
    )


def _step(fixes: PairFixes, before: np.ndarray, heard: _Receptions, speed_mps: float) -> Step:
    """Where one search came to rest: its steps in a compiled loop are counted, not kept."""
    return Step(
        stage=f"{len(heard.pairs)} experiments at {speed_mps:.1f} m/s",
        iteration=int(fixes.iterations[0]),
        position=fixes.estimate[0, :3] + heard.centre,
        rms_ms=None,
        step_m=float(np.linalg.norm(fixes.estimate[0, :3] - before)),
        damping=None,
        pings=len(heard.heard),
    )
