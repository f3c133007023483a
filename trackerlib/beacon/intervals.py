"""95 % intervals where an ellipse is not enough: by profile likelihood, and by bootstrap.

Both follow the misfit as it is, bent or lopsided, where the ellipse takes it for a parabola. What residuals do not
tell (slow errors of the ship, the antenna, a speed of sound that is not fitted) is added in quadrature on each side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from trackerlib.beacon.attempt import SEARCH_PINGS
from trackerlib.beacon.diagnosis import COORDINATES, problem_at
from trackerlib.beacon.minimise import Problem, descend
from trackerlib.beacon.motion import Motion
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import FixSettings
from trackerlib.rounding import decimals_for, rounded

PLACE = COORDINATES[:3]  # east, north, depth
STEP = 0.25  # of the interval's quadratic half-width, by which a profile is followed
FARTHEST = 12.0  # such half-widths after which an interval counts as open
NOTED = 0.2  # share by which an interval must differ from the ellipse's for a warning
BATCH = 40  # bootstrap samples fitted side by side
Progress = Callable[[float, str], object]  # told the share done and in words; what it raises ends the work


@dataclass(frozen=True)
class Interval:
    """95 % interval of one coordinate: of east or north in the frame of the fix, or of depth below the surface."""

    low_m: float  # -inf where it is open
    high_m: float

    def __str__(self) -> str:
        low_open, high_open = np.isinf(self.low_m), np.isinf(self.high_m)
        if low_open or high_open:
            if low_open and high_open:
                return "open"
            return f"{self.high_m:.1f} m or less" if low_open else f"{self.low_m:.1f} m or more"
        decimals = decimals_for((self.high_m - self.low_m) / 4)
        low, high = (f"{round(side, decimals):.{max(decimals, 0)}f}" for side in (self.low_m, self.high_m))
        return f"{low} to {high} m"


def _untold(share: float, text: str) -> None:
    """Progress that nobody follows."""


def profile_likelihood(
    pings: Pings, fix: BeaconFix, settings: FixSettings, component: str = "depth"
) -> Interval:
    """95 % interval of one of PLACE of the position, all other unknowns following.

    The bounds are where the misfit has risen as far as the ellipse says it would at its own edge, which counts in
    the noise of the residuals, their correlation and how few they are. A survey of many pings is thinned.
    Raises ValueError for a fix without a place or an uncertainty, and for another component.
    """
    if component not in PLACE:
        raise ValueError(f"component is {component!r}; wanted one of {', '.join(PLACE)}")
    problem, state, motion = _ground(pings, fix, settings)
    chosen = np.unique(
        np.linspace(0, len(problem.time) - 1, min(len(problem.time), SEARCH_PINGS)).astype(int)
    )
    problem = problem.only(chosen)
    # Along the free directions: what the coordinate is of a state, and what leaves it alone.
    axes = problem.axes
    toward = axes @ motion.at(0.0)[PLACE.index(component)]
    others = linalg.null_space(toward[None]).T @ axes
    weight = np.repeat(_weight(problem, state), 2, axis=0)
    state = descend(problem, state[None], weight[:1], steps=20, axes=axes)[0][0]
    misfit = problem.eliminate(state[None], weight[:1])
    cross = linalg.pinvh(misfit.normal_matrix(axes)[0]) @ toward
    at = toward @ cross
    k = PLACE.index(component)
    half = 1.96 * np.sqrt(fix.uncertainty.residual_covariance[k, k])
    # The rise of the misfit that stands for a bound: where a parabola would have risen to at the ellipse's edge.
    wanted = half**2 / at
    bounds = _follow(problem, state, weight, cross @ axes / at, others, half, wanted)
    if component == "depth":
        bounds = bounds[::-1]
    return _interval(fix, component, bounds[0], bounds[1])


def _follow(problem, state, weight, way, others, half, wanted) -> np.ndarray:
    """How far (2,) [m] below and above a coordinate the misfit stays within `wanted` of its least; inf if it always is.

    way : (P,) movement per metre of the coordinate; others : (K - 1, P) directions that follow
    """
    least = problem.eliminate(state[None], weight[:1]).sum_of_squares[0]
    states, bounds = np.repeat(state[None], 2, axis=0), np.full(2, np.inf)
    before, signs = np.zeros(2), np.array([-1.0, 1.0])
    for distance in np.arange(STEP, FARTHEST + STEP / 2, STEP) * half:
        states = states + STEP * half * signs[:, None] * way
        if len(others):
            states = descend(problem, states, weight, steps=12, axes=others)[0]
        rise = np.maximum(problem.eliminate(states, weight).sum_of_squares - least, 0.0)
        root = np.sqrt(rise / wanted)  # grows by STEP a step where the ellipse is right
        passed = np.isinf(bounds) & (root >= 1)
        within = (1 - before) / np.maximum(root - before, 1e-12)
        bounds[passed] = distance - STEP * half * (1 - np.clip(within, 0.0, 1.0))[passed]
        before = root
        if np.isfinite(bounds).all():
            break
    return bounds


def bootstrap_positions(
    pings: Pings,
    fix: BeaconFix,
    settings: FixSettings,
    samples: int = 400,
    seed: int = 0,
    progress: Progress = _untold,
) -> np.ndarray:
    """Positions (samples, 3) [m] at the first ping, refitted to the residuals in another order.

    Residuals are drawn in blocks as long as their correlation, made as large as noise is before a fit, and put on
    the fitted times; which pings count and how much they weigh stays. Their spread is that of least squares.
    Raises ValueError for a fix without a place or an uncertainty.
    """
    problem, state, motion = _ground(pings, fix, settings)
    weight, count = _weight(problem, state), len(problem.time)
    misfit = problem.eliminate(state[None], weight)
    root = np.sqrt(np.maximum(weight[0], 1e-30))
    noise = misfit.residual[0] * root * np.sqrt(count / max(count - problem.unknowns, 1))
    noise = noise - np.average(noise, weights=root)
    fitted = problem.time - misfit.residual[0]
    block = int(np.clip(np.ceil(2 * fix.uncertainty.correlation.length), 1, max(count // 4, 1)))
    rng = np.random.default_rng(seed)
    found = []
    for done in range(0, samples, BATCH):
        progress(done / samples, f"sample {done} of {samples}")
        size = min(BATCH, samples - done)
        first = rng.integers(0, count, (size, -(-count // block), 1))
        rows = ((first + np.arange(block)) % count).reshape(size, -1)[:, :count]
        drawn = replace(problem, time=fitted + noise[rows] / root)
        states, _ = descend(
            drawn,
            np.repeat(state[None], size, axis=0),
            np.repeat(weight, size, axis=0),
            steps=20,
            axes=problem.axes,
        )
        found.append(states @ motion.at(0.0)[:3].T)
    moved = np.concatenate(found) - motion.at(0.0)[:3] @ state
    return fix.position + moved


def bootstrap_intervals(
    pings: Pings,
    fix: BeaconFix,
    settings: FixSettings,
    samples: int = 400,
    seed: int = 0,
    progress: Progress = _untold,
) -> dict[str, Interval]:
    """95 % intervals of all PLACE by `bootstrap_positions`; raises what it raises."""
    moved = bootstrap_positions(pings, fix, settings, samples, seed, progress) - fix.position
    moved[:, 2] *= -1
    low, high = np.quantile(moved, [0.025, 0.975], axis=0)
    return {name: _interval(fix, name, -low[k], high[k]) for k, name in enumerate(PLACE)}


def profile_intervals(
    pings: Pings, fix: BeaconFix, settings: FixSettings, progress: Progress = _untold
) -> dict[str, Interval]:
    """95 % intervals of all PLACE by `profile_likelihood`; raises what it raises."""
    intervals = {}
    for k, name in enumerate(PLACE):
        progress(k / len(PLACE), name)
        intervals[name] = profile_likelihood(pings, fix, settings, name)
    return intervals


def interval_words(fix: BeaconFix, intervals: dict[str, Interval]) -> str | None:
    """A sentence on the coordinate whose interval differs most from the ellipse's; None if none does by NOTED."""
    worst, most = None, NOTED
    for k, name in enumerate(PLACE):
        interval, centre = intervals[name], _value(fix, name)
        half = 1.96 * fix.sigma[k]
        differs = max(abs((centre - interval.low_m) / half - 1), abs((interval.high_m - centre) / half - 1))
        if differs > most:
            worst, most = name, differs
    if worst is None:
        return None
    interval, sides = intervals[worst], []
    for bound, word in ((interval.low_m, "below"), (interval.high_m, "above")):
        far = abs(bound - _value(fix, worst))
        sides.append(f"{rounded(far)} m {word}" if np.isfinite(far) else f"open {word}")
    half = 1.96 * fix.sigma[PLACE.index(worst)]
    return (
        f"the misfit is not a parabola: the 95 % interval of {worst} is {' and '.join(sides)}, where the ellipse says "
        f"{rounded(half)} m either side; believe the interval"
    )


