"""A beacon's position from every ping, never knowing when it first pinged.

    fix = fix_beacon(pings, FixSettings(sound_speed_mps=1507))
    print(fix)

After Wojcik (1993), chapter II, with every reception used instead of chained pairs (2-12).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from trackerlib.beacon.fix_pairs import fix_experiments
from trackerlib.beacon.folds import refold
from trackerlib.beacon.minimise import (
    Problem,
    Region,
    biweight_cost,
    descend,
    robust_descent,
    scale_of,
    settle,
    starts,
)
from trackerlib.beacon.motion import FREE_DIRECTIONS, Motion, motion_over
from trackerlib.beacon.observability import (
    UNSEEN_SHARE,
    StraightTrack,
    Unobservable,
    straight_track,
    unseen_beside_line,
    unseen_directions,
)
from trackerlib.beacon.paths import StraightPaths, depth_below_surface, paths_through
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix, Solution, blank_fix, time_sigma, unfolded_times
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, FixSettings
from trackerlib.beacon.squared_range import NEIGHBOURS, fix_squared_range, linear_start
from trackerlib.beacon.uncertainty import SlowErrors, uncertainty_of
from trackerlib.residuals import residual_correlation

SEARCH_PINGS = 300  # the search looks at no more pings than this, evenly chosen; the fix at all
ONE_PLACE = 6.0  # times the ship's error: a track shorter than this is one place
FEWEST_CHANGES = 8  # pairs of pings from which impossible times are told
DRIFTING_LENGTH = 3.0  # residuals that count as one, from which a still beacon's motion is looked for
SLOWEST_MPS = 0.02  # below this a beacon is not said to move
MOVING_SHARE = 0.4  # of the still fit's squares: a drift that leaves less shows that the beacon moves
SPARE_PINGS = 3  # pings beyond the number of unknowns below which a fix is refused
TYPICAL_DEPTH_M = 2000.0  # to which the search takes the mean of a profile's speed
SAME_PLACE_SHARE = 0.02  # of the slant range: solutions closer than this are one
UNREACHABLE = "no ray through this profile reaches any place in the search region"
FOLDED_ROUNDS = 4  # fixes after which no folded time may move any more
NEIGHBOUR_SHARE = 0.1  # of the slant range: farther than this, neighbours say little of the ship's place
AS_LIKELY = 9.0  # chi-square by which another solution may fit worse and still count (3 sigma)


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
        return fix_experiments(pings, settings)
    blank, allowed = blank_fix(pings, settings)
    motion = motion_over(settings.motion, blank.elapsed_s)
    needed = len(motion.axes) + (0 if settings.emission_known else 1) + SPARE_PINGS
    if allowed.sum() < needed:
        return replace(
            blank,
            reason=f"{int(allowed.sum())} usable pings; with fewer than {needed} the unknowns fit anything, "
            "so collect more",
        )
    if motion.moving and not pings.timed and settings.interval_s is None:
        return replace(
            blank,
            reason="a moving beacon needs the instant of each ping: a column utc or time_s, or the interval",
        )
    problem = problem_of(pings, blank, allowed, settings, motion)
    frame = blank.frame
    extra = None if settings.start is None else frame.to_local(*settings.start[:2], -settings.start[2])
    fix = _Attempt(problem, motion, blank, allowed, settings, extra).result()
    for _ in range(FOLDED_ROUNDS if settings.interval_s else 0):
        if fix.residual_s is None:
            break
        time = refold(problem.time, fix.residual_s[allowed], settings.interval_s)
        if np.array_equal(time, problem.time):
            break
        problem = replace(problem, time=time)
        fix = _Attempt(problem, motion, blank, allowed, settings, extra).result()
    return fix


def fix_history(
    pings: Pings, settings: FixSettings | None = None, first: int = 1, step: int = 1
) -> Iterator[tuple[int, BeaconFix]]:
    """How many pings had been heard, and the fix the ship would have had then, every `step` pings."""
    for count in range(first, len(pings) + 1, step):
        yield count, fix_beacon(pings.only(slice(0, count)), settings)


def problem_of(
    pings: Pings, blank: BeaconFix, allowed: np.ndarray, settings: FixSettings, motion: Motion
) -> Problem:
    """What is minimised for the pings allowed (N,) of a survey, in the frame of a fix of it."""
    ship = blank.ship[allowed]
    region = Region(
        ship[:, :2].mean(axis=0),
        settings.max_range_m,
        settings.max_depth_m,
        settings.max_speed_mps * motion.half_s,
    )
    return Problem(
        ship=ship,
        time=unfolded_times(pings, blank.ship, allowed, settings),
        paths=paths_through(settings.sound_speed_mps, settings.profile, settings.max_depth_m),
        region=region,
        gps_rms_m=settings.gps_rms_m or 0.0,
        time_sigma_s=time_sigma(pings, settings),
        emission_known=settings.emission_known,
        share=motion.shares(blank.elapsed_s[allowed]),
        axes=motion.axes,
    )


@dataclass(frozen=True, eq=False)
class _Candidate:
    position: np.ndarray  # (P,) state
    keep: np.ndarray  # (n,) of the allowed pings
    settled: bool
    cost: float


@dataclass(frozen=True, eq=False)
class _Attempt:
    """One fix on its way: search, settle, judge."""

    problem: Problem
    motion: Motion
    blank: BeaconFix
    allowed: np.ndarray
    settings: FixSettings
    extra_start: np.ndarray | None

    def result(self) -> BeaconFix:
        track = straight_track(self.problem.ship)
        ship_sigma = ASSUMED_SHIP_RMS_M if self.settings.gps_rms_m is None else self.settings.gps_rms_m
        if track.length_m < ONE_PLACE * max(ship_sigma, 1.0):
            why = (
                f"the ship stayed within {track.length_m:.0f} m: from one place nothing can be told but changes of "
                "range; sail two legs on different bearings"
            )
            return replace(self.blank, reason=why)
        if why := self._impossible_times(max(ship_sigma, 1.0)):
            return replace(self.blank, reason=why)
        if track.is_straight(max(ship_sigma, 0.1)):
            if not self.motion.moving:
                return self._on_a_circle(track)
            beside = unseen_beside_line(track)
            return replace(self.blank, reason=beside[0].why, unobservable=beside)
        unseen: tuple[Unobservable, ...] = ()
        candidates = self._candidates()
        if not candidates:
            return replace(self.blank, reason=UNREACHABLE)
        best = candidates[0]
        fix = self._describe(best, self._unbiased(best))
        if fix.uncertainty is not None:
            slant_range = self.problem.slant_range(best.position)
            for instant in (0.0, 2 * self.motion.half_s)[: 1 + self.motion.moving]:
                unseen = unseen or unseen_directions(fix.at(instant)[1], slant_range, track)
        others = tuple(
            self._solution(other.position, other.cost - best.cost)
            for other in candidates[1:]
            if self._as_likely(other, best, fix) and self.problem.region.edge(other.position) is None
        )
        reason = self._objection(best, fix, unseen, others)
        return replace(fix, converged=reason is None, reason=reason, unobservable=unseen, alternatives=others)

    def _impossible_times(self, ship_sigma: float) -> str | None:
        """Why the times cannot be travel times of these places: most change faster than sound would let them."""
        problem = self.problem
        apart = max(len(problem.time) // 4, 1)
        moved = np.linalg.norm(problem.ship[apart:] - problem.ship[:-apart], axis=1)
        if self.motion.moving:
            moved = moved + problem.region.max_moved_m * np.abs(
                problem.share[apart:] - problem.share[:-apart]
            )
        speed = problem.paths.mean_speed(TYPICAL_DEPTH_M)
        allowed = 1.5 * (moved + 10 * ship_sigma) / speed + 0.02
        changed = np.abs(problem.time[apart:] - problem.time[:-apart])
        if len(changed) < FEWEST_CHANGES or np.mean(changed > allowed) < 0.6:
            return None
        return (
            f"the times change by {np.median(changed):.3g} s where the ship's movement allows "
            f"{np.median(allowed):.3g} s; check their unit, or tell the interval if they are folded"
        )

    def _quick(self) -> tuple[Problem, Problem]:
        """The problem with few enough pings to search with, along straight paths and as it is.

        Straight paths are good enough to find the right valleys, at a tenth of the cost of rays.
        """
        count = len(self.problem.time)
        chosen = np.unique(np.linspace(0, count - 1, min(count, SEARCH_PINGS)).astype(int))
        few = self.problem.only(chosen)
        return replace(few, paths=StraightPaths(few.paths.mean_speed(TYPICAL_DEPTH_M))), few

    def _candidates(self) -> list[_Candidate]:
        """Distinct places that fit, best first."""
        straight, search = self._quick()
        first = np.concatenate([starts(self.problem, self.extra_start), self._linear_start(straight)])
        found, scale = robust_descent(straight, first, rounds=12, steps=6)
        found = found[self._distinct(found, self._cost(found, float(scale.min()), straight))[:6]]
        found, scale = robust_descent(search, found, rounds=8, steps=6)
        reachable = np.isfinite(search.times(found)[0]).mean(axis=1) > 0.5
        found, scale = found[reachable], scale[reachable]
        if not len(found):
            return []
        settled = []
        for k in range(len(found)):
            position, keep, at_rest = settle(self.problem, found[k], scale[k], reject=self.settings.reject)
            settled.append((position, keep, at_rest))
        positions = np.array([position for position, _, _ in settled])
        cost = self._cost(positions, self._common_scale(settled), self.problem)
        return [_Candidate(*settled[k], float(cost[k])) for k in self._distinct(positions, cost)]

    def _linear_start(self, straight: Problem) -> np.ndarray:
        """The state (0 or 1, P) that solves the equations linear in squared ranges, along straight paths."""
        ranges = straight.time * straight.paths.mean_speed(TYPICAL_DEPTH_M)
        ship = np.ascontiguousarray(straight.ship)
        solved, fine = linear_start(ship, ship[:, :2], ranges, straight.share, self.motion.moving)
        if not fine or not np.isfinite(solved).all():
            return np.empty((0, straight.axes.shape[1]))
        state = np.concatenate([solved[:3], solved[4:]])
        return straight.region.clip((state @ straight.axes.T @ straight.axes)[None])

    def _common_scale(self, settled) -> float:
        scales = []
        for position, keep, _ in settled:
            residual = self.problem.eliminate(position[None], keep[None].astype(float)).residual[:, keep]
            scales.append(scale_of(residual, self.problem.unknowns, self.problem.time_sigma_s)[0])
        return float(min(scales))

    def _cost(self, positions: np.ndarray, scale: float, problem: Problem) -> np.ndarray:
        """Robust chi-square (S,) at positions (S, 3), each with its own best emission offset."""
        weight = np.ones((len(positions), len(problem.time)))
        residual = problem.eliminate(positions, weight).residual
        if not problem.emission_known:
            residual = residual - np.median(residual, axis=1, keepdims=True)
        return biweight_cost(residual, scale)

    def _distinct(self, positions: np.ndarray, cost: np.ndarray) -> list[int]:
        """Indices of places farther apart than SAME_PLACE_SHARE of the slant range, cheapest first."""
        kept: list[int] = []
        for k in np.argsort(cost):
            slant_range = self.problem.slant_range(positions[k])
            apart = [np.linalg.norm(positions[k] - positions[j]) for j in kept]
            if all(distance > SAME_PLACE_SHARE * slant_range for distance in apart):
                kept.append(int(k))
        return kept

    def _as_likely(self, other: _Candidate, best: _Candidate, fix: BeaconFix) -> bool:
        length = 1.0 if fix.uncertainty is None else fix.uncertainty.correlation.length
        return (other.cost - best.cost) / length < AS_LIKELY

    def _unbiased(self, candidate: _Candidate) -> np.ndarray:
        """The candidate's state (P,) without the bias that noisy ship positions give, where it can be found.

        By squared ranges along straight lines that take as long as the rays do. Restricted motions, unknown noise
        and the usual least squares keep the state as it is.
        """
        problem, state = self.problem.only(candidate.keep), candidate.position
        if self.settings.method == "least-squares":
            return state
        problem = problem.only(np.argsort(problem.share, kind="stable"))
        if not problem.gps_rms_m or problem.emission_known or self.motion.kind not in ("still", "free"):
            return state
        misfit = self.problem.eliminate(state[None], self._weight(candidate))
        time_error = np.sqrt(misfit.sum_of_squares[0] / max(len(problem.time) - problem.unknowns, 1))
        gradient = problem.times(state[None])[1][0, :, :2]
        stated = problem.time_sigma_s**2 + problem.gps_rms_m**2 * (gradient**2).sum(axis=1)
        scale = time_error / np.sqrt(np.median(stated))
        spacing = np.median(np.linalg.norm(np.diff(problem.ship[:, :2], axis=0), axis=1))
        reach = NEIGHBOUR_SHARE * problem.slant_range(state)
        neighbours = int(np.clip(reach / max(spacing, 1e-3), 2, NEIGHBOURS))
        offset = misfit.offset[0]
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
                moving=self.motion.moving,
                neighbours=neighbours,
            )
            if not found.converged[0]:
                return candidate.position
            offset += found.estimate[0, 3] / float(np.median(speed))
            state = np.concatenate([found.estimate[0, :3], found.estimate[0, 4:]])
        return state

    def _describe(self, candidate: _Candidate, state: np.ndarray | None = None) -> BeaconFix:
        """The candidate as a fix that nobody has judged yet, at a state (P,) if not its own."""
        problem = self.problem
        state = candidate.position if state is None else state
        misfit = problem.eliminate(state[None], self._weight(candidate))
        first = self.motion.at(0.0)
        position = (first @ state)[:3]
        lat, lon, up = self.blank.frame.to_geodetic(position)
        mean_speed = problem.paths.mean_speed(max(-float(up), 0.0))
        uncertainty = uncertainty_of(
            misfit,
            candidate.keep,
            unknowns=problem.unknowns,
            axes=problem.axes,
            floor_s=problem.time_sigma_s,
            mean_speed_mps=mean_speed,
            speed_sigma_mps=self.settings.speed_sigma_mps,
            ship_errors=self._ship_errors(candidate.keep),
        )
        residual = np.full(len(self.allowed), np.nan)
        residual[self.allowed] = misfit.residual[0]
        used = self.allowed.copy()
        used[self.allowed] = candidate.keep
        return replace(
            self.blank,
            position=position,
            velocity=(first @ state)[3:] if self.motion.moving else None,
            lat_deg=float(lat),
            lon_deg=float(lon),
            depth_m=-float(up),
            used=used,
            residual_s=residual,
            uncertainty=None if uncertainty is None else uncertainty.turned(first),
            emission_offset_s=float(misfit.offset[0]),
            sound_speed_mps=mean_speed,
        )

    def _weight(self, candidate: _Candidate) -> np.ndarray:
        """Weights (1, n) of the pings at a candidate, zero at those left out."""
        gradient = self.problem.times(candidate.position[None])[1]
        return candidate.keep * np.nan_to_num(self.problem.relative_weight(gradient))

    def _ship_errors(self, keep: np.ndarray) -> SlowErrors | None:
        """Assumed slow errors of the ship's position at the pings used; None where its error is told."""
        if self.settings.gps_rms_m is not None:
            return None
        return SlowErrors(ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, self.blank.elapsed_s[self.allowed][keep])

    def _objection(self, best, fix, unseen, others) -> str | None:
        """Why this fix must not be believed, or None."""
        edge = self.problem.region.edge(best.position)
        if edge:
            return f"the best fit lies on the edge of the search region: {edge}; widen it or check the times"
        if fix.uncertainty is None:
            return (
                f"{int(fix.used.sum())} pings with residuals this alike say too little for a standard error; "
                "collect more"
            )
        for when, instant in (("first", 0.0), ("last", 2 * self.motion.half_s)):
            depth = depth_below_surface(fix.at(instant)[0])
            if self.motion.moving and depth < -2 * np.sqrt(fix.at(instant)[1][2, 2]):
                return (
                    f"at the {when} ping the beacon would have been {-depth:.0f} m above the surface; "
                    "it does not move like this, or the times are wrong"
                )
        if why := self._moves(best, fix):
            return why
        if unseen:
            return unseen[-1].why
        if not best.settled:
            return "the search did not come to rest; check the speed of sound and the times"
        if others:
            return (
                f"{len(others)} other place{'s' if len(others) > 1 else ''} fit about as well; "
                "turn by 60 degrees or more and sail on to tell them apart"
            )
        if not self._as_steep_as_stated(best, fix):
            return (
                "the misfit is flatter than its ellipse says, so no honest sigma can be given; sail further"
            )
        return None

    def _moves(self, best: _Candidate, fix: BeaconFix) -> str | None:
        """Why a beacon taken to lie still does not: residuals that hang together and that a drift takes away."""
        if self.motion.moving or fix.uncertainty.correlation.length < DRIFTING_LENGTH:
            return None
        problem = replace(self.problem.only(best.keep), axes=FREE_DIRECTIONS["free"])
        weight = self._weight(best)[:, best.keep]
        state, _ = descend(
            problem, np.concatenate([best.position, np.zeros(3)])[None], weight, steps=60, axes=problem.axes
        )
        free = problem.eliminate(state, weight).sum_of_squares[0]
        still = self.problem.eliminate(best.position[None], self._weight(best)).sum_of_squares[0]
        speed = float(np.linalg.norm(state[0, 3:])) / self.motion.half_s
        if free > MOVING_SHARE * still or speed < SLOWEST_MPS or problem.region.edge(state[0]) is not None:
            return None
        return (
            f"a beacon that moves, at {speed:.2g} m/s, leaves residuals {np.sqrt(still / free):.1f} times smaller "
            "than one that lies still; tell the motion (horizontal, vertical, free), or check ship positions and times"
        )

    def _as_steep_as_stated(self, best: _Candidate, fix: BeaconFix) -> bool:
        """Whether two noise sigmas along the weakest direction really cost what the ellipse says (4)."""
        to_state = np.linalg.inv(self.motion.at(0.0))
        values, vectors = np.linalg.eigh(to_state @ fix.uncertainty.noise_covariance @ to_state.T)
        step = 2 * np.sqrt(values[-1]) * vectors[:, -1]
        places = self.problem.region.clip(
            np.array([best.position, best.position + step, best.position - step])
        )
        weight = np.repeat(self._weight(best), 3, axis=0)
        square = self.problem.eliminate(places, weight).sum_of_squares
        variance = square[0] / max(best.keep.sum() - self.problem.unknowns, 1)
        rise = (square[1:] - square[0]) / max(variance, 1e-30) / fix.uncertainty.correlation.length
        return bool(rise.min() > 1.0)

    def _on_a_circle(self, track: StraightTrack) -> BeaconFix:
        """What a straight track does say: place along it, closest slant range, a pair of mirror solutions.

        The pair stands 45 degrees down on either side; every other point of the circle fits as well.
        """
        down = np.array([0.0, 0.0, -1.0])
        below = self._below_line(track, down) - track.centre
        slopes = [(side * track.across + down) / np.sqrt(2) for side in (1, -1)]
        pair = [
            self._in_plane(track, float(below @ track.along), float(below @ down), slope) for slope in slopes
        ]
        lowest = min(pair, key=lambda candidate: candidate.cost)
        if not np.isfinite(self.problem.times(lowest.position[None])[0]).any():
            return replace(self.blank, reason=UNREACHABLE)
        offsets = np.array([candidate.position - track.centre for candidate in pair])
        along_each = offsets @ track.along
        closest = np.linalg.norm(offsets - along_each[:, None] * track.along, axis=1)
        first = (self.problem.ship[0] - track.centre) @ track.along
        unseen = unseen_beside_line(track)
        if not self._distance_known(
            lowest, np.array([track.along, slopes[pair.index(lowest)]]), float(closest.min())
        ):
            why = f"{unseen[0].why}; the line is too short yet to tell even the distance, so sail on as well"
            return replace(self.blank, reason=why, unobservable=unseen)
        return replace(
            self._describe(lowest),
            reason=unseen[0].why,
            position=None,
            lat_deg=None,
            lon_deg=None,
            depth_m=None,
            uncertainty=None,
            unobservable=unseen,
            alternatives=tuple(self._solution(c.position, c.cost - lowest.cost) for c in pair),
            along_track_m=float(along_each.mean() - first),
            closest_slant_range_m=float(closest.mean()),
        )

    def _distance_known(self, candidate: _Candidate, axes: np.ndarray, distance_m: float) -> bool:
        """Whether the pings bend enough along a straight track to tell the distance from it."""
        misfit = self.problem.eliminate(candidate.position[None], self._weight(candidate))
        variance = misfit.sum_of_squares[0] / max(candidate.keep.sum() - self.problem.unknowns, 1)
        variance = max(variance, self.problem.time_sigma_s**2)
        correlation = residual_correlation(misfit.residual[0][candidate.keep])
        sigma = np.sqrt(variance * correlation.length * np.linalg.pinv(misfit.normal_matrix(axes)[0])[1, 1])
        inside = self.problem.region.edge(candidate.position) is None
        return bool(inside and sigma < UNSEEN_SHARE * distance_m)

    def _below_line(self, track: StraightTrack, down: np.ndarray) -> np.ndarray:
        """The best place (3,) in the vertical plane through a straight track, along straight paths."""
        places = [
            track.centre + share * track.length_m * track.along + distance * track.length_m * down
            for share in (-0.4, -0.1, 0.1, 0.4)
            for distance in (0.05, 0.2, 0.5)
        ]
        straight, _ = self._quick()
        axes = np.array([track.along, down])
        found, scale = robust_descent(straight, np.array(places), rounds=12, steps=6, axes=axes)
        return found[int(np.argmin(self._cost(found, float(scale.min()), straight)))]

    def _in_plane(self, track, along: float, radius: float, slope: np.ndarray) -> _Candidate:
        """The best fit in the plane of the track and a direction (3,) at right angles to it."""
        start = track.centre + along * track.along + radius * slope
        axes = np.array([track.along, slope])
        found, scale = robust_descent(self.problem, start[None], rounds=12, steps=6, axes=axes)
        position, keep, at_rest = settle(
            self.problem, found[0], scale[0], reject=self.settings.reject, axes=axes
        )
        return _Candidate(
            position, keep, at_rest, float(self._cost(position[None], float(scale[0]), self.problem)[0])
        )

    def _solution(self, state: np.ndarray, misfit: float) -> Solution:
        position = (self.motion.at(0.0) @ state)[:3]
        lat, lon, up = self.blank.frame.to_geodetic(position)
        return Solution(
            float(lat), float(lon), -float(up), float(position[0]), float(position[1]), float(misfit)
        )
