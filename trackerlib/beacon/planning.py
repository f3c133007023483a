"""Where to sail next: what a leg would add to a fix, before it is sailed.

    plan = plan_next_leg(pings, fix, settings, budget_s=1800)
    plan.best.ellipse, plan.best.words

Fisher information of all pings, heard and expected, about place, motion, the pinger's clock and speed of sound, in the
linear picture that every stated ellipse uses. Candidates go out in all directions from where the ship is; one goes
straight over the beacon, always. After Wojcik (1993), chapters IV and VI, which found such legs to help most.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.beacon.first_order import FirstOrder, first_order
from trackerlib.beacon.motion import Motion, motion_over
from trackerlib.beacon.paths import Paths, paths_through
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix, time_sigma
from trackerlib.beacon.settings import ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, FixSettings
from trackerlib.beacon.uncertainty import AntennaErrors, Ellipse, SlowErrors, ellipse95, wider
from trackerlib.frames import bearing_deg
from trackerlib.rounding import rounded

FASTEST_MPS = 5.0  # above this the flow past the hydrophone is louder than the beacon
BEARINGS = 16
SHARES = (0.15, 0.3, 0.6, 1.0)  # of the time budget that candidates use
NOT_KNOWN_M = 100_000.0  # an expected error of more than this is none
AHEAD = 4.0  # times a leg that it is looked whether a moving beacon's place gets worse
AHEAD_STEPS = 24
USUAL_INTERVAL_S = 2.0  # where the survey does not tell one
MATERIAL = 0.9  # share of a sigma below which what is left of it is worth telling


@dataclass(frozen=True, eq=False)
class Leg:
    """A straight leg to sail, in the frame of the fix."""

    start: np.ndarray  # (2,) east, north [m]
    end: np.ndarray  # (2,)
    speed_mps: float
    over_beacon: bool = False

    @property
    def length_m(self) -> float:
        """How long it is."""
        return float(np.linalg.norm(self.end - self.start))

    @property
    def bearing_deg(self) -> float:
        """Its course from true north."""
        return bearing_deg(*(self.end - self.start))

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return self.length_m / self.speed_mps


@dataclass(frozen=True, eq=False)
class Forecast:
    """How well the beacon would be known at the end of a leg."""

    leg: Leg
    covariance: np.ndarray  # (3, 3) [m^2] of its place then
    speed_sigma_mps: float  # standard error of the speed of sound then
    expected_pings: int

    @property
    def ellipse(self) -> Ellipse:
        """95 % ellipse on the map."""
        return ellipse95(self.covariance)

    @property
    def sigma(self) -> np.ndarray:
        """Standard errors (3,) [m] east, north, depth."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms_m(self) -> float:
        """Expected distance [m] from the truth in space, root-mean-square."""
        return float(np.sqrt(np.trace(self.covariance)))


@dataclass(frozen=True, eq=False)
class Plan:
    """Candidate legs, best first, beside what is known now."""

    forecasts: tuple[Forecast, ...]
    now: np.ndarray  # (3, 3) [m^2] covariance of the beacon's place at the last ping
    worse_after_s: float | None = None  # from now, along the best leg and on, see `worse_after`
    speed_sigma_mps: float = 0.0  # standard error of the speed of sound now

    @property
    def best(self) -> Forecast:
        """The leg that leaves the smallest expected error."""
        return self.forecasts[0]

    @property
    def over_beacon(self) -> Forecast | None:
        """The best leg straight over the beacon, None if the budget does not reach it."""
        return next((forecast for forecast in self.forecasts if forecast.leg.over_beacon), None)

    @property
    def words(self) -> str:
        """What would help, in a sentence, and how long a moving beacon's place gets better."""
        leg, sigma = self.best.leg, self.best.sigma
        way = "over the beacon, " if leg.over_beacon else ""
        before = np.sqrt(np.trace(self.now))
        known = f"falls from {rounded(before)} to" if before < NOT_KNOWN_M else "falls to"
        return (
            f"Sail {way}{leg.length_m:.0f} m on {leg.bearing_deg:.0f}° at {leg.speed_mps:g} m/s "
            f"({leg.duration_s / 60:.0f} min): the expected error {known} {rounded(self.best.rms_m)} m, "
            f"depth sigma to {rounded(sigma[2])} m.{self._speed_words}{self._worse_words}"
        )

    @property
    def _speed_words(self) -> str:
        before, after = self.speed_sigma_mps, self.best.speed_sigma_mps
        if not after < MATERIAL * before:
            return ""
        return f" The leg tells the speed of sound too: its sigma falls from {rounded(before)} to {rounded(after)} m/s."

    @property
    def _worse_words(self) -> str:
        if self.worse_after_s is None:
            return ""
        after = (
            f"after {self.worse_after_s / 60:.0f} min on that course" if self.worse_after_s else "from now on"
        )
        return f" As the beacon moves, its present place gets less sure {after}."


