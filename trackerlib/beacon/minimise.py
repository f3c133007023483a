"""The place whose travel times fit best: robust least squares from many starts at once.

Minimised is the weighted sum of squares of  e = t - T(beacon) - emission offset  over the pings.
Emission offset, interval, drift and slowness of the water are linear given the beacon, so they are
eliminated, not iterated on. Weights are
frozen within a descent and renewed between descents: left free inside the sum they would reward
places that make their own weights small.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from trackerlib.beacon.paths import Paths, depth_below_surface

TUKEY = 4.685  # biweight tuning constant, 95 % efficient on normal errors
CUT = 5.0  # a ping farther than this many scales from the fit is a false return


@dataclass(frozen=True, eq=False)
class Region:
    """Where a beacon may be: within a range of the ship's mean position, and no deeper than told."""

    centre: np.ndarray  # (2,) east, north [m]
    max_range_m: float
    max_depth_m: float
    max_moved_m: float = np.inf  # in half the survey

    def clip(self, beacon: np.ndarray) -> np.ndarray:
        """States (S, P) brought back inside; above the surface counts as its mirror below it."""
        out = beacon.copy()
        from_centre = out[:, :2] - self.centre
        distance = np.hypot(*from_centre.T)
        shrink = np.minimum(1.0, self.max_range_m / np.maximum(distance, 1e-9))
        out[:, :2] = self.centre + from_centre * shrink[:, None]
        depth = depth_below_surface(out)
        out[:, 2] += depth - np.minimum(np.abs(depth), self.max_depth_m)
        if out.shape[1] > 3:
            moved = np.linalg.norm(out[:, 3:], axis=1)
            out[:, 3:] *= np.minimum(1.0, self.max_moved_m / np.maximum(moved, 1e-9))[:, None]
        return out

    def edge(self, beacon: np.ndarray) -> str | None:
        """Which edge of the region a state (P,) stands on, in words; None inside it."""
        if np.hypot(*(beacon[:2] - self.centre)) > 0.9999 * self.max_range_m:
            return f"the greatest range ({self.max_range_m:g} m from the ship's mean position)"
        if depth_below_surface(beacon) > 0.9999 * self.max_depth_m:
            return f"the greatest depth ({self.max_depth_m:g} m)"
        if len(beacon) > 3 and np.linalg.norm(beacon[3:]) > 0.9999 * self.max_moved_m:
            return "the greatest speed"
        return None


