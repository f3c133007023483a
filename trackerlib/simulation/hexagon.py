"""The six scenarios of Wojcik (1993), chapter IV: a ship round a hexagon, a beacon below, many trials.

    points = sail_hexagon(SCENARIOS[2], receptions=1126)
    study = run_trials(points, gps_rms_m=3, trials=2000, seed=1)
    same = run_point(2, 25, 45, gps_rms_m=3, trials=2000, seed=1, method="thesis")

Everything made here is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.stats import chi2

from trackerlib.beacon.pairs import experiments, fix_pairs
from trackerlib.beacon.squared_range import MOVING, SquaredRangeFixes, fix_squared_range, refusals

LEG_M = 1000.0
INTERVAL_S = 2.0
SAMPLE_S = 1e-3
SOUND_SPEED_MPS = 1500.0
TIME_RMS_S = SAMPLE_S / np.sqrt(12)  # of a time read off 1 ms samples
BATCH = 200  # trials simulated at once
CHAIN = 64  # receptions that noise is drawn for at once
PROBABILITY = 0.95
NOT_AT_REST = "no place inside the search box at which the iteration rests"
METHODS = ("all-pings", "thesis")  # every reception; the thesis's chained experiments


@dataclass(frozen=True)
class Scenario:
    """A beacon: position [m] and velocity [m/s], east, north, up."""

    position: tuple[float, float, float]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def moving(self) -> bool:
        """Whether it moves."""
        return any(self.velocity)


_DRIFT = (0.5, -0.5, 0.25)
# Wojcik (1993), Table 4-1; of scenario 6 the text prints x = -10000 once, which its own search region forbids.
SCENARIOS = {
    1: Scenario((0.0, 0.0, -2000.0)),
    2: Scenario((0.0, 866.0, -2000.0)),
    3: Scenario((-1000.0, 1000.0, -2000.0)),
    4: Scenario((0.0, 0.0, -2000.0), _DRIFT),
    5: Scenario((0.0, 866.0, -2000.0), _DRIFT),
    6: Scenario((-1000.0, 1000.0, -2000.0), _DRIFT),
}


@dataclass(frozen=True, eq=False)
class Receptions:
    """Where the ship truly was when each of N pings came, and how far each came."""

    scenario: Scenario
    emitted_s: np.ndarray  # (N,) since the first emission
    received_s: np.ndarray  # (N,)
    ship: np.ndarray  # (N, 3) [m]
    beacon: np.ndarray  # (N, 3) [m] at emission

    @property
    def range_m(self) -> np.ndarray:
        """Slant ranges (N,)."""
        return np.linalg.norm(self.ship - self.beacon, axis=1)

    @property
    def truth(self) -> np.ndarray:
        """Position at the first emission and, if it moves, velocity: (3,) or (6,)."""
        one = self.scenario
        return np.array([*one.position, *one.velocity] if one.moving else one.position)


@dataclass(frozen=True, eq=False)
class Trials:
    """What many simulated fixes of one beacon came to; components as in `Receptions.truth`."""

    receptions: Receptions
    estimate: np.ndarray  # (M, 3 or 6)
    covariance: np.ndarray  # (M, 3 or 6, 3 or 6)
    converged: np.ndarray  # (M,)
    bound_covariance: np.ndarray  # (3 or 6, 3 or 6) Cramer-Rao bound
    refused_why: dict[str, int]  # how many trials were refused, by reason

    @property
    def errors(self) -> np.ndarray:
        """Errors of the trials that converged, (C, 3 or 6)."""
        return self.estimate[self.converged] - self.receptions.truth

    @property
    def bound(self) -> np.ndarray:
        """Cramer-Rao bound of each component."""
        return np.sqrt(np.diag(self.bound_covariance))

    @property
    def bound_now(self) -> np.ndarray:
        """Cramer-Rao bound of the position at the last reception, (3,)."""
        return self._sigma_now(self.bound_covariance[None])[0]

    @property
    def rmse(self) -> np.ndarray:
        """Root-mean-square error of each component; NaN if no trial converged."""
        return np.sqrt(_mean(self.errors**2))

    @property
    def bias(self) -> np.ndarray:
        """Mean error of each component."""
        return _mean(self.errors)

    @property
    def mean_sigma(self) -> np.ndarray:
        """Mean stated sigma of each component."""
        return _mean(np.sqrt(np.einsum("kii->ki", self.covariance[self.converged])))

    @property
    def rmse_now(self) -> np.ndarray:
        """Root-mean-square error of the position at the last reception, (3,)."""
        errors = self.errors
        now = errors[:, :3].copy()
        if self.receptions.scenario.moving:
            now += self.receptions.received_s[-1] * errors[:, 3:]
        return np.sqrt(_mean(now**2))

    @property
    def mean_sigma_now(self) -> np.ndarray:
        """Mean stated sigma of the position at the last reception, (3,)."""
        return _mean(self._sigma_now(self.covariance[self.converged]))

    def _sigma_now(self, covariance: np.ndarray) -> np.ndarray:
        """Sigmas (M, 3) of the position at the last reception: o + t v (3-19), S11 + t^2 S44 + 2 t S14."""
        variance = np.einsum("kii->ki", covariance[:, :3, :3])
        if self.receptions.scenario.moving:
            t = self.receptions.received_s[-1]
            variance = variance + t**2 * np.einsum("kii->ki", covariance[:, 3:, 3:])
            variance = variance + 2 * t * np.einsum("kii->ki", covariance[:, :3, 3:])
        return np.sqrt(variance)

    @property
    def coverage(self) -> float:
        """Share of converged trials whose truth lies inside the stated 95 % ellipsoid of all components."""
        errors = self.errors
        if not len(errors):
            return np.nan
        inside = np.linalg.solve(self.covariance[self.converged], errors[:, :, None])[:, :, 0]
        return float(np.mean(np.sum(errors * inside, axis=1) <= chi2.ppf(PROBABILITY, errors.shape[1])))


def _mean(values: np.ndarray) -> np.ndarray:
    return values.mean(axis=0) if len(values) else np.full(values.shape[1:], np.nan)


def sail_hexagon(
    scenario: Scenario, receptions: int, speed_mps: float = 5.0, start_vertex: int = 4
) -> Receptions:
    """The first pings of a beacon heard from a ship that sails counter-clockwise round the hexagon.

    start_vertex : it starts at 60 times this many degrees from east; 4 is (-500, -866)
    Raises ValueError for fewer than one reception and for a ship that is not slower than sound.
    """
    if receptions < 1:
        raise ValueError(f"found {receptions} receptions; wanted at least 1")
    if not 0 <= speed_mps < 100:
        raise ValueError(f"found a ship's speed of {speed_mps} m/s; wanted 0 to 100")
    corners = np.radians(60.0 * (start_vertex + np.arange(7)))
    corners = LEG_M * np.column_stack([np.cos(corners), np.sin(corners)])
    emitted = INTERVAL_S * np.arange(receptions)
    beacon = np.array(scenario.position) + emitted[:, None] * np.array(scenario.velocity)
    received = emitted
    ship = np.zeros((receptions, 3))
    for _ in range(60):  # the ship's own way between emission and reception: contracts by speed / C
        sailed = np.mod(speed_mps * received, 6 * LEG_M)
        for k in (0, 1):
            ship[:, k] = np.interp(sailed, LEG_M * np.arange(7), corners[:, k])
        later = emitted + np.linalg.norm(ship - beacon, axis=1) / SOUND_SPEED_MPS
        if np.max(np.abs(later - received)) < 1e-12:
            break
        received = later
    return Receptions(scenario, emitted, later, ship, beacon)


def position_bound(receptions: Receptions, gps_rms_m: float, range_rms_m: float) -> np.ndarray:
    """Cramer-Rao bound of each component of `Receptions.truth`; see `bound_covariance`."""
    return np.sqrt(np.diag(bound_covariance(receptions, gps_rms_m, range_rms_m)))


def bound_covariance(receptions: Receptions, gps_rms_m: float, range_rms_m: float) -> np.ndarray:
    """Cramer-Rao bound of the covariance (P, P) of `Receptions.truth`, ship positions and emission time unknown.

    A ship position that is seen once adds its error along the ray's horizontal part to that of the range.
    Infinite where the geometry does not show all components.
    """
    offset = receptions.beacon - receptions.ship
    distance = receptions.range_m
    direction = offset / distance[:, None]
    rows = [direction, np.ones((len(offset), 1))]
    if receptions.scenario.moving:
        rows.insert(1, direction * receptions.emitted_s[:, None])
    slope = np.hstack(rows)
    variance = range_rms_m**2 + gps_rms_m**2 * np.sum(direction[:, :2] ** 2, axis=1)
    information = (slope / variance[:, None]).T @ slope
    scale = np.sqrt(np.diag(information))
    scaled = information / np.outer(scale, scale)
    components = slope.shape[1] - 1
    if len(offset) <= components or np.linalg.cond(scaled) > 1e14:
        return np.full((components, components), np.inf)
    return (np.linalg.inv(scaled) / np.outer(scale, scale))[:components, :components]


def noisy_surveys(
    receptions: Receptions, gps_rms_m: float, trials: int, seed: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Ship positions (B, N, 3) as its GPS gave them and ranges (B, N) with an unknown constant, BATCH at a time.

    Raises ValueError for fewer than one trial.
    """
    if trials < 1:
        raise ValueError(f"found {trials} trials; wanted at least 1")
    rng = np.random.default_rng(seed)
    for first in range(0, trials, BATCH):
        count = min(BATCH, trials - first)
        ship = np.repeat(receptions.ship[None], count, axis=0)
        ship[:, :, :2] += rng.normal(0, gps_rms_m, (count, len(receptions.ship), 2))
        ranges = receptions.range_m + rng.normal(0, SOUND_SPEED_MPS * TIME_RMS_S, ship.shape[:2])
        ranges += SOUND_SPEED_MPS * rng.uniform(-1, 1, (count, 1))  # the emission offset, never known
        yield ship, ranges


