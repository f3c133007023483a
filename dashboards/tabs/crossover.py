"""Tab "Crossover": from a T-file through four gates to the tracks that two arrays both saw."""

from __future__ import annotations

import html

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.track_views import TrackViews
from dashboards.session import MODE_NAMES
from dashboards.tabs.tab import Tab, alone, heading, number
from trackerlib.crossover.gaps import summarise_gap
from trackerlib.crossover.gating import GAP_COUNTS, MAX_SLANT_RANGE_FT, GatingResult
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.smooth_track import is_curved
from trackerlib.crossover.straight_line import fit_straight_line
from trackerlib.rangefiles.crossover_file import crossover_file_name, crossover_text

EMPTY = (
    "<b>No range run is open.</b> File, Open… reads a T-file and its array table; "
    "File, Open simulated range run shows one that comes with the program."
)
AXES = ("downrange", "crossrange", "vertical")
LISTED = 12  # bad lines and repeats that are listed before "and so many more"


class CrossoverTab(Tab):
    """Gates with their counts, the pair and pass to look at, both versions of its track."""

    title = "Crossover"
    watches = ("tfile", "survey", "gating", "crossover")

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.views = TrackViews()
        self.views.points.selected.on_change("indices", lambda attr, old, new: self._selected())
        self.selected_counts: frozenset[int] = frozenset()
        self._set: CrossoverSet | None = None
        self._quiet = False
        self._make_controls()
        self.words = _words("14px")
        self.selection = _words("13px")
        self.gates = _words("13px")
        self.remarks = _words("13px")

    def _make_controls(self) -> None:
        session = self.session
        self.vehicle = _select("Vehicle", "Which vehicle's reports are gated: the mode in column 68")
        self.pair = _select("Array pair", "Two arrays that saw the vehicle at the same point counts")
        self.passing = _select("Pass", "A pass ends where point counts jump by more than the gap")
        self.earlier = pmui.Button(label="Previous", size="small", variant="outlined", margin=(4, 4, 4, 8))
        self.later = pmui.Button(label="Next", size="small", variant="outlined", margin=(4, 4))
        self.max_slant_range = number(
            "Greatest slant range (ft)",
            session.max_slant_range_ft,
            f"Reports farther from their own array are dropped; {MAX_SLANT_RANGE_FT:.0f} unless told",
            start=100.0,
            step=100.0,
        )
        self.gap_counts = number(
            "Gap that ends a pass (counts)",
            session.gap_counts,
            f"Point counts may jump by so many within a pass; {GAP_COUNTS} unless told",
            start=1,
        )
        self.defaults = pmui.Button(label="Defaults", size="small", variant="text", margin=(2, 8))
        self.defaults.on_click(
            lambda event: self._edit(max_slant_range_ft=MAX_SLANT_RANGE_FT, gap_counts=GAP_COUNTS)
        )
        self.earlier.on_click(lambda event: self._step(-1))
        self.later.on_click(lambda event: self._step(1))
        self.pair.param.watch(lambda event: self._choose_pair(event.new), "value")
        self.passing.param.watch(lambda event: self._choose(event.new), "value")
        for widget, name in (
            (self.vehicle, "mode"),
            (self.max_slant_range, "max_slant_range_ft"),
            (self.gap_counts, "gap_counts"),
        ):
            widget.param.watch(lambda event, name=name: self._edit(**{name: event.new}), "value")

    # -- layout --------------------------------------------------------------------------------

    def controls(self):
        return [
            heading("Set"),
            self.vehicle,
            self.pair,
            self.passing,
            pn.Row(self.earlier, self.later, margin=0),
            heading("Gates"),
            self.max_slant_range,
            self.gap_counts,
            self.defaults,
        ]

    def picture(self):
        return pn.pane.Bokeh(self.views.plan, sizing_mode="stretch_both", margin=0)

    def strips(self):
        return [
            pn.pane.Bokeh(figure, sizing_mode="stretch_both", margin=0)
            for figure in (self.views.side, self.views.gap)
        ]

    def answer(self):
        return pn.Column(self.words, self.selection, self.gates, self.remarks, margin=0)

    def refresh(self, changed):
        session = self.session
        self._show_controls()
        if session.gating is None:
            missing = "array table" if session.tfile is not None else "T-file"
            self.words.object = EMPTY if session.tfile is None else f"{EMPTY} The {missing} is missing."
            return
        if "gating" in changed:
            self.gates.object = gate_table(session.gating)
            self.remarks.object = remarks(session.gating)
        if session.crossover is not self._set:
            self._show_set(session.crossover)

    def _show_controls(self) -> None:
        session = self.session
        self._quiet = True
        try:
            self.max_slant_range.value = session.max_slant_range_ft
            self.gap_counts.value = session.gap_counts
            if session.tfile is not None:
                modes = sorted({int(mode) for mode in np.unique(session.tfile.reports.mode)} | {session.mode})
                self.vehicle.param.update(options={mode_name(m): m for m in modes}, value=session.mode)
            if session.gating is not None:
                self._show_choice(session.gating.sets, session.crossover)
        finally:
            self._quiet = False

    def _show_choice(self, sets: tuple[CrossoverSet, ...], chosen: CrossoverSet | None) -> None:
        pairs = {one.pair: 0 for one in sets}
        for one in sets:
            pairs[one.pair] += one.points
        passes = (
            {} if chosen is None else {_pass_name(s): k for k, s in enumerate(sets) if s.pair == chosen.pair}
        )
        at = next((k for k, s in enumerate(sets) if chosen is not None and _same(s, chosen)), None)
        self.pair.param.update(
            options={f"{a} and {b} · {points} points": (a, b) for (a, b), points in pairs.items()},
            value=None if chosen is None else chosen.pair,
        )
        self.passing.param.update(options=passes, value=at)
        self.earlier.disabled = at is None or at == 0
        self.later.disabled = at is None or at == len(sets) - 1

    def _show_set(self, crossover: CrossoverSet | None) -> None:
        self._set = crossover
        self.views.points.selected.indices = []
        if crossover is None:
            self.views.clear()
            self.words.object = (
                "<b>No two arrays saw this vehicle at one point count.</b> Try another vehicle."
            )
            return
        self.views.show(crossover, excluded=summarise_gap(crossover).far, lines=straight_lines(crossover))
        self.words.object = sentence(crossover, self.session.gating, self.session.simulated)

    # -- what the analyst does -----------------------------------------------------------------

    def _edit(self, **changes) -> None:
        """Changes how the reports are gated, so that Undo takes it back."""
        if self._quiet or any(value is None for value in changes.values()):
            return
        if any(getattr(self.session, name) != value for name, value in changes.items()):
            try:
                self.session.edit(**changes)
            except ValueError as error:
                self.session.report(error)
                self._show_controls()

    def _choose(self, index: int | None) -> None:
        if self._quiet or index is None:
            return
        chosen = self.session.gating.sets[index]
        if self.session.crossover is None or not _same(chosen, self.session.crossover):
            self.session.edit(crossover=chosen, correction=None)

    def _choose_pair(self, pair: tuple[int, int] | None) -> None:
        if not self._quiet and pair is not None:
            self._choose(next(k for k, one in enumerate(self.session.gating.sets) if one.pair == tuple(pair)))

    def _step(self, by: int) -> None:
        sets, chosen = self.session.gating.sets, self.session.crossover
        at = next(k for k, one in enumerate(sets) if _same(one, chosen))
        self._choose(min(max(at + by, 0), len(sets) - 1))

    def _selected(self) -> None:
        """Says what is selected; the point counts are kept, not the rows."""
        index = np.array(self.views.points.selected.indices, dtype=int)
        crossover = self._set
        self.selected_counts = frozenset()
        if crossover is not None:
            self.selected_counts = frozenset(crossover.point_count[index].tolist())
        if not len(index) or crossover is None:
            self.selection.object = ""
            return
        part = crossover.only(np.sort(index))
        self.selection.object = (
            f"<b>{part.points} selected</b>, counts {part.point_count[0]} to {part.point_count[-1]}"
            + gap_table(part)
        )

    def export(self):
        if self._set is None:
            return None
        return crossover_file_name(self._set), crossover_text(self._set)


