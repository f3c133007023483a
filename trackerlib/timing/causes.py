"""What could make two arrays disagree about one track, and which of it the run supports.

    ranking = compare_causes(sets, survey, profile)
    print(ranking.best.name)

Read (1990) corrects timing alone and ends by asking for the rest: a displaced or turned array, a bias of its
angles, a wrong speed of sound. To first order each cause moves the gap X - Y of every crossover set by a known
pattern, so all of them stand in one system of normal equations, and any one or two of them are a small part of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.stats import chi2

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.acoustics.rays import fit_rays
from trackerlib.crossover.noise import residual_noise
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.straight_line import MIN_POINTS
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.timing.correction import corrected_tracks, estimate_timing, stretches

STEP = 1.0  # length by which a place is moved to see how its ray changes
SAME = 1e-6  # relative: chi-squares closer than this are one, and the geometry cannot tell the causes apart
HELD_OUT = 15  # causes, best first, that are also tried on sets left out
LUCK = 0.01  # chance that the best of all useless causes looks better than a simpler one
CORRELATED = 0.95  # two parameters with a correlation beyond this are hardly told apart
LEAST_VARIANCE = 0.01  # ft^2 along any direction: positions are printed to 0.1 ft


@dataclass(frozen=True)
class Cause:
    """One thing that may be wrong, and the parameters it has."""

    name: str
    parameters: tuple[str, ...]  # with unit
    array: int | None = None  # the array it belongs to; None: the vehicle's clock or the water


@dataclass(frozen=True, eq=False)
class CauseFit:
    """How well one cause, or a pair of them, explains the gaps of all sets together."""

    causes: tuple[Cause, ...]
    parameters: tuple[str, ...]
    estimate: np.ndarray  # (K,)
    covariance: np.ndarray  # (K, K)
    chi_square: float
    count: float  # independent numbers that the gaps hold
    aicc: float  # above that of the best
    held_out: float | None  # chi-square per number of sets that the fit had not seen; None: not tried
    alike: tuple[str, ...] = ()  # causes that explain these gaps exactly as well

    @property
    def name(self) -> str:
        """The causes in words."""
        return " and ".join(cause.name for cause in self.causes)

    @property
    def sigma(self) -> np.ndarray:
        """Standard errors (K,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation (K, K) of the parameters: near 1 in size, the geometry cannot separate them."""
        size = np.maximum(self.sigma, 1e-300)
        return self.covariance / np.outer(size, size)

    @property
    def hardly_separated(self) -> tuple[tuple[str, str], ...]:
        """Pairs of parameters that the geometry hardly tells apart."""
        near = np.abs(np.triu(self.correlation, 1)) > CORRELATED
        return tuple((self.parameters[i], self.parameters[j]) for i, j in np.argwhere(near))


@dataclass(frozen=True, eq=False)
class Ranking:
    """Causes by how well they explain the gaps, the least AICc first."""

    fits: tuple[CauseFit, ...]
    sets: int
    chi_square_before: float  # of the gaps as they are
    skipped: tuple[str, ...]  # sets that could not take part, and why

    @property
    def best(self) -> CauseFit:
        """The cause that the run supports: the simplest that none beats by more than luck, often but not always first.

        Of many useless causes the best gains a good deal by luck. So no cause at all, then single causes and then
        pairs by their parameters give way only to one whose gain would come to any useless cause with a chance of at
        most LUCK, shared out evenly among the kinds.
        """
        return _supported(self.fits)

    def leading(self, count: int) -> tuple[CauseFit, ...]:
        """The first so many causes, and the best after them where it is none of these."""
        first = self.fits[:count]
        return first if any(fit is self.best for fit in first) else (*first, self.best)


def _supported(fits: Sequence[CauseFit]) -> CauseFit:
    kinds: dict[tuple[int, int], list[CauseFit]] = {}
    for fit in fits:
        kinds.setdefault((len(fit.causes), len(fit.parameters)), []).append(fit)
    held = None
    for _, rivals in sorted(kinds.items()):
        best = rivals[0]
        if held is None:
            held = best
            continue
        gained = best.count * np.log(held.chi_square / best.chi_square)
        more = len(best.parameters) - len(held.parameters)
        # With no more parameters: of two laws, data favour the false one k-fold with a chance of 1/k at most.
        chance = chi2.sf(gained, more) if more > 0 else np.exp(-gained / 2)
        if len(rivals) * (len(kinds) - 1) * chance < LUCK:
            held = best
    return held


NONE = Cause("no cause beyond noise", ())
COMMON = (
    Cause("timing offset", ("offset (s)",)),
    Cause("timing drift", ("drift (s/count)",)),
    Cause("scale of sound speed", ("scale",)),
    Cause("gradient of sound speed", ("gradient (1/s)",)),
    Cause("sound speed changing in time", ("scale per count",)),
    Cause("sound speed changing along the range", ("scale per length",)),
)
OF_ARRAYS = (
    ("displacement", ("downrange", "crossrange", "up")),
    ("rotation", ("about downrange (rad)", "about crossrange (rad)", "about vertical (rad)")),
    ("elevation bias", ("elevation (rad)",)),
    ("azimuth bias", ("azimuth (rad)",)),
)


@dataclass(frozen=True, eq=False)
class _Normal:
    """Normal equations of one set, whitened: numbers of columns, matrix, right side, square, count."""

    columns: np.ndarray
    matrix: np.ndarray
    right: np.ndarray
    square: float
    count: float


def compare_causes(
    sets: Sequence[CrossoverSet],
    survey: ArraySurvey,
    profile: SoundSpeedProfile,
    pairs: bool = True,
    progress: Callable[[float, str], None] = lambda share, text: None,
) -> Ranking:
    """Every cause, and with `pairs` every two of them, on all sets of a run together.

    The sets share one clock and one water; a cause of an array acts in each set that the array has part in.
    progress is told the share done, and in words what is looked at.
    AICc counts gaps by how many of them are independent. Sets of fewer than MIN_POINTS points, and sets that no
    ray reaches, are skipped and named. Raises ValueError where no set is left.
    """
    usable, skipped = [], []
    for one in sets:
        fit = estimate_timing(one, *stretches(one, survey, profile))
        keep = ~fit.excluded
        if keep.sum() < MIN_POINTS or fit.sigma_offset_s is None:
            skipped.append(f"arrays {one.pair[0]} and {one.pair[1]}, pass {one.pass_number}: {fit.reason}")
            continue
        usable.append((one.only(np.flatnonzero(keep)), fit))
    if not usable:
        raise ValueError("no crossover set has enough points to compare causes")
    causes = [*COMMON] + [
        Cause(f"{kind} of array {number}", parameters, number)
        for number in sorted({number for one, _ in usable for number in one.pair})
        for kind, parameters in OF_ARRAYS
    ]
    ends = np.cumsum([len(cause.parameters) for cause in causes])
    columns = {
        cause.name: np.arange(end - len(cause.parameters), end)
        for cause, end in zip(causes, ends, strict=True)
    }
    counts = np.concatenate([one.point_count for one, _ in usable])
    downrange = np.concatenate([one.x[:, 0] for one, _ in usable])
    height = np.concatenate([one.x[:, 2] for one, _ in usable])
    floor = np.mean([survey.position_of(number)[2] for one, _ in usable for number in one.pair])
    centre = (float(np.mean(counts)), float(np.mean(downrange)), float(-(np.median(height) + floor) / 2))
    normals = []
    shares = independent_shares([one for one, _ in usable])
    for k, ((one, fit), share) in enumerate(zip(usable, shares, strict=True)):
        progress(k / len(usable), f"set {k + 1} of {len(usable)}")
        normals.append(_normal(one, fit, share, survey, profile, columns, centre))
    total = _added(normals, int(ends[-1]))
    candidates: list[tuple[Cause, ...]] = [(cause,) for cause in (NONE, *causes)]
    if pairs:
        candidates += list(combinations(causes, 2))
    return _ranked(candidates, columns, total, normals, tuple(skipped))


def _ranked(candidates, columns, total: _Normal, normals, skipped) -> Ranking:
    fits = []
    for candidate in candidates:
        chosen = _columns_of(candidate, columns)
        estimate, inverse = _solved(total, chosen)
        chi_square = float(total.square + total.right[chosen] @ estimate)
        spread = max(chi_square / max(total.count - len(chosen), 1.0), 1.0)
        many = len(chosen) + 1
        aicc = total.count * np.log(chi_square / total.count) + 2 * many
        aicc += 2 * many * (many + 1) / max(total.count - many - 1, 1e-9)
        names = tuple(name for cause in candidate for name in cause.parameters)
        fits.append(
            CauseFit(candidate, names, estimate, spread * inverse, chi_square, total.count, float(aicc), None)
        )
    fits.sort(key=lambda fit: fit.aicc)
    least, best = fits[0].aicc, _supported(fits)
    out = []
    for rank, fit in enumerate(fits):
        held_out = None
        common = len(fit.causes) == 1 and fit.causes[0].array is None
        if len(normals) > 2 and (rank < HELD_OUT or common or fit is best):
            held_out = _held_out(_columns_of(fit.causes, columns), total, normals)
        alike = tuple(
            other.name
            for other in fits[max(rank - 8, 0) : rank + 9]
            if other is not fit
            and len(other.parameters) == len(fit.parameters)
            and abs(other.chi_square - fit.chi_square) <= SAME * fit.chi_square
        )
        out.append(replace(fit, aicc=fit.aicc - least, held_out=held_out, alike=alike))
    return Ranking(tuple(out), len(normals), total.square, skipped)


def _columns_of(causes: Sequence[Cause], columns: dict[str, np.ndarray]) -> np.ndarray:
    return np.concatenate([np.empty(0, int), *(columns[cause.name] for cause in causes if cause.parameters)])


def _solved(total: _Normal, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate (K,) and inverse normal matrix (K, K) of the chosen columns; least change where they are not seen."""
    matrix = total.matrix[np.ix_(chosen, chosen)]
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(
        size, size
    )
    return -inverse @ total.right[chosen], inverse


def _held_out(chosen: np.ndarray, total: _Normal, normals: Sequence[_Normal]) -> float:
    """Chi-square per number of each set by the fit of all others."""
    square = count = 0.0
    for one in normals:
        place = np.searchsorted(one.columns, chosen)
        seen = (place < len(one.columns)) & (one.columns[np.minimum(place, len(one.columns) - 1)] == chosen)
        own = place[seen]
        matrix, right = np.zeros((len(chosen),) * 2), np.zeros(len(chosen))
        matrix[np.ix_(seen, seen)] = one.matrix[np.ix_(own, own)]
        right[seen] = one.right[own]
        rest = replace(
            total,
            matrix=total.matrix[np.ix_(chosen, chosen)] - matrix,
            right=total.right[chosen] - right,
        )
        estimate, _ = _solved(rest, np.arange(len(chosen)))
        square += one.square + 2 * right @ estimate + estimate @ matrix @ estimate
        count += one.count
    return float(square / count)


def _added(normals: Sequence[_Normal], size: int) -> _Normal:
    matrix, right = np.zeros((size, size)), np.zeros(size)
    for one in normals:
        matrix[np.ix_(one.columns, one.columns)] += one.matrix
        right[one.columns] += one.right
    return _Normal(
        np.arange(size), matrix, right, sum(one.square for one in normals), sum(one.count for one in normals)
    )


def independent_shares(sets: Sequence[CrossoverSet]) -> list[np.ndarray]:
    """How much of each gap (T,) of each set is its own: three gaps of three arrays at one count are two, 2/3 each."""
    counts = [one.point_count for one in sets]
    every, where = np.unique(np.concatenate(counts), return_inverse=True)
    seen = np.zeros((len(every), len(sets)), bool)
    seen[where, np.repeat(np.arange(len(sets)), [len(one) for one in counts])] = True
    arrays = np.unique([one.pair for one in sets])
    first, second = np.array([one.pair for one in sets]).T
    joined = np.equal.outer(first, arrays).astype(float) - np.equal.outer(second, arrays)
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    share = np.array([np.linalg.matrix_rank(joined[pattern]) / pattern.sum() for pattern in patterns])
    return np.split(share[which.ravel()][where], np.cumsum([len(one) for one in counts])[:-1])


def _normal(one: CrossoverSet, fit, share, survey, profile, columns, centre) -> _Normal:
    """One set's normal equations, whitened by its own noise about smooth courses after its own timing correction.

    share : (T,) of `independent_shares`
    """
    first, second = stretches(one, survey, profile)
    x, y = corrected_tracks(one, first, second, fit.offset_s, fit.drift_s_per_count, fit.t0)
    noise = residual_noise(x, y, one.point_count, degree=fit.degree).gap
    values, vectors = np.linalg.eigh(noise)
    whiten = vectors.T / np.sqrt(np.maximum(values, LEAST_VARIANCE) * fit.correlation_length)[:, None]
    patterns = _patterns(one, first, second, survey, profile, centre)
    chosen = np.concatenate([columns[name] for name in patterns])
    order = np.argsort(chosen)
    stacked = np.concatenate(list(patterns.values()), axis=2)[:, :, order]
    root = np.sqrt(share)[:, None]
    white = np.einsum("ij,tjk->tik", whiten, root[..., None] * stacked).reshape(-1, len(chosen))
    gap = (root * one.gap @ whiten.T).ravel()
    count = 3 * float(share.sum()) / fit.correlation_length
    return _Normal(chosen[order], white.T @ white, white.T @ gap, float(gap @ gap), count)


def _patterns(one: CrossoverSet, first, second, survey, profile, centre) -> dict[str, np.ndarray]:
    """How the gap (T, 3) moves by each parameter of each cause: name -> (T, 3, K)."""
    t, downrange = one.point_count - centre[0], one.x[:, 0] - centre[1]
    c = first.velocity - second.velocity
    # All speeds larger by a share: the same ray, followed farther by that share of its time.
    scale = first.velocity * first.travel_time[:, None] - second.velocity * second.travel_time[:, None]
    positions = [survey.position_of(number) for number in one.pair]
    gradient = _by_gradient(one.x, positions[0], profile, centre[2])
    gradient = gradient - _by_gradient(one.y, positions[1], profile, centre[2])
    water = (scale, gradient, t[:, None] * scale, downrange[:, None] * scale)
    patterns = {
        cause.name: pattern[:, :, None]
        for cause, pattern in zip(COMMON, (c, t[:, None] * c, *water), strict=True)
    }
    for number, track, position, sign in zip(one.pair, (one.x, one.y), positions, (1.0, -1.0), strict=True):
        offset = track - position
        level = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-6)
        ahead = np.column_stack([offset[:, 0] / level, offset[:, 1] / level, np.zeros(len(level))])
        left = np.column_stack([-offset[:, 1], offset[:, 0], np.zeros(len(level))])
        raised = _by_elevation(track, position, profile)
        raised = raised[:, :1] * ahead + raised[:, 1:] * np.array([0.0, 0.0, 1.0])
        moved = (
            np.repeat(np.eye(3)[None], len(level), axis=0),
            _turned(offset),
            raised[:, :, None],
            left[:, :, None],
        )
        for (kind, _), pattern in zip(OF_ARRAYS, moved, strict=True):
            patterns[f"{kind} of array {number}"] = sign * pattern
    return patterns


