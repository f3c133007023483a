"""How residuals in time order hang together: white noise and a slow part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

MANY = 3000  # residuals from which products of all lags are quicker by Fourier transform


@dataclass(frozen=True)
class ResidualCorrelation:
    """Autocorrelation of residuals: share x decay^lag at lags from 1 on."""

    share: float = 0.0  # of the variance that is correlated; the rest is white
    decay: float = 0.0  # from one ping to the next

    @property
    def length(self) -> float:
        """How many successive residuals count as one independent: 1 + 2 x the sum of correlations."""
        return 1 + 2 * self.share * self.decay / (1 - self.decay)

    @property
    def variance_length(self) -> float:
        """The same for an estimate of their variance: 1 + 2 x the sum of squared correlations."""
        return 1 + 2 * (self.share * self.decay) ** 2 / (1 - self.decay**2)


def residual_correlation(residual: np.ndarray) -> ResidualCorrelation:
    """White noise and a slow part, as the autocorrelation of residuals in time order shows them.

    The slow part is given the sum of the autocorrelations: pairs of lags are added while their sum
    stays positive (Geyer's initial positive sequence), up to a quarter of the series. Residuals
    whose first autocorrelation is within what white noise shows 99 times in 100 count as white.
    """
    pings = len(residual)
    e = residual - residual.mean() if pings else residual
    total = e @ e
    if pings < 8 or total == 0:
        return ResidualCorrelation()
    lags = pings // 4 + 1
    if pings < MANY:
        products = np.array([e[: pings - lag] @ e[lag:] for lag in range(lags)])
    else:  # the same by Fourier transform
        length = next_fast_len(pings + lags, real=True)
        products = irfft(np.abs(rfft(e, length)) ** 2, length)[:lags]
    return correlation_from(products / total, pings)


def correlation_from(rho: np.ndarray, pings: int) -> ResidualCorrelation:
    """The same from autocorrelations at lags 0, 1, ... of as many residuals."""
    if pings < 8 or len(rho) < 2:
        return ResidualCorrelation()
    if rho[1] < 2.33 / np.sqrt(pings):
        return ResidualCorrelation()
    if len(rho) % 2:
        rho = rho[:-1]
    pair_sums = rho[0::2] + rho[1::2]  # rho 0 + rho 1, rho 2 + rho 3, ...
    negative = np.flatnonzero(pair_sums <= 0)
    kept = pair_sums[: negative[0]] if len(negative) else pair_sums
    beyond_zero = kept.sum() - 1.0  # at least rho 1
    # share x decay = rho 1 and share x decay / (1 - decay) = beyond_zero
    decay = 1 - rho[1] / max(beyond_zero, rho[1] / 0.99)
    share = min(rho[1] / decay, 1.0)
    decay += (1 + 3 * decay) / pings  # a short series looks whiter than it is (Marriott and Pope 1954)
    return ResidualCorrelation(share=float(share), decay=float(min(decay, 0.999)))