@dataclass(frozen=True, eq=False)
class Survey:
    """Pings heard, and what is assumed of those to come."""

    ship: np.ndarray  # (N, 3) [m] at the pings that the fix rests on
    elapsed_s: np.ndarray  # (N,)
    beacon: np.ndarray  # (3,) [m] at the first ping
    velocity: np.ndarray  # (3,) [m/s]
    motion_kind: str
    paths: Paths
    time_sigma_s: float
    gps_rms_m: float | np.ndarray  # per axis, or (2,) east and north; 0 where it is part of time_sigma_s
    speed_sigma_mps: float
    widened: float  # variance over that of independent pings
    interval_s: float  # between pings to come
    clock_terms: int  # unknowns of the pinger's clock: emission time, interval, drift
    speed_fitted: bool = False  # the speed of sound is estimated too, speed_sigma_mps that of its prior
    # of the ship's errors, independent from ping to ping where it is None
    gps_correlation_s: float | None = None
    antenna_sigma_m: tuple[float, float] = (0.0, 0.0)  # level and vertical
    heading_rad: np.ndarray | None = None  # (N,) None: not known
    # (K, K) [1/m^2] information of the pings heard that their fix makes no use of
    lost: np.ndarray | None = None

    @property
    def last_s(self) -> float:
        """When the last ping was heard [s]."""
        return float(np.max(self.elapsed_s))

    @property
    def now(self) -> np.ndarray:
        """Covariance (3, 3) [m^2] of the beacon's place at the last ping."""
        return self.forecast(self.ship, self.elapsed_s, self.last_s, self.heading_rad)

    def forecast(
        self, ship: np.ndarray, elapsed_s: np.ndarray, at_s: float, heading_rad: np.ndarray | None = None
    ) -> np.ndarray:
        """Covariance (3, 3) [m^2] of the beacon's place at an instant, from pings heard at ship (N, 3).

        heading_rad : (N,) of the bow, None where it is not known; only an antenna's error asks for it
        """
        return self._outlook(ship, elapsed_s, at_s, heading_rad)[0]

    @property
    def speed_now_mps(self) -> float:
        """Standard error of the speed of sound [m/s] at the last ping."""
        return self._outlook(self.ship, self.elapsed_s, self.last_s, self.heading_rad)[1]

    def _outlook(self, ship, elapsed_s, at_s, heading_rad) -> tuple[np.ndarray, float]:
        """The same as `forecast`, and the standard error of the speed of sound [m/s]."""
        motion = motion_over(self.motion_kind, elapsed_s)
        gradient, linear = self._linear(ship, elapsed_s, motion)
        noise = self.widened * self._less_lost(linear.noise, motion)
        if (slow := self._slow_errors(elapsed_s)) is not None:
            noise = wider(noise, slow.moved_by(gradient[:, :2, None] * linear.gain[:, None, :]))
        if any(self.antenna_sigma_m):
            noise = noise + AntennaErrors(*self.antenna_sigma_m, heading_rad).moved_by(gradient, linear.gain)
        covariance = noise + self.speed_sigma_mps**2 * np.outer(linear.by_speed, linear.by_speed)
        place = len(motion.axes)
        step = motion.at(at_s)[:3] @ motion.axes.T
        speed = float(np.sqrt(covariance[-1, -1])) if self.speed_fitted else self.speed_sigma_mps
        return step @ covariance[:place, :place] @ step.T, speed

    def _less_lost(self, noise: np.ndarray, motion: Motion) -> np.ndarray:
        """The noise (L, L) that is left after some information on the place is lost; the speed of sound follows."""
        if self.lost is None:
            return noise
        size = len(motion.axes)
        before = noise[:size, :size]
        after = np.linalg.inv(np.linalg.inv(before) - self._lost_in(motion))
        follow = np.vstack([np.eye(size), np.linalg.solve(before, noise[:size, size:]).T])
        return noise + follow @ (after - before) @ follow.T

    def _lost_in(self, motion: Motion) -> np.ndarray:
        """The information lost (K, K) in the state of another span of time."""
        turn = motion.axes @ np.linalg.inv(self.motion.at(0.0)) @ motion.at(0.0) @ motion.axes.T
        return turn.T @ self.lost @ turn

    def independent(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the state (K, K): information from pings heard [1/m^2], and covariance per variance of times [m^2/s^2]."""
        linear, size = self._linear(self.ship, self.elapsed_s, self.motion)[1], len(self.motion.axes)
        gain = linear.gain[:, :size]
        return np.linalg.inv(linear.noise[:size, :size]), gain.T @ gain

    @property
    def motion(self) -> Motion:
        """How the beacon moves over the pings heard."""
        return motion_over(self.motion_kind, self.elapsed_s)

    def _linear(self, ship, elapsed_s, motion: Motion) -> tuple[np.ndarray, FirstOrder]:
        """Gradients (N, 3) [s/m] of the travel times by place, and how state and speed of sound follow from times."""
        place = self.beacon + elapsed_s[:, None] * self.velocity
        time, gradient = (value[0] for value in self.paths.times(place[None], ship))
        seen = np.isfinite(time)
        gradient, time = np.where(seen[:, None], gradient, 0.0), np.where(seen, time, 0.0)
        variance = self.time_sigma_s**2 + gradient[:, :2] ** 2 @ np.broadcast_to(self.gps_rms_m, 2) ** 2
        weight = np.where(seen, 1 / np.where(seen, variance, 1.0), 0.0)
        shares = motion_over("free", elapsed_s).shares(elapsed_s)
        slope = gradient
        if motion.moving:
            slope = np.hstack([slope, shares[:, None] * slope])
        slope = slope @ motion.axes.T
        if self.clock_terms:
            root = np.sqrt(weight)[:, None]
            clock = np.linalg.qr(root * shares[:, None] ** np.arange(self.clock_terms))[0]
            both = root * np.column_stack([slope, time])
            both = (both - clock @ (clock.T @ both)) / np.maximum(root, 1e-30)
            slope, time = both[:, :-1], both[:, -1]
        by_speed = time / self.paths.mean_speed(max(-float(self.beacon[2]), 0.0))
        prior = self.widened / self.speed_sigma_mps**2 if self.speed_fitted else None
        return gradient, first_order(slope, by_speed, weight, prior)

    def _slow_errors(self, elapsed_s: np.ndarray) -> SlowErrors | None:
        """The ship's errors that hang together in time: those told, or what a fix assumes where none are."""
        if not np.any(self.gps_rms_m):
            return SlowErrors(ASSUMED_SHIP_RMS_M, ASSUMED_SHIP_TIME_S, elapsed_s)
        if self.gps_correlation_s is None:
            return None
        return SlowErrors(self.gps_rms_m, self.gps_correlation_s, elapsed_s)

    def after(self, leg: Leg) -> Forecast:
        """What the survey would come to with a leg added at its end."""
        expected = np.arange(self.interval_s, leg.duration_s + 1e-9, self.interval_s)
        along = (expected / max(leg.duration_s, 1e-9))[:, None]
        place = leg.start + along * (leg.end - leg.start)
        ship = np.vstack([self.ship, np.column_stack([place, np.full(len(place), self.ship[-1, 2])])])
        elapsed = np.concatenate([self.elapsed_s, self.last_s + expected])
        heading = self.heading_rad
        if heading is not None:
            heading = np.concatenate([heading, np.full(len(expected), np.radians(leg.bearing_deg))])
        at_end = self._outlook(ship, elapsed, self.last_s + leg.duration_s, heading)
        return Forecast(leg, *at_end, len(expected))


def surveys_so_far(pings: Pings, fix: BeaconFix, settings: FixSettings) -> list[Survey]:
    """What a plan builds on, for each place that fits: the pings of a fix with the errors its residuals show.

    Raises ValueError, with the reason, for a fix with no place at all, not even a pair of mirror solutions.
    """
    places = [np.array([a.east_m, a.north_m, -a.depth_m]) for a in fix.alternatives]
    if fix.position is not None:
        places = [fix.position, *places]
    if not places or fix.residual_s is None or fix.sound_speed_mps is None:
        raise ValueError(f"there is no place to plan from: {fix.reason}")
    used = fix.used
    elapsed = fix.elapsed_s if fix.elapsed_s is not None else pings.instant_s
    told = np.zeros(2) if settings.gps_axes_m is None else settings.gps_axes_m
    rms = max(float(np.sqrt(np.mean(fix.residual_s[used] ** 2))), time_sigma(pings, settings))
    residual, velocity = fix.residual_s[used], np.zeros(3) if fix.velocity is None else fix.velocity
    paths = paths_through(settings.sound_speed_mps, settings.profile, settings.max_depth_m)
    scale = 1.0
    if told.any():  # both errors grow together until they explain the residuals
        gradient = paths.times((places[0] + elapsed[used, None] * velocity)[None], fix.ship[used])[1][
            0, :, :2
        ]
        stated = time_sigma(pings, settings) ** 2 + gradient**2 @ told**2
        scale = max(float(np.sqrt(np.nanmean(residual**2 / stated))), 1e-3)
    one = Survey(
        ship=fix.ship[used],
        elapsed_s=elapsed[used],
        beacon=places[0],
        velocity=velocity,
        motion_kind=settings.motion,
        paths=paths,
        time_sigma_s=scale * time_sigma(pings, settings) if told.any() else rms,
        gps_rms_m=scale * told,
        speed_sigma_mps=settings.speed_sigma_mps,
        widened=1.0 if fix.uncertainty is None else fix.uncertainty.correlation.length,
        interval_s=_usual_interval(elapsed),
        clock_terms=settings.clock_terms,
        speed_fitted=settings.estimate_sound_speed,
        gps_correlation_s=settings.gps_correlation_s,
        antenna_sigma_m=settings.antenna_sigma_m,
        heading_rad=None if pings.heading_rad is None else pings.heading_rad[used],
    )
    one = replace(one, lost=_lost(one, fix))
    return [replace(one, beacon=place) for place in places]


def _usual_interval(elapsed_s: np.ndarray) -> float:
    apart = np.diff(np.sort(elapsed_s))
    apart = apart[apart > 0]
    return float(np.median(apart)) if len(apart) else USUAL_INTERVAL_S


def _lost(survey: Survey, fix: BeaconFix) -> np.ndarray | None:
    """Information (K, K) [1/m^2] that a fix makes no use of, or that its pings do not have, by what residuals tell.

    Some is lost where pings are few, where residuals hang together in time, and where bias had to be taken out.
    """
    told = None if fix.uncertainty is None else fix.uncertainty.residual_covariance
    if not fix.converged or told is None:
        return None
    back = survey.motion.axes @ np.linalg.inv(survey.motion.at(0.0))
    return survey.independent()[0] - survey.widened * np.linalg.inv(back @ told @ back.T)


def plan_next_leg(
    pings: Pings,
    fix: BeaconFix,
    settings: FixSettings,
    budget_s: float = 1800.0,
    speed_mps: float = FASTEST_MPS,
) -> Plan:
    """Candidate legs of a time budget, the best first; one of them straight over the beacon and beyond.

    Where several places fit, each leg is judged by the place for which it does least.
    Raises ValueError for a budget or speed that makes no sense and for a fix without a place.
    """
    if not 10 <= budget_s <= 10 * 86_400:
        raise ValueError(f"budget_s is {budget_s:g}; wanted 10 to 864000")
    if not 0.1 <= speed_mps <= 20:
        raise ValueError(f"speed_mps is {speed_mps:g}; wanted 0.1 to 20")
    surveys = surveys_so_far(pings, fix, settings)
    legs = _candidates(surveys, budget_s, speed_mps)
    forecasts = sorted((forecast_leg(surveys, leg) for leg in legs), key=lambda forecast: forecast.rms_m)
    worse_s = worse_after(surveys, forecasts[0].leg)
    return Plan(tuple(forecasts), surveys[0].now, worse_s, surveys[0].speed_now_mps)


def forecast_leg(surveys: list[Survey], leg: Leg) -> Forecast:
    """How well the beacon would be known after a leg, for the place that it tells least of."""
    return max((survey.after(leg) for survey in surveys), key=lambda forecast: forecast.rms_m)


def _candidates(surveys: list[Survey], budget_s: float, speed_mps: float) -> list[Leg]:
    """Those of the likeliest place, and the ones over every other place that fits."""
    first, *others = (candidate_legs(survey, budget_s, speed_mps) for survey in surveys)
    return first + [leg for legs in others for leg in legs if leg.over_beacon]


def candidate_legs(survey: Survey, budget_s: float, speed_mps: float) -> list[Leg]:
    """Legs within a time budget in BEARINGS directions from the last ping, the ones over the beacon first.

    Those lead over where a moving beacon will be when the ship comes there.
    """
    start, reach = survey.ship[-1, :2], budget_s * speed_mps
    there = (survey.beacon + survey.last_s * survey.velocity)[:2] - start
    meeting_s = time_to_meet(there, survey.velocity[:2], speed_mps)
    if meeting_s is not None:
        there = there + meeting_s * survey.velocity[:2]
    distance = float(np.linalg.norm(there))
    over = 0.0 if meeting_s is None else min(1.2 * distance / reach, 1.0)
    course = there / distance if distance > 1 else np.array([0.0, 1.0])
    angles = 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    courses = [course, *np.column_stack([np.sin(angles), np.cos(angles)])]
    return [
        Leg(
            start,
            start + share * reach * way,
            speed_mps,
            over_beacon=k == 0 and over > 0 and share * reach >= distance,
        )
        for k, way in enumerate(courses)
        for share in sorted({*SHARES, over if k == 0 and over else 1.0})
    ]


def time_to_meet(there: np.ndarray, velocity: np.ndarray, speed_mps: float) -> float | None:
    """Least time [s] in which a ship meets what is at there (2,) [m] and moves; None if it runs away."""
    a = velocity @ velocity - speed_mps**2
    b, c = there @ velocity, there @ there
    if abs(a) < 1e-9:
        return -c / (2 * b) if b < 0 else None
    inside = b**2 - a * c
    if inside < 0:
        return None
    roots = (-b + np.array([-1.0, 1.0]) * np.sqrt(inside)) / a
    return float(roots[roots >= 0].min()) if (roots >= 0).any() else None


def map_reach(plan: Plan, budget_s: float, speed_mps: float) -> float:
    """How far [m] from the beacon a map of attainable accuracy is worth drawing beside a plan."""
    return min(budget_s * speed_mps, 3 * plan.best.leg.length_m + 500)


def accuracy_map(surveys: list[Survey], half_width_m: float, speed_mps: float, cells: int = 25):
    """Expected error [m] (cells, cells), by north then east, at the end of a straight leg to each place of a grid.

    Where several places fit, each cell tells the error for the place that its leg tells least of. Also the grid's
    east (cells,) and north (cells,) [m]; it reaches half_width_m beyond the places that fit, every way.
    """
    places = np.array([(one.beacon + one.last_s * one.velocity)[:2] for one in surveys])
    low, high = places.min(axis=0), places.max(axis=0)
    half = half_width_m + (high - low).max() / 2
    steps = np.linspace(-half, half, cells)
    east, north = (low + high)[:, None] / 2 + steps
    start = surveys[0].ship[-1, :2]
    error = np.array(
        [[forecast_leg(surveys, Leg(start, np.array([x, y]), speed_mps)).rms_m for x in east] for y in north]
    )
    return east, north, error


def time_to_reach(
    surveys: list[Survey], wanted_m: float, speed_mps: float, longest_s: float = 86_400.0
) -> float | None:
    """Least time [s] of a straight leg after which the expected error is `wanted_m`, or None within `longest_s`.

    Where several places fit, each leg is judged by the place for which it does least.
    """
    if not wanted_m > 0:
        raise ValueError(f"wanted_m is {wanted_m:g}; wanted more than 0")

    def best(budget_s: float) -> float:
        return min(forecast_leg(surveys, leg).rms_m for leg in _candidates(surveys, budget_s, speed_mps))

    low, high = 0.0, 60.0
    while best(high) > wanted_m:
        low, high = high, 2 * high
        if high > longest_s:
            return None
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if best(middle) <= wanted_m else (middle, high)
    return high


def worse_after(surveys: list[Survey], leg: Leg) -> float | None:
    """Time from now [s] after which a moving beacon's present place gets worse, sailing on along a leg.

    None if it still gets better after AHEAD times the leg, and for a beacon that lies still. Wojcik (1993), 3.6, 4.4.1.
    """
    if surveys[0].motion_kind == "still":
        return None
    shares = AHEAD * np.arange(1, AHEAD_STEPS + 1) / AHEAD_STEPS
    errors = [max(float(np.sqrt(np.trace(survey.now))) for survey in surveys)]
    for share in shares:
        errors.append(
            forecast_leg(surveys, replace(leg, end=leg.start + share * (leg.end - leg.start))).rms_m
        )
    best = int(np.argmin(errors))
    return None if best == len(shares) else leg.duration_s * AHEAD * best / AHEAD_STEPS
