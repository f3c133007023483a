"""Tab "Crossover": from a T-file through four gates to the tracks that two arrays both saw."""

from __future__ import annotations

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.noise_views import NoiseViews
from dashboards.pictures.pair_matrix import PairMatrix
from dashboards.pictures.range_plan import RangePlan
from dashboards.pictures.track_views import AGAINST, TrackViews
from dashboards.session import same_set
from dashboards.tabs.crossover_edits import PointEditing
from dashboards.tabs.crossover_rays import RadialPage
from dashboards.tabs.crossover_words import (
    EMPTY,
    doubts_words,
    gap_table,
    gate_table,
    mode_name,
    noise_words,
    remarks,
    sentence,
)
from dashboards.tabs.pages import Pages, above, button, fill, words
from dashboards.tabs.tab import Tab, alone, choice, heading, number
from trackerlib.crossover.gaps import summarise_gap
from trackerlib.crossover.gating import GAP_COUNTS, MAX_SLANT_RANGE_FT, gate_mode_and_flag
from trackerlib.crossover.noise import ResidualNoise, residual_noise
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.straight_line import fit_straight_line
from trackerlib.rangefiles.crossover_file import crossover_file_name, crossover_text
from trackerlib.textfiles import InputError

VECTORS = {"not drawn": 0.0, "as long as they are": 1.0, "10 times as long": 10.0, "50 times as long": 50.0}
RANGE, SET, RAYS, NOISE = "Range", "Set", "Rays", "Noise"


