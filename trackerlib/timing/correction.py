"""Timing offset and drift of one vehicle's clock from two arrays' versions of its track.

Read (1990), equations (3) to (19):

    first, second = (stretch(track, survey.position_of(array), profile) for track, array in ...)
    correction = estimate_timing(crossover, first, second)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.noise import residual_noise
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.smooth_track import choose_degree
from trackerlib.crossover.straight_line import MIN_POINTS
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.timing.correlated_noise import spread_of
from trackerlib.timing.stretch import Stretch, stretch

CUT = 5.0  # robust standard deviations beyond which a gap of many is an outlier
FEW = 9.0  # points: the cut is (1 + (FEW / points)^2) times as wide, for few points say little of their own spread
ROUNDS = 12
METHODS = ("report", "joint")  # every direction alike, or by what M says of each
OUTLIERS = ("out", "noise", "in")  # left out of offset and M, of M alone, of nothing
JOINT_ROUNDS = 20
LEAST_JOINT = 12  # points that say how to weigh the directions
APART = 3.0  # sigmas of a mean gap after correction beyond which the two versions are apart
DIRECTIONS = ("downrange", "crossrange", "vertical")
LEAST_VARIANCE = 1e-6  # of the gap along any direction, squared lengths; positions are printed to 0.1


@dataclass(frozen=True, eq=False)
class TimingCorrection:
    """Offset and drift of one clock, how sure they are, and what they leave of the gap."""

    offset_s: float
    drift_s_per_count: float
    t0: float  # point count at which the offset holds, eq. (9)
    points: int  # used
    excluded: np.ndarray  # (T,) true at outliers, at points left out by hand and at those that no ray reaches
    residual: np.ndarray  # (T, 3) gap that remains after correction
    mean_before: np.ndarray  # (3,) mean gap downrange, crossrange, vertical
    mean_after: np.ndarray  # (3,)
    rms_before: float  # root mean square length of the gap
    rms_after: float
    point_count: np.ndarray  # (T,)
    gain: np.ndarray  # (T, 3) by how much each number of the gap lowers the offset; zero where left out
    q_slope: np.ndarray  # (2,) Ave (1, t - t0) c'residual: zero where the fit is the least of Q
    q_bend: np.ndarray  # (2, 2) Ave (1, t - t0)(1, t - t0)' ||c||^2 [(length/s)^2]
    degree: int = 1  # of the smooth course that the test asks for; 1 is a straight line at constant speed
    in_shadow: int = 0  # of those excluded, points that no direct ray joins to both arrays
    noise_points: int = 0  # that M rests on; the same as `points` unless outliers count for the offset
    separation: np.ndarray | None = None  # (3,) mean gap after correction over its sigma, assumption (14)
    method: str = "report"  # one of METHODS
    settled: bool = True  # whether a joint fit came to rest
    isotropic_sigma_offset_s: float | None = None  # with equal noise on every axis, where there is no M
    isotropic_sigma_drift_s_per_count: float | None = None
    sigma_offset_s: float | None = None  # None with too few points; `reason` says so
    sigma_drift_s_per_count: float | None = None
    correlation: float | None = None
    noise: np.ndarray | None = None  # M (3, 3)
    correlation_length: float = 1.0  # point counts as good as one independent one
    reason: str | None = None

    @property
    def curved(self) -> bool:
        """Whether the track bends."""
        return self.degree > 1

    @property
    def separated(self) -> tuple[str, ...]:
        """Directions in which the two versions stay apart after correction, against assumption (14)."""
        if self.separation is None:
            return ()
        return tuple(name for name, z in zip(DIRECTIONS, self.separation, strict=True) if abs(z) > APART)

    def q_surface(self, offset_s: np.ndarray, drift_s_per_count: np.ndarray) -> np.ndarray:
        """Q (8), (11): mean squared gap (N, M) left by offsets (N,) and drifts (M,) at this t0."""
        d = np.asarray(offset_s)[:, None] - self.offset_s
        m = np.asarray(drift_s_per_count)[None] - self.drift_s_per_count
        bend = self.q_bend[0, 0] * d**2 + 2 * self.q_bend[0, 1] * d * m + self.q_bend[1, 1] * m**2
        return self.rms_after**2 + 2 * (self.q_slope[0] * d + self.q_slope[1] * m) + bend

    def __str__(self) -> str:
        plus = "" if self.sigma_offset_s is None else f" ± {1e3 * self.sigma_offset_s:.2g}"
        also = "" if self.sigma_drift_s_per_count is None else f" ± {1e3 * self.sigma_drift_s_per_count:.2g}"
        return (
            f"offset {1e3 * self.offset_s:.3f}{plus} ms at count {self.t0:.2f} (T = {self.points}); "
            f"drift {1e3 * self.drift_s_per_count:.4f}{also} ms/count"
        )


def fit_timing(
    crossover: CrossoverSet,
    survey: ArraySurvey,
    profile: SoundSpeedProfile,
    noise: np.ndarray | None = None,
    **options,
) -> TimingCorrection:
    """Offset and drift of a crossover set, its arrays looked up in the survey.

    noise, options : as for `estimate_timing`
    Raises InputError for an array that the survey lacks.
    """
    return estimate_timing(crossover, *stretches(crossover, survey, profile), noise, **options)


def stretches(
    crossover: CrossoverSet, survey: ArraySurvey, profile: SoundSpeedProfile
) -> tuple[Stretch, Stretch]:
    """Directions of stretch of both versions of a track, from their own arrays."""
    first, second = (survey.position_of(number) for number in crossover.pair)
    return stretch(crossover.x, first, profile), stretch(crossover.y, second, profile)


def estimate_timing(
    crossover: CrossoverSet,
    first: Stretch,
    second: Stretch,
    noise: np.ndarray | None = None,
    *,
    method: str = "report",
    outliers: str = "out",
    left_out: np.ndarray | None = None,
) -> TimingCorrection:
    """Offset and drift that bring two versions of a track together, eqs. (9)-(19).

    noise : M (3, 3), where it is told and not to be estimated
    method : "report" weighs every direction alike, (10); "joint" weighs them by M, renewed until it settles, and with
        fewer than LEAST_JOINT points, which M cannot be told well enough from, does as the report
    outliers : "out" leaves them out of the offset and of M; "noise" of M alone, as the report did in 17 sets;
        "in" of nothing
    left_out : (T,) true at points that an analyst leaves out, of offset and of M
    Gaps farther than CUT robust standard deviations (of few points: more) from the corrected ones are outliers: one
    list for both. M is taken about smooth courses after the correction, so that a gap which changes along the track
    because of the offset itself does not count as noise.
    Raises ValueError for another method or way with outliers.
    """
    if method not in METHODS or outliers not in OUTLIERS:
        raise ValueError(f"found {method!r}, {outliers!r}; wanted one of {METHODS} and one of {OUTLIERS}")
    c = first.velocity - second.velocity
    reached = first.reached & second.reached
    usable = reached if left_out is None else reached & ~left_out
    c = np.where(usable[:, None], c, 0.0)
    count = crossover.point_count.astype(float)
    quiet = usable if outliers == "in" else usable & _without_outliers(crossover.gap, c, count, usable)
    keep = quiet if outliers == "out" else usable
    shadow = int(np.sum(~reached))
    bare = _corrected(crossover, c, count, keep, quiet, np.eye(3))
    bare = replace(bare, in_shadow=shadow, degree=_degree(bare, crossover, first, second))
    if method == "report" or quiet.sum() < LEAST_JOINT:
        return _with_sigma(bare, crossover, first, second, c, keep, quiet, noise, np.eye(3))
    weight = np.eye(3)
    for _ in range(JOINT_ROUNDS):
        before = bare.offset_s
        found = _with_sigma(bare, crossover, first, second, c, keep, quiet, noise, weight)
        if found.sigma_offset_s is None:
            return replace(found, method=method)
        weight = np.linalg.inv(found.noise)
        weight = weight / np.trace(weight)
        again = _corrected(crossover, c, count, keep, quiet, weight)
        bare = replace(again, in_shadow=shadow, degree=bare.degree)
        if abs(bare.offset_s - before) < 1e-3 * found.sigma_offset_s:
            break
    settled = abs(bare.offset_s - before) < 1e-2 * found.sigma_offset_s
    found = _with_sigma(bare, crossover, first, second, c, keep, quiet, noise, weight)
    wider = 1.0 if noise is not None else _by_estimated_weights(found.noise_points)
    return replace(
        found,
        method=method,
        settled=bool(settled),
        sigma_offset_s=wider * found.sigma_offset_s,
        sigma_drift_s_per_count=wider * found.sigma_drift_s_per_count,
    )


def _by_estimated_weights(points: int) -> float:
    """By how much a sigma grows because the M that weighs three directions is estimated from so many points.

    Weighing by M takes the offset's own direction free of what correlates with the two across it: as a regression on
    two series does, it leaves less to see and errs itself (Rao 1967, for M from a Wishart law).
    """
    freedom = points - 2
    return float(np.sqrt(freedom / (freedom - 2) * (freedom - 1) / (freedom - 3)))


def _degree(bare: TimingCorrection, crossover, first: Stretch, second: Stretch) -> int:
    """Of the smooth course of the corrected track, which the offset itself does not bend."""
    x, y = corrected_tracks(crossover, first, second, bare.offset_s, bare.drift_s_per_count, bare.t0)
    keep = ~bare.excluded
    return choose_degree((x[keep] + y[keep]) / 2, crossover.point_count[keep])


def _corrected(crossover, c, count, keep, quiet, weight) -> TimingCorrection:
    """Offset and drift by directions weighted with `weight` (3, 3), and what they leave of the gap."""
    offset, drift, t0 = _solve(c[keep], crossover.gap[keep], count[keep], weight)
    residual = crossover.gap + (offset + drift * (count - t0))[:, None] * c
    before, after = crossover.gap[keep], residual[keep]
    some = max(len(before), 1)
    pull = np.where(keep[:, None], c @ weight, 0.0)
    time = np.column_stack([np.ones(len(after)), count[keep] - t0])
    return TimingCorrection(
        offset_s=offset,
        drift_s_per_count=drift,
        t0=t0,
        points=int(keep.sum()),
        excluded=~keep,
        residual=residual,
        mean_before=before.sum(axis=0) / some,
        mean_after=after.sum(axis=0) / some,
        rms_before=_rms(before),
        rms_after=_rms(after),
        point_count=crossover.point_count,
        gain=pull / max(np.sum(pull * c), 1e-300),
        q_slope=time.T @ np.sum(c[keep] * after, axis=1) / some,
        q_bend=(time.T * np.sum(c[keep] ** 2, axis=1)) @ time / some,
        noise_points=int(quiet.sum()),
    )


def corrected_tracks(
    crossover: CrossoverSet,
    first: Stretch,
    second: Stretch,
    offset_s: float,
    drift_s_per_count: float,
    t0: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Both versions (T, 3) of the track with the clock corrected, eqs. (3), (4) and (6)."""
    g = (offset_s + drift_s_per_count * (crossover.point_count - t0))[:, None]
    return crossover.x + g * first.velocity, crossover.y + g * second.velocity


