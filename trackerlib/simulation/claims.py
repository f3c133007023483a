"""What Wojcik (1993) concludes from chapter IV, each conclusion held against the rows of a study.

    for claim in claims(rows): print(claim)

The rows are those of one estimator and one ship's speed. How fast an error falls is the slope of its logarithm
against that of what the sweep turns, so a plain power law has no knee. Where a conclusion does not hold the same is
asked of the bound beside each error: what the bound does too is no fault of the estimator. What no row tells is said.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trackerlib.simulation.hexagon import INTERVAL_S, LEG_M

QUARTILES = 3.6  # of the size of one normal draw, the upper over the lower: chi of one degree of freedom
BOXED = 0.5  # of the bound: an error below it is that of a search that ends at the sides of its box
NO_CAUSE = "these rows do not tell the cause"
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
        swept = rows[rows.sweep == sweep]
        yield _ratio(words, swept, _falls, "from first third to last the error falls {:.1f}-fold")
    yield _ratio(
        "The quality of GPS decides, 3 m about ten times as good as 25 m (4.5).",
        rows,
        _coarse_over_fine,
        "25 m makes the error {:.1f} times as great",
    )
    yield _ratio(
        "Depth is known worst (4.5).",
        rows,
        lambda part: part["rmse.z"] / part[["rmse.x", "rmse.y"]].max(axis=1),
        "its error is {:.2f} times that of the worse of east and north",
    )
    yield from _knees(rows)
    yield from _passages(rows)
    yield from _between_scenarios(rows)
    yield from _present_position(rows)


def of_bound(rows: pd.DataFrame) -> pd.DataFrame:
    """The same rows with the bound of every reception in the place of the error; NaN where a table has none."""
    bound = rows.copy()
    for name in rows.columns:
        if name.startswith("rmse"):
            beside = name.replace("rmse", "crlb", 1)
            bound[name] = rows.get(beside, np.nan)
    return bound


def _ratio(
    words: str,
    rows: pd.DataFrame,
    ratios: Callable[[pd.DataFrame], Sequence[float] | pd.Series | np.ndarray],
    found: str,
    besides: str = "",
) -> Claim:
    """A claim that holds if the median of some ratios of errors is above one; `besides` is said where it does not."""
    middle, count = _median(ratios(rows))
    if not count:
        return Claim(words, None)
    why = "" if middle > 1 else _why_not_above_one(middle, _median(ratios(of_bound(rows)))[0], rows) + besides
    return Claim(words, middle > 1, f"{found.format(middle)} (median of {count})", why)


def _median(ratios: Sequence[float] | pd.Series | np.ndarray) -> tuple[float, int]:
    """The median of those that are numbers, and how many they are."""
    ratios = np.asarray(ratios, float)
    ratios = ratios[np.isfinite(ratios)]
    return (float(np.median(ratios)), len(ratios)) if len(ratios) else (np.nan, 0)


def _why_not_above_one(middle: float, bound: float, rows: pd.DataFrame) -> str:
    """Whether bound or estimator makes a ratio no greater than one, and whether one draw could hide it."""
    if not np.isfinite(bound):
        why = NO_CAUSE
    elif bound <= 1:
        why = (
            f"the bound of every reception gives {bound:.2f} too, so it is the geometry and not the estimator"
        )
    else:
        why = f"the bound of every reception gives {bound:.2f}, so it is the estimator{_beside_bound(rows)}"
    if middle > 1 / QUARTILES:
        why += f"; one draw a point, as the thesis has it, scatters by a factor of {QUARTILES:g} between its quartiles"
    return why


def _beside_bound(rows: pd.DataFrame) -> str:
    """How far errors lie above the bound, in words; "" for a table that has no bound."""
    share = (rows.rmse_3d_m / rows.crlb_3d_m).to_numpy(float) if "crlb_3d_m" in rows else np.empty(0)
    share = share[np.isfinite(share)]
    if not len(share):
        return ""
    low, high = np.quantile(share, (0.1, 0.9))
    boxed = ", and so small only because the search box ends there" if low < BOXED else ""
    return f", whose error is {low:.2g} to {high:.2g} times it (four points in five){boxed}"


def _falls(rows: pd.DataFrame) -> list[float]:
    """Error in the first third of each curve over that in its last."""
    ratios = []
    for (_, sweep, _), curve in rows.groupby(CURVE):
        error = curve.sort_values(str(sweep)).rmse_3d_m.to_numpy()
        third = len(error) // 3
        if third:
            ratios.append(np.median(error[:third]) / np.median(error[-third:]))
    return ratios


def _coarse_over_fine(rows: pd.DataFrame) -> Sequence[float] | pd.Series:
    """Error with 25 m of GPS over that with 3 m."""
    keys = ["scenario", "sweep", "experiments", "spacing"]
    error = rows.pivot_table(index=keys, columns="gps_rms_m", values="rmse_3d_m")
    return error[25.0] / error[3.0] if {3.0, 25.0} <= set(error.columns) else []


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


def _bend(
    words: str, rows: pd.DataFrame, sweep: str, window: tuple[int, int, int], flatter: bool, besides: str
) -> Claim:
    """A claim that curves are flatter, or steeper, after a bend: by more than three sigmas of their mean."""
    bends = _bends(rows, sweep, window)
    if not len(bends):
        return Claim(words, None)
    before, after = bends[:, :2].mean(axis=0)
    sigma = float(np.sqrt(np.sum(bends[:, 2:] ** 2))) / len(bends)
    change = (before - after) if flatter else (after - before)
    found = f"the error falls with the power {before:.2f} before and {after:.2f} after, sigma of the change {sigma:.2f}"
    holds = bool(change > 3 * sigma)
    bound = _bends(of_bound(rows), sweep, window)
    why = "" if holds else f"{_why_no_bend(change / sigma, bound, flatter, rows)}; {besides}"
    return Claim(words, holds, f"{found} ({len(bends)} curves)", why)


def _why_no_bend(change: float, bound: np.ndarray, flatter: bool, rows: pd.DataFrame) -> str:
    """Whether rows decide, by a change in its sigmas, and whether bound or estimator has no such bend."""
    undecided = "the change is within three of its sigmas, so these rows do not decide" if change > -3 else ""
    if not len(bound):
        return undecided or NO_CAUSE
    before, after = bound[:, :2].mean(axis=0)
    powers = f"{before:.2f} before and {after:.2f} after"
    if not (before > after if flatter else after > before):
        why = f"the bound of every reception falls with {powers}, so the geometry has no such bend"
    else:
        why = f"the bound of every reception has it, {powers}"
        why += "" if undecided else f", so it is the estimator{_beside_bound(rows)}"
    return f"{undecided}; {why}" if undecided else why


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
            by_then = f"at {speed:g} m/s the ship has sailed {sailed / LEG_M:.1f} legs by then"
            words = f"Errors of a {name} beacon fall fast up to {AT[sweep].format(bend)}, then slowly (4.3.1, 4.4)."
            yield _bend(words, chosen, sweep, (low, bend, high), True, by_then)


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
            there = f"at {speed:g} m/s the ship is there after {place_m:.0f} m, and has sailed {sailed:.0f} m by then"
            claim = f"{words} {AT[sweep].format(bend)} (4.3.{scenario})."
            yield _bend(claim, chosen, sweep, (low, bend, high), False, there)


def _between_scenarios(rows: pd.DataFrame) -> Iterator[Claim]:
    yield _ratio(
        "Scenario 1 is best of the still ones, as every leg has a closest point to its beacon (4.3.4).",
        rows,
        lambda part: _best_of(_paired(part, "rmse_3d_m"), [2, 3], 1),
        "the better of 2 and 3 has {:.2f} times its error",
    )
    yield _ratio(
        "A moving beacon is known far worse than a still one (4.4).",
        rows,
        _moving_over_still,
        "its error is {:.1f} times as great",
        _at_equal_times(rows),
    )
    yield _ratio(
        "With 25 m the present position follows the beacon in scenario 5 only (4.4.2).",
        rows[rows.gps_rms_m == 25.0],
        lambda part: _best_of(_paired(part.assign(now=_now(part, "rmse_now")), "now"), [4, 6], 5),
        "the better of 4 and 6 has {:.2f} times its error",
        "; the thesis itself puts it down to the errors drawn",
    )


def _best_of(error: pd.DataFrame, others: list[int], one: int) -> Sequence[float] | pd.Series:
    """The least error of other scenarios over that of one; nothing where a scenario is missing."""
    return error[others].min(axis=1) / error[one] if {one, *others} <= set(error.columns) else []


def _moving_over_still(rows: pd.DataFrame) -> Sequence[float] | np.ndarray:
    middle = rows.groupby(["scenario", "sweep", "gps_rms_m"]).rmse_3d_m.median().unstack("scenario")
    pairs = [(one, one + 3) for one in STILL if {one, one + 3} <= set(middle.columns)]
    return np.concatenate([middle[moving] / middle[still] for still, moving in pairs]) if pairs else []


def _at_equal_times(rows: pd.DataFrame) -> str:
    """What the ratio of a moving beacon's errors to a still one's is where both are heard for as long, in words."""
    ratios, longer = [], []
    for _, curves in rows.groupby(["sweep", "gps_rms_m"]):
        lines = {
            one: curve.assign(time=curve.experiments * curve.spacing).sort_values("time")
            for one, curve in curves.groupby("scenario")
        }
        for still in set(STILL) & set(lines):
            if still + 3 in lines:
                one, other = lines[still], lines[still + 3]
                both = one.time[one.time.between(other.time.min(), other.time.max())]
                moving = np.interp(both, other.time, np.log(other.rmse_3d_m))
                ratios.extend(np.exp(moving - np.log(one.rmse_3d_m[both.index])))
                longer.append(other.time.median() / one.time.median())
    middle, count = _median(ratios)
    if not count:
        return ""
    return (
        f"; its points collect {np.median(longer):.1f} times as long, and at equal times its error is {middle:.1f} "
        f"times as great (median of {count})"
    )


def _now(rows: pd.DataFrame, key: str) -> np.ndarray:
    """Size of an error or bound of the present position."""
    return np.linalg.norm(rows[[f"{key}.{axis}" for axis in "xyz"]].to_numpy(float), axis=1)


def _present_position(rows: pd.DataFrame) -> Iterator[Claim]:
    moving = rows[rows.scenario.isin(MOVING)]
    if not len(moving):
        yield from (Claim(SUM, None), Claim(WORSE, None))
        return
    yield _ratio(
        SUM,
        moving,
        lambda part: np.hypot(part.rmse_3d_m, _carried(part)) / _now(part, "rmse_now"),
        "start and carried velocity, as if independent, err {:.1f} times as much",
    )
    curves = [
        curve.sort_values(str(sweep))
        for (_, sweep, _), curve in moving.assign(
            now=_now(moving, "crlb_now"), carried=_carried(of_bound(moving))
        ).groupby(CURVE)
    ]
    rises = np.array([_greatest_rise(curve.now.to_numpy()) for curve in curves])
    yield Claim(
        WORSE,
        bool((rises > SLIGHT).any()),
        f"the bound of every reception rises by over {100 * (SLIGHT - 1):.0f} % on {np.sum(rises > SLIGHT)} of "
        f"{len(rises)} curves, by {100 * (rises.max() - 1):.1f} % at most",
        _why_never_worse([curve.carried.to_numpy() for curve in curves]),
    )


def _carried(rows: pd.DataFrame) -> np.ndarray:
    """Error of the velocity times the time that it is carried over; NaN where rows tell no velocity."""
    names = [f"rmse.v{axis}" for axis in "xyz"]
    if not set(names) <= set(rows.columns):
        return np.full(len(rows), np.nan)
    duration = INTERVAL_S * rows.experiments * rows.spacing
    return (duration * np.linalg.norm(rows[names].to_numpy(float), axis=1)).to_numpy()


def _why_never_worse(carried: list[np.ndarray]) -> str:
    told = [values[np.isfinite(values)] for values in carried]
    told = [values for values in told if len(values) > 1]
    falls = sum(values[-1] < values[0] for values in told)
    if not told or falls < len(told):
        return NO_CAUSE
    return (
        f"the velocity's bound times the time that it is carried over falls on all {len(told)} curves: "
        "what is gained in velocity outweighs the longer time"
    )


def _greatest_rise(bound: np.ndarray) -> float:
    """Greatest ratio of a value to the least before it; 1 where it only falls."""
    bound = bound[np.isfinite(bound)]
    return float(np.max(bound / np.minimum.accumulate(bound), initial=1.0))