def _ground(pings: Pings, fix: BeaconFix, settings: FixSettings) -> tuple[Problem, np.ndarray, Motion]:
    if fix.position is None or fix.uncertainty is None:
        raise ValueError(f"there is no place to look about: {fix.reason}")
    if settings.method != "all-pings":
        raise ValueError(
            "intervals are for the fix of all pings; the thesis's pairs have their covariance alone"
        )
    return problem_at(pings, fix, settings)


def _weight(problem: Problem, state: np.ndarray) -> np.ndarray:
    return np.nan_to_num(problem.relative_weight(problem.times(state[None])[1]))


def _value(fix: BeaconFix, component: str) -> float:
    k = PLACE.index(component)
    return float(fix.depth_m if component == "depth" else fix.position[k])


def _interval(fix: BeaconFix, component: str, down: float, up: float) -> Interval:
    """The interval that reaches `down` and `up` [m] from the fix by its residuals, widened by what they do not tell."""
    k, uncertainty = PLACE.index(component), fix.uncertainty
    beyond = 1.96**2 * max(uncertainty.covariance[k, k] - uncertainty.residual_covariance[k, k], 0.0)
    sides = np.hypot([down, up], np.sqrt(beyond))
    return Interval(_value(fix, component) - float(sides[0]), _value(fix, component) + float(sides[1]))
