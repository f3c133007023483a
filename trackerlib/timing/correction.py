"""Timing offset and drift of one vehicle's clock from two arrays' versions of its track.

Read (1990), equations (3) to (19):

    first, second = (stretch(track, survey.position_of(array), profile) for track, array in ...)
    correction = estimate_timing(crossover, first, second)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.noise import residual_noise
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.straight_line import MIN_POINTS, is_curved
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.timing.correlated_noise import spread_of
from trackerlib.timing.stretch import Stretch, stretch

CUT = 5.0  # robust standard deviations beyond which a gap is an outlier
ROUNDS = 12
LEAST_VARIANCE = 1e-6  # of the gap along any direction, squared lengths; positions are printed to 0.1


@dataclass(frozen=True, eq=False)
class TimingCorrection:
    """Offset and drift of one clock, how sure they are, and what they leave of the gap."""

    offset_s: float
    drift_s_per_count: float
    t0: float  # point count at which the offset holds, eq. (9)
    points: int  # used
    excluded: np.ndarray  # (T,) true at outliers and at points that no ray reaches
    residual: np.ndarray  # (T, 3) gap that remains after correction
    mean_before: np.ndarray  # (3,) mean gap downrange, crossrange, vertical
    mean_after: np.ndarray  # (3,)
    rms_before: float  # root mean square length of the gap
    rms_after: float
    curved: bool
    sigma_offset_s: float | None = None  # None with too few points; `reason` says so
    sigma_drift_s_per_count: float | None = None
    correlation: float | None = None
    noise: np.ndarray | None = None  # M (3, 3)
    correlation_length: float = 1.0  # point counts as good as one independent one
    reason: str | None = None

    def offset_at(self, point_count) -> np.ndarray:
        """g(t) [s], eq. (4)."""
        return self.offset_s + self.drift_s_per_count * (np.asarray(point_count, float) - self.t0)

    def __str__(self) -> str:
        plus = "" if self.sigma_offset_s is None else f" ± {1e3 * self.sigma_offset_s:.2g}"
        also = "" if self.sigma_drift_s_per_count is None else f" ± {1e3 * self.sigma_drift_s_per_count:.2g}"
        return (
            f"offset {1e3 * self.offset_s:.3f}{plus} ms at count {self.t0:.2f} (T = {self.points}); "
            f"drift {1e3 * self.drift_s_per_count:.4f}{also} ms/count"
        )


def fit_timing(
    crossover: CrossoverSet, survey: ArraySurvey, profile: SoundSpeedProfile, noise: np.ndarray | None = None
) -> TimingCorrection:
    """Offset and drift of a crossover set, its arrays looked up in the survey.

    noise : M (3, 3), where it is told and not to be estimated
    Raises InputError for an array that the survey lacks.
    """
    return estimate_timing(crossover, *stretches(crossover, survey, profile), noise)


def stretches(
    crossover: CrossoverSet, survey: ArraySurvey, profile: SoundSpeedProfile
) -> tuple[Stretch, Stretch]:
    """Directions of stretch of both versions of a track, from their own arrays."""
    first, second = (survey.position_of(number) for number in crossover.pair)
    return stretch(crossover.x, first, profile), stretch(crossover.y, second, profile)


def estimate_timing(
    crossover: CrossoverSet, first: Stretch, second: Stretch, noise: np.ndarray | None = None
) -> TimingCorrection:
    """Offset and drift that bring two versions of a track together, eqs. (9)-(19).

    Gaps farther than CUT robust standard deviations from the corrected ones are outliers: one list for
    the offset and for M. M is taken about straight lines after the correction, so that a gap which
    changes along the track because of the offset itself does not count as noise.
    """
    c = first.velocity - second.velocity
    usable = first.reached & second.reached
    c = np.where(usable[:, None], c, 0.0)
    count = crossover.point_count.astype(float)
    keep = usable & _without_outliers(crossover.gap, c, count, usable)
    offset, drift, t0 = _solve(c[keep], crossover.gap[keep], count[keep])
    g = offset + drift * (count - t0)
    residual = crossover.gap + g[:, None] * c
    before, after = crossover.gap[keep], residual[keep]
    bare = TimingCorrection(
        offset_s=offset,
        drift_s_per_count=drift,
        t0=t0,
        points=int(keep.sum()),
        excluded=~keep,
        residual=residual,
        mean_before=before.mean(axis=0) if len(before) else np.zeros(3),
        mean_after=after.mean(axis=0) if len(after) else np.zeros(3),
        rms_before=_rms(before),
        rms_after=_rms(after),
        curved=is_curved((crossover.x[keep] + crossover.y[keep]) / 2, crossover.point_count[keep]),
    )
    return _with_sigma(bare, crossover, first, second, c, keep, noise)


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


def _solve(c: np.ndarray, gap: np.ndarray, count: np.ndarray) -> tuple[float, float, float]:
    """Offset, drift and t0, eqs. (9) and (10); zero drift where all point counts are one."""
    weight, closing = np.sum(c * c, axis=1), np.sum(c * gap, axis=1)
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
    for _ in range(ROUNDS):
        middle = np.median(residual[keep], axis=0)
        scale = 1.4826 * np.median(np.abs(residual[keep] - middle), axis=0)
        renewed = usable & np.all(np.abs(residual - middle) <= CUT * np.maximum(scale, 1e-6), axis=1)
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


def _with_sigma(bare, crossover, first, second, c, keep, noise) -> TimingCorrection:
    """The correction with its variances (15)-(19), or with the reason why there are none."""
    if bare.points < MIN_POINTS:
        return replace(
            bare, reason=f"{bare.points} points are too few for a sigma; at least {MIN_POINTS} are needed"
        )
    count = crossover.point_count[keep].astype(float)
    told = noise is not None
    if noise is None:
        x, y = corrected_tracks(crossover, first, second, bare.offset_s, bare.drift_s_per_count, bare.t0)
        noise = residual_noise(x[keep], y[keep], count).gap
    c, t = c[keep], count - bare.t0
    values, vectors = np.linalg.eigh(noise)  # below zero by rounding where a made-up set has no noise
    noise = (vectors * np.maximum(values, LEAST_VARIANCE)) @ vectors.T
    size = np.sqrt(np.einsum("ti,ij,tj->t", c, noise, c))  # of the noise along c
    weight = np.sum(c * c, axis=1)
    if not weight.min() > 0:
        return replace(
            bare, noise=noise, reason="both arrays see the track from one place; no offset moves the gap"
        )
    offset_gain, drift_gain = 1 / weight.sum(), 1 / (t**2 @ weight)  # eq. (15)
    both = np.column_stack([np.ones(len(t)), t])
    # Eqs. (17)-(19) are gain' gain; here the noise of neighbouring counts may hang together.
    spread = spread_of(
        gain=both * np.array([offset_gain, drift_gain]) * size[:, None],
        residual=np.sum(c * bare.residual[keep], axis=1) / size,
        design=both * (weight / size)[:, None],
        others=_beside(bare.residual[keep], c, noise),
        point_count=count,
        scale_known=told,
    )
    return replace(
        bare,
        sigma_offset_s=float(spread.sigma[0]),
        sigma_drift_s_per_count=float(spread.sigma[1]),
        correlation=float(spread.correlation[0, 1]),
        noise=noise,
        correlation_length=spread.length,
    )


def _beside(residual: np.ndarray, c: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """What remains of the gap (T, 2) at right angles to c, by the noise, in whitened units."""
    whiten = np.linalg.inv(np.linalg.cholesky(noise))
    along = whiten @ np.median(c, axis=0)
    along = along / max(np.linalg.norm(along), 1e-300)
    basis = np.linalg.svd(np.eye(3) - np.outer(along, along))[0][:, :2]
    return residual @ whiten.T @ basis
