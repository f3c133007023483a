"""How sure a fix is: its covariance, what widens it, and what the geometry cannot see."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from trackerlib.beacon.minimise import Misfit
from trackerlib.compiled import compiled, warms
from trackerlib.residuals import ResidualCorrelation, residual_correlation

CHI_SQUARE_95_IN_PLANE = stats.chi2.ppf(0.95, 2)


@dataclass(frozen=True)
class Ellipse:
    """Ellipse on the map that holds the truth with 95 % probability."""

    semi_major_m: float
    semi_minor_m: float
    bearing_deg: float  # of the major axis, from true north, 0 to 180


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of a state (east, north, up, and velocity if it moves) and where it comes from."""

    covariance: np.ndarray  # (P, P) [m^2]: noise and sound speed together
    noise_covariance: np.ndarray  # (P, P) [m^2] from times and ship positions
    by_sound_speed: np.ndarray  # (P,) movement of the answer per m/s of mean sound speed
    speed_sigma_mps: float  # standard error of the mean sound speed that the covariance holds
    rms_s: float  # root-mean-square residual of the pings used
    correlation: ResidualCorrelation
    degrees_of_freedom: float
    residual_covariance: np.ndarray | None = None  # (P, P) [m^2] what the residuals alone tell of the noise
    noise_s: float = 1e-3  # error of a time of weight one, the correlation of residuals counted in
    linear_covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))  # of clock and slowness

    @property
    def sigma(self) -> np.ndarray:
        """Standard errors (P,) of the state's components."""
        return np.sqrt(np.diag(self.covariance))

    def turned(self, matrix: np.ndarray) -> Uncertainty:
        """The same for matrix (Q, P) times the state."""
        return replace(
            self,
            covariance=matrix @ self.covariance @ matrix.T,
            residual_covariance=None
            if self.residual_covariance is None
            else matrix @ self.residual_covariance @ matrix.T,
            noise_covariance=matrix @ self.noise_covariance @ matrix.T,
            by_sound_speed=matrix @ self.by_sound_speed,
        )


def uncertainty_of(
    misfit: Misfit,
    keep: np.ndarray,
    *,
    axes: np.ndarray,
    floor_s: float,
    mean_speed_mps: float,
    speed_sigma_mps: float,
    ship_errors: SlowErrors | None = None,
    antenna: AntennaErrors | None = None,
    least: np.ndarray | None = None,
) -> Uncertainty | None:
    """Uncertainty of a least-squares state from its residuals, or None with too few pings for one.

    misfit : of that one state, with weight zero at the pings left out
    axes : (K, P) its free directions
    keep : (N,) which pings were used
    floor_s : the time error that the logging step alone makes
    least : (K + L, K + L) noise covariance of the equations used, if not those of least squares
    ship_errors, antenna : errors of the ship's position at the pings used that residuals do not tell
    The noise part is scaled by the residuals themselves, with their autocorrelation carried through
    the geometry, and by Student's t so that 1.96 sigma holds 95 % with few pings too. A slow error of the ship's
    position is swallowed by a short survey and leaves no residual, so where `ship_errors` would
    move the answer farther than the residuals tell, they count. The speed of sound enters as what its
    standard error would move the answer by, which is less where it was fitted as well.
    """
    pings, state = int(keep.sum()), len(axes)
    weight, root = misfit.weight[0][keep], np.sqrt(misfit.weight[0][keep])
    whitened = misfit.residual[0][keep] * root
    correlation = residual_correlation(whitened)
    unknowns = state + misfit.linear.shape[1]
    freedom = pings / correlation.variance_length - unknowns
    if freedom < 1:
        return None
    variance = max(whitened @ whitened / (pings - unknowns), floor_s**2)
    follow = misfit.follow[0] @ axes.T
    inverse = np.linalg.pinv(misfit.normal_matrix(axes)[0], rcond=1e-15, hermitian=True)
    gain = (misfit.gradient[0][keep] @ axes.T * weight[:, None]) @ inverse
    linear_gain = (misfit.columns[0][keep] * weight[:, None]) @ misfit.inverse[0] - gain @ follow.T
    gain = np.hstack([gain, linear_gain])  # how each ping's time moves the state and the linear unknowns
    spread = gain / np.maximum(root, 1e-30)[:, None]
    noise = variance * (1 - correlation.share) * spread.T @ spread
    if correlation.share:
        decay = np.full(pings - 1, correlation.decay)
        noise = noise + variance * correlation.share * _correlated_sum(
            np.ascontiguousarray(spread[:, None, :]), decay
        )
    if least is not None:
        noise = wider(noise, correlation.length * least)
    noise = noise * (stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)) ** 2
    told = noise  # by the residuals
    slope = misfit.time_gradient[0][keep][:, :3]
    if ship_errors is not None:
        noise = wider(noise, ship_errors.moved_by(slope[:, :2, None] * gain[:, None, :]))
    if antenna is not None:
        noise = noise + antenna.moved_by(slope, gain)
    by_speed = _by_speed(misfit, keep, gain, inverse, follow) / mean_speed_mps
    covariance = noise + speed_sigma_mps**2 * np.outer(by_speed, by_speed)
    rms = float(np.sqrt(np.mean(misfit.residual[0][keep] ** 2)))
    place, others = axes.T @ np.eye(state, unknowns), np.eye(unknowns)[state:]
    return Uncertainty(
        place @ covariance @ place.T,
        place @ noise @ place.T,
        place @ by_speed,
        speed_sigma_mps,
        rms,
        correlation,
        float(freedom),
        place @ told @ place.T,
        float(np.sqrt(variance * correlation.length)),
        others @ covariance @ others.T,
    )


