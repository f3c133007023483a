"""What an analyst may turn in a beacon fix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon.motion import MOTIONS

# Antenna lever arm, age of the position and the receiver's own wander, where nobody says better.
ASSUMED_SHIP_RMS_M = 5.0
ASSUMED_SHIP_TIME_S = 60.0
# Every reception; the thesis's experiments; every reception by the usual weighted least squares, which noisy ship
# positions bias.
METHODS = ("all-pings", "pairs", "least-squares")


LIMITS = {
    "sound_speed_mps": (1300, 1700),
    "sound_speed_sigma_mps": (0, 100),
    "gps_correlation_s": (0.001, 1_000_000),
    "sample_interval_ms": (0, 10_000),
    "max_range_m": (1, 1_000_000),
    "max_depth_m": (1, 12_000),
    "hydrophone_depth_m": (0, 12_000),
    "max_speed_mps": (0.001, 100),
    "interval_s": (0.01, 86_400),
    "experiments": (1, 1_000_000),
    "spacing": (1, 1_000_000),
    "step": (1, 1_000_000),
}


@dataclass(frozen=True, eq=False)
class FixSettings:
    """Settings of a fix; every default is a number a hunt can start with.

    Raises ValueError, naming the setting, for a number that makes no sense.
    """

    sound_speed_mps: float = 1500.0
    profile: SoundSpeedProfile | None = None  # metres; replaces sound_speed_mps when given
    sound_speed_sigma_mps: float | None = None  # None: 2 m/s, or 0.5 m/s with a profile
    estimate_sound_speed: bool = False  # with the place; the speed told and its sigma are then the prior
    # Ship position error, each of east and north, or both apart; independent from ping to ping unless a correlation
    # time is told. None: not known, so all pings weigh alike and slow errors (ASSUMED_SHIP_*) are allowed for in the
    # stated sigma.
    gps_rms_m: float | tuple[float, float] | None = None
    gps_correlation_s: float | None = None  # in which the correlation of that error falls by e
    # Standard error of the offset from antenna to hydrophone, the same all survey long: of each of forward and
    # starboard, and of down.
    antenna_sigma_m: tuple[float, float] = (0.0, 0.0)
    sample_interval_ms: float | None = None  # step of the logged one-way times; None: the file's own
    emission_known: bool = False  # times are true travel times, no unknown constant
    start: tuple[float, float, float] | None = None  # a further start: latitude, longitude, depth_m
    max_range_m: float = 20_000.0  # search region: horizontally from the ship's mean position
    max_depth_m: float = 11_000.0  # search region: below the sea surface
    max_speed_mps: float = 5.0  # search region: of a beacon that moves
    motion: str = "still"  # one of MOTIONS
    interval_s: float | None = None  # of the pinger: times are known only up to whole intervals of it
    estimate_interval: bool = False  # with the place; the one told is nearly right
    estimate_interval_drift: bool = False  # and its steady change
    method: str = "all-pings"  # one of METHODS
    experiments: int | None = None  # pairs: how many; None: as many as there are
    # pairs: receptions from the first of a pair to the second; None: the thesis's least
    spacing: int | None = None
    step: int | None = None  # pairs: receptions from one pair to the next; None: spacing, pairs are chained
    hydrophone_depth_m: float = 0.0  # where the file does not say
    reject: str = "auto"  # "auto" leaves out false returns, "none" keeps every ping
    left_out: frozenset[int] = frozenset()  # ping numbers the analyst leaves out by hand

    def __post_init__(self):
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"{name} is {value:g}; wanted {low:g} to {high:g}")
        if self.gps_rms_m is not None:
            each = np.atleast_1d(self.gps_rms_m)
            if each.shape not in ((1,), (2,)) or not ((each >= 0) & (each <= 10_000)).all():
                raise ValueError(
                    f"gps_rms_m is {self.gps_rms_m}; wanted 0 to 10000, or that for east and for north"
                )
        each = np.array(self.antenna_sigma_m)
        if each.shape != (2,) or not ((each >= 0) & (each <= 1000)).all():
            raise ValueError(
                f"antenna_sigma_m is {self.antenna_sigma_m}; wanted two of 0 to 1000, level and vertical"
            )
        if self.reject not in ("auto", "none"):
            raise ValueError(f"reject is {self.reject!r}; wanted 'auto' or 'none'")
        for name, values in (("motion", MOTIONS), ("method", METHODS)):
            if getattr(self, name) not in values:
                raise ValueError(f"{name} is {getattr(self, name)!r}; wanted one of {', '.join(values)}")
        self._refuse_contradictions()
        if self.method == "pairs":
            self._refuse_beyond_pairs()

    def _refuse_contradictions(self) -> None:
        if self.interval_s is not None and self.emission_known:
            raise ValueError("times folded at an interval are not true travel times; tell one or the other")
        if self.estimate_interval and self.interval_s is None:
            raise ValueError("an interval is estimated from the one told; tell interval_s")
        if self.estimate_interval_drift and not self.estimate_interval:
            raise ValueError(
                "the drift of an interval is estimated with the interval; tell estimate_interval"
            )
        if self.gps_correlation_s is not None and self.gps_rms_m is None:
            raise ValueError("gps_correlation_s says how gps_rms_m hangs together in time; tell gps_rms_m")
        if self.estimate_sound_speed and self.speed_sigma_mps == 0:
            raise ValueError(
                "a speed of sound of sigma 0 is known, not estimated; tell sound_speed_sigma_mps"
            )

    def _refuse_beyond_pairs(self) -> None:
        beyond = {
            "estimate_sound_speed": self.estimate_sound_speed,
            "estimate_interval": self.estimate_interval,
            "gps_correlation_s": self.gps_correlation_s is not None,
            "antenna_sigma_m": any(self.antenna_sigma_m),
            "two values of gps_rms_m": np.size(self.gps_rms_m) == 2,
        }
        if any(beyond.values()):
            told = ", ".join(name for name, value in beyond.items() if value)
            raise ValueError(f"the thesis's pairs know no {told}; use all-pings")
        if self.emission_known or self.motion in ("vertical", "horizontal"):
            raise ValueError(
                "pairs of receptions are for an unknown emission time and a motion still or free"
            )

    @property
    def gps_axes_m(self) -> np.ndarray | None:
        """Ship position error (2,) of east and of north [m]; None if it is not told."""
        return None if self.gps_rms_m is None else np.broadcast_to(np.asarray(self.gps_rms_m, float), 2)

    @property
    def ship_rms_m(self) -> float | None:
        """The same as one number, root-mean-square of the axes."""
        return None if self.gps_axes_m is None else float(np.sqrt(np.mean(self.gps_axes_m**2)))

    @property
    def clock_terms(self) -> int:
        """How many unknowns the pinger's clock has: emission time, interval, drift."""
        return 0 if self.emission_known else 1 + self.estimate_interval + self.estimate_interval_drift

    @property
    def linear_unknowns(self) -> int:
        """How many unknowns a fix has beside place and motion."""
        return self.clock_terms + self.estimate_sound_speed

    @property
    def speed_sigma_mps(self) -> float:
        """Standard error of the mean speed of sound [m/s] that goes into every stated sigma."""
        if self.sound_speed_sigma_mps is not None:
            return self.sound_speed_sigma_mps
        return 2.0 if self.profile is None else 0.5
