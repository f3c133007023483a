"""What the Crossover tab says: of the chosen set, of its noise, of the gates, of the edits."""

from __future__ import annotations

import html

import numpy as np

from dashboards.session import MODE_NAMES
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.doubts import profile_doubts, set_doubts
from trackerlib.crossover.edits import PointEdits
from trackerlib.crossover.gaps import summarise_gap
from trackerlib.crossover.gating import GatingResult
from trackerlib.crossover.noise import ResidualNoise
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.smooth_track import is_curved
from trackerlib.crossover.straight_line import MIN_POINTS
from trackerlib.crossover.survey import ArraySurvey

EMPTY = (
    "<b>No range run is open.</b> File, Open… reads a T-file and its array table; "
    "File, Open simulated range run shows one that comes with the program."
)
AXES = ("downrange", "crossrange", "vertical")
LISTED = 12  # bad lines, repeats and edits that are listed before "and so many more"


def sentence(crossover: CrossoverSet, gating: GatingResult, simulated: bool, left_out: np.ndarray) -> str:
    """What the chosen set is and how far apart its two versions lie, as HTML."""
    a, b = crossover.pair
    first, last = crossover.point_count[[0, -1]]
    passes = sum(one.pair == crossover.pair for one in gating.sets)
    points = "1 point count" if crossover.points == 1 else f"{crossover.points} point counts"
    words = (
        f"<b>Arrays {a} and {b} both saw the {mode_name(gating.mode)} at {points}</b>, {first} to {last}, "
        f"pass {crossover.pass_number} of {passes}{' (simulated)' if simulated else ''}. "
        f"Array {a}'s version less array {b}'s is:"
    )
    kept = crossover.only(~left_out)
    if not kept.points:
        return words + " nothing, for every point is left out by hand. Restore some to go on."
    lies_far = summarise_gap(kept).far
    far = int(lies_far.sum())
    words += gap_table(kept)
    if left_out.any():
        words += f"{counted(int(left_out.sum()), 'is', 'are')} left out by hand. "
    if far:
        does = "does" if far == 1 else "do"
        words += f"{counted(far, 'lies', 'lie')} far off (grey crosses) and {does} not count in the lines. "
    if crossover.points < MIN_POINTS:
        words += f"So few points tell no noise: that takes {MIN_POINTS}. "
    return words + _bent_words(kept.only(~lies_far))


def _bent_words(crossover: CrossoverSet) -> str:
    """Which versions of a track a straight line is no model of, and why that may be; nothing where none bends."""
    bent = [
        number
        for number, track in zip(crossover.pair, (crossover.x, crossover.y), strict=True)
        if is_curved(track, crossover.point_count)
    ]
    if not bent:
        return ""
    whose = f"Array {bent[0]}'s version bends" if len(bent) == 1 else "Both versions bend"
    return (
        f"{whose}: a straight line is no model of the track as reported. The vehicle turns or changes speed here, or "
        "its clock's offset bends what an array near the track reports; Timing tells which."
    )


def doubts_words(
    crossover: CrossoverSet, survey: ArraySurvey, profile: SoundSpeedProfile | None = None
) -> str:
    """What is odd about a set, and of its profile where one is told, asked in words, as HTML."""
    doubts = set_doubts(crossover, survey)
    if profile is not None:
        doubts = doubts + profile_doubts(profile, survey, crossover.pair)
    return "".join(f" <b>{html.escape(one[:1].upper() + one[1:])}</b>" for one in doubts)


def gap_table(crossover: CrossoverSet) -> str:
    """Median gap and its spread by component, as HTML."""
    summary = summarise_gap(crossover)
    rows = "".join(
        f"<tr><td>{axis}</td><td align=right>{median:.1f} ft</td><td align=right>{_spread(spread)}</td></tr>"
        for axis, median, spread in zip(AXES, summary.median, summary.spread, strict=True)
    )
    return (
        "<table style='margin:4px 0'><tr><th align=left>gap</th><th align=right>median</th>"
        f"<th align=right>&nbsp; one point's spread</th></tr>{rows}</table>"
    )


