"""How a beacon may move while it is heard: which directions of position and velocity are free.

A state is east, north, up and, unless the beacon lies still, the velocity times half the survey's length, so that
all of it is in metres. Structural models of Wojcik (1993), (2-8) and (3-2), and the two restricted motions that
section 3.1 names: sinking or rising, and drifting with a current.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_EAST, _NORTH, _UP, _EASTWARD, _NORTHWARD, _UPWARD = np.eye(6)
FREE_DIRECTIONS = {
    "still": np.eye(3),
    "vertical": np.array([_EAST, _NORTH, _UP, _UPWARD]),
    "horizontal": np.array([_EAST, _NORTH, _UP, _EASTWARD, _NORTHWARD]),
    "free": np.eye(6),
}
MOTIONS = tuple(FREE_DIRECTIONS)


@dataclass(frozen=True, eq=False)
class Motion:
    """A kind of motion over the span of a survey."""

    kind: str  # one of MOTIONS
    middle_s: float  # since the first ping: the instant of a state's position
    half_s: float  # half the time from the first ping to the last

    @property
    def axes(self) -> np.ndarray:
        """Free directions (K, P) of a state with P components."""
        return FREE_DIRECTIONS[self.kind]

    @property
    def moving(self) -> bool:
        """Whether a state holds a velocity."""
        return self.kind != "still"

    def shares(self, elapsed_s: np.ndarray) -> np.ndarray:
        """Instants (N,) as shares of half the survey, -1 at its first ping and 1 at its last."""
        return (elapsed_s - self.middle_s) / self.half_s

    def at(self, elapsed_s: float) -> np.ndarray:
        """Matrix (P, P) that turns a state into position at an instant [m] and velocity [m/s]."""
        if not self.moving:
            return np.eye(3)
        share = float(self.shares(np.array(elapsed_s)))
        return np.block([[np.eye(3), share * np.eye(3)], [np.zeros((3, 3)), np.eye(3) / self.half_s]])


def motion_over(kind: str, elapsed_s: np.ndarray) -> Motion:
    """The motion of a survey whose pings came at elapsed_s (N,) [s]; at rest in the middle of its span."""
    first, last = (float(np.min(elapsed_s)), float(np.max(elapsed_s))) if len(elapsed_s) else (0.0, 0.0)
    return Motion(kind, (first + last) / 2, max((last - first) / 2, 1.0))
