"""Two versions of one track in plan and from the side, over one shared source of points."""

from __future__ import annotations

import numpy as np
from bokeh.core.properties import value
from bokeh.models import (
    BoxSelectTool,
    BoxZoomTool,
    ColumnDataSource,
    CustomJS,
    HoverTool,
    LassoSelectTool,
    Range1d,
    Span,
)
from bokeh.plotting import figure

from dashboards.palette import BEFORE, COMPONENTS, FIRST_ARRAY, REJECTED, SECOND_ARRAY, SHIP
from dashboards.pictures.legend import legend_entry, style_legend
from dashboards.pictures.mercator import equal_scale
from trackerlib.crossover.gaps import course_of, distance_along, heading_of, summarise_gap
from trackerlib.crossover.pairs import CrossoverSet

# Of either version, x and y: downrange 0, crossrange 1, vertical 2, and distance along the course s.
TRACK_COLUMNS = tuple(f"{letter}{k}" for letter in "xy" for k in "012s")
GAP_COLUMNS = ("gap0", "gap1", "gap2")
RESIDUAL_COLUMNS = tuple(f"r{letter}{k}" for letter in "xy" for k in range(3))
# What the gap can be drawn against: column, and words for the axis.
AGAINST = {
    "point count": ("count", "point count"),
    "range to the first array": ("range0", "slant range to the first array (ft)"),
    "range to the second array": ("range1", "slant range to the second array (ft)"),
    "depth": ("depth", "depth (ft)"),
    "heading": ("heading", "heading (° from downrange towards crossrange)"),
}
AGAINST_COLUMNS = ("range0", "range1", "depth", "heading")
LINE_COLUMNS = ("linex", "liney")  # of the file, 0 where it is not known
VECTOR_COLUMNS = ("begin0", "begin1", "end0", "end1")
AXIS_NAMES = ("downrange", "crossrange", "vertical")
REPORTED = "as reported"
GAP = "gap"
VERSIONS = (("x", FIRST_ARRAY, "first array", "circle"), ("y", SECOND_ARRAY, "second array", "square"))
# What a point left out changes: its word, for either version its mark, its colour and that of its outline, and for the
# gap its mark and the colour of each component.
LOOK_COLUMNS = ("used", "markx", "marky", "inkx", "inky", "edgex", "edgey", "markg", "ink0", "ink1", "ink2")
# What sliders move is painted over the rest, by itself: Bokeh then leaves axes and grids as they are.
MOVING = "overlay"
# Bokeh keeps an empty element about the points of each renderer, and at every paint a style sheet of its place. Out of
# the page, it makes that style nothing and lay nothing out anew as the points move.
TAKE_OUT = "for (const one of moving) Bokeh.index.find_one(one)?.el.remove()"


