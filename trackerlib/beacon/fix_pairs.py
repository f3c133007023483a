"""A beacon fixed from experiments, as the thesis did, on a logged survey.

Wojcik (1993), chapters II and III: pairs of receptions, errors in all measurements, a box to search in. The
covariance stated is not his D^-1, which takes experiments that share a reception for independent, but the
spread that the errors of the receptions really give it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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
from trackerlib.beacon.result import BeaconFix, blank_fix, time_sigma
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, FixSettings
from trackerlib.beacon.uncertainty import Uncertainty
from trackerlib.residuals import ResidualCorrelation

TYPICAL_DEPTH_M = 2000.0  # to which the mean of a profile's speed is first taken
FIRST_DEPTH_M = 2500.0  # (4-6)


def fix_experiments(pings: Pings, settings: FixSettings) -> BeaconFix:
    """The fix of the thesis's estimator, with the uncertainty that its shared receptions really give.

    Nothing is rejected: every reception of every experiment counts. A profile enters by its mean speed down to
    the beacon. Ship position error is ASSUMED_SHIP_RMS_M where it is not told; the scale comes from the misfit.
    """
    moving = settings.motion != "still"
    blank, allowed = blank_fix(pings, settings)
    blank = replace(blank, used=np.zeros(len(pings), bool))
    least_count, least_spacing = LEAST_EXPERIMENTS[moving]
    rows = np.flatnonzero(allowed)
    spacing = settings.spacing or max(min(least_spacing, len(rows) // 8), 1)
    step = settings.step or spacing
    most = max((len(rows) - 1 - spacing) // step + 1, 0) if len(rows) > spacing else 0
    count = min(settings.experiments or most, most)
    unknowns = 6 if moving else 3
    if count < unknowns + 2 or (settings.experiments or 0) > most:
        return replace(
            blank,
            reason=f"{len(rows)} usable pings make {most} experiments {spacing} receptions wide, {step} apart; "
            f"wanted {max(settings.experiments or 0, unknowns + 2)}, so collect more or choose a smaller spacing "
            f"(the thesis's least are {least_count} experiments at spacing {least_spacing})",
        )
    if moving and not pings.timed and settings.interval_s is None:
        return replace(
            blank,
            reason="a moving beacon needs the instant of each ping: a column utc or time_s, or the interval",
        )
    pairs = experiments(count, spacing, step)
    heard = np.unique(pairs)
    ship, elapsed = blank.ship[rows], blank.elapsed_s[rows]
    time = blank.time_s[rows]
    gps_rms = ASSUMED_SHIP_RMS_M if settings.ship_rms_m is None else settings.ship_rms_m
    track = straight_track(ship[heard])
    if track.is_straight(max(gps_rms, 0.1)):
        unseen = unseen_beside_line(track)
        return replace(blank, reason=unseen[0].why, unobservable=unseen)

    centre = np.array([*ship[heard, :2].mean(axis=0), 0.0])
    box = SearchBox(settings.max_range_m, settings.max_depth_m, settings.max_speed_mps)
    start = (0.0, 0.0, -min(FIRST_DEPTH_M, settings.max_depth_m / 2))
    if settings.start is not None:
        told = blank.frame.to_local(*settings.start[:2], -settings.start[2]) - centre
        start = (float(told[0]), float(told[1]), float(told[2]))
    depth, speed = TYPICAL_DEPTH_M, settings.sound_speed_mps
    place, log = np.array(start), []
    for _ in range(1 if settings.profile is None else 3):
        if settings.profile is not None:
            speed = float(settings.profile.extended(0.0, settings.max_depth_m).harmonic_mean(0.0, depth))
        range_rms = speed * time_sigma(pings, settings)
        places, ranges = (ship - centre)[None], (speed * time)[None]
        fixes = fix_pairs(
            places, ranges, elapsed, pairs, gps_rms, range_rms, moving=moving, box=box, start=start
        )
        log.append(_step(fixes, place, centre, count, speed, len(heard)))
        place = fixes.estimate[0, :3]
        depth = (
            float(np.clip(-fixes.estimate[0, 2], 1.0, settings.max_depth_m)) if fixes.converged[0] else depth
        )
    if not fixes.converged[0]:
        edge = np.abs(fixes.estimate[0]) > 0.999 * np.abs(box.limits(unknowns)[0])
        where = (
            "on the edge of the search region; widen it" if edge.any() else "nowhere; try more experiments"
        )
        return replace(
            blank,
            reason=f"the search came to rest {where}, or check the times and the speed of sound",
            log=tuple(log),
        )

    state = fixes.estimate[0]
    scale = float(fixes.misfit[0]) / (count - unknowns)  # 1 where the errors are as told (2-72), (2-73)
    noise = scale * shared_covariance(places[0], ranges[0], elapsed, pairs, state, gps_rms, range_rms)
    slightly = fix_pairs(
        places,
        ranges * (1 + 1 / speed),
        elapsed,
        pairs,
        gps_rms,
        range_rms,
        moving=moving,
        box=box,
        start=start,
    )
    by_speed = slightly.estimate[0] - state  # refitted with 1 m/s more
    position, velocity = state[:3] + centre, state[3:] if moving else None
    lat, lon, up = blank.frame.to_geodetic(position)
    where_at = position + (elapsed[:, None] * velocity if moving else 0.0)
    residual = time - np.linalg.norm(where_at - ship, axis=1) / speed
    offset = float(np.mean(residual[heard]))
    residuals = np.full(len(pings), np.nan)
    residuals[rows] = residual - offset
    used = np.zeros(len(pings), bool)
    used[rows[heard]] = True
    uncertainty = Uncertainty(
        covariance=noise + settings.speed_sigma_mps**2 * np.outer(by_speed, by_speed),
        noise_covariance=noise,
        by_sound_speed=by_speed,
        speed_sigma_mps=settings.speed_sigma_mps,
        rms_s=float(np.sqrt(np.mean(residuals[used] ** 2))),
        correlation=ResidualCorrelation(),
        degrees_of_freedom=float(count - unknowns),
    )
    fix = replace(
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
        log=tuple(log),
        sound_speed_mps=speed,
        sigma_sound_speed_mps=settings.speed_sigma_mps,
    )
    slant_range = float(np.median(np.linalg.norm(position - ship[heard], axis=1)))
    for instant in (0.0, float(elapsed[-1])):
        unseen = unseen_directions(fix.at(instant)[1], slant_range, track)
        if unseen:
            return replace(fix, converged=False, reason=unseen[-1].why, unobservable=unseen)
    return fix


def _step(
    fixes: PairFixes, before: np.ndarray, centre: np.ndarray, count: int, speed: float, pings: int
) -> Step:
    """Where one search came to rest: its steps in a compiled loop are counted, not kept."""
    return Step(
        stage=f"{count} experiments at {speed:.1f} m/s",
        iteration=int(fixes.iterations[0]),
        position=fixes.estimate[0, :3] + centre,
        rms_ms=None,
        step_m=float(np.linalg.norm(fixes.estimate[0, :3] - before)),
        damping=None,
        pings=pings,
    )