def _turned(offset: np.ndarray) -> np.ndarray:
    """Movement (T, 3, 3) of points by a small turn about each axis through the array: axis x offset."""
    return np.stack([np.cross(axis, offset) for axis in np.eye(3)], axis=2)


def _seen(horizontal, depth, array_depth, profile) -> np.ndarray:
    """What an array measures of places (T,): elevation of the arriving ray [rad] and travel time [s], (2, T)."""
    rays = fit_rays(profile, horizontal, depth, array_depth)
    return np.array([rays.elevation_array, rays.travel_time])


def _placed(track: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    offset = track - position
    return np.hypot(offset[:, 0], offset[:, 1]), -track[:, 2], -float(position[2])


def _slopes(track, position, profile) -> np.ndarray:
    """How elevation and time change with horizontal range and height: (T, 2, 2)."""
    horizontal, depth, array_depth = _placed(track, position)

    def difference(dr, dz):
        later = _seen(horizontal + dr, depth - dz, array_depth, profile)
        return (later - _seen(np.maximum(horizontal - dr, 0.0), depth + dz, array_depth, profile)) / (
            2 * (dr + dz)
        )

    return np.stack([difference(STEP, 0.0), difference(0.0, STEP)], axis=-1).swapaxes(0, 1)


def _by_elevation(track, position, profile) -> np.ndarray:
    """Movement (T, 2), outward and up, by a radian of elevation at the array, the travel time kept."""
    return np.linalg.solve(_slopes(track, position, profile), np.array([1.0, 0.0])[:, None])[..., 0]


def _by_gradient(track, position, profile, middle: float) -> np.ndarray:
    """Movement (T, 3) by a speed that grows by one length/s more for each length of depth below a middle."""
    horizontal, depth, array_depth = _placed(track, position)
    small = 1e-4
    deepest = max(float(depth.max()), array_depth, float(profile.depth[-1])) + STEP
    wide = profile.extended(0.0, deepest)
    steeper = replace(wide, speed=wide.speed + small * (wide.depth - middle))
    change = _seen(horizontal, depth, array_depth, steeper) - _seen(horizontal, depth, array_depth, wide)
    moved = np.linalg.solve(_slopes(track, position, wide), -change.T[..., None] / small)[..., 0]
    offset = track - position
    ahead = offset[:, :2] / np.maximum(horizontal, 1e-6)[:, None]
    return np.column_stack([moved[:, :1] * ahead, moved[:, 1]])
