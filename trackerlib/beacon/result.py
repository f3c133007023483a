"""What a beacon fix comes to: a place with its uncertainty, or the reason why there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.beacon.above_below import side_words
from trackerlib.beacon.clock import Emission, emission_instants
from trackerlib.beacon.convergence import Step
from trackerlib.beacon.folds import unfold
from trackerlib.beacon.observability import Unobservable
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.settings import FixSettings
from trackerlib.beacon.uncertainty import Ellipse, Uncertainty, ellipse95
from trackerlib.frames import LocalFrame
from trackerlib.rounding import rounded, value_with_sigma

AS_LIKELY = 9.0  # chi-square by which another solution may fit worse and still count (3 sigma)


@dataclass(frozen=True, eq=False)
class Solution:
    """One place that fits the pings."""

    lat_deg: float
    lon_deg: float
    depth_m: float
    east_m: float
    north_m: float
    misfit: float  # robust chi-square above the best solution's


def chi_square_words(misfit: float) -> str:
    """How likely a solution is beside the best, of `Solution.misfit`."""
    return f"chi-square {misfit:.1f} above the best" if misfit >= 0.05 else "none more likely"


@dataclass(frozen=True, eq=False)
class Present:
    """A beacon's place at the last ping."""

    elapsed_s: float  # since the first ping
    position: np.ndarray  # (3,) east, north, up [m] in the frame of the fix
    lat_deg: float
    lon_deg: float
    depth_m: float
    covariance: np.ndarray | None  # (3, 3) [m^2]

    @property
    def sigma(self) -> np.ndarray | None:
        """Standard errors (3,) [m] east, north, depth."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance))

    @property
    def ellipse(self) -> Ellipse | None:
        """95 % ellipse on the map."""
        return None if self.covariance is None else ellipse95(self.covariance)


@dataclass(frozen=True, eq=False)
class BeaconFix:
    """Where the beacon is, how sure that is, or why it cannot be said.

    Not converged means that `reason` says what is wrong and what would help; a position that comes
    with it is the best guess so far and is drawn hollow.
    """

    converged: bool
    reason: str | None
    frame: LocalFrame  # origin: the ship's place at the first ping that has one
    ship: np.ndarray  # (N, 3) hydrophone east, north, up [m]
    number: np.ndarray  # (N,) ping numbers
    used: np.ndarray  # (N,) which pings the fix rests on
    offered: np.ndarray | None = None  # (N,) which pings the method would use; None: all
    position: np.ndarray | None = None  # (3,) east, north, up [m]; of a moving beacon that at elapsed_s 0
    lat_deg: float | None = None
    lon_deg: float | None = None
    depth_m: float | None = None  # below the sea surface
    velocity: np.ndarray | None = None  # (3,) east, north, up [m/s]; None for a beacon that lies still
    # (N,) since the first ping (its emission, where receptions are logged)
    elapsed_s: np.ndarray | None = None
    residual_s: np.ndarray | None = None  # (N,) time minus fit, also of pings left out
    uncertainty: Uncertainty | None = None
    emission_offset_s: float | None = None  # the constant in every time that is not travel
    emission: Emission | None = None  # the same, and what was estimated of the pinger's interval
    time_s: np.ndarray | None = None  # (N,) times as the fix took them, whole intervals put right
    sound_speed_mps: float | None = None  # mean speed on the way down
    # as told, or what is left of it where the speed was fitted too
    sigma_sound_speed_mps: float | None = None
    unobservable: tuple[Unobservable, ...] = ()
    alternatives: tuple[Solution, ...] = ()
    along_track_m: float | None = None  # from the first ping, along a straight track
    sigma_along_track_m: float | None = None
    closest_slant_range_m: float | None = None  # from a straight track
    sigma_closest_slant_range_m: float | None = None
    method: str = "all-pings"  # one of METHODS
    log: tuple[Step, ...] = ()  # how the minimisation went
    simulated: bool = False

    @property
    def ellipse(self) -> Ellipse | None:
        """95 % ellipse on the map."""
        return None if self.uncertainty is None else ellipse95(self.uncertainty.covariance)

    @property
    def sigma(self) -> np.ndarray | None:
        """Standard errors (3,) [m] east, north, depth."""
        return None if self.uncertainty is None else self.uncertainty.sigma[:3]

    def at(self, elapsed_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] at an instant, and its covariance (3, 3) [m^2] (3-19), (3-21)-(3-29) mended.

        Raises ValueError for a fix without a position or an uncertainty.
        """
        if self.position is None or self.uncertainty is None:
            raise ValueError(f"there is no position to project: {self.reason}")
        if self.velocity is None:
            return self.position, self.uncertainty.covariance
        step = np.hstack([np.eye(3), elapsed_s * np.eye(3)])
        return self.position + elapsed_s * self.velocity, step @ self.uncertainty.covariance @ step.T

    @property
    def present(self) -> Present:
        """Where the beacon is at the last ping; a beacon that lies still is where it was."""
        instant = 0.0 if self.velocity is None or self.elapsed_s is None else float(np.max(self.elapsed_s))
        if self.position is None:
            raise ValueError(f"there is no position to project: {self.reason}")
        moved = np.zeros(3) if self.velocity is None else instant * self.velocity
        covariance = None if self.uncertainty is None else self.at(instant)[1]
        lat, lon, up = self.frame.to_geodetic(self.position + moved)
        return Present(instant, self.position + moved, float(lat), float(lon), -float(up), covariance)

    @property
    def steadiest_s(self) -> float:
        """The instant since the first ping at which a moving beacon's position is known best."""
        if self.uncertainty is None or self.velocity is None:
            return 0.0
        covariance = self.uncertainty.covariance
        return float(-np.trace(covariance[:3, 3:]) / max(np.trace(covariance[3:, 3:]), 1e-300))

    @property
    def notes(self) -> tuple[str, ...]:
        """What else must be told beside the place, unless `reason` tells it."""
        words = side_words(self)
        return () if words is None or words in (self.reason or "") else (words,)

    @property
    def rejected(self) -> np.ndarray:
        """Numbers of the pings that were left out; a ping that no experiment holds is not."""
        left_out = ~self.used if self.offered is None else self.offered & ~self.used
        return self.number[left_out]

    def __str__(self) -> str:
        label = "SIMULATED: " if self.simulated else ""
        if self.position is None:
            return f"{label}no fix: {self.reason}"
        head = label if self.converged else f"{label}not converged: {self.reason}\n"
        if self.uncertainty is None:
            return f"{head}best guess {self.lat_deg:.6f}, {self.lon_deg:.6f}, depth {self.depth_m:.0f} m"
        east, north, depth = self.sigma
        shape = self.ellipse
        return (
            f"{head}{self.lat_deg:.6f}, {self.lon_deg:.6f} "
            f"(± {rounded(east)} m east, ± {rounded(north)} m north; 95 % ellipse {rounded(shape.semi_major_m)} by "
            f"{rounded(shape.semi_minor_m)} m, long axis {shape.bearing_deg:.0f}°)\n"
            f"depth {value_with_sigma(self.depth_m, depth, 'm')}, {int(self.used.sum())} of {len(self.used)} pings, "
            f"rms {1e3 * self.uncertainty.rms_s:.2g} ms"
        )