class CrossoverTab(Tab):
    """Gates with their counts, the pair and pass to look at, both versions of its track."""

    title = "Crossover"
    watches = ("tfile", "survey", "gating", "crossover", "edits", "profile", "max_slant_range_ft")

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.views = TrackViews()
        self.plan, self.matrix = RangePlan(), PairMatrix()
        self.noise_views = NoiseViews(self.views.points)
        self.rays = RadialPage(self.session)
        self.editing = PointEditing(self.session, self._take_selection)
        self.selected_counts: frozenset[int] = frozenset()
        self._set: CrossoverSet | None = None
        self._noise: ResidualNoise | None = None
        self._quiet = False
        self._make_controls()
        self._make_pages()
        self.words, self.selection, self.gates, self.remarks = words("14px"), words(), words(), words()
        self._link()

    # -- parts ---------------------------------------------------------------------------------

    def _make_controls(self) -> None:
        session = self.session
        self.vehicle = _select("Vehicle", "Which vehicle's reports are gated: the mode in column 68")
        self.pair = _select("Array pair", "Two arrays that saw the vehicle at the same point counts")
        self.passing = _select("Pass", "A pass ends where point counts jump by more than the gap")
        self.earlier = button("Previous", lambda: self._step(-1))
        self.later = button("Next", lambda: self._step(1), margin=(4, 4))
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
        self.defaults = button(
            "Defaults",
            lambda: self._edit(max_slant_range_ft=MAX_SLANT_RANGE_FT, gap_counts=GAP_COUNTS),
            variant="text",
        )
        self.pair.param.watch(lambda event: self._choose_pair(event.new), "value")
        self.passing.param.watch(lambda event: self._choose(event.new), "value")
        for widget, name in (
            (self.vehicle, "mode"),
            (self.max_slant_range, "max_slant_range_ft"),
            (self.gap_counts, "gap_counts"),
        ):
            widget.param.watch(lambda event, name=name: self._edit(**{name: event.new}), "value")

    def _make_pages(self) -> None:
        self.against = choice("Gap against", {name: name for name in AGAINST}, next(iter(AGAINST)))
        self.against.param.watch(lambda event: self.views.gap_against(event.new), "value")
        self.vectors = choice("Gap vectors", VECTORS, 10.0)
        self.vectors.param.watch(lambda event: self.views.scale_vectors(event.new), "value")
        self.views.scale_vectors(self.vectors.value)
        noise = self.noise_views
        self.noise_words = words()
        self.pages = Pages(
            {
                RANGE: above(fill(self.plan.figure), fill(self.matrix.figure), sizes=(58, 42)),
                SET: above(fill(self.views.plan), fill(self.views.side), fill(self.views.gap)),
                RAYS: self.rays.pane,
                NOISE: above(
                    pn.Row(fill(noise.level), fill(noise.upright), sizing_mode="stretch_both", margin=0),
                    pn.Row(*map(fill, noise.correlations), sizing_mode="stretch_both", margin=0),
                ),
            }
        )
        self.pages.on_show(self._show_page)

    def _link(self) -> None:
        """A selection in one picture is one in all; a click on a pair chooses it."""
        self.views.points.selected.on_change("indices", lambda attr, old, new: self._selected())
        self.plan.tracks.selected.on_change("indices", lambda attr, old, new: self._selected_on_range(new))
        for source in (self.plan.overlaps, self.matrix.source):
            source.selected.on_change("indices", lambda attr, old, new, one=source: self._clicked(one, new))

    # -- layout --------------------------------------------------------------------------------

    def controls(self):
        return [
            heading("Set"),
            self.vehicle,
            self.pair,
            self.passing,
            pn.Row(self.earlier, self.later, margin=0),
            heading("Selected points"),
            *self.editing.controls(),
        ]

    def more(self):
        return {
            "Gates": [self.max_slant_range, self.gap_counts, self.defaults],
            "Pictures": [self.against, self.vectors],
            **self.editing.more(),
        }

    def picture(self):
        return self.pages

    def answer(self):
        return pn.Column(
            self.words,
            self.selection,
            self.noise_words,
            self.editing.list,
            self.gates,
            self.remarks,
            margin=0,
        )

    # -- what is shown -------------------------------------------------------------------------

    def refresh(self, changed):
        session = self.session
        self._show_controls()
        if session.gating is None:
            missing = "array table" if session.tfile is not None else "T-file"
            self.words.object = EMPTY if session.tfile is None else f"{EMPTY} The {missing} is missing."
            return
        if changed & {"gating", "survey", "tfile"}:
            self._show_run()
        if changed & {"gating", "edits"}:
            self.editing.show()
        if session.crossover is not self._set or changed & {"edits", "survey", "profile"}:
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
        at = next((k for k, s in enumerate(sets) if same_set(s, chosen)), None)
        self.pair.param.update(
            options={f"{a} and {b} · {points} points": (a, b) for (a, b), points in pairs.items()},
            value=None if chosen is None else chosen.pair,
        )
        self.passing.param.update(options=passes, value=at)
        self.earlier.disabled = at is None or at == 0
        self.later.disabled = at is None or at == len(sets) - 1

    def _show_run(self) -> None:
        """The range, the pairs and the gates."""
        session = self.session
        gating = session.gating
        if session.tfile is not None:
            self.gates.object = gate_table(gating)
            self.remarks.object = remarks(gating)
        reports = None if session.tfile is None else gate_mode_and_flag(session.tfile.reports, gating.mode)
        if session.survey is not None:
            self.plan.show(session.survey, session.max_slant_range_ft, gating.sets, reports)
        self.matrix.show(gating.sets, None if session.crossover is None else session.crossover.pair)
        self.plan.choose(session.crossover)

    def _show_set(self, crossover: CrossoverSet | None) -> None:
        same = same_set(crossover, self._set) if crossover is not None else False
        kept_selection = self.selected_counts if same else frozenset()
        self._set = crossover
        self.views.points.selected.indices = []
        self.plan.choose(crossover)
        if crossover is None:
            self.matrix.choose(None)
            self.views.clear()
            self.noise_views.show(None, np.zeros(0), np.zeros(0, bool))
            self.noise_words.object = ""
            self.words.object = (
                "<b>No two arrays saw this vehicle at one point count.</b> Try another vehicle."
            )
            return
        self.matrix.choose(crossover.pair)
        left_out = self.session.left_out(crossover)
        self._draw(crossover, left_out)
        self.words.object = sentence(crossover, self.session.gating, self.session.simulated, left_out)
        if self.session.survey is not None:
            self.words.object += doubts_words(crossover, self.session.survey)
        rows = np.flatnonzero(np.isin(crossover.point_count, list(kept_selection)))
        self.views.points.selected.indices = rows.tolist()
        self._show_page()

    def _draw(self, crossover: CrossoverSet, left_out: np.ndarray) -> None:
        """Both versions, their lines, their noise."""
        far = far_points(crossover, left_out)
        keep = ~(far | left_out)
        self._noise, reason = noise_of(crossover, keep)
        residuals = None if self._noise is None else (self._noise.residual_x, self._noise.residual_y)
        self.views.show(
            crossover,
            excluded=~keep,
            lines=straight_lines(crossover, keep),
            why=self._why(crossover, left_out, far),
            places=self._places(crossover),
            residuals=residuals,
        )
        self.views.gap_against(self.against.value)
        self.noise_views.show(self._noise, crossover.point_count, keep)
        self._noise_text = noise_words(self._noise, crossover.pair, reason)

    def _why(self, crossover: CrossoverSet, left_out: np.ndarray, far: np.ndarray) -> np.ndarray:
        """Words (T,) on each point: whether it is used, and if not, why."""
        reasons, mode = self.session.edits.reasons, self.session.gating.mode
        by_hand = [reasons.get((mode, *crossover.pair, int(count)), "") for count in crossover.point_count]
        said = [f"left out: {reason}" if out else "" for reason, out in zip(by_hand, left_out, strict=True)]
        return np.where(left_out, said, np.where(far, "far off", "used"))

    def _places(self, crossover: CrossoverSet) -> np.ndarray | None:
        survey = self.session.survey
        try:
            return None if survey is None else np.stack([survey.position_of(n) for n in crossover.pair])
        except InputError:  # an array that the table lacks has no range
            return None

    def _show_page(self) -> None:
        """What stands at the right for the picture in sight."""
        self.noise_words.object = (
            self._noise_text if self.pages.shown == NOISE and self._set is not None else ""
        )
        if self.pages.shown == RAYS:
            rows = self.views.points.selected.indices
            self.rays.show(rows[0] if rows and self._set is not None else None)

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
        if not same_set(chosen, self.session.crossover):
            self.session.edit(crossover=chosen, correction=None)

    def _choose_pair(self, pair: tuple[int, int] | None) -> None:
        if self._quiet or pair is None:
            return
        index = next((k for k, one in enumerate(self.session.gating.sets) if one.pair == tuple(pair)), None)
        if index is None:
            self.session.say(f"Arrays {pair[0]} and {pair[1]} never saw this vehicle at one point count")
        self._choose(index)

    def _clicked(self, source, rows: list[int]) -> None:
        """A click on a pair of arrays, in the plan or the matrix."""
        if not rows:
            return
        pairs = [tuple(sorted((source.data["first"][k], source.data["second"][k]))) for k in rows]
        seen = [pair for pair in pairs if any(one.pair == pair for one in self.session.gating.sets)]
        source.selected.indices = []
        if self.session.crossover is None or self.session.crossover.pair not in seen:
            self._choose_pair((seen or pairs)[0])

    def _step(self, by: int) -> None:
        sets, chosen = self.session.gating.sets, self.session.crossover
        at = next(k for k, one in enumerate(sets) if same_set(one, chosen))
        self._choose(min(max(at + by, 0), len(sets) - 1))

    def _selected_on_range(self, rows: list[int]) -> None:
        """Points selected on the range plan, as rows of the chosen set."""
        if self._set is not None and rows:
            counts = self.plan.counts_of(rows)
            found = np.flatnonzero(np.isin(self._set.point_count, counts))
            self.views.points.selected.indices = found.tolist()

    def _take_selection(self) -> np.ndarray:
        rows = np.sort(np.array(self.views.points.selected.indices, dtype=int))
        self.views.points.selected.indices = []
        self.plan.tracks.selected.indices = []
        return rows

    def _selected(self) -> None:
        """Says what is selected; the point counts are kept, not the rows."""
        index = np.array(self.views.points.selected.indices, dtype=int)
        crossover = self._set
        self.selected_counts = frozenset()
        if crossover is not None:
            self.selected_counts = frozenset(crossover.point_count[index].tolist())
        self.plan.mark(crossover, index)
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