def gate_table(gating: GatingResult) -> str:
    """The gates in a row with what each kept, as HTML bars."""
    counts = gating.counts
    rows = (
        ("records read", counts.records_read),
        (f"{mode_name(gating.mode)}, no edit mark", counts.kept_mode),
        ("two or more arrays", counts.kept_paired),
        ("slant range", counts.kept_range),
        ("paired again", counts.kept_repaired),
        ("repeats chosen", counts.kept_repaired - counts.repeats_left_out),
    )
    bars = "".join(
        f"<tr><td>{html.escape(name)}</td><td align=right>&nbsp;{kept:,}</td><td style='width:40%'><div "
        f"style='background:#0072B2;height:9px;width:{100 * kept / max(counts.records_read, 1):.1f}%'></div></td></tr>"
        for name, kept in rows
    )
    return f"<b>Gates</b><table style='width:100%'>{bars}</table>"


def remarks(gating: GatingResult) -> str:
    """Warnings, lines that could not be read and repeats, folded, as HTML."""
    parts = [f"<p>{html.escape(warning)}</p>" for warning in gating.warnings]
    bad = [f"line {record.line}: {record.why}" for record in gating.bad_records]
    repeats = [
        f"array {c.array}, count {c.point_count}: line {c.kept_line} kept ({c.kept_distance_ft:.1f} ft from its own "
        f"track), line {', '.join(map(str, c.dropped_lines))} not ({c.dropped_distances_ft[0]:.1f} ft)"
        for c in gating.choices
    ]
    parts.append(_folded(f"{len(bad)} lines could not be read", bad))
    parts.append(_folded(f"{len(repeats)} times an array reported twice at a count", repeats))
    return "".join(parts)


def mode_name(mode: int) -> str:
    """A vehicle's name for its mode."""
    if mode in MODE_NAMES:
        return f"{MODE_NAMES[mode]} (mode {mode})"
    return f"vehicle of mode {mode}" if mode else "vehicle"  # 0: of sets that were gated elsewhere


def _folded(title: str, lines: list[str]) -> str:
    if not lines:
        return ""
    rest = f"<li>… and {len(lines) - LISTED} more</li>" if len(lines) > LISTED else ""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines[:LISTED])
    return f"<details><summary>{title}</summary><ul style='padding-left:18px'>{items}{rest}</ul></details>"


def _spread(spread: float) -> str:
    return f"{spread:.1f} ft" if np.isfinite(spread) else "not known"


def counted(count: int, one: str, many: str) -> str:
    """So many points, with the verb for one or for more."""
    return f"1 point {one}" if count == 1 else f"{count} points {many}"


def noise_words(noise: ResidualNoise | None, pair: tuple[int, int], reason: str) -> str:
    """Covariances of both versions and of their gap, as HTML tables; or the reason why there are none."""
    if noise is None:
        return f"<b>No noise can be told:</b> {html.escape(reason)}."
    course = "a straight line" if noise.degree == 1 else f"a smooth course of degree {noise.degree}"
    deviation = np.sqrt(np.diag(noise.gap))
    words = (
        f"About {course} the gap of one point scatters by {deviation[0]:.1f} ft downrange, {deviation[1]:.1f} ft "
        f"crossrange and {deviation[2]:.1f} ft vertically (from {noise.points} points)."
    )
    tables = (
        (f"Covariance of array {pair[0]}, Dx (ft²)", noise.first, ".2f"),
        (f"Covariance of array {pair[1]}, Dy (ft²)", noise.second, ".2f"),
        ("Correlation of the two, Rxy", noise.cross_correlation, ".2f"),
        ("Covariance of the gap, M (ft²)", noise.gap, ".2f"),
    )
    return words + "".join(_matrix(*one) for one in tables)


def _matrix(title: str, matrix: np.ndarray, form: str) -> str:
    head = "".join(f"<th align=right>&nbsp;{axis}</th>" for axis in AXES)
    rows = "".join(
        f"<tr><td>{axis}</td>" + "".join(f"<td align=right>{value:{form}}</td>" for value in row) + "</tr>"
        for axis, row in zip(AXES, matrix, strict=True)
    )
    return f"<div style='margin-top:8px'>{title}</div><table><tr><td></td>{head}</tr>{rows}</table>"


def edits_words(edits: PointEdits, mode: int) -> str:
    """The points of a vehicle that are left out by hand, as HTML."""
    lines = [
        f"arrays {first} and {second}, count {count}: {reason or 'no reason told'}"
        for (vehicle, first, second, count), reason in edits.reasons.items()
        if vehicle == mode
    ]
    return _folded(f"{len(lines)} left out by hand", lines[::-1]) or "No point is left out by hand."