@dataclass(frozen=True, eq=False)
class Problem:
    """What was measured, how well, and where the answer may lie."""

    ship: np.ndarray  # (N, 3) hydrophone east, north, up [m]
    time: np.ndarray  # (N,) travel time plus what `columns` adds [s]
    paths: Paths
    region: Region
    gps_rms_m: np.ndarray  # (2,) ship position error, east and north; zeros weigh all pings alike
    time_sigma_s: float  # error of one time before ship position enters; the scale's floor
    columns: np.ndarray  # (N, L) what the linear unknowns add to the times, see `clock_columns`
    share: np.ndarray  # (N,) instants from -1 at the first ping to 1 at the last, see Motion
    axes: np.ndarray  # (K, P) free directions of a state, see Motion
    slowness_sigma: float | None = None  # relative, of the water told; None: its speed is taken as known
    noise_s: float = 1e-3  # error of a time of weight one, against which that prior is weighed

    def only(self, keep) -> Problem:
        """The same problem with some of its pings."""
        return replace(
            self,
            ship=self.ship[keep],
            time=self.time[keep],
            share=self.share[keep],
            columns=self.columns[keep],
        )

    @property
    def emission_known(self) -> bool:
        """Whether times are true travel times, with no unknown constant."""
        return self.columns.shape[1] == 0

    @property
    def linear_unknowns(self) -> int:
        """How many unknowns are eliminated: the clock's, and the slowness of the water if it is fitted."""
        return self.columns.shape[1] + (self.slowness_sigma is not None)

    @property
    def unknowns(self) -> int:
        """How many numbers are estimated: free directions, and the linear unknowns."""
        return len(self.axes) + self.linear_unknowns

    @property
    def prior(self) -> np.ndarray:
        """Weights (L,) that pull the linear unknowns to zero: only that of the slowness, which stands last."""
        weight = np.zeros(self.linear_unknowns)
        if self.slowness_sigma is not None:
            weight[-1] = (self.noise_s / max(self.slowness_sigma, 1e-9)) ** 2
        return weight

    def places(self, state: np.ndarray) -> np.ndarray:
        """Where beacons with states (S, P) are at each ping: (S, 3) if still, (S, N, 3) if moving."""
        if state.shape[1] == 3:
            return state
        return state[:, None, :3] + self.share[:, None] * state[:, None, 3:]

    def times(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Travel times (S, N) [s] and gradients (S, N, P) [s/m] at states (S, P), in the water told."""
        travel_time, gradient = self.paths.times(self.places(state), self.ship)
        if state.shape[1] > 3:
            gradient = np.concatenate([gradient, self.share[:, None] * gradient], axis=-1)
        return travel_time, gradient

    def slant_range(self, state: np.ndarray) -> float:
        """Median distance [m] from the ship to a beacon with this state (P,)."""
        return float(np.median(np.linalg.norm(self.places(state[None])[0] - self.ship, axis=-1)))

    def variance(self, gradient: np.ndarray) -> np.ndarray:
        """Stated variance (S, N) [s^2] of each time, its ship position's error included."""
        return self.time_sigma_s**2 + np.einsum("snk,k->sn", gradient[..., :2] ** 2, self.gps_rms_m**2)

    def relative_weight(self, gradient: np.ndarray) -> np.ndarray:
        """Weight of each ping (S, N) from its time error and its ship position's error, mean near 1."""
        if not self.gps_rms_m.any():
            return np.ones(gradient.shape[:2])
        variance = self.variance(gradient)
        return np.median(variance, axis=1, keepdims=True) / variance

    def columns_at(self, travel_time: np.ndarray) -> np.ndarray:
        """What each linear unknown adds to the times (S, N, L) where sound takes travel_time (S, N)."""
        columns = np.broadcast_to(self.columns, (len(travel_time), *self.columns.shape))
        if self.slowness_sigma is None:
            return columns
        return np.concatenate([columns, np.nan_to_num(travel_time)[..., None]], axis=-1)

    def eliminate(self, beacon, weight) -> Misfit:
        """Residuals and gradients at states (S, P) with the linear unknowns at their best."""
        travel_time, gradient = self.times(beacon)
        usable = np.isfinite(travel_time)
        weight = np.where(usable, weight, 0.0)
        residual = np.where(usable, self.time - travel_time, 0.0)
        gradient = np.where(usable[..., None], gradient, 0.0)
        columns = self.columns_at(travel_time)
        weighted = np.swapaxes(columns * weight[..., None], 1, 2)
        normal = weighted @ columns + np.diag(self.prior)
        size = np.trace(normal, axis1=1, axis2=2)[:, None, None] * 1e-15 + 1e-300
        inverse = np.linalg.inv(normal + size * np.eye(normal.shape[1]))
        best = inverse @ (weighted @ residual[..., None])
        if self.slowness_sigma is not None:
            gradient = gradient * (1 + best[:, -1:])
        follow = inverse @ (weighted @ gradient)
        return Misfit(
            residual=np.where(usable, residual - (columns @ best)[..., 0], 0.0),
            gradient=np.where(usable[..., None], gradient - columns @ follow, 0.0),
            weight=weight,
            travel_time=travel_time,
            time_gradient=gradient,
            columns=columns,
            linear=best[..., 0],
            follow=follow,
            inverse=inverse,
            prior=self.prior,
        )


@dataclass(frozen=True, eq=False)
class Misfit:
    """Residuals at some positions, with the linear unknowns eliminated."""

    residual: np.ndarray  # (S, N) [s]
    gradient: np.ndarray  # (S, N, P) [s/m] of the fitted time by state, the linear unknowns following
    weight: np.ndarray  # (S, N)
    travel_time: np.ndarray  # (S, N) [s] in the water told
    time_gradient: np.ndarray  # (S, N, P) [s/m] of the travel time alone
    columns: np.ndarray  # (S, N, L) what a linear unknown adds to the times
    linear: np.ndarray  # (S, L) the linear unknowns
    follow: np.ndarray  # (S, L, P) how much less they become as the state grows
    inverse: np.ndarray  # (S, L, L) of their own normal matrix
    prior: np.ndarray  # (L,) weights that pull them to zero

    @property
    def sum_of_squares(self) -> np.ndarray:
        """Weighted sum of squared residuals (S,) [s^2]."""
        lost = ~np.isfinite(self.travel_time)  # a place that no ray reaches must never look good
        worst = np.max(np.abs(self.residual), axis=1, initial=1e-3) ** 2
        squares = (self.weight * self.residual**2).sum(axis=1) + lost.sum(axis=1) * worst
        return squares + self.linear**2 @ self.prior

    def normal_matrix(self, axes: np.ndarray) -> np.ndarray:
        """Normal matrices (S, K, K) along the free axes (K, P)."""
        along, follow = self.gradient @ axes.T, self.follow @ axes.T
        pings = np.swapaxes(along * self.weight[..., None], 1, 2) @ along
        return pings + np.swapaxes(follow * self.prior[:, None], 1, 2) @ follow

    def slope(self, axes: np.ndarray) -> np.ndarray:
        """Half the descent (S, K) of the sum of squares along the free axes (K, P)."""
        pings = np.einsum("snk,sn->sk", self.gradient, self.weight * self.residual)
        return (pings + np.einsum("slk,sl->sk", self.follow, self.prior * self.linear)) @ axes.T

    def or_better(self, trial: Misfit, better: np.ndarray) -> Misfit:
        """This misfit, and that of `trial` for the positions where `better` (S,)."""
        if better.all() or not better.any():
            return trial if better.any() else self
        kept = {"prior": self.prior}
        for name in (field.name for field in fields(self) if field.name != "prior"):
            mine, other = getattr(self, name), getattr(trial, name)
            kept[name] = np.where(better.reshape(-1, *[1] * (mine.ndim - 1)), other, mine)
        return Misfit(**kept)


def descend(problem, beacon, weight, *, steps, axes, log=None):
    """States (S, P) after some Levenberg-Marquardt steps with frozen weights, and the last step [m].

    Each start has its own damping; a step is kept only where it lessens the sum of squares.
    log : a Recorder that notes every step
    """
    damping = np.full(len(beacon), 1e-3)
    misfit = problem.eliminate(beacon, weight)
    moved = np.full(len(beacon), np.inf)
    for _ in range(steps):
        normal = misfit.normal_matrix(axes)
        slope = misfit.slope(axes)
        # Scaled by the trace, not by each diagonal element: a direction that no ping sees must
        # stay put, not leap.
        trace = np.trace(normal, axis1=1, axis2=2) + 1e-300
        damped = normal + (damping * trace)[:, None, None] * np.eye(len(axes))
        step = np.linalg.solve(damped, slope[..., None])[..., 0] @ axes
        trial = problem.region.clip(beacon + step)
        trial_misfit = problem.eliminate(trial, weight)
        better = trial_misfit.sum_of_squares < misfit.sum_of_squares
        moved = np.where(better, np.linalg.norm(trial - beacon, axis=1), np.linalg.norm(step, axis=1))
        damping = np.clip(np.where(better, damping * 0.1, damping * 10), 1e-12, 1e6)
        beacon = np.where(better[:, None], trial, beacon)
        misfit = misfit.or_better(trial_misfit, better)
        if log is not None:
            log.note(beacon, misfit, moved, damping)
        if np.all(moved < 1e-5):
            break
    return beacon, moved


def scale_of(residual: np.ndarray, unknowns: int, floor: float) -> np.ndarray:
    """Robust standard deviation (S,) of residuals (S, N) after fitting, from their median size."""
    pings = residual.shape[1]
    freedom = np.sqrt(pings / max(pings - unknowns, 1))
    return np.maximum(1.4826 * freedom * np.median(np.abs(residual), axis=1), floor)


def biweight(residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Tukey's redescending weights (S, N): one at the centre, none beyond TUKEY scales."""
    u = residual / (TUKEY * scale[:, None])
    return np.where(np.abs(u) < 1, (1 - u**2) ** 2, 0.0)


def biweight_cost(residual: np.ndarray, scale: float) -> np.ndarray:
    """Robust chi-square (S,): squares near the centre, a constant for a false return."""
    u = np.minimum(np.abs(residual) / (TUKEY * scale), 1.0)
    return (TUKEY**2 / 3 * (1 - (1 - u**2) ** 3)).sum(axis=1)


def robust_descent(problem, beacon, *, rounds, steps, axes=None, log=None):
    """States (S, P) after redescending least squares, with the scale (S,) [s] at which it ended.

    axes : free directions, where not those of the problem
    log : a Recorder that notes the start of least scale in every round
    """
    axes = problem.axes if axes is None else axes
    weight = np.ones((len(beacon), len(problem.time)))
    for round_number in range(rounds):
        misfit = problem.eliminate(beacon, weight)
        # The offset of the first rounds is a median, which false returns do not move.
        residual = misfit.residual
        if not problem.emission_known and round_number < 3:
            residual = residual - np.median(residual, axis=1, keepdims=True)
        scale = scale_of(residual, problem.unknowns, problem.time_sigma_s)
        weight = biweight(residual, scale)
        if log is not None:
            log.note(beacon, replace(misfit, weight=weight), best=int(np.argmin(scale)))
        beacon, moved = descend(problem, beacon, weight, steps=steps, axes=axes)
        if np.all(moved < 1e-4) and round_number > 3:
            break
    return beacon, scale


def settle(problem, beacon, scale, *, reject, axes=None, log=None):
    """One state (P,) by least squares on the pings within CUT scales, renewed until none changes.

    Returns the state, which pings were used (N,), and whether the last step had come to rest.
    With reject="none" every ping is used.
    """
    axes = problem.axes if axes is None else axes
    beacon = beacon[None]
    keep = np.ones(len(problem.time), bool)
    if reject != "none":
        misfit = problem.eliminate(beacon, np.ones((1, len(keep))))
        residual = misfit.residual[0]
        if not problem.emission_known:
            residual = residual - np.median(residual)
        keep = np.abs(residual) <= CUT * scale
    seen: set[bytes] = set()
    for _ in range(12):
        for _ in range(3):  # weights follow the geometry, frozen within each descent
            gradient = problem.times(beacon)[1]
            weight = keep * np.nan_to_num(problem.relative_weight(gradient))
            beacon, moved = descend(problem, beacon, weight, steps=30, axes=axes, log=log)
        if reject == "none":
            break
        residual = problem.eliminate(beacon, weight).residual
        scale = scale_of(residual[:, keep], problem.unknowns, problem.time_sigma_s)
        renewed = np.abs(residual[0]) <= CUT * scale[0]
        if np.array_equal(renewed, keep) or renewed.tobytes() in seen:
            break
        seen.add(renewed.tobytes())
        keep = renewed
    return beacon[0], keep, bool(moved[0] < 1e-3)


def starts(problem: Problem, extra: np.ndarray | None = None) -> np.ndarray:
    """Starting states (S, P), at rest: four bearings at four depths about the ship's track, and any told."""
    extent = max(np.ptp(problem.ship[:, 0]), np.ptp(problem.ship[:, 1]), 200.0)
    depths = np.array([0.02, 0.1, 0.25, 0.6]) * min(problem.region.max_depth_m, 10_000.0)
    angles = np.pi / 2 * np.arange(4) + 0.3
    east_north = problem.region.centre + 0.3 * extent * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    grid = np.array([(*place, -depth) for depth in depths for place in east_north])
    if extra is not None:
        grid = np.concatenate([grid, np.atleast_2d(extra)])
    still = np.zeros((len(grid), problem.axes.shape[1] - 3))
    return problem.region.clip(np.concatenate([grid, still], axis=1))