# -- words and pictures of results ----------------------------------------------------------------


def straight_lines(crossover: CrossoverSet) -> np.ndarray | None:
    """Ends (2, 2, 3) of both versions' straight lines, None for a single point count."""
    if crossover.points < 2:
        return None
    ends = crossover.point_count[[0, -1]]
    keep = ~summarise_gap(crossover).far
    keep = keep if keep.sum() > 1 else None
    return np.stack(
        [fit_straight_line(t, crossover.point_count, keep).at(ends) for t in (crossover.x, crossover.y)]
    )


def sentence(crossover: CrossoverSet, gating: GatingResult, simulated: bool) -> str:
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
    far = int(summarise_gap(crossover).far.sum())
    words += gap_table(crossover)
    if far:
        words += (
            f"{far} {'point lies' if far == 1 else 'points lie'} far off (grey crosses) and "
            f"{'does' if far == 1 else 'do'} not count in the lines. "
        )
    if is_curved(crossover.x, crossover.point_count) or is_curved(crossover.y, crossover.point_count):
        words += "The vehicle turns or changes speed here: a straight line is no model of this track."
    return words


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
    return f"{MODE_NAMES[mode]} (mode {mode})" if mode in MODE_NAMES else f"vehicle of mode {mode}"


def _folded(title: str, lines: list[str]) -> str:
    if not lines:
        return ""
    rest = f"<li>… and {len(lines) - LISTED} more</li>" if len(lines) > LISTED else ""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines[:LISTED])
    return f"<details><summary>{title}</summary><ul style='padding-left:18px'>{items}{rest}</ul></details>"


def _spread(spread: float) -> str:
    return f"{spread:.1f} ft" if np.isfinite(spread) else "not known"


def _pass_name(crossover: CrossoverSet) -> str:
    first, last = crossover.point_count[[0, -1]]
    return f"{crossover.pass_number} · counts {first} to {last} · {crossover.points} points"


def _same(one: CrossoverSet, other: CrossoverSet) -> bool:
    return one.pair == other.pair and one.pass_number == other.pass_number


def _words(size: str):
    return pn.pane.HTML(sizing_mode="stretch_width", margin=(6, 10), styles={"font-size": size})


def _select(label: str, tip: str):
    return pmui.Select(
        label=label, options=[], description=tip, size="small", sizing_mode="stretch_width", margin=(5, 8)
    )


alone(__name__, "dashboards.tabs.crossover:CrossoverTab")
