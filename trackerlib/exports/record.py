"""What every export of a beacon fix says: the fix, the pings it came from, and both in words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from trackerlib import __version__
from trackerlib.beacon.intervals import Interval
from trackerlib.beacon.navigation import PositionLimits, ShipPositions
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import FixSettings
from trackerlib.positions import decimal_degrees, degrees_minutes
from trackerlib.rounding import rounded, value_with_sigma

SIMULATED = "SIMULATED: made by a program, not measured at sea"
LARGEST_ELLIPSE_M = 50_000.0  # a larger one is stated in numbers and not drawn


@dataclass(frozen=True, eq=False)
class Place:
    """A named place under water; a name says so where the place is not a fix."""

    name: str
    lat_deg: float
    lon_deg: float
    depth_m: float  # below the sea surface
    description: str


@dataclass(frozen=True, eq=False)
class Placing:
    """How arrivals came to have places: what was asked of the ship's positions, and what that refused."""

    ship: ShipPositions
    limits: PositionLimits
    antenna_offset_m: tuple[float, float, float]  # antenna to hydrophone: forward, starboard, down


@dataclass(frozen=True, eq=False)
class FixRecord:
    """A fix with the pings and settings that it was made from, where these are known.

    Raises ValueError where the pings are not those of the fix.
    """

    fix: BeaconFix
    pings: Pings | None = None  # without them no times are known
    settings: FixSettings | None = None
    reasons: dict[int, str] = field(default_factory=dict)  # why pings were left out by hand
    intervals: dict[str, Interval] = field(default_factory=dict)  # 95 %, where they were asked for
    placing: Placing | None = None  # where the pings were made of arrivals and positions

    def __post_init__(self):
        if self.pings is not None and not np.array_equal(self.pings.number, self.fix.number):
            raise ValueError("the pings are not those that the fix was made from: their numbers differ")

    @property
    def ship(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Latitude, longitude (N,) [degrees] and depth (N,) [m] of the hydrophone at each ping."""
        lat, lon, up = self.fix.frame.to_geodetic(self.fix.ship.reshape(-1, 3))
        return lat, wrapped(lon), -up

    @property
    def placed(self) -> np.ndarray:
        """Which pings (N,) the ship's place is known at."""
        return np.isfinite(self.fix.ship.reshape(-1, 3)).all(axis=1)

    @property
    def utc(self) -> np.ndarray:
        """Times (N,) datetime64[ms] of the pings, NaT where not known."""
        if self.pings is None:
            return np.full(len(self.fix.number), np.datetime64("NaT", "ms"))
        return self.pings.utc

    @property
    def clock_s(self) -> np.ndarray:
        """Seconds (N,) of the log's own clock, NaN where it tells dates or nothing."""
        clock = None if self.pings is None else self.pings.clock_s
        return np.full(len(self.fix.number), np.nan) if clock is None else clock

    @property
    def travel_time_s(self) -> np.ndarray:
        """Logged one-way times (N,) [s] with their unknown constant, NaN where not known."""
        return np.full(len(self.fix.number), np.nan) if self.pings is None else self.pings.travel_time_s

    @property
    def residual_ms(self) -> np.ndarray:
        """Residuals (N,) [ms], also of pings left out, NaN where there is none."""
        if self.fix.residual_s is None:
            return np.full(len(self.fix.number), np.nan)
        return 1e3 * self.fix.residual_s

    @property
    def left_out_because(self) -> dict[int, str]:
        """Why each ping that was left out was, by its number: what the analyst told, or that it does not fit."""
        by_hand = frozenset() if self.settings is None else self.settings.left_out
        return {
            int(number): self.reasons.get(int(number)) or "left out by hand"
            if number in by_hand or number in self.reasons
            else "does not fit"
            for number in self.fix.rejected
        }

    @property
    def survey_times(self) -> tuple[str, ...]:
        """First and last time of the pings as text; empty if no time is known."""
        known = self.utc[~np.isnat(self.utc)]
        return (utc_text(known.min()), utc_text(known.max())) if len(known) else ()

    @property
    def beacon(self) -> Place | None:
        """The beacon's place, at the last ping if it moves, or None where the fix was refused without one."""
        fix = self.fix
        if fix.position is None:
            return None
        name = self.named("Beacon" if fix.converged else "Beacon, best guess only")
        now = fix.present
        return Place(name, now.lat_deg, _wrapped(now.lon_deg), now.depth_m, "\n".join(self.summary))

    @property
    def alternatives(self) -> tuple[Place, ...]:
        """Other places that fit about as well, mirror solutions among them."""
        return tuple(
            Place(
                self.named(f"Alternative {k}"),
                other.lat_deg,
                _wrapped(other.lon_deg),
                other.depth_m,
                f"Fits about as well as the best: depth {other.depth_m:.1f} m, "
                f"robust chi-square {other.misfit:.1f} above the best",
            )
            for k, other in enumerate(self.fix.alternatives, 1)
        )

    @property
    def title(self) -> str:
        """What the file holds, and from which survey."""
        what = "Beacon fix" if self.fix.converged else "Beacon, no fix"
        source = self.pings.source if self.pings is not None else ""
        return self.named(f"{what} from {source}" if source else what)

    @property
    def provenance(self) -> str:
        """Which program wrote this, when, from what."""
        source = f" from {self.pings.source}" if self.pings is not None and self.pings.source else ""
        return f"Written{source} by trackerlib {__version__}, {datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"

    def named(self, name: str) -> str:
        """The name, behind SIMULATED where the survey was."""
        return f"SIMULATED {name}" if self.fix.simulated else name

    def ellipse_local(self, points: int = 72) -> np.ndarray | None:
        """Outline (points + 1, 2) [m] east, north of the 95 % ellipse, closed and counter-clockwise.

        None where there is no ellipse, or one too large to draw.
        """
        fix = self.fix
        shape = None if fix.position is None else fix.present.ellipse
        if shape is None or not shape.semi_major_m < LARGEST_ELLIPSE_M:
            return None
        angle = -np.linspace(0, 2 * np.pi, points + 1)
        bearing = np.radians(shape.bearing_deg)
        along, across = shape.semi_major_m * np.cos(angle), shape.semi_minor_m * np.sin(angle)
        east = along * np.sin(bearing) + across * np.cos(bearing)
        north = along * np.cos(bearing) - across * np.sin(bearing)
        outline = fix.present.position[:2] + np.column_stack([east, north])
        outline[-1] = outline[0]
        return outline

    def ellipse_ring(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Latitude and longitude [degrees] of `ellipse_local`, or None."""
        outline = self.ellipse_local()
        if outline is None:
            return None
        height = np.full(len(outline), self.fix.present.position[2])
        lat, lon, _ = self.fix.frame.to_geodetic(np.column_stack([outline, height]))
        return lat, wrapped(lon)

    @property
    def summary(self) -> tuple[str, ...]:
        """The fix in lines for a person: position, sigma, ellipse, or the reason why there is none."""
        return tuple(" ".join(line.split()) for line in [*_summary(self), self.provenance])

    @property
    def properties(self) -> dict:
        """The fix under the keys of the command `fix`, for machines; None where not known."""
        return _properties(self.fix)


def wrapped(lon_deg: np.ndarray) -> np.ndarray:
    """Longitudes from -180 up to but not 180 degrees, as GPX wants them, once written to 9 decimals."""
    return (np.round(lon_deg, 9) + 180) % 360 - 180


def _wrapped(lon_deg: float) -> float:
    return float(wrapped(np.array(lon_deg)))


def utc_text(utc: np.datetime64) -> str:
    """A time as ISO 8601 with Z, to the millisecond where it has any; empty where not known."""
    if np.isnat(utc):
        return ""
    return str(np.datetime_as_string(utc, unit="ms")).removesuffix(".000") + "Z"


def _summary(record: FixRecord) -> list[str]:
    fix = record.fix
    lines = [SIMULATED] if fix.simulated else []
    if not fix.converged:
        lines.append(f"No fix: {fix.reason}")
    if fix.position is not None:
        kind = "Position" if fix.converged else "Best guess"
        now = fix.present
        if fix.velocity is not None:
            kind += " at the last ping"
        place = (now.lat_deg, now.lon_deg)
        lines.append(f"{kind} (WGS 84): {decimal_degrees(*place)} = {degrees_minutes(*place)}")
        depth_sigma = None if now.sigma is None else float(now.sigma[2])
        lines.append(f"Depth below the sea surface: {value_with_sigma(now.depth_m, depth_sigma, 'm')}")
        if fix.velocity is not None:
            east, north, up = fix.velocity
            lines.append(f"Velocity: {east:.4f} m/s east, {north:.4f} m/s north, {up:.4f} m/s up")
    if fix.position is not None and now.sigma is not None:
        east, north, depth = map(rounded, now.sigma)
        lines.append(f"Standard error (1 sigma): {east} m east, {north} m north, {depth} m depth")
        lines.append(ellipse_text(fix))
        lines.append(f"Residuals of the pings used, rms: {rounded(1e3 * fix.uncertainty.rms_s)} ms")
    if fix.along_track_m is not None:
        along = value_with_sigma(fix.along_track_m, fix.sigma_along_track_m, "m")
        closest = value_with_sigma(fix.closest_slant_range_m, fix.sigma_closest_slant_range_m, "m")
        lines.append(f"Along the straight track from the first ping: {along}")
        lines.append(f"Closest slant range: {closest}")
    for other in fix.alternatives:
        place = (other.lat_deg, other.lon_deg)
        lines.append(f"Fits about as well: {decimal_degrees(*place)}, depth {other.depth_m:.0f} m")
    lines += [f"95 % interval, {name}: {interval}" for name, interval in record.intervals.items()]
    lines += [f"Note: {note}" for note in fix.notes]
    lines.append(f"Pings used: {int(fix.used.sum())} of {len(fix.number)}")
    return lines


def ellipse_text(fix: BeaconFix) -> str:
    """The ellipse on the map in words, its level and its reference direction named."""
    shape = fix.present.ellipse
    return (
        f"95 % ellipse on the map: half axes {rounded(shape.semi_major_m)} by "
        f"{rounded(shape.semi_minor_m)} m, long axis {shape.bearing_deg:.0f} degrees from true north"
    )


def _properties(fix: BeaconFix) -> dict:
    known = fix.uncertainty is not None and fix.position is not None
    now = fix.present if fix.position is not None else None
    sigma = map(float, now.sigma) if known else (None, None, None)
    shape = now.ellipse if known else None
    return {
        "converged": fix.converged,
        "reason": fix.reason,
        "depth_m": None if now is None else _finite(now.depth_m),
        "elapsed_s": None if now is None else now.elapsed_s,
        "velocity_mps": None if fix.velocity is None else fix.velocity.tolist(),
        **dict(zip(("sigma_east_m", "sigma_north_m", "sigma_depth_m"), map(_finite, sigma), strict=True)),
        "covariance_enu_m2": [[_finite(cell) for cell in row] for row in now.covariance] if known else None,
        "ellipse95": {
            "semi_major_m": _finite(shape.semi_major_m),
            "semi_minor_m": _finite(shape.semi_minor_m),
            "bearing_deg": _finite(shape.bearing_deg),
        }
        if known
        else None,
        "rms_ms": _finite(1e3 * fix.uncertainty.rms_s) if known else None,
        "sound_speed_mps": _finite(fix.sound_speed_mps),
        "emission_offset_s": _finite(fix.emission_offset_s),
        "along_track_m": _finite(fix.along_track_m),
        "sigma_along_track_m": _finite(fix.sigma_along_track_m),
        "closest_slant_range_m": _finite(fix.closest_slant_range_m),
        "sigma_closest_slant_range_m": _finite(fix.sigma_closest_slant_range_m),
        "pings": len(fix.number),
        "used": int(fix.used.sum()),
        "rejected": [int(number) for number in fix.rejected],
        "method": fix.method,
        "simulated": fix.simulated,
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
