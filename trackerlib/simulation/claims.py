"""What Wojcik (1993) concludes from chapter IV, each conclusion held against the rows of a study.

    for claim in claims(rows): print(claim)

The rows are those of one estimator and one ship's speed. How fast an error falls is the slope of its logarithm
against that of what the sweep turns, so a plain power law has no knee.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackerlib.simulation.hexagon import INTERVAL_S, LEG_M

ONE_DRAW = "the thesis draws one estimate a point, which scatters by more than this"
CURVE = ["scenario", "sweep", "gps_rms_m"]
STILL, MOVING = (1, 2, 3), (4, 5, 6)
OVER_BEACON_2_M, CLOSEST_TO_3_M = 3.5 * LEG_M, 4134.0  # sailed until then: fourth leg, fifth leg
AT = {"experiments": "{} experiments", "spacing": "a spacing of {}"}
SUM = "Start and velocity are worse known than their sum, the present position (6.1)."
WORSE = "A longer collection can make the present position slightly worse (3.6, 4.4.1)."
SLIGHT = 1.01  # a bound that has risen by this share has risen


@dataclass(frozen=True)
class Claim:
    """One conclusion, whether these rows bear it out, by what numbers, and why not."""

    words: str
    holds: bool | None  # None: these rows do not tell
    found: str = ""
    why: str = ""

    def __str__(self) -> str:
        if self.holds is None:
            return f"{self.words} not told by these points"
        if self.holds:
            return f"{self.words} holds: {self.found}."
        return f"{self.words} does not hold: {self.found}; {self.why}."


def claims(rows: pd.DataFrame) -> Iterator[Claim]:
    """Every conclusion; `rows` are those of a study's table at which most fixes converged."""
    for sweep, words in (
        ("experiments", "More experiments help (6.1)."),
        ("spacing", "Wider spacing helps (6.1)."),
    ):
        yield _ratio(
            words, _falls(rows[rows.sweep == sweep]), "from first third to last the error falls {:.1f}-fold"
        )
    yield _quality_of_gps(rows)
    depth = rows["rmse.z"] / rows[["rmse.x", "rmse.y"]].max(axis=1)
    yield _ratio(
        "Depth is known worst (4.5).",
        depth,
        "its error is {:.2f} times that of the worse of east and north",
        "these tracks pass so close to the beacon that depth is seen as well as the plan",
    )
    yield from _knees(rows)
    yield from _passages(rows)
    yield from _between_scenarios(rows)
    yield from _present_position(rows)


def _ratio(words: str, ratios: Sequence[float] | pd.Series, found: str, why: str = ONE_DRAW) -> Claim:
    """A claim that holds if the median of some ratios is above one."""
    ratios = np.asarray(ratios, float)
    ratios = ratios[np.isfinite(ratios)]
    if not len(ratios):
        return Claim(words, None)
    middle = float(np.median(ratios))
    return Claim(words, middle > 1, f"{found.format(middle)} (median of {len(ratios)})", why)


def _falls(rows: pd.DataFrame) -> list[float]:
    """Error in the first third of each curve over that in its last."""
    ratios = []
    for (_, sweep, _), curve in rows.groupby(CURVE):
        error = curve.sort_values(str(sweep)).rmse_3d_m.to_numpy()
        third = len(error) // 3
        if third:
            ratios.append(np.median(error[:third]) / np.median(error[-third:]))
    return ratios


def _quality_of_gps(rows: pd.DataFrame) -> Claim:
    words = "The quality of GPS decides, 3 m about ten times as good as 25 m (4.5)."
    keys = ["scenario", "sweep", "experiments", "spacing"]
    error = rows.pivot_table(index=keys, columns="gps_rms_m", values="rmse_3d_m")
    if not {3.0, 25.0} <= set(error.columns):
        return Claim(words, None)
    return _ratio(words, error[25.0] / error[3.0], "25 m makes the error {:.1f} times as great")


