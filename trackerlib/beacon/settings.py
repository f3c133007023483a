"""What an analyst may turn in a beacon fix."""

from __future__ import annotations

from dataclasses import dataclass

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon.motion import MOTIONS

# Antenna lever arm, age of the position and the receiver's own wander, where nobody says better.
ASSUMED_SHIP_RMS_M = 5.0
ASSUMED_SHIP_TIME_S = 60.0
# Every reception; the thesis's experiments; every reception by the usual weighted least squares, which noisy ship
# positions bias.
METHODS = ("all-pings", "pairs", "least-squares")


@dataclass(frozen=True, eq=False)
class FixSettings:
    """Settings of a fix; every default is a number a hunt can start with.

    Raises ValueError, naming the setting, for a number that makes no sense.
    """

    sound_speed_mps: float = 1500.0
    profile: SoundSpeedProfile | None = None  # metres; replaces sound_speed_mps when given
    sound_speed_sigma_mps: float | None = None  # None: 2 m/s, or 0.5 m/s with a profile
    # Ship position error, each of east and north, independent from ping to ping. None: not known, so
    # all pings weigh alike and slow errors (ASSUMED_SHIP_*) are allowed for in the stated sigma.
    gps_rms_m: float | None = None
    sample_interval_ms: float | None = None  # step of the logged one-way times; None: the file's own
    emission_known: bool = False  # times are true travel times, no unknown constant
    start: tuple[float, float, float] | None = None  # a further start: latitude, longitude, depth_m
    max_range_m: float = 20_000.0  # search region: horizontally from the ship's mean position
    max_depth_m: float = 11_000.0  # search region: below the sea surface
    max_speed_mps: float = 5.0  # search region: of a beacon that moves
    motion: str = "still"  # one of MOTIONS
    interval_s: float | None = None  # of the pinger: times are known only up to whole intervals of it
    method: str = "all-pings"  # one of METHODS
    experiments: int | None = None  # pairs: how many; None: as many as there are
    spacing: int | None = (
        None  # pairs: receptions from the first of a pair to the second; None: the thesis's least
    )
    step: int | None = None  # pairs: receptions from one pair to the next; None: spacing, pairs are chained
    hydrophone_depth_m: float = 0.0  # where the file does not say
    reject: str = "auto"  # "auto" leaves out false returns, "none" keeps every ping
    left_out: frozenset[int] = frozenset()  # ping numbers the analyst leaves out by hand

    def __post_init__(self):
        limits = {
            "sound_speed_mps": (1300, 1700),
            "sound_speed_sigma_mps": (0, 100),
            "gps_rms_m": (0, 10_000),
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
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"{name} is {value:g}; wanted {low:g} to {high:g}")
        if self.reject not in ("auto", "none"):
            raise ValueError(f"reject is {self.reject!r}; wanted 'auto' or 'none'")
        for name, values in (("motion", MOTIONS), ("method", METHODS)):
            if getattr(self, name) not in values:
                raise ValueError(f"{name} is {getattr(self, name)!r}; wanted one of {', '.join(values)}")
        if self.interval_s is not None and self.emission_known:
            raise ValueError("times folded at an interval are not true travel times; tell one or the other")
        if self.method == "pairs" and (self.emission_known or self.motion in ("vertical", "horizontal")):
            raise ValueError(
                "pairs of receptions are for an unknown emission time and a motion still or free"
            )

    @property
    def speed_sigma_mps(self) -> float:
        """Standard error of the mean speed of sound [m/s] that goes into every stated sigma."""
        if self.sound_speed_sigma_mps is not None:
            return self.sound_speed_sigma_mps
        return 2.0 if self.profile is None else 0.5