# -- numbers of a set -----------------------------------------------------------------------------


def far_points(crossover: CrossoverSet, left_out: np.ndarray) -> np.ndarray:
    """Which points (T,) lie far from the rest, of those that are not left out."""
    far = np.zeros(crossover.points, bool)
    if not left_out.all():
        far[~left_out] = summarise_gap(crossover.only(~left_out)).far
    return far


def straight_lines(crossover: CrossoverSet, keep: np.ndarray | None = None) -> np.ndarray | None:
    """Ends (2, 2, 3) of both versions' straight lines, None where fewer than two points are kept."""
    keep = np.ones(crossover.points, bool) if keep is None else keep
    if keep.sum() < 2:
        return None
    ends = crossover.point_count[[0, -1]]
    return np.stack(
        [fit_straight_line(t, crossover.point_count, keep).at(ends) for t in (crossover.x, crossover.y)]
    )


def noise_of(crossover: CrossoverSet, keep: np.ndarray) -> tuple[ResidualNoise | None, str]:
    """Noise of the points kept about smooth courses; or None and the reason."""
    try:
        return residual_noise(crossover.x, crossover.y, crossover.point_count, keep, degree=None), ""
    except ValueError as error:
        return None, str(error)


def _pass_name(crossover: CrossoverSet) -> str:
    first, last = crossover.point_count[[0, -1]]
    return f"{crossover.pass_number} · counts {first} to {last} · {crossover.points} points"


def _select(label: str, tip: str):
    return pmui.Select(
        label=label, options=[], description=tip, size="small", sizing_mode="stretch_width", margin=(5, 8)
    )


alone(__name__, "dashboards.tabs.crossover:CrossoverTab")