def _by_speed(misfit: Misfit, keep, gain, inverse, follow) -> np.ndarray:
    """How far the unknowns move if the speed told were greater by all of itself, to first order.

    Times scale as 1/speed, and the answer moves to undo what the linear unknowns cannot. Where the speed is fitted
    from a prior, only the prior moves.
    """
    pull = misfit.prior[-1] if len(misfit.prior) else 0.0
    if not pull:
        return gain.T @ misfit.travel_time[0][keep]
    towards = inverse @ follow[-1]
    return pull * np.concatenate([towards, -misfit.inverse[0][:, -1] - follow @ towards])


def wider(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The covariance that is as wide as the wider of two in every direction (second may be singular)."""
    size = np.sqrt(np.maximum(np.diag(first), 1e-300))
    first = first / np.outer(size, size)
    root = np.linalg.cholesky(first + 1e-12 * np.eye(len(first)))
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ (second / np.outer(size, size)) @ inverse.T)
    basis = size[:, None] * (root @ vectors)
    return (basis * np.maximum(values, 1.0)) @ basis.T


@dataclass(frozen=True, eq=False)
class SlowErrors:
    """An error of the ship's position that changes slowly, independent in east and north."""

    rms_m: float | np.ndarray  # of each, or (2,)
    time_s: float  # in which its correlation falls by e
    elapsed_s: np.ndarray  # (n,) instants of the pings used

    def moved_by(self, response: np.ndarray) -> np.ndarray:
        """Covariance (K, K) of an answer that moves by response (n, 2, K) per metre of ship east, north."""
        apart = np.abs(np.diff(self.elapsed_s))
        response = response * np.broadcast_to(self.rms_m, 2)[:, None]
        return _correlated_sum(np.ascontiguousarray(response), np.exp(-apart / self.time_s))


@dataclass(frozen=True, eq=False)
class AntennaErrors:
    """An error of the offset from antenna to hydrophone, the same in the ship's frame all survey long."""

    level_m: float  # standard error of each of forward and starboard
    vertical_m: float
    heading_rad: np.ndarray | None  # (n,) at the pings used; None or any NaN: not known

    def moved_by(self, slope: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Covariance (K, K) of an answer that moves by gain (n, K) per second, times by slope (n, 3) per metre of ship.

        Where headings are not known, no headings can make it wider in any direction: (sum of a_i)^2 is at most
        the sum of s_i times the sum of a_i^2 / s_i, whatever sizes s_i are taken.
        """
        upward = gain.T @ slope[:, 2]
        vertical = self.vertical_m**2 * np.outer(upward, upward)
        heading = self.heading_rad
        if heading is not None and np.isfinite(heading).all():
            sine, cosine = np.sin(heading), np.cos(heading)
            forward = gain.T @ (slope[:, 0] * sine + slope[:, 1] * cosine)
            starboard = gain.T @ (slope[:, 0] * cosine - slope[:, 1] * sine)
            return vertical + self.level_m**2 * (np.outer(forward, forward) + np.outer(starboard, starboard))
        moved = gain * np.hypot(slope[:, 0], slope[:, 1])[:, None]
        whole = np.maximum(np.abs(moved).sum(axis=0), 1e-300)
        size = np.maximum(np.linalg.norm(moved / whole, axis=1), 1e-300)
        return vertical + self.level_m**2 * size.sum() * (moved.T / size) @ moved


@compiled
def _correlated_sum(response, kept):
    """Sum over pairs of pings of response_i response_j' (K, K) times the product of `kept` between them.

    response : (n, axes, K), each axis on its own; kept : (n - 1,) correlation from one to the next
    """
    unknowns = response.shape[2]
    total = np.zeros((unknowns, unknowns))
    for axis in range(response.shape[1]):
        before = np.zeros(unknowns)  # what all earlier pings add, as correlated with this one
        for i in range(len(response)):
            if i:
                before = (before + response[i - 1, axis]) * kept[i - 1]
            for j in range(unknowns):
                for k in range(unknowns):
                    own = response[i, axis]
                    total[j, k] += own[j] * own[k] + own[j] * before[k] + before[j] * own[k]
    return total


@warms
def _warm() -> None:
    _correlated_sum(np.ones((2, 2, 3)), np.ones(1))


def ellipse95(covariance: np.ndarray) -> Ellipse:
    """95 % ellipse on the map of a covariance (3, 3) or (2, 2), east and north first [m^2]."""
    values, vectors = np.linalg.eigh(covariance[:2, :2])
    minor, major = np.sqrt(CHI_SQUARE_95_IN_PLANE * np.maximum(values, 0))
    bearing = float(np.degrees(np.arctan2(vectors[0, 1], vectors[1, 1])) % 180)
    return Ellipse(float(major), float(minor), bearing)