def _paired(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """A column of equal points, a scenario a column."""
    keys = ["sweep", "experiments", "spacing", "gps_rms_m"]
    return rows.pivot_table(index=keys, columns="scenario", values=column)


def steepness(x: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """How fast an error falls, -d log(error) / d log(x), with its sigma; NaN for fewer than four points."""
    keep = np.isfinite(error) & (error > 0)
    if keep.sum() < 4:
        return np.nan, np.nan
    line, covariance = np.polyfit(np.log(x[keep]), np.log(error[keep]), 1, cov=True)
    return -float(line[0]), float(np.sqrt(covariance[0, 0]))


def _bends(rows: pd.DataFrame, sweep: str, window: tuple[int, int, int]) -> np.ndarray:
    """Steepness before and after a bend, with both sigmas (C, 4), of the curves of a sweep that show both."""
    low, bend, high = window
    found = []
    for _, curve in rows[rows.sweep == sweep].groupby(CURVE):
        curve = curve.sort_values(sweep)
        x, error = curve[sweep].to_numpy(float), curve.rmse_3d_m.to_numpy()
        sides = (x >= low) & (x <= bend), (x >= bend) & (x <= high)
        before, after = (steepness(x[side], error[side]) for side in sides)
        found.append((before[0], after[0], before[1], after[1]))
    bends = np.array(found).reshape(-1, 4)
    return bends[np.isfinite(bends).all(axis=1)]


def _bend(words: str, bends: np.ndarray, flatter: bool, why: str) -> Claim:
    """A claim that curves are flatter, or steeper, after a bend: by more than three sigmas of their mean."""
    if not len(bends):
        return Claim(words, None)
    before, after = bends[:, :2].mean(axis=0)
    sigma = float(np.sqrt(np.sum(bends[:, 2:] ** 2))) / len(bends)
    change = (before - after) if flatter else (after - before)
    found = f"the error falls with the power {before:.2f} before and {after:.2f} after, sigma of the change {sigma:.2f}"
    return Claim(words, bool(change > 3 * sigma), f"{found} ({len(bends)} curves)", why)


def _sailed(rows: pd.DataFrame, experiments: int, spacing: int) -> tuple[float, float]:
    """The ship's speed, and how far it has sailed after so many experiments."""
    speed = float(rows.speed_mps.iloc[0]) if len(rows) else np.nan
    return speed, experiments * spacing * INTERVAL_S * speed


def _knees(rows: pd.DataFrame) -> Iterator[Claim]:
    for name, numbers, windows in (
        ("still", STILL, {"experiments": (5, 20, 40, 45), "spacing": (2, 35, 65, 25)}),
        ("moving", MOVING, {"experiments": (10, 30, 50, 60), "spacing": (2, 45, 90, 30)}),
    ):
        chosen = rows[rows.scenario.isin(numbers)]
        for sweep, (low, bend, high, held) in windows.items():
            speed, sailed = _sailed(chosen, bend, held)
            why = (
                f"at {speed:g} m/s short surveys end against the search box, which keeps their errors small, and past "
                "two legs the error goes on falling"
                if sailed < 3 * LEG_M
                else f"at {speed:g} m/s the ship has covered {sailed / LEG_M:.0f} legs by then, and not two"
            )
            words = f"Errors of a {name} beacon fall fast up to {AT[sweep].format(bend)}, then slowly (4.3.1, 4.4)."
            yield _bend(words, _bends(chosen, sweep, (low, bend, high)), True, why)


def _passages(rows: pd.DataFrame) -> Iterator[Claim]:
    for scenario, words, place_m, windows in (
        (
            2,
            "The leg over the beacon helps, past",
            OVER_BEACON_2_M,
            {"experiments": (28, 40, 50, 45), "spacing": (45, 65, 90, 25)},
        ),
        (
            3,
            "The closest approach on the fifth leg helps, past",
            CLOSEST_TO_3_M,
            {"experiments": (35, 45, 50, 45), "spacing": (55, 75, 90, 25)},
        ),
    ):
        chosen = rows[rows.scenario == scenario]
        for sweep, (low, bend, high, held) in windows.items():
            speed, sailed = _sailed(chosen, bend, held)
            why = f"at {speed:g} m/s the ship is there after {place_m:.0f} m, and has sailed {sailed:.0f} m by then"
            if sailed < 1.3 * place_m:
                why += "; the error falls as fast on the way there"
            claim = f"{words} {AT[sweep].format(bend)} (4.3.{scenario})."
            yield _bend(claim, _bends(chosen, sweep, (low, bend, high)), False, why)


def _between_scenarios(rows: pd.DataFrame) -> Iterator[Claim]:
    error = _paired(rows, "rmse_3d_m")
    best = "Scenario 1 is best of the still ones, as every leg has a closest point to its beacon (4.3.4)."
    if set(STILL) <= set(error.columns):
        yield _ratio(
            best,
            error[[2, 3]].min(axis=1) / error[1],
            "the better of 2 and 3 has {:.2f} times its error",
            "a beacon at the side gives ranges that change more, once the ship has sailed the legs near it",
        )
    else:
        yield Claim(best, None)
    yield from _moving_scenarios(rows)


def _moving_scenarios(rows: pd.DataFrame) -> Iterator[Claim]:
    far = "A moving beacon is known far worse than a still one (4.4)."
    middle = rows.groupby(["scenario", "sweep", "gps_rms_m"]).rmse_3d_m.median().unstack("scenario")
    pairs = [(one, one + 3) for one in STILL if {one, one + 3} <= set(middle.columns)]
    yield _ratio(
        far,
        np.concatenate([middle[moving] / middle[still] for still, moving in pairs]) if pairs else [],
        "its error is {:.1f} times as great",
        "its drift shows it from new sides on every lap, its sweeps collect longer (spacing 60 for 45, 30 experiments "
        "for 25), and surveys too short for a fix do not count",
    )
    now = _paired(rows.assign(now=_now(rows, "rmse_now")), "now")
    words = "With 25 m the present position follows the beacon in scenario 5 only (4.4.2)."
    coarse = now[now.index.get_level_values("gps_rms_m") == 25.0]
    ratios = coarse[[4, 6]].min(axis=1) / coarse[5] if set(MOVING) <= set(now.columns) else []
    yield _ratio(
        words,
        ratios,
        "the better of 4 and 6 has {:.2f} times its error",
        "the thesis itself puts it down to the errors drawn",
    )


def _now(rows: pd.DataFrame, key: str) -> np.ndarray:
    """Size of an error or bound of the present position."""
    return np.linalg.norm(rows[[f"{key}.{axis}" for axis in "xyz"]].to_numpy(float), axis=1)


def _present_position(rows: pd.DataFrame) -> Iterator[Claim]:
    moving = rows[rows.scenario.isin(MOVING)]
    if not len(moving):
        yield from (Claim(SUM, None), Claim(WORSE, None))
        return
    duration = INTERVAL_S * moving.experiments * moving.spacing
    carried = duration * np.linalg.norm(moving[[f"rmse.v{axis}" for axis in "xyz"]].to_numpy(float), axis=1)
    parts = np.hypot(moving.rmse_3d_m, carried) / _now(moving, "rmse_now")
    yield _ratio(SUM, parts, "start and carried velocity, as if independent, err {:.1f} times as much")
    rises = np.array(
        [
            _greatest_rise(curve.sort_values(str(sweep)).now.to_numpy())
            for (_, sweep, _), curve in moving.assign(now=_now(moving, "crlb_now")).groupby(CURVE)
        ]
    )
    yield Claim(
        WORSE,
        bool((rises > SLIGHT).any()),
        f"the bound of every reception rises by over {100 * (SLIGHT - 1):.0f} % on {np.sum(rises > SLIGHT)} of "
        f"{len(rises)} curves, by {100 * (rises.max() - 1):.1f} % at most",
        "the gain in velocity outweighs the longer time that it is carried over",
    )


def _greatest_rise(bound: np.ndarray) -> float:
    """Greatest ratio of a value to the least before it; 1 where it only falls."""
    bound = bound[np.isfinite(bound)]
    return float(np.max(bound / np.minimum.accumulate(bound), initial=1.0))