def frame_of(pings: Pings) -> LocalFrame:
    """The frame of a survey: its origin is the first ping that has a place, or 0, 0 where none has."""
    placed = np.flatnonzero(np.isfinite(pings.lat_deg) & np.isfinite(pings.lon_deg))[:1]
    return LocalFrame(*(float(np.sum(column[placed])) for column in (pings.lat_deg, pings.lon_deg)))


def blank_fix(pings: Pings, settings: FixSettings) -> tuple[BeaconFix, np.ndarray]:
    """A fix of which only the survey is known, and which pings may be used (N,)."""
    frame = frame_of(pings)
    ship = frame.to_local(pings.lat_deg, pings.lon_deg, pings.up_m)
    allowed = np.isfinite(pings.travel_time_s) & np.isfinite(ship).all(axis=1)
    allowed &= ~np.isin(pings.number, list(settings.left_out))
    time = pings.travel_time_s[allowed]
    if settings.interval_s is not None:
        time = unfold(time, settings.interval_s, ship[allowed], settings.sound_speed_mps)
    blank = BeaconFix(
        False,
        None,
        frame,
        ship,
        pings.number,
        allowed.copy(),
        method=settings.method,
        simulated=pings.simulated,
    )
    return timed(blank, time, pings, allowed, settings), allowed


def timed(
    blank: BeaconFix, time_s: np.ndarray, pings: Pings, allowed: np.ndarray, settings: FixSettings
) -> BeaconFix:
    """A fix with its times in order again, and the instants that follow from them.

    time_s : (n,) of the pings allowed (N,)
    """
    every = np.full(len(allowed), np.nan)
    every[allowed] = time_s
    return replace(blank, time_s=every, elapsed_s=emission_instants(pings, time_s, allowed, settings))


def time_sigma(pings: Pings, settings: FixSettings) -> float:
    """Standard error [s] that the step of the logged times makes."""
    step_s = pings.time_step_s if settings.sample_interval_ms is None else settings.sample_interval_ms * 1e-3
    return max(step_s / np.sqrt(12), 1e-6)
