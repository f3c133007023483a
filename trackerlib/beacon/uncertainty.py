"""How sure a fix is: its covariance, what widens it, and what the geometry cannot see."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

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

    @property
    def sigma(self) -> np.ndarray:
        """Standard errors (P,) of the state's components."""
        return np.sqrt(np.diag(self.covariance))

    def turned(self, matrix: np.ndarray) -> Uncertainty:
        """The same for matrix (Q, P) times the state."""
        return replace(
            self,
            covariance=matrix @ self.covariance @ matrix.T,
            noise_covariance=matrix @ self.noise_covariance @ matrix.T,
            by_sound_speed=matrix @ self.by_sound_speed,
        )


def uncertainty_of(
    misfit,
    keep,
    *,
    unknowns,
    axes,
    floor_s,
    mean_speed_mps,
    speed_sigma_mps,
    ship_errors: SlowErrors | None = None,
) -> Uncertainty | None:
    """Uncertainty of a least-squares state from its residuals, or None with too few pings for one.

    misfit : Misfit of that one state, with weight zero at the pings left out
    axes : (K, P) its free directions
    keep : (N,) which pings were used
    floor_s : the time error that the logging step alone makes
    ship_errors : errors of the ship's position at the pings used, where they are assumed and not
        left to the residuals
    The noise part is scaled by the residuals themselves, with their autocorrelation carried through
    the geometry, and by Student's t so that 1.96 sigma holds 95 % with few pings too. A slow error of the ship's
    position is swallowed by a short survey and leaves no residual, so where `ship_errors` would
    move the answer farther than the residuals tell, they count. Sound speed is not estimated: its
    standard error enters as what it would move the answer by.
    """
    weight, gradient = misfit.weight[0][keep], misfit.gradient[0][keep] @ axes.T
    root = np.sqrt(weight)
    whitened = misfit.residual[0][keep] * root
    correlation = residual_correlation(whitened)
    freedom = len(whitened) / correlation.variance_length - unknowns
    if freedom < 1:
        return None
    variance = max(whitened @ whitened / (len(whitened) - unknowns), floor_s**2)
    inverse = np.linalg.pinv(gradient.T @ (weight[:, None] * gradient), rcond=1e-15, hermitian=True)
    noise = variance * (1 - correlation.share) * inverse
    if correlation.share:
        response = ((gradient * root[:, None]) @ inverse)[:, None, :]
        decay = np.full(len(response) - 1, correlation.decay)
        noise = noise + variance * correlation.share * _correlated_sum(response, decay)
    noise = noise * (stats.t.ppf(0.975, freedom) / stats.norm.ppf(0.975)) ** 2
    if ship_errors is not None:
        gain = (gradient * weight[:, None]) @ inverse
        slope = misfit.time_gradient[0][keep][:, :2]
        noise = wider(noise, ship_errors.moved_by(slope[:, :, None] * gain[:, None, :]))
    # Times scale as 1/speed; the answer moves to undo what the emission offset cannot.
    by_speed = inverse @ (gradient.T @ (weight * misfit.travel_time[0][keep])) / mean_speed_mps
    noise, by_speed = axes.T @ noise @ axes, by_speed @ axes
    covariance = noise + speed_sigma_mps**2 * np.outer(by_speed, by_speed)
    rms = float(np.sqrt(np.mean(misfit.residual[0][keep] ** 2)))
    return Uncertainty(covariance, noise, by_speed, speed_sigma_mps, rms, correlation, float(freedom))


def wider(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The covariance that is as wide as the wider of two in every direction (second may be singular)."""
    root = np.linalg.cholesky(first + 1e-12 * np.trace(first) * np.eye(len(first)))
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ second @ inverse.T)
    basis = root @ vectors
    return (basis * np.maximum(values, 1.0)) @ basis.T


@dataclass(frozen=True, eq=False)
class SlowErrors:
    """An error of the ship's position that changes slowly, the same for east and north."""

    rms_m: float
    time_s: float  # in which its correlation falls by e
    elapsed_s: np.ndarray  # (n,) instants of the pings used

    def moved_by(self, response: np.ndarray) -> np.ndarray:
        """Covariance (K, K) of an answer that moves by response (n, 2, K) per metre of ship east, north."""
        apart = np.abs(np.diff(self.elapsed_s))
        return self.rms_m**2 * _correlated_sum(np.ascontiguousarray(response), np.exp(-apart / self.time_s))


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