def _solve(c: np.ndarray, gap: np.ndarray, count: np.ndarray, weighing=None) -> tuple[float, float, float]:
    """Offset, drift and t0, eqs. (9) and (10); zero drift where all point counts are one.

    weighing : (3, 3) of the directions; None weighs them alike
    """
    pull = c if weighing is None else c @ weighing
    weight, closing = np.sum(pull * c, axis=1), np.sum(pull * gap, axis=1)
    total = weight.sum()
    if total == 0:
        return 0.0, 0.0, float(count.mean()) if len(count) else 0.0
    t0 = float(count @ weight / total)
    t = count - t0
    spread = t**2 @ weight
    return float(-closing.sum() / total), float(-(t @ closing) / spread) if spread > 0 else 0.0, t0


def _without_outliers(gap: np.ndarray, c: np.ndarray, count: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Which points (T,) lie within CUT robust standard deviations, axis by axis, of the corrected gap."""
    keep = usable.copy()
    if keep.sum() < MIN_POINTS:
        return keep
    weight = np.sum(c * c, axis=1)
    single = -np.sum(c * gap, axis=1) / np.where(weight > 0, weight, 1.0)
    start = _weighted_median(single[usable], weight[usable])
    residual = gap + start * c
    cut = CUT * (1 + (FEW / usable.sum()) ** 2)
    for _ in range(ROUNDS):
        middle = np.median(residual[keep], axis=0)
        scale = 1.4826 * np.median(np.abs(residual[keep] - middle), axis=0)
        renewed = usable & np.all(np.abs(residual - middle) <= cut * np.maximum(scale, 1e-6), axis=1)
        if renewed.sum() < MIN_POINTS or np.array_equal(renewed, keep):
            break
        keep = renewed
        offset, drift, t0 = _solve(c[keep], gap[keep], count[keep])
        residual = gap + (offset + drift * (count - t0))[:, None] * c
    return keep


def _weighted_median(values: np.ndarray, weight: np.ndarray) -> float:
    order = np.argsort(values)
    share = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(share, share[-1] / 2)]])


def _rms(gap: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(gap**2, axis=1)))) if len(gap) else 0.0


def _with_sigma(bare, crossover, first, second, c, keep, quiet, noise, weighing) -> TimingCorrection:
    """The correction with its variances (15)-(19), or with the reason why there are none."""
    if not bare.points:
        return replace(bare, reason="no point is left: each is excluded, or no direct ray reaches it")
    count = crossover.point_count[keep].astype(float)
    residual = bare.residual[keep]
    t = count - bare.t0
    pull = c[keep] @ weighing
    weight = np.sum(pull * c[keep], axis=1)
    if not weight.sum() > 0:
        return replace(bare, reason="both arrays see the track from one place; no offset moves the gap")
    # Eqs. (15)-(19): gain' gain, were the noise of neighbouring counts independent.
    gain = np.column_stack([np.ones(len(t)) / weight.sum(), t / max(t**2 @ weight, 1e-300)])
    if quiet.sum() < MIN_POINTS:
        few = f"{'1 point is' if bare.points == 1 else f'{bare.points} points are'} too few for a sigma; "
        few += f"at least {MIN_POINTS} are needed"
        return replace(bare, reason=few, **_isotropic(residual, gain, np.linalg.norm(pull, axis=1)))
    told = noise is not None
    if noise is None:
        x, y = corrected_tracks(crossover, first, second, bare.offset_s, bare.drift_s_per_count, bare.t0)
        noise = residual_noise(x, y, crossover.point_count, quiet, degree=bare.degree).gap
    values, vectors = np.linalg.eigh(noise)  # below zero by rounding where a made-up set has no noise
    noise = (vectors * np.maximum(values, LEAST_VARIANCE)) @ vectors.T
    size = np.sqrt(np.einsum("ti,ij,tj->t", pull, noise, pull))  # of the noise along the pull
    if not size.min() > 0:
        return replace(
            bare, noise=noise, reason="both arrays see the track from one place; no offset moves the gap"
        )
    spread = spread_of(
        gain=gain * size[:, None],
        residual=np.sum(pull * residual, axis=1) / size,
        design=np.column_stack([np.ones(len(t)), t]) * (weight / size)[:, None],
        others=_beside(residual, pull, noise),
        point_count=count,
        scale_known=told,
    )
    # The offset is a mean along the pull: by as much as it is less sure than (17) says, so are these means.
    mean_sigma = np.sqrt(np.diag(noise) / bare.points) * spread.sigma[0] * weight.sum() / np.linalg.norm(size)
    return replace(
        bare,
        sigma_offset_s=float(spread.sigma[0]),
        sigma_drift_s_per_count=float(spread.sigma[1]),
        correlation=float(spread.correlation[0, 1]),
        noise=noise,
        correlation_length=spread.length,
        separation=bare.mean_after / mean_sigma,
    )


def _isotropic(residual: np.ndarray, gain: np.ndarray, size: np.ndarray) -> dict:
    """Sigmas with noise that is the same on every axis, from the 3 T - 2 numbers that two estimates leave."""
    freedom = 3 * len(residual) - 2
    if len(residual) < 2:
        return {}
    variance = float(np.sum(residual**2)) / freedom
    widened = stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)
    offset, drift = widened * np.sqrt(variance * np.sum((gain * size[:, None]) ** 2, axis=0))
    return {"isotropic_sigma_offset_s": float(offset), "isotropic_sigma_drift_s_per_count": float(drift)}


def _beside(residual: np.ndarray, c: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """What remains of the gap (T, 2) at right angles to c, by the noise, in whitened units."""
    whiten = np.linalg.inv(np.linalg.cholesky(noise))
    along = whiten @ np.median(c, axis=0)
    along = along / max(np.linalg.norm(along), 1e-300)
    basis = np.linalg.svd(np.eye(3) - np.outer(along, along))[0][:, :2]
    return residual @ whiten.T @ basis