def run_trials(receptions: Receptions, gps_rms_m: float, trials: int, seed: int) -> Trials:
    """Fixes of many simulated surveys that differ in their noise only, every reception used.

    gps_rms_m : ship position error, each of east and north
    Raises ValueError for fewer than one trial.
    """
    range_rms = SOUND_SPEED_MPS * TIME_RMS_S
    moving = receptions.scenario.moving
    parts: list[SquaredRangeFixes] = []
    for ship, ranges in noisy_surveys(receptions, gps_rms_m, trials, seed):
        parts.append(
            fix_squared_range(ship, ranges, receptions.emitted_s, gps_rms_m, range_rms, moving=moving)
        )
    keep = [0, 1, 2, *range(4, MOVING)] if moving else [0, 1, 2]
    return Trials(
        receptions,
        np.concatenate([part.estimate for part in parts])[:, keep],
        np.concatenate([part.covariance for part in parts])[:, keep][:, :, keep],
        np.concatenate([part.converged for part in parts]),
        bound_covariance(receptions, gps_rms_m, range_rms),
        refusals(np.concatenate([part.why for part in parts])),
    )


@lru_cache(maxsize=2)  # the points of a sweep share it
def _noise(trials: int, seed: int, receptions: int) -> np.ndarray:
    """Standard errors (3, trials, receptions) east, north and in range; more receptions leave the first as they are."""
    drawn = np.random.default_rng(seed).standard_normal((receptions, trials, 3))
    return np.ascontiguousarray(drawn.transpose(2, 1, 0))


