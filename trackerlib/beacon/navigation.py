"""Where the hydrophone was at each reception, from a stream of fixes and a stream of arrivals.

    ship = ship_at_receptions(fixes, arrival_s, PositionLimits(), antenna_offset_m=(-12.0, 3.0, 8.0))
    ship.east_m[ship.accepted], ship.refused

The first step of Wojcik (1993), chapter II, which wants one position and one time of each reception. His
program TRACKER.C refuses a fix with HDOP of 10 or more; so does this, and counts whatever else it refuses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.beacon.pings import Pings
from trackerlib.frames import LocalFrame

LEAST_SPEED_MPS = 0.3  # slower than this, course over ground says nothing of heading
ROUNDING_S = 1e-6  # what seconds since 1970 lose in a difference
TURNED_BY = (
    "no offset",
    "heading",
    "course over ground",
    "neither heading nor course: offset not applied, its length added to sigma",
)
_ACCEPTED, _NO_TIME, _TOO_FEW, _HDOP, _NOT_YET, _GAP, _OLD = range(7)


@dataclass(frozen=True, eq=False)
class NavigationFixes:
    """Fixes of the antenna, in any order; ValueError if the columns differ in length."""

    time_s: np.ndarray  # (M,) by the clock of the arrivals
    lat_deg: np.ndarray  # (M,) WGS 84, south negative, NaN or 0 with lon_deg 0 where there is no position
    lon_deg: np.ndarray  # (M,) WGS 84, west negative
    hdop: np.ndarray  # (M,) NaN if not known, which is not refused
    heading_rad: np.ndarray | None = None  # (M,) of the bow, clockwise from true north, NaN if not known

    def __post_init__(self):
        columns = ("time_s", "lat_deg", "lon_deg", "hdop", "heading_rad")
        lengths = {name: len(getattr(self, name)) for name in columns if getattr(self, name) is not None}
        if len(set(lengths.values())) != 1:
            raise ValueError(f"columns of fixes differ in length: {lengths}")


@dataclass(frozen=True)
class PositionLimits:
    """When a position is good enough for a reception; ValueError names a limit that makes no sense."""

    greatest_hdop: float = 10.0  # a fix of this or more is refused
    greatest_age_s: float = 2.0  # from the reception to the fix before it, and to the fix after it
    greatest_gap_s: float | None = None  # between two good fixes in a row; None: 2 x greatest_age_s

    def __post_init__(self):
        for name, high in (("greatest_hdop", 1000), ("greatest_age_s", 3600), ("greatest_gap_s", 7200)):
            value = getattr(self, name)
            if value is not None and not 0 < value <= high:
                raise ValueError(f"{name} is {value:g}; wanted more than 0, at most {high}")

    @property
    def gap_s(self) -> float:
        """Longest time between two good fixes that is interpolated across [s]."""
        return 2 * self.greatest_age_s if self.greatest_gap_s is None else self.greatest_gap_s


@dataclass(frozen=True, eq=False)
class ShipPositions:
    """The hydrophone at N receptions, in the order of the arrivals; NaN where a reception is refused."""

    time_s: np.ndarray  # (N,)
    lat_deg: np.ndarray  # (N,)
    lon_deg: np.ndarray  # (N,) -180 to 180
    east_m: np.ndarray  # (N,) in `frame`
    north_m: np.ndarray  # (N,)
    sigma_m: np.ndarray  # (N,) what the antenna offset adds to the error of each of east and north
    reason: np.ndarray  # (N,) row of `reasons`, 0 if accepted
    heading_rad: np.ndarray  # (N,) of the bow, or the course for want of it, NaN if neither is known
    turned_by: np.ndarray  # (N,) row of TURNED_BY: what the antenna offset was turned by, 0 if refused
    reasons: tuple[str, ...]
    fixes_refused: tuple[tuple[str, int], ...]  # why, and how many fixes
    frame: LocalFrame | None  # its origin is the first good fix; None if there are not two

    @property
    def accepted(self) -> np.ndarray:
        """Whether each reception has a position (N,)."""
        return self.reason == _ACCEPTED

    @property
    def refused(self) -> tuple[tuple[str, int], ...]:
        """Why receptions were refused, and how many for each reason there was."""
        return _counted(self.reasons, self.reason[~self.accepted])

    @property
    def turned(self) -> tuple[tuple[str, int], ...]:
        """What the antenna offset was turned by, or that it was not applied, and at how many receptions."""
        return _counted(TURNED_BY, self.turned_by[self.accepted])

    @property
    def words(self) -> tuple[str, ...]:
        """Every refusal counted, and what an antenna offset was turned by, a sentence each."""
        told = [f"{count} positions refused: {why}" for why, count in self.fixes_refused]
        told += [f"{count} arrivals refused: {why}" for why, count in self.refused]
        told += [
            f"{count} arrivals: antenna offset turned by {how}"
            for how, count in self.turned
            if how in TURNED_BY[1:]
        ]
        return tuple(told)


def ship_at_receptions(
    fixes: NavigationFixes,
    arrival_s,
    limits: PositionLimits = PositionLimits(),
    antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    offset_sigma_m: float = 0.0,
) -> ShipPositions:
    """Position of the hydrophone at each reception, linear between the good fixes on both sides of it.

    arrival_s : (N,) instants of reception by the clock of the fixes, in any order
    antenna_offset_m : from antenna to hydrophone: forward, starboard, down; down moves no position
    offset_sigma_m : standard error of the offset, each of forward and starboard

    A reception after the last fix is refused unless within `greatest_age_s` of it; then the last two good
    fixes are continued. The offset is turned by the heading, or where there is none by the course between
    the two fixes if faster than LEAST_SPEED_MPS; with neither, its horizontal length is added to `sigma_m`.
    Of several good fixes at one time the one of lowest HDOP is kept. Raises ValueError for an antenna offset
    that is not three finite numbers or a sigma below zero.
    """
    offset = np.asarray(antenna_offset_m, float)
    if offset.shape != (3,) or not np.isfinite(offset).all():
        raise ValueError(f"antenna_offset_m is {antenna_offset_m}; wanted forward, starboard, down in metres")
    if not 0 <= offset_sigma_m < np.inf:
        raise ValueError(f"offset_sigma_m is {offset_sigma_m:g}; wanted 0 or more")
    time = np.asarray(arrival_s, float)
    good, fixes_refused = _good_fixes(fixes, limits.greatest_hdop)
    any_hdop, _ = _good_fixes(fixes, np.inf)
    reason = _reasons(good.time_s, time, limits)
    would_do = _reasons(any_hdop.time_s, time, limits) == _ACCEPTED
    reason[(reason != _ACCEPTED) & would_do] = _HDOP
    accepted = reason == _ACCEPTED

    lat, lon, east, north, sigma, heading = columns = np.full((6, len(time)), np.nan)
    turned_by = np.zeros(len(time), np.int8)
    frame = None
    if len(good.time_s) >= 2:
        frame = LocalFrame(float(good.lat_deg[0]), float(good.lon_deg[0]))
        position, bow, turned_by[accepted] = _interpolate(good, frame, time[accepted], limits)
        length = np.hypot(*offset[:2])
        if length == 0:
            turned_by[:] = 0
        ahead, abeam = (
            np.array([np.sin(bow), np.cos(bow)]),
            np.array([np.cos(bow), -np.sin(bow)]),
        )
        position[:, :2] += np.nan_to_num(offset[0] * ahead + offset[1] * abeam).T
        unturned_m = np.where(np.isnan(bow), length, 0.0)
        lat_lon = frame.to_geodetic(position)[:2]
        columns[:, accepted] = *lat_lon, *position.T[:2], offset_sigma_m + unturned_m, bow
    return ShipPositions(
        time, lat, lon, east, north, sigma, reason, heading, turned_by, _words(limits), fixes_refused, frame
    )


def _good_fixes(fixes: NavigationFixes, greatest_hdop: float) -> tuple[NavigationFixes, tuple]:
    """Fixes with a position and HDOP low enough, in order of time, each time once; and counts of the rest."""
    time, lat, lon, hdop = (
        np.asarray(c, float) for c in (fixes.time_s, fixes.lat_deg, fixes.lon_deg, fixes.hdop)
    )
    heading = (
        np.full(len(time), np.nan) if fixes.heading_rad is None else np.asarray(fixes.heading_rad, float)
    )
    has_position = (np.abs(lat) <= 90) & (np.abs(lon) <= 360) & ~((lat == 0) & (lon == 0))
    why = np.select([~np.isfinite(time), ~has_position, hdop >= greatest_hdop], [1, 2, 3], 0)
    rows = np.flatnonzero(why == 0)
    rows = rows[np.lexsort((hdop[rows], time[rows]))]  # NaN comes last
    repeated = np.diff(time[rows], prepend=-np.inf) == 0
    why[rows[repeated]] = 4
    rows = rows[~repeated]
    words = (
        "",
        "no time",
        "no position",
        f"HDOP of {greatest_hdop:g} or more",
        "another fix at the same time",
    )
    kept = NavigationFixes(time[rows], lat[rows], lon[rows], hdop[rows], heading[rows])
    return kept, _counted(words, why[why > 0])


def _reasons(fix_s: np.ndarray, time: np.ndarray, limits: PositionLimits) -> np.ndarray:
    """Why fixes at sorted times give no position at each instant (N,), _ACCEPTED where they do."""
    if len(fix_s) < 2:
        return np.where(np.isfinite(time), _TOO_FEW, _NO_TIME)
    before = _before(fix_s, time)
    since, until = time - fix_s[before], fix_s[before + 1] - time  # until is negative after the last fix
    gap = fix_s[before + 1] - fix_s[before]
    old = np.where(until < 0, -until, np.maximum(since, until)) > limits.greatest_age_s + ROUNDING_S
    conditions = {
        _NO_TIME: ~np.isfinite(time),
        _NOT_YET: since < 0,
        _ACCEPTED: (since == 0) | (until == 0),  # nothing to interpolate
        _GAP: (gap > limits.gap_s + ROUNDING_S) & ~(old & (until < 0)),
        _OLD: old,
    }
    return np.select(list(conditions.values()), list(conditions), _ACCEPTED)


def _interpolate(good: NavigationFixes, frame: LocalFrame, time: np.ndarray, limits: PositionLimits):
    """East, north, up (N, 3) of the antenna, heading [rad], NaN if not known, and row of TURNED_BY (N,)."""
    place = frame.to_local(good.lat_deg, good.lon_deg, 0.0)
    before = _before(good.time_s, time)
    gap = good.time_s[before + 1] - good.time_s[before]
    share = (time - good.time_s[before]) / gap
    step = place[before + 1] - place[before]
    near = gap <= limits.gap_s + ROUNDING_S
    moving = near & (np.hypot(step[:, 0], step[:, 1]) > LEAST_SPEED_MPS * gap)

    known = np.where(np.isfinite(good.heading_rad), good.heading_rad, np.nan)
    first, second = known[before], known[before + 1]
    first, second = (
        np.where(np.isnan(first) & (near | (share > 0)), second, first),
        np.where(np.isnan(second) & (near | (share < 1)), first, second),
    )
    heading = first + share * ((second - first + np.pi) % (2 * np.pi) - np.pi)  # the short way round
    course = np.where(moving, np.arctan2(step[:, 0], step[:, 1]), np.nan)
    turned_by = np.select([~np.isnan(heading), moving], [1, 2], 3)
    return place[before] + share[:, None] * step, np.where(np.isnan(heading), course, heading), turned_by


def _before(fix_s: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Row of the fix before each instant, or at it; never the last, which has no fix after it."""
    return np.clip(np.searchsorted(fix_s, time, side="right") - 1, 0, len(fix_s) - 2)