class TrackViews:
    """Plan view, side view and gap against point count; a selection in one is a selection in all.

    The side view looks across the first version's course. Wild positions do not set the frames; the wheel
    reaches them.
    """

    def __init__(self):
        names = (
            "count", *LOOK_COLUMNS, *LINE_COLUMNS, *AGAINST_COLUMNS, *RESIDUAL_COLUMNS, *TRACK_COLUMNS, *GAP_COLUMNS
        )  # fmt: skip
        self.points = ColumnDataSource({name: [] for name in names}, name="points")
        self.before = ColumnDataSource({name: [] for name in TRACK_COLUMNS})
        self.lines = ColumnDataSource({name: [] for name in TRACK_COLUMNS}, name="lines")
        self.vectors = ColumnDataSource({name: [] for name in VECTOR_COLUMNS}, name="vectors")
        self.vector_scale = 0.0  # gap vectors are drawn so many times their length; 0: not at all
        self._centre, self._course = np.zeros(3), np.array([1.0, 0.0])
        self._moving = []  # renderers of plan and side view that sliders move
        # What the legend names, in its order: its renderers in plan and side view.
        self._named = {REPORTED: [], VERSIONS[0][2]: [], GAP: [], VERSIONS[1][2]: []}
        self.plan = self._view(
            "plan",
            "downrange (ft)",
            "crossrange (ft)",
            "01",
            x_range=Range1d(0, 1000),
            y_range=Range1d(0, 1000),
        )
        self.home = equal_scale(self.plan)
        self.side = self._view(
            "side",
            "distance along the course (ft)",
            "vertical (ft)",
            "s2",
            x_range=Range1d(0, 1000),
            y_range=Range1d(-1000, 0),
        )
        self.side_home = equal_scale(self.side)
        self._entries = self._legend()
        self.gap = self._gap()
        take_out = CustomJS(args={"moving": [*self._moving, *self._gap_dots]}, code=TAKE_OUT)
        self.points.js_on_change("data", take_out)
        self.aspect(plan=True, side=False)

    # -- figures -------------------------------------------------------------------------------

    def _view(self, name, x_label, y_label, axes, **ranges):
        fig = figure(
            name=name,
            sizing_mode="stretch_both",
            tools="pan,wheel_zoom,box_zoom,box_select,lasso_select,tap,reset,save",
            active_scroll="wheel_zoom",
            x_axis_label=x_label,
            y_axis_label=y_label,
            **ranges,
        )
        for letter, colour, label, marker in VERSIONS:
            h, v = (letter + axis for axis in axes)
            before = fig.scatter(h, v, source=self.before, size=4, color=BEFORE, alpha=0.5, marker=marker)
            line = fig.line(h, v, source=self.lines, color=colour, line_width=1)
            if letter == "x" and name == "plan":
                ends = (f"{end}{axis}" for end in ("begin", "end") for axis in axes)
                vectors = fig.segment(*ends, source=self.vectors, line_color=SHIP, line_alpha=0.7)
                self._named[GAP].append(vectors)
            dots = fig.scatter(
                h,
                v,
                source=self.points,
                size=6,
                fill_color=f"ink{letter}",
                line_color=f"edge{letter}",
                marker=f"mark{letter}",
                nonselection_alpha=0.15,
                level=MOVING,
            )
            self._moving.append(dots)
            self._named[REPORTED].append(before)
            self._named[label] += [line, dots]
            where = f"@{letter}0{{0.0}}, @{letter}1{{0.0}}, @{letter}2{{0.0}} ft"
            tips = [("count", "@count"), (label, where), ("file line", f"@line{letter}"), ("", "@used")]
            fig.add_tools(HoverTool(renderers=[dots], tooltips=tips))
        fig.yaxis.formatter.use_scientific = fig.xaxis.formatter.use_scientific = False
        _lower_frames(fig)
        return fig

    def _legend(self) -> dict:
        """The plan's legend, for the side view too: its entries by name."""
        marks = {REPORTED: {"size": 4, "color": BEFORE, "alpha": 0.5, "marker": "square"}}
        marks |= {label: {"size": 6, "color": ink, "marker": mark} for _, ink, label, mark in VERSIONS}
        marks[GAP] = {"line": True, "line_color": SHIP, "line_alpha": 0.7}
        entries = {
            name: legend_entry(self.plan, name, shown, visible=name not in (REPORTED, GAP), **marks[name])
            for name, shown in self._named.items()
        }
        style_legend(self.plan)
        return entries

    def _gap(self):
        self._gap_dots = []
        fig = figure(
            name="gap",
            sizing_mode="stretch_both",
            tools="xpan,xwheel_zoom,ywheel_zoom,box_select,lasso_select,tap,reset,save",
            active_scroll="xwheel_zoom",
            x_axis_label="point count",
            y_axis_label="first minus second (ft)",
            x_range=Range1d(0, 1000),
            y_range=Range1d(-10, 10),
        )
        for k, (column, label, colour) in enumerate(zip(GAP_COLUMNS, AXIS_NAMES, COMPONENTS, strict=True)):
            dots = fig.scatter(
                "count",
                column,
                source=self.points,
                size=5,
                marker="markg",
                color=f"ink{k}",
                line_color=None,
                nonselection_fill_alpha=0.15,
                level=MOVING,
            )
            tips = [("count", "@count"), (label, f"@{column}{{0.0}} ft"), ("", "@used")]
            self._gap_dots.append(dots)
            legend_entry(fig, label, [dots], size=5, color=colour, line_color=None)
            fig.add_tools(HoverTool(renderers=[dots], tooltips=tips))
        fig.add_layout(Span(location=0, dimension="width", line_color=REJECTED, line_width=1))
        style_legend(fig)
        fig.legend.orientation = "horizontal"
        fig.add_layout(fig.legend[0], "above")
        _lower_frames(fig)
        return fig

    # -- data ----------------------------------------------------------------------------------

    def show(self, crossover: CrossoverSet, x=None, y=None, excluded=None, lines=None, **more) -> None:
        """A set, its tracks moved to x and y (T, 3) where those are given, its straight lines if any.

        excluded : (T,) points that an estimate leaves out
        lines : straight lines (2, 2, 3) of the first and of the second version: their two ends
        more : `why` (T,) words on each point; `places` (2, 3) of the arrays; `residuals`, two of (T, 3)
        """
        x, y = crossover.x if x is None else x, crossover.y if y is None else y
        self._centre, self._course = crossover.x.mean(axis=0), course_of(crossover.x, crossover.point_count)
        excluded = np.zeros(crossover.points, bool) if excluded is None else excluded
        self.points.data = {
            "count": crossover.point_count.astype(np.int32),
            **_looks(excluded, more.get("why")),
            **_beside(crossover, more.get("places"), more.get("residuals")),
            **self._columns(x, y),
        }
        self.lines.data = (
            {name: [] for name in TRACK_COLUMNS} if lines is None else self._tracks(lines[0], lines[1])
        )
        self._name_arrays(crossover.pair)
        self._frame(crossover)
        self._draw_vectors()

    def gap_against(self, name: str) -> None:
        """Draws the gap against one of AGAINST."""
        column, self.gap.xaxis.axis_label = AGAINST[name]
        for dots in self._gap_dots:
            for glyph in (dots.glyph, dots.nonselection_glyph):
                glyph.x = column
        values = np.asarray(self.points.data[column], float)
        values = values[np.isfinite(values)]
        if len(values):
            _set_range(self.gap.x_range, values, room=0.03)

    def aspect(self, plan: bool, side: bool) -> None:
        """Whether one length is as long on both axes of the plan, and of the side view; else they are stretched."""
        for home, true in ((self.home, plan), (self.side_home, side)):
            home.tags = [*home.tags[:4], 0.0 if true else 1.0]

    def scale_vectors(self, scale: float) -> None:
        """Draws gap vectors so many times their length; 0: none."""
        self.vector_scale = scale
        self._draw_vectors()

    def _draw_vectors(self) -> None:
        data = self.points.data
        shown = self.vector_scale > 0 and len(data["count"]) > 0
        self._entries[GAP].update(label=value(f"gap, {self.vector_scale:g} times as long"), visible=shown)
        columns = {}
        for axis in "01":
            x, y = (np.asarray(data[f"{letter}{axis}"], float) if shown else np.zeros(0) for letter in "xy")
            columns |= {f"begin{axis}": x, f"end{axis}": x + self.vector_scale * (y - x)}
        self.vectors.data = columns

    def leave_out(self, excluded: np.ndarray, why=None) -> None:
        """Shows the points where `excluded` (T,) is true as grey crosses; `why` (T,) are words on each point."""
        self.points.data.update(_looks(excluded, why))

    def clear(self) -> None:
        """Nothing to see."""
        for source in (self.points, self.before, self.lines, self.vectors):
            source.data = {name: [] for name in source.data}

    def move(self, x: np.ndarray, y: np.ndarray) -> None:
        """The same points at new places: only the columns that change are sent."""
        self.points.data.update(self._columns(x, y))
        if self.vector_scale > 0:
            self._draw_vectors()

    def show_before(self, crossover: CrossoverSet | None) -> None:
        """Faint marks where both versions were reported, or none."""
        empty = np.zeros((0, 3))
        self.before.data = self._tracks(
            *((empty, empty) if crossover is None else (crossover.x, crossover.y))
        )
        self._entries[REPORTED].visible = crossover is not None

    def _tracks(self, x: np.ndarray, y: np.ndarray) -> dict:
        """Columns of both tracks, single precision: a twentieth of an inch at 50,000 ft."""
        columns = {}
        for letter, track in (("x", x), ("y", y)):
            columns |= {f"{letter}{k}": track[:, k].astype("f4") for k in range(3)}
            columns[f"{letter}s"] = distance_along(track, self._centre, self._course).astype("f4")
        return columns

    def _columns(self, x: np.ndarray, y: np.ndarray) -> dict:
        gap = (x - y).astype("f4")
        return self._tracks(x, y) | {name: gap[:, k] for k, name in enumerate(GAP_COLUMNS)}

    def _name_arrays(self, pair: tuple[int, int]) -> None:
        """Array numbers in the legends."""
        for (_, _, name, _), number in zip(VERSIONS, pair, strict=True):
            self._entries[name].label = value(f"array {number}")
        self.gap.yaxis.axis_label = f"array {pair[0]} minus {pair[1]} (ft)"

    def _frame(self, crossover: CrossoverSet) -> None:
        """Frames all three views to what is not far off."""
        summary = summarise_gap(crossover)
        near = ~summary.far if not summary.far.all() else np.ones(crossover.points, bool)
        places = np.concatenate([crossover.x[near], crossover.y[near]])[:, :2]
        middle = (places.min(axis=0) + places.max(axis=0)) / 2
        half = np.maximum(0.55 * np.ptp(places, axis=0), 50.0)
        box = (middle[0] - half[0], middle[0] + half[0], middle[1] - half[1], middle[1] + half[1])
        self.home.tags = [*map(float, box), self.home.tags[4]]
        along = distance_along(crossover.x[near], self._centre, self._course)
        _set_range(self.side.x_range, along, room=0.05)
        _set_range(self.gap.x_range, crossover.point_count, room=0.03)
        _set_range(self.gap.y_range, np.append(crossover.gap[near].ravel(), 0.0))
        heights = np.concatenate([crossover.x[near], crossover.y[near]])[:, 2]
        _set_range(self.side.y_range, heights)
        room = 0.05 * np.ptp(along) + 5.0, 0.2 * np.ptp(heights) + 5.0
        box = (along.min() - room[0], along.max() + room[0], heights.min() - room[1], heights.max() + room[1])
        self.side_home.tags = [*map(float, box), self.side_home.tags[4]]


