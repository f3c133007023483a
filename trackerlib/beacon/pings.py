"""What a beacon fix starts from: where the hydrophone was, and when it heard each ping."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


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
    heading_rad: np.ndarray | None = (
        None  # (N,) of the ship's bow, clockwise from true north, NaN if not known
    )
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


_COLUMNS = ("number", "lat_deg", "lon_deg", "up_m", "travel_time_s", "utc")
