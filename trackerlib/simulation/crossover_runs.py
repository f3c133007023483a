"""Crossover sets with a known timing offset: one track, seen by two arrays through curved rays.

Everything made here is simulated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.timing.stretch import stretch


@dataclass(frozen=True)
class ClockTruth:
    """A clock's offset and drift: positive makes transit times too short, tracks too near the arrays."""

    offset_s: float
    drift_s_per_count: float = 0.0
    reference_count: float = 0.0

    def at(self, point_count) -> np.ndarray:
        """Offset (T,) [s] at point counts."""
        return self.offset_s + self.drift_s_per_count * (
            np.asarray(point_count, float) - self.reference_count
        )


def simulate_crossover(
    track: np.ndarray,
    point_count: np.ndarray,
    arrays: tuple[np.ndarray, np.ndarray],
    profile: SoundSpeedProfile,
    truth: ClockTruth,
    rng: np.random.Generator,
    noise_ft: float = 1.0,
    wobble_ft: float = 0.0,
    correlation: float = 0.0,
) -> CrossoverSet:
    """What two arrays report of a true track (T, 3) when their clock is off.

    arrays : positions (3,) of the two
    noise_ft : standard deviation of each coordinate of each report
    wobble_ft : the vehicle's own wandering, the same in both reports
    correlation : of a coordinate's noise from one point count to the next; it dies off by this factor a count
    """
    path = track + rng.normal(0, wobble_ft, track.shape)
    offset = truth.at(point_count)[:, None]
    seen = [_reported(path, offset, position, profile) for position in arrays]
    x, y = (
        version + _hanging_together(rng.normal(0, noise_ft, track.shape), point_count, correlation)
        for version in seen
    )
    return CrossoverSet((1, 2), np.asarray(point_count), x, y, source="simulated")


def _reported(path, offset, array_position, profile) -> np.ndarray:
    """Where an array reports a path (T, 3): the place that the correction (3) by the true offset brings back to it."""
    place = path
    for _ in range(3):  # the direction is that at the reported place; contracts by offset x speed / range
        place = path - offset * stretch(place, array_position, profile).velocity
    return place


def _hanging_together(noise: np.ndarray, point_count: np.ndarray, correlation: float) -> np.ndarray:
    """Independent noise (T, 3) made to repeat itself from count to count, its variance unchanged."""
    for k in range(1, len(noise) if correlation else 0):
        kept = correlation ** (point_count[k] - point_count[k - 1])
        noise[k] = kept * noise[k - 1] + np.sqrt(1 - kept**2) * noise[k]
    return noise
