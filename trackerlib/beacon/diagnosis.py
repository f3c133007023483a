"""A closer look at a fix: how its misfit rises about it, and how far each ping moves it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.beacon.attempt import SEARCH_PINGS, problem_of
from trackerlib.beacon.minimise import Problem, descend
from trackerlib.beacon.motion import FREE_DIRECTIONS, Motion, motion_over
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import FixSettings

COORDINATES = ("east", "north", "depth", "velocity east", "velocity north", "velocity up")
ROUNDS = 8  # steps in which the other unknowns follow


@dataclass(frozen=True, eq=False)
class MisfitSurface:
    """Chi-square over two coordinates of the beacon, all other unknowns at their best."""

    names: tuple[str, str]  # of COORDINATES, across and up
    across: np.ndarray  # (C,) east or north of the frame's origin or depth below it [m], or a velocity [m/s]
    up: np.ndarray  # (C,)
    rise: np.ndarray  # (C, C) chi-square above its least, by up then across


def misfit_surface(
    pings: Pings,
    fix: BeaconFix,
    settings: FixSettings,
    names: tuple[str, str] = ("east", "north"),
    half_widths: tuple[float, float] | None = None,
    cells: int = 25,
) -> MisfitSurface:
    """How chi-square rises about a fix in two coordinates of it at mid-survey, the others following.

    half_widths : of the grid [m, m/s]; None: six standard errors of what chi-square knows
    Residual correlation divides chi-square, so a rise of 6.0 bounds 95 % in two dimensions. A survey of many pings
    is thinned and its chi-square scaled up. Raises ValueError for a fix without a place or an uncertainty, and for
    names that are not two of COORDINATES that this motion leaves free.
    """
    if fix.position is None or fix.uncertainty is None:
        raise ValueError(f"there is no place to look about: {fix.reason}")
    if len(set(names)) != 2 or not set(names) <= set(COORDINATES):
        raise ValueError(f"names are {names}; wanted two of {', '.join(COORDINATES)}")
    free = free_coordinates(settings.motion)
    if not set(names) <= set(free):
        raise ValueError(f"names are {names}; this motion leaves free {', '.join(free)}")
    problem, state, motion = problem_at(pings, fix, settings)
    chosen = np.unique(
        np.linspace(0, len(problem.time) - 1, min(len(problem.time), SEARCH_PINGS)).astype(int)
    )
    share = len(problem.time) / len(chosen)
    problem = problem.only(chosen)
    axes = [COORDINATES.index(name) for name in names]
    # What a component of the state [m] is shown as: depth counts down, velocities are per second.
    shown = np.array([1.0, 1.0, -1.0, *3 * [1 / motion.half_s]])[axes]
    weight = np.nan_to_num(problem.relative_weight(problem.times(state[None])[1]))
    here = problem.eliminate(state[None], weight)
    variance = max(here.sum_of_squares[0] / max(len(chosen) - problem.unknowns, 1), problem.time_sigma_s**2)
    variance *= fix.uncertainty.correlation.length / share
    inverse = np.linalg.pinv(here.normal_matrix(problem.axes)[0], rcond=1e-15, hermitian=True)
    spread = np.sqrt(variance * np.diag(problem.axes.T @ inverse @ problem.axes))[axes]
    sigma = spread * np.abs(shown) if half_widths is None else np.array(half_widths) / 6
    steps = np.linspace(-6.0, 6.0, cells)
    grids = [state[axis] * shown[k] + steps * sigma[k] for k, axis in enumerate(axes)]
    states = np.repeat(state[None], cells * cells, axis=0)
    across, up = np.meshgrid(*grids)
    states[:, axes[0]], states[:, axes[1]] = across.ravel() / shown[0], up.ravel() / shown[1]
    others = problem.axes[~np.any(problem.axes[:, axes] != 0, axis=1)]
    weight = np.repeat(weight, len(states), axis=0)
    if len(others):
        states, _ = descend(problem, states, weight, steps=ROUNDS, axes=others)
    squares = problem.eliminate(states, weight).sum_of_squares
    rise = (squares - squares.min()) / variance
    return MisfitSurface(names, grids[0], grids[1], rise.reshape(cells, cells))


def free_coordinates(kind: str) -> tuple[str, ...]:
    """Those of COORDINATES that a motion, one of MOTIONS, leaves free."""
    free = np.flatnonzero(np.any(FREE_DIRECTIONS[kind] != 0, axis=0))
    return tuple(COORDINATES[k] for k in free)


def influence(pings: Pings, fix: BeaconFix, settings: FixSettings) -> np.ndarray:
    """How far [m] the place would move (N,) if a ping were left out, to first order; NaN where it was left out.

    Raises ValueError for a fix without a place.
    """
    if fix.position is None:
        raise ValueError(f"there is no place that a ping could move: {fix.reason}")
    problem, state, _ = problem_at(pings, fix, settings)
    gradient = problem.times(state[None])[1]
    misfit = problem.eliminate(state[None], np.nan_to_num(problem.relative_weight(gradient)))
    slope = misfit.gradient[0] @ problem.axes.T
    weight = misfit.weight[0]
    inverse = np.linalg.pinv((slope * weight[:, None]).T @ slope, rcond=1e-15, hermitian=True)
    gain = (slope * weight[:, None]) @ inverse
    linear = weight * np.einsum("nl,lm,nm->n", misfit.columns[0], misfit.inverse[0], misfit.columns[0])
    leverage = np.sum(gain * slope, axis=1) + linear
    moved = (gain * (misfit.residual[0] / np.maximum(1 - leverage, 1e-9))[:, None]) @ problem.axes
    out = np.full(len(fix.number), np.nan)
    out[fix.used] = np.linalg.norm(moved[:, :3], axis=1)
    return out


def problem_at(pings: Pings, fix: BeaconFix, settings: FixSettings) -> tuple[Problem, np.ndarray, Motion]:
    """The problem of the pings that a fix rests on, its state (P,) and its motion."""
    motion = motion_over(settings.motion, fix.elapsed_s)
    problem = problem_of(pings, fix, fix.used, settings, motion)
    if problem.slowness_sigma is not None and fix.uncertainty is not None:
        problem = replace(problem, noise_s=fix.uncertainty.noise_s)
    place = fix.position if fix.velocity is None else np.concatenate([fix.position, fix.velocity])
    return problem, np.linalg.solve(motion.at(0.0), place), motion