def _lower_frames(fig) -> None:
    """Draws what tools drag, such as a box, beneath what moves: else it is styled anew whenever that is painted."""
    for kind in (BoxZoomTool, BoxSelectTool, LassoSelectTool):
        for tool in fig.select(type=kind):
            tool.overlay.level = "annotation"


def _set_range(axis: Range1d, values: np.ndarray, room: float = 0.2) -> None:
    """Frames some values, now and after a reset, with room for a track that is corrected by a few ms.

    Fixed frames: one that followed the points would paint each view twice while a slider is dragged.
    """
    margin = room * np.ptp(values) + 5.0
    low, high = float(values.min() - margin), float(values.max() + margin)
    axis.update(start=low, end=high, reset_start=low, reset_end=high)


def _looks(excluded: np.ndarray, why=None) -> dict:
    """Columns that tell points left out (T,) from the others; `why` (T,) are words on each."""
    columns = {"used": np.where(excluded, "left out", "used") if why is None else np.asarray(why)}
    for letter, colour, _, marker in VERSIONS:
        columns[f"mark{letter}"] = np.where(excluded, "x", marker)
        columns[f"ink{letter}"] = np.where(excluded, _rgba(REJECTED), _rgba(colour))
        columns[f"edge{letter}"] = np.where(excluded, _rgba(REJECTED), np.uint32(0))
    # The gap has no outlines: its cross is one that is filled.
    columns["markg"] = np.where(excluded, "plus", "circle")
    return columns | {
        f"ink{k}": np.where(excluded, _rgba(REJECTED), _rgba(colour)) for k, colour in enumerate(COMPONENTS)
    }


