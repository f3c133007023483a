"""What a straight track says of a beacon: place along it, closest slant range, a pair of mirror solutions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackerlib.beacon.advice import leg_that_helps
from trackerlib.beacon.attempt import TYPICAL_DEPTH_M, Attempt, Candidate
from trackerlib.beacon.minimise import robust_descent, settle
from trackerlib.beacon.observability import UNSEEN_SHARE, StraightTrack, unseen_beside_line
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M
from trackerlib.residuals import residual_correlation

UNREACHABLE = (
    "no ray through this profile reaches any place in the search region; check it, or widen the region"
)


def fix_on_a_line(attempt: Attempt, track: StraightTrack) -> BeaconFix:
    """What a straight track does say: place along it, closest slant range, a pair of mirror solutions.

    The pair stands 45 degrees down on either side; every other point of the circle fits as well.
    """
    attempt = replace(attempt, problem=replace(attempt.problem, slowness_sigma=None))
    down = np.array([0.0, 0.0, -1.0])
    below = _below_line(attempt, track, down) - track.centre
    slopes = [(side * track.across + down) / np.sqrt(2) for side in (1, -1)]
    pair = [
        _in_plane(attempt, track, float(below @ track.along), float(below @ down), slope) for slope in slopes
    ]
    lowest = min(pair, key=lambda candidate: candidate.cost)
    if not np.isfinite(attempt.problem.times(lowest.position[None])[0]).any():
        return replace(attempt.blank, reason=UNREACHABLE)
    offsets = np.array([candidate.position - track.centre for candidate in pair])
    along_each = offsets @ track.along
    closest = np.linalg.norm(offsets - along_each[:, None] * track.along, axis=1)
    first = (attempt.problem.ship[0] - track.centre) @ track.along
    unseen = unseen_beside_line(track)
    axes = np.array([track.along, slopes[pair.index(lowest)]])
    if not _distance_known(attempt, lowest, axes, float(closest.min())):
        why = f"{unseen[0].why}; the line is too short yet to tell even the distance, so sail on as well"
        return replace(attempt.blank, reason=why, unobservable=unseen)
    noise_s = np.hypot(lowest.noise_s, ASSUMED_SHIP_RMS_M / attempt.problem.paths.mean_speed(TYPICAL_DEPTH_M))
    leg = leg_that_helps(
        attempt.problem, np.array([candidate.position for candidate in pair]), float(noise_s)
    )
    along_sigma, closest_sigma = _sigmas(attempt, lowest, axes)
    return replace(
        attempt.describe(lowest),
        reason=f"{unseen[0].why}: {leg}",
        position=None,
        lat_deg=None,
        lon_deg=None,
        depth_m=None,
        uncertainty=None,
        unobservable=unseen,
        alternatives=tuple(attempt.solution(c.position, c.cost - lowest.cost) for c in pair),
        along_track_m=float(along_each.mean() - first),
        sigma_along_track_m=along_sigma,
        closest_slant_range_m=float(closest.mean()),
        sigma_closest_slant_range_m=closest_sigma,
    )


def _sigmas(attempt: Attempt, candidate: Candidate, axes: np.ndarray) -> tuple[float, float]:
    """Standard errors [m] along the track and from it, axes (2, 3), as a fix states them; NaN with too few pings."""
    in_plane = replace(attempt, problem=replace(attempt.problem, axes=axes)).describe(candidate).uncertainty
    if in_plane is None:
        return np.nan, np.nan
    along, closest = np.sqrt(np.diag(axes @ in_plane.covariance[:3, :3] @ axes.T))
    return float(along), float(closest)


def _distance_known(attempt: Attempt, candidate: Candidate, axes: np.ndarray, distance_m: float) -> bool:
    """Whether the pings bend enough along a straight track to tell the distance from it."""
    misfit = attempt.problem.eliminate(candidate.position[None], attempt.weight(candidate))
    variance = misfit.sum_of_squares[0] / max(candidate.keep.sum() - attempt.problem.unknowns, 1)
    variance = max(variance, attempt.problem.time_sigma_s**2)
    correlation = residual_correlation(misfit.residual[0][candidate.keep])
    sigma = np.sqrt(variance * correlation.length * np.linalg.pinv(misfit.normal_matrix(axes)[0])[1, 1])
    inside = attempt.problem.region.edge(candidate.position) is None
    return bool(inside and sigma < UNSEEN_SHARE * distance_m)


def _below_line(attempt: Attempt, track: StraightTrack, down: np.ndarray) -> np.ndarray:
    """The best place (3,) in the vertical plane through a straight track, along straight paths."""
    places = [
        track.centre + share * track.length_m * track.along + distance * track.length_m * down
        for share in (-0.4, -0.1, 0.1, 0.4)
        for distance in (0.05, 0.2, 0.5)
    ]
    straight, _ = attempt.quick()
    axes = np.array([track.along, down])
    attempt.log.begin(f"search below the line from {len(places)} starts")
    found, scale = robust_descent(straight, np.array(places), rounds=12, steps=6, axes=axes, log=attempt.log)
    return found[int(np.argmin(attempt.cost(found, float(scale.min()), straight)))]


def _in_plane(attempt: Attempt, track, along: float, radius: float, slope: np.ndarray) -> Candidate:
    """The best fit in the plane of the track and a direction (3,) at right angles to it."""
    start = track.centre + along * track.along + radius * slope
    axes = np.array([track.along, slope])
    log = attempt.log
    log.begin("settle on one side of the line")
    found, scale = robust_descent(attempt.problem, start[None], rounds=12, steps=6, axes=axes, log=log)
    position, keep, at_rest = settle(
        attempt.problem, found[0], scale[0], reject=attempt.settings.reject, axes=axes, log=log
    )
    cost = attempt.cost(position[None], float(scale[0]), attempt.problem)
    return Candidate(position, keep, at_rest, float(scale[0]), float(cost[0]))
