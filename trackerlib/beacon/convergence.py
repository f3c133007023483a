"""The way a fix came about, step by step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Step:
    """Where a minimisation stood after one step."""

    stage: str  # "search from 17 starts", "settle place 1 of 2", "unbiased", ...
    iteration: int  # from 1 within the stage
    position: np.ndarray  # (3,) east, north, up [m] in the frame of the fix, at its first ping
    rms_ms: float | None  # weighted root-mean-square residual
    step_m: float | None  # how far the place moved
    damping: float | None  # of Levenberg and Marquardt, where the stage has one
    pings: int  # that had a say

    def __str__(self) -> str:
        east, north, up = self.position
        rms = "" if self.rms_ms is None else f"  rms {self.rms_ms:.4g} ms"
        moved = "" if self.step_m is None else f"  moved {self.step_m:.2g} m"
        damping = "" if self.damping is None else f"  damping {self.damping:.0e}"
        return (
            f"{self.stage}, {self.iteration}: {east:.2f} east, {north:.2f} north, {-up:.2f} down"
            f"{rms}{moved}{damping}  {self.pings} pings"
        )


class Recorder:
    """Collects the steps of one fix.

    to_first : (P, P) turns a state into the place at the first ping, see `Motion.at`
    """

    def __init__(self, to_first: np.ndarray) -> None:
        self.steps: list[Step] = []
        self._to_first = to_first
        self._stage = ""
        self._iteration = 0

    def begin(self, stage: str) -> None:
        """Starts counting the steps of another stage."""
        self._stage, self._iteration = stage, 0

    def note(self, state, misfit, moved=None, damping=None, best: int | None = None) -> None:
        """One step of states (S, P), of which the best (default: of the least sum of squares) is kept.

        misfit : Misfit of those states; moved, damping : (S,)
        """
        k = int(np.argmin(misfit.sum_of_squares)) if best is None else best
        weight, residual = misfit.weight[k], misfit.residual[k]
        rms = np.sqrt((weight * residual**2).sum() / max(weight.sum(), 1e-300))
        self.add(
            state[k],
            1e3 * float(rms),
            None if moved is None else float(moved[k]),
            None if damping is None else float(damping[k]),
            int((weight > 0).sum()),
        )

    def add(self, state, rms_ms: float | None, step_m: float | None, damping: float | None, pings: int):
        """One step to a state (P,)."""
        self._iteration += 1
        position = (self._to_first @ state)[:3]
        self.steps.append(Step(self._stage, self._iteration, position, rms_ms, step_m, damping, pings))