def _rgba(colour: str) -> np.uint32:
    """A colour as the number that a page need not parse again for every point whenever one moves; 0 is none."""
    return np.uint32(int(colour[1:] + "ff", 16))


def _beside(crossover: CrossoverSet, places, residuals) -> dict:
    """Columns that no slider moves: file lines, what the gap is drawn against, residuals about smooth courses."""
    unknown = np.full((crossover.points, 3), np.nan)
    lines = np.zeros((crossover.points, 2), int) if crossover.lines is None else crossover.lines
    columns = {name: lines[:, k].astype(np.int32) for k, name in enumerate(LINE_COLUMNS)}
    for k, track in enumerate((crossover.x, crossover.y)):
        away = unknown if places is None else track - places[k]
        columns[f"range{k}"] = np.linalg.norm(away, axis=1).astype("f4")
    columns["depth"] = (-crossover.x[:, 2]).astype("f4")
    heading = np.exp(1j * heading_of(crossover.x, crossover.point_count))
    middle = np.angle(np.nansum(heading))  # about which 180° and -180° lie side by side
    columns["heading"] = np.degrees(middle + np.angle(heading * np.exp(-1j * middle))).astype("f4")
    first, second = (unknown, unknown) if residuals is None else residuals
    for letter, residual in (("x", first), ("y", second)):
        columns |= {f"r{letter}{k}": residual[:, k].astype("f4") for k in range(3)}
    return columns
