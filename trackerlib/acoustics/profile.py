"""Sound-speed profiles: speed of sound against depth, in straight lines between known depths."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

FEET_PER_METRE = 1 / 0.3048
GAP = 1.75  # times the larger of its neighbours, from which a step of depth is a gap
TAIL_ROWS = 6  # the mean step of this many last rows carries a profile on below its end


@dataclass(frozen=True, eq=False)
class SoundSpeedProfile:
    """Speed of sound against depth, linear between the depths given.

    Raises ValueError for depths that do not grow or speeds that are not positive numbers.
    """

    depth: np.ndarray  # (L,) length unit, positive down, strictly ascending
    speed: np.ndarray  # (L,) length unit per second, at those depths
    unit: str = "ft"  # "ft" or "m"
    name: str = ""
    notes: tuple[str, ...] = ()  # what was added to the measured part, in words

    def __post_init__(self):
        depth, speed = np.asarray(self.depth, float), np.asarray(self.speed, float)
        if depth.ndim != 1 or depth.shape != speed.shape or len(depth) < 2:
            raise ValueError(
                f"a profile needs two or more depths and as many speeds, got {depth.shape}, {speed.shape}"
            )
        if not (np.isfinite(depth).all() and np.isfinite(speed).all() and (speed > 0).all()):
            raise ValueError("depths and speeds of a profile must be numbers, speeds positive")
        if not (np.diff(depth) > 0).all():
            row = int(np.flatnonzero(np.diff(depth) <= 0)[0])
            raise ValueError(f"depths of a profile must grow: {depth[row + 1]:g} comes after {depth[row]:g}")
        if self.unit not in ("ft", "m"):
            raise ValueError(f"unit is {self.unit!r}; wanted 'ft' or 'm'")
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "speed", speed)

    @classmethod
    def constant(cls, speed: float, unit: str = "ft", bottom: float = 12_000.0) -> SoundSpeedProfile:
        """The same speed at every depth down to `bottom`."""
        return cls(np.array([0.0, bottom]), np.array([speed, speed]), unit, "constant")

    @classmethod
    def from_layer_middles(cls, upper_boundary, middle_speed, unit="ft", name="") -> SoundSpeedProfile:
        """A profile from layers whose speed is known at their middle (VELOCITY.DAT; Read 1990, appendix E).

        upper_boundary : (L,) depth of each layer's upper boundary
        middle_speed : (L,) speed at the middle between that boundary and the next; the last layer is
            as thick as the one before, and so is a layer above a gap (`depth_gaps`)
        """
        boundary = np.asarray(upper_boundary, float)
        thickness = np.append(np.diff(boundary), boundary[-1] - boundary[-2])
        for gap in depth_gaps(boundary):  # rows are missing: the layer above was as thick as its neighbours
            thickness[gap] = thickness[gap - 1] if gap else thickness[gap + 1]
        notes = gap_notes(boundary, unit)
        return cls(boundary + thickness / 2, np.asarray(middle_speed, float), unit, name, notes)

    @property
    def gradient(self) -> np.ndarray:
        """Gradient (L - 1,) [1/s] of each layer."""
        return np.diff(self.speed) / np.diff(self.depth)

    def speed_at(self, depth) -> np.ndarray:
        """Speed at some depths, carried on beyond both ends as `extended` does."""
        depth = np.asarray(depth, float)
        inside = np.interp(depth, self.depth, self.speed)
        above = self.speed[0] + (depth - self.depth[0]) * self.gradient[0]
        below = self.speed[-1] + (depth - self.depth[-1]) * self._tail_gradient()
        return np.where(depth < self.depth[0], above, np.where(depth > self.depth[-1], below, inside))

    def gradient_at(self, depth) -> np.ndarray:
        """Gradient [1/s] at some depths; on a boundary, that of the layer below."""
        gradient = np.concatenate([self.gradient[:1], self.gradient, [self._tail_gradient()]])
        return gradient[np.searchsorted(self.depth, np.asarray(depth, float), side="right")]

    def harmonic_mean(self, depth_a: float, depth_b: float) -> float:
        """Harmonic mean speed between two depths: their distance over the vertical travel time."""
        top, bottom = sorted((float(depth_a), float(depth_b)))
        if bottom - top < 1e-9 * max(abs(bottom), 1.0):
            return float(self.speed_at(top))
        inner = self.depth[(self.depth > top) & (self.depth < bottom)]
        depth = np.concatenate([[top], inner, [bottom]])
        speed = self.speed_at(depth)
        ratio = np.diff(speed) / speed[:-1]
        # thickness / v1 x ln(v2/v1) / (v2/v1 - 1), which is 1 where the speed does not change
        shape = np.where(np.abs(ratio) > 1e-12, np.log1p(ratio) / np.where(ratio == 0, 1.0, ratio), 1.0)
        return float((bottom - top) / np.sum(np.diff(depth) / speed[:-1] * shape))

    def extended(self, top: float, bottom: float) -> SoundSpeedProfile:
        """The profile carried on to cover these depths, with a note where that was needed.

        Above with the first gradient, below with the mean step of the last six rows.
        """
        depth, speed, notes = self.depth, self.speed, self.notes
        if top < depth[0]:
            notes += (f"above {depth[0]:g} {self.unit} speed goes on with the first gradient",)
            depth, speed = np.append(top, depth), np.append(self.speed_at(top), speed)
        if bottom > depth[-1]:
            notes += (f"below {depth[-1]:g} {self.unit} speed goes on with the mean step of the last rows",)
            depth, speed = np.append(depth, bottom), np.append(speed, self.speed_at(bottom))
        return replace(self, depth=depth, speed=speed, notes=notes)

    def _tail_gradient(self) -> float:
        first = max(len(self.depth) - 1 - TAIL_ROWS, 0)
        return float((self.speed[-1] - self.speed[first]) / (self.depth[-1] - self.depth[first]))


def depth_gaps(depth: np.ndarray) -> np.ndarray:
    """Places (K,) of steps between depths (L,) that are much longer than those before and after."""
    step = np.diff(depth)
    if len(step) < 2:
        return np.empty(0, int)
    # the last step has none behind it, and tables grow coarser with depth
    beside = np.maximum(np.append(step[1:], 2 * step[-2]), np.append(0, step[:-1]))
    return np.flatnonzero(step > GAP * beside)


def gap_notes(depth: np.ndarray, unit: str) -> tuple[str, ...]:
    """A sentence on every gap of a profile's depths (L,), across which the speed is a straight line."""
    return tuple(
        f"gap in the depths from {depth[k]:g} to {depth[k + 1]:g} {unit}: speed goes straight across"
        for k in depth_gaps(depth)
    )
