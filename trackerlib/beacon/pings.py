"""What a beacon fix starts from: where the hydrophone was, and when it heard each ping."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Ping:
    """One reception, as a reader hands it on the moment it is known."""

    number: int  # its stable name
    lat_deg: float
    lon_deg: float
    travel_time_s: float  # one-way travel time plus any constant
    clock_s: float  # seconds of the clock that all pings of the hunt share
    up_m: float = 0.0  # of the hydrophone above the sea surface
    utc: np.datetime64 | None = None


@dataclass(frozen=True, eq=False)
class Pings:
    """Receptions of one beacon, in the order of the file they came from."""

    number: np.ndarray  # (N,) integers: the stable name of a ping, the file's own or 1, 2, ...
    lat_deg: np.ndarray  # (N,) WGS 84, south negative
    lon_deg: np.ndarray  # (N,) WGS 84, west negative
    up_m: np.ndarray  # (N,) height of the hydrophone above the sea surface, negative below it
    travel_time_s: np.ndarray  # (N,) one-way travel time plus any constant, known or not
    utc: np.ndarray  # (N,) datetime64[ms], NaT where the file gives none
    clock_s: np.ndarray | None = None  # (N,) seconds of any clock, where the file tells no date
    at_reception: bool = False  # whether instants are those of reception, not of emission
    # (N,) of the ship's bow, clockwise from true north, NaN if not known
    heading_rad: np.ndarray | None = None
    time_step_s: float = 0.0  # step in which travel times were logged, 0 if they are continuous
    source: str = ""  # file it came from
    simulated: bool = False

    def __post_init__(self):
        lengths = {name: len(getattr(self, name)) for name in _COLUMNS}
        if len(set(lengths.values())) != 1:
            raise ValueError(f"columns of pings differ in length: {lengths}")

    def __len__(self) -> int:
        return len(self.number)

    @property
    def instant_s(self) -> np.ndarray:
        """Seconds (N,) since the ping that stands first; 15 s a ping where the file tells no time."""
        if not self.timed:
            return 15.0 * np.arange(len(self))
        if self.clock_s is not None:
            return self.clock_s - self.clock_s[:1]
        return (self.utc - self.utc[:1]).astype("timedelta64[ms]").astype(float) * 1e-3

    @property
    def elapsed_s(self) -> np.ndarray:
        """The same, never falling, as a file is played back."""
        return np.maximum.accumulate(self.instant_s)

    @property
    def timed(self) -> bool:
        """Whether the instants of the pings are known."""
        return self.clock_s is not None or not np.isnat(self.utc).any()

    @property
    def arrival_s(self) -> np.ndarray:
        """Arrivals (N,) [s] by a clock that starts with the first ping: what a chart recorder would fold."""
        return self.elapsed_s + self.travel_time_s

    def only(self, keep: np.ndarray | slice) -> Pings:
        """The same pings where `keep` (N,) is true, or a slice of them."""
        clock = None if self.clock_s is None else self.clock_s[keep]
        heading = None if self.heading_rad is None else self.heading_rad[keep]
        return replace(
            self, clock_s=clock, heading_rad=heading, **{name: getattr(self, name)[keep] for name in _COLUMNS}
        )


class PingLog:
    """Pings kept as they come, the newest `most` of them.

    log.add(ping)
    log.pings()
    """

    def __init__(self, source: str = "", simulated: bool = False, most: int = 1 << 17):
        self.source, self.simulated = source, simulated
        self.count = 0  # pings added, kept or not
        self._rows: deque[Ping] = deque(maxlen=most)
        self._pings: Pings | None = None

    def add(self, ping: Ping) -> None:
        """Keeps one more ping, and lets go of the oldest where there are too many."""
        self._rows.append(ping)
        self.count += 1
        self._pings = None

    def pings(self) -> Pings:
        """Those kept, in the order in which they came."""
        if self._pings is None:
            rows = self._rows
            self._pings = Pings(
                number=np.array([ping.number for ping in rows], np.int64),
                lat_deg=np.array([ping.lat_deg for ping in rows], float),
                lon_deg=np.array([ping.lon_deg for ping in rows], float),
                up_m=np.array([ping.up_m for ping in rows], float),
                travel_time_s=np.array([ping.travel_time_s for ping in rows], float),
                utc=np.array(["NaT" if ping.utc is None else ping.utc for ping in rows], "datetime64[ms]"),
                clock_s=np.array([ping.clock_s for ping in rows], float),
                source=self.source,
                simulated=self.simulated,
            )
        return self._pings


_COLUMNS = ("number", "lat_deg", "lon_deg", "up_m", "travel_time_s", "utc")
