"""How a least-squares state follows from times, to first order, before any time is measured.

linear = first_order(slope, by_speed, weight)
linear.noise, linear.by_speed
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

UNSEEN_M = 1e6  # standard error of what no ping shows


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """L is K, the components of a state, or K + 1 where the speed of sound is estimated too: it comes last [m/s]."""

    gain: np.ndarray  # (N, L) [m/s] of the state by each time
    noise: np.ndarray  # (L, L) [m^2] covariance that independent errors of times leave
    by_speed: np.ndarray  # (L,) [m] per m/s of the mean speed of sound told


def first_order(
    slope: np.ndarray, by_speed: np.ndarray, weight: np.ndarray, speed_prior: float | None = None
) -> FirstOrder:
    """The state of least squares from N times.

    slope : (N, K) [s/m] of times by state, less what other unknowns would undo
    by_speed : (N,) [s per m/s] what a higher speed of sound takes off the times, less the same
    weight : (N,) [1/s^2] one over the variance of each time
    speed_prior : [s^2/m^2] one over the variance to which the speed told holds the one that is estimated; None: the
        speed told is taken as it is
    """
    seen = np.full(slope.shape[1], 1 / UNSEEN_M**2)
    held = np.zeros(len(seen))
    if speed_prior is not None:
        slope, seen, held = (
            np.column_stack([slope, -by_speed]),
            np.append(seen, 0.0),
            np.append(held, speed_prior),
        )
    weighted = slope * weight[:, None]
    information = weighted.T @ slope + np.diag(seen)
    inverse = np.linalg.inv(information + np.diag(held))
    gain = weighted @ inverse
    moved = gain.T @ by_speed if speed_prior is None else speed_prior * inverse[:, -1]
    return FirstOrder(gain, inverse @ information @ inverse, moved)