_sailed = lru_cache(maxsize=128)(sail_hexagon)  # a sweep's ways, the same for each estimator and GPS error


def run_pair_trials(receptions: Receptions, spacing: int, gps_rms_m: float, trials: int, seed: int) -> Trials:
    """Fixes of many simulated surveys by the thesis's estimator, from chained pairs `spacing` receptions apart.

    The bound beside them is that of every reception, used or not. Trial k has the same noise at reception
    number n of the chain whatever the spacing and the number of experiments.
    Raises ValueError for fewer than one trial.
    """
    if trials < 1:
        raise ValueError(f"found {trials} trials; wanted at least 1")
    chain = np.arange(0, len(receptions.ship), spacing)
    range_rms = SOUND_SPEED_MPS * TIME_RMS_S
    east, north, along = _noise(trials, seed, -(-len(chain) // CHAIN) * CHAIN)[:, :, : len(chain)]
    ship = np.empty((trials, len(chain), 3))
    ship[:, :, 0] = receptions.ship[chain, 0] + gps_rms_m * east
    ship[:, :, 1] = receptions.ship[chain, 1] + gps_rms_m * north
    ship[:, :, 2] = receptions.ship[chain, 2]
    ranges = receptions.range_m[chain] + range_rms * along
    fixes = fix_pairs(
        ship, ranges, receptions.emitted_s[chain], experiments(len(chain) - 1, 1), gps_rms_m, range_rms,
        moving=receptions.scenario.moving,
    )  # fmt: skip
    return Trials(
        receptions,
        fixes.estimate,
        fixes.covariance,
        fixes.converged,
        bound_covariance(receptions, gps_rms_m, range_rms),
        {NOT_AT_REST: lost} if (lost := int(np.sum(~fixes.converged))) else {},
    )


def sail_for(
    beacon: Scenario, experiment_count: int, spacing: int, speed_mps: float = 5.0, start_vertex: int = 4
) -> Receptions:
    """As many pings of a beacon as so many chained experiments need.

    Raises ValueError for a count or spacing below one.
    """
    if experiment_count < 1 or spacing < 1:
        raise ValueError(
            f"found {experiment_count} experiments at spacing {spacing}; wanted at least 1 of each"
        )
    return _sailed(beacon, experiment_count * spacing + 1, speed_mps, start_vertex)


def run_point(
    scenario: int,
    experiment_count: int,
    spacing: int,
    gps_rms_m: float,
    trials: int,
    seed: int,
    method: str,
    speed_mps: float = 5.0,
    start_vertex: int = 4,
) -> Trials:
    """Trials of one point of the study: a scenario of Table 4-1, a length of survey, an estimator of METHODS.

    Raises ValueError for a count or spacing below one and for an unknown scenario or method.
    """
    if scenario not in SCENARIOS or method not in METHODS:
        raise ValueError(f"found scenario {scenario}, method {method}; wanted 1 to 6, one of {METHODS}")
    receptions = sail_for(SCENARIOS[scenario], experiment_count, spacing, speed_mps, start_vertex)
    return run_method(receptions, spacing, gps_rms_m, trials, seed, method)


def run_method(
    receptions: Receptions, spacing: int, gps_rms_m: float, trials: int, seed: int, method: str
) -> Trials:
    """Trials of one survey by an estimator of METHODS. Raises ValueError for a ship without position error."""
    if not gps_rms_m > 0:
        raise ValueError(f"found a ship position error of {gps_rms_m:g} m; wanted more than 0")
    if method == "thesis":
        return run_pair_trials(receptions, spacing, gps_rms_m, trials, seed)
    return run_trials(receptions, gps_rms_m, trials, seed)