def _words(limits: PositionLimits) -> tuple[str, ...]:
    return (
        "accepted",
        "no time of arrival",
        "fewer than two positions",
        f"HDOP of {limits.greatest_hdop:g} or more",
        "no position yet",
        f"gap of more than {limits.gap_s:g} s between positions",
        f"older than {limits.greatest_age_s:g} s",
    )


def _counted(words: tuple[str, ...], rows: np.ndarray) -> tuple[tuple[str, int], ...]:
    """Each word that occurs among rows of `words`, and how often."""
    return tuple((words[row], int(n)) for row, n in zip(*np.unique(rows, return_counts=True), strict=True))


@dataclass(frozen=True, eq=False)
class Receptions:
    """Arrivals and the positions beside them: what pings are made of, again whenever the limits are others."""

    number: np.ndarray  # (N,) integers: the stable name of a ping
    arrival_s: np.ndarray  # (N,) by the clock of the positions
    fixes: NavigationFixes
    travel_time_s: np.ndarray | None = None  # (N,) see `pings_of_stream`
    emission_s: np.ndarray | None = None  # (N,)
    utc: np.ndarray | None = None  # (N,)
    source: str = ""
    simulated: bool = False

    def pings(
        self,
        limits: PositionLimits = PositionLimits(),
        antenna_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
        hydrophone_depth_m: float = 0.0,
    ) -> tuple[Pings, ShipPositions]:
        """Pings of the arrivals for which there is a position, and where the ship was at all of them.

        Raises what `ship_at_receptions` raises.
        """
        ship = ship_at_receptions(self.fixes, self.arrival_s, limits, antenna_offset_m)
        pings = pings_of_stream(
            ship, self.number, hydrophone_depth_m, self.source, self.simulated, self.travel_time_s,
            self.emission_s, self.utc,
        )  # fmt: skip
        return pings, ship


def pings_of_stream(
    ship: ShipPositions,
    number: np.ndarray,
    hydrophone_depth_m: float = 0.0,
    source: str = "",
    simulated: bool = False,
    travel_time_s: np.ndarray | None = None,
    emission_s: np.ndarray | None = None,
    utc: np.ndarray | None = None,
) -> Pings:
    """Pings whose place is known, each column (N,) in the order of `ship`.

    travel_time_s : with any constant; None: the instants of reception, whole intervals too long, so tell the interval
    emission_s : instants of emission; None: not known, so those of reception stand for them
    utc : of reception, where it is known
    """
    keep = ship.accepted
    count = int(keep.sum())
    travel, clock = (ship.time_s if one is None else one for one in (travel_time_s, emission_s))
    return Pings(
        number=np.asarray(number)[keep],
        lat_deg=ship.lat_deg[keep],
        lon_deg=ship.lon_deg[keep],
        up_m=np.full(count, -hydrophone_depth_m),
        travel_time_s=travel[keep],
        utc=np.full(count, np.datetime64("NaT", "ms")) if utc is None else utc[keep],
        clock_s=clock[keep],
        at_reception=emission_s is None,
        heading_rad=ship.heading_rad[keep],
        source=source,
        simulated=simulated,
    )
