"""Fixes from experiments, pairs of receptions whose difference of ranges no emission time can change.

    pairs = experiments(25, spacing=45)
    fixes = fix_pairs(ship, ranges, epochs, pairs, gps_rms_m=3, range_rms_m=0.43)

The estimator of Wojcik (1993), chapters II and III: every measured quantity of an experiment may err, and the
beacon is where the least weighted squares of all corrections satisfy (2-19) or (3-10). The thesis steps all
corrections and the beacon together, hundreds of times where it is slow; here the corrections of an experiment
are solved for at each trial place, which leaves a least-squares problem in 3 or 6 unknowns and the same answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from trackerlib.beacon.pair_descent import fix_all, fix_some
from trackerlib.compiled import warms

START = (0.0, 0.0, -2500.0)  # (4-6), (4-7)
LEAST_EXPERIMENTS = {False: (20, 35), True: (30, 45)}  # count, spacing: the thesis's minima still and moving


@dataclass(frozen=True)
class SearchBox:
    """Where a beacon may be and how fast (2-48), (3-11)."""

    range_m: float = 5000.0  # |east|, |north| from the origin
    depth_m: float = 5000.0
    speed_mps: float = 5.0  # |each component|

    def __post_init__(self):
        for name in ("range_m", "depth_m", "speed_mps"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name):g}; wanted more than 0")

    def limits(self, unknowns: int) -> np.ndarray:
        """Lowest and highest value of each unknown (2, 3 or 6)."""
        r, d, v = self.range_m, self.depth_m, self.speed_mps
        return np.array([[-r, -r, -d, -v, -v, -v], [r, r, 0.0, v, v, v]])[:, :unknowns]


@dataclass(frozen=True, eq=False)
class PairFixes:
    """Fixes of B surveys: metres and m/s, unknowns east, north, up and, if it moves, three velocities."""

    estimate: np.ndarray  # (B, 3 or 6)
    covariance: np.ndarray  # (B, 3 or 6, 3 or 6) D^-1 (3-20), as if no two experiments shared a reception
    misfit: np.ndarray  # (B,) least weighted sum of squared corrections
    converged: np.ndarray  # (B,) at rest inside the search box, every direction seen
    iterations: np.ndarray  # (B,) steps taken


def experiments(count: int, spacing: int, step: int | None = None) -> np.ndarray:
    """Pairs of receptions (count, 2): first ones `step` apart (default: chained), partners `spacing` later.

    Raises ValueError for a count, spacing or step below one.
    """
    step = spacing if step is None else step
    if min(count, spacing, step) < 1:
        raise ValueError(
            f"found {count} experiments, spacing {spacing}, step {step}; wanted at least 1 of each"
        )
    first = step * np.arange(count)
    return np.column_stack([first, first + spacing])


def fix_pairs(
    ship: np.ndarray,
    ranges: np.ndarray,
    epochs: np.ndarray,
    pairs: np.ndarray,
    gps_rms_m: float,
    range_rms_m: float,
    *,
    moving: bool = False,
    box: SearchBox | None = None,
    start: tuple[float, ...] = START,
) -> PairFixes:
    """Maximum-likelihood places of beacons from pairs of receptions, all measurements in error.

    ship : (B, R, 3) logged positions of the hydrophone [m]; east and north in error, up known
    ranges : (B, R) speed of sound times arrival time less emission number times interval [m] (2-6)
    epochs : (R,) emission times [s]; a moving beacon's position is that at epoch 0
    pairs : (N, 2) which receptions make an experiment
    gps_rms_m, range_rms_m : sigma of a position (each axis) and of speed of sound times arrival time
    box, start : search region (2-48) and first guess (4-6); velocities start at zero unless given

    A fix starts from equations that are linear in squared ranges, then from `start`, then from places about it, until
    one comes to rest at a misfit that the noise explains. Where that place is known badly and was hard to find, all
    are tried, for there may be several minima; the least is kept. At the surface, where no depth is told, none rests.
    Fewer experiments than unknowns plus one is `converged` false.
    Raises ValueError for shapes that do not fit and for noise that is not positive.
    """
    ship, ranges = np.ascontiguousarray(ship, float), np.ascontiguousarray(ranges, float)
    epochs, pairs = np.ascontiguousarray(epochs, float), np.ascontiguousarray(pairs, np.int64)
    if (
        ship.ndim != 3
        or ship.shape[2] != 3
        or ranges.shape != ship.shape[:2]
        or epochs.shape != ranges.shape[1:]
    ):
        raise ValueError(
            f"found ship {ship.shape}, ranges {ranges.shape}, epochs {epochs.shape}; wanted (B, R, 3), (B, R), (R,)"
        )
    if (
        pairs.ndim != 2
        or pairs.shape[1] != 2
        or (pairs.size and not 0 <= pairs.min() <= pairs.max() < len(epochs))
    ):
        raise ValueError(
            f"found pairs {pairs.shape}; wanted (N, 2) numbers of receptions below {len(epochs)}"
        )
    if not gps_rms_m >= 0 or not range_rms_m >= 0 or gps_rms_m + range_rms_m <= 0:
        raise ValueError(f"found noise of {gps_rms_m} m and {range_rms_m} m; wanted at least one above zero")
    surveys, unknowns = len(ship), 6 if moving else 3
    first = np.zeros(unknowns)
    first[: len(start)] = start
    fixes = PairFixes(
        np.full((surveys, unknowns), np.nan),
        np.full((surveys, unknowns, unknowns), np.nan),
        np.full(surveys, np.nan),
        np.zeros(surveys, bool),
        np.zeros(surveys, np.int64),
    )
    if len(pairs) > unknowns:
        threads = numba.get_num_threads()
        told = (
            ship, ranges, epochs, pairs, float(gps_rms_m) ** 2, float(range_rms_m) ** 2, first,
            (box or SearchBox()).limits(unknowns), fixes.estimate, fixes.covariance, fixes.misfit, fixes.converged,
            fixes.iterations,
        )  # fmt: skip
        if threads > 1:
            fix_all(*told, threads)
        else:
            fix_some(*told, 0, surveys)
    return fixes


def shared_covariance(
    ship: np.ndarray,
    ranges: np.ndarray,
    epochs: np.ndarray,
    pairs: np.ndarray,
    state: np.ndarray,
    gps_rms_m: float,
    range_rms_m: float,
) -> np.ndarray:
    """Covariance (P, P) of one fix, the errors of a reception counted once in every experiment that holds it.

    ship (R, 3), ranges (R,), epochs (R,), pairs (N, 2) as for `fix_pairs`; state (P,) what it came to.
    D^-1 (3-20) is this where no two experiments share a reception.
    """
    moving = len(state) > 3
    place = state[:3] + (epochs[:, None] * state[3:] if moving else 0.0)
    offset = place - ship
    direction = offset / np.linalg.norm(offset, axis=1)[:, None]
    slope = np.hstack([direction, epochs[:, None] * direction]) if moving else direction
    b = slope[pairs[:, 0]] - slope[pairs[:, 1]]
    variance = gps_rms_m**2 * np.sum(direction[:, :2] ** 2, axis=1) + range_rms_m**2  # of one reception
    c = variance[pairs].sum(axis=1)
    sign = np.zeros((len(pairs), len(epochs)))
    rows = np.arange(len(pairs))
    sign[rows, pairs[:, 0]], sign[rows, pairs[:, 1]] = 1.0, -1.0
    pull = (b / c[:, None]).T @ sign  # (P, R): how each reception's error moves the normal equations
    scale = np.linalg.norm(b / np.sqrt(c)[:, None], axis=0)
    root = np.linalg.inv((b / c[:, None]).T @ b / np.outer(scale, scale)) / np.outer(scale, scale)
    return root @ (pull * variance) @ pull.T @ root


@warms
def _warm() -> None:
    rng = np.random.default_rng(1)
    ship = np.zeros((2, 30, 3))
    ship[:, :, :2] = 100 * rng.normal(size=(2, 30, 2))
    ranges = np.linalg.norm(ship - [10.0, 0.0, -200.0], axis=2)
    for moving in (False, True):
        fix_pairs(ship, ranges, np.arange(30.0), experiments(20, 5, 1), 1.0, 1.0, moving=moving)
