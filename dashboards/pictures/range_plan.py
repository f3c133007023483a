"""The whole range in plan: arrays with the circles they hear, where circles overlap, and a vehicle's tracks."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from bokeh.models import BoxSelectTool, ColumnDataSource, HoverTool, LassoSelectTool, Range1d, TapTool
from bokeh.plotting import figure

from dashboards.palette import ESTIMATE, FIRST_ARRAY, REJECTED, SECOND_ARRAY, SHIP
from dashboards.pictures.legend import legend_entry, style_legend
from dashboards.pictures.mercator import equal_scale
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.reports import PositionReports
from trackerlib.crossover.survey import ArraySurvey

MOST_POINTS = 4000  # of the tracks that are sent to the page
ARC = 24  # points of each arc of an overlap
TRACKS = ("x", "y", "array", "count", "line", "ink")
OVERLAPS = ("xs", "ys", "first", "second", "points", "passes", "alpha")


class RangePlan:
    """Arrays, circles, overlaps and tracks; a click on an overlap chooses its pair of arrays."""

    def __init__(self):
        self.arrays = ColumnDataSource({name: [] for name in ("x", "y", "number", "ink", "radius")})
        self.overlaps = ColumnDataSource({name: [] for name in OVERLAPS}, name="overlaps")
        self.tracks = ColumnDataSource({name: [] for name in TRACKS}, name="tracks")
        self.marked = ColumnDataSource({"x": [], "y": []})
        self._reports: PositionReports | None = None
        self.figure = fig = figure(
            name="range",
            sizing_mode="stretch_both",
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_scroll="wheel_zoom",
            x_axis_label="downrange (ft)",
            y_axis_label="crossrange (ft)",
            x_range=Range1d(0, 1000),
            y_range=Range1d(0, 1000),
        )
        self.home = equal_scale(fig)
        circles = fig.circle(
            "x", "y", radius="radius", source=self.arrays, fill_color=None, line_color="ink", line_alpha=0.6,
        )  # fmt: skip
        lenses = fig.patches(
            "xs", "ys", source=self.overlaps, fill_color=SHIP, fill_alpha="alpha", line_color=SHIP, line_alpha=0.25,
            nonselection_fill_alpha=0.06, selection_fill_alpha=0.3,
        )  # fmt: skip
        dots = fig.scatter(
            "x", "y", source=self.tracks, size=3, color="ink", line_color=None, nonselection_alpha=0.15
        )
        chosen = fig.scatter(
            "x", "y", source=self.marked, size=8, fill_color=None, line_color=ESTIMATE, line_width=2
        )
        fig.scatter("x", "y", source=self.arrays, size=8, marker="triangle", color="ink")
        fig.text(
            "x", "y", "number", source=self.arrays, x_offset=7, y_offset=-3, text_font_size="12px", text_color="ink"
        )  # fmt: skip
        fig.add_tools(
            TapTool(renderers=[lenses]),
            HoverTool(
                renderers=[lenses],
                tooltips=[("arrays", "@first and @second"), ("both saw", "@points points, @passes passes")],
            ),
            HoverTool(renderers=[dots], tooltips=[("count", "@count"), ("array", "@array, line @line")]),
        )
        fig.add_tools(BoxSelectTool(renderers=[dots]), LassoSelectTool(renderers=[dots]))
        legend_entry(fig, "first array of the set", [], color=FIRST_ARRAY, size=6)
        legend_entry(fig, "second array", [], color=SECOND_ARRAY, size=6)
        legend_entry(fig, "other arrays' tracks", [dots], color=REJECTED, size=6)
        legend_entry(
            fig, "circles that arrays hear", [circles], line=True, line_color=REJECTED, line_alpha=0.6
        )
        legend_entry(fig, "where two overlap", [lenses], marker="square", size=9, color=SHIP, alpha=0.3)
        legend_entry(fig, "selected", [chosen], fill_color=None, line_color=ESTIMATE, line_width=2, size=7)
        # Flat, so that it ends above the centres of the uppermost circles.
        style_legend(fig, ncols=3, margin=4, padding=2, spacing=6)
        fig.xaxis.formatter.use_scientific = fig.yaxis.formatter.use_scientific = False

    def show(self, survey: ArraySurvey, limit_ft: float, sets, reports: PositionReports | None) -> None:
        """The range with one vehicle's reports; sets are those that its pairs of arrays have in common."""
        placed = np.flatnonzero(~survey.placeholder)
        place, number = survey.position[placed], survey.number[placed]
        self.arrays.data = {
            "x": place[:, 0],
            "y": place[:, 1],
            "number": [str(n) for n in number],
            "ink": [REJECTED] * len(placed),
            "radius": np.full(len(placed), limit_ft),
        }
        self._show_overlaps(place, number, limit_ft, sets)
        self._reports = _thinned(reports)
        if len(placed):
            low, high = place[:, :2].min(axis=0) - limit_ft, place[:, :2].max(axis=0) + limit_ft
            self.home.tags = [float(v) for v in (low[0], high[0], low[1], high[1])]

    def _show_overlaps(self, place, number, limit_ft, sets) -> None:
        seen: dict[tuple[int, int], list[int]] = {}
        for one in sets:
            seen.setdefault(tuple(sorted(one.pair)), []).append(one.points)
        rows = []
        for i, j in combinations(range(len(number)), 2):
            outline = overlap(place[i, :2], place[j, :2], limit_ft)
            points = seen.get((min(number[i], number[j]), max(number[i], number[j])), [])
            if outline is not None:
                rows.append((*outline, int(number[i]), int(number[j]), sum(points), len(points)))
        columns = list(zip(*rows, strict=True)) or [()] * 6
        self.overlaps.data = {
            **dict(zip(OVERLAPS, columns, strict=False)),
            "alpha": [0.14 if points else 0.0 for points in columns[4]],
        }

    def choose(self, crossover: CrossoverSet | None) -> None:
        """Gives the two arrays of a set their colours."""
        inks = (
            {} if crossover is None else dict(zip(crossover.pair, (FIRST_ARRAY, SECOND_ARRAY), strict=True))
        )
        self.arrays.data["ink"] = [inks.get(int(number), REJECTED) for number in self.arrays.data["number"]]
        reports = self._reports
        if reports is None:
            self.tracks.data = {name: [] for name in TRACKS}
            return
        in_set = np.zeros(len(reports), bool)
        if crossover is not None:
            in_set = (reports.point_count >= crossover.point_count[0]) & (
                reports.point_count <= crossover.point_count[-1]
            )
        ink = np.full(len(reports), REJECTED, dtype=object)
        for number, colour in inks.items():
            ink[in_set & (reports.array == number)] = colour
        self.tracks.data = {
            "x": reports.position[:, 0].astype("f4"),
            "y": reports.position[:, 1].astype("f4"),
            "array": reports.array.astype(np.int32),
            "count": reports.point_count.astype(np.int32),
            "line": reports.line.astype(np.int32),
            "ink": ink.tolist(),
        }

    def mark(self, crossover: CrossoverSet | None, rows: np.ndarray) -> None:
        """Rings round some points of a set."""
        place = np.zeros((0, 3)) if crossover is None else crossover.x[rows]
        self.marked.data = {"x": place[:, 0], "y": place[:, 1]}

    def counts_of(self, rows) -> np.ndarray:
        """Point counts of rows selected in the tracks."""
        return np.unique(np.asarray(self.tracks.data["count"])[list(rows)])


def overlap(first: np.ndarray, second: np.ndarray, radius: float) -> tuple[list, list] | None:
    """Outline of where two circles of one radius overlap, None where they do not."""
    apart = second - first
    distance = float(np.hypot(*apart))
    if not 0 < distance < 2 * radius:
        return None
    half, towards = np.arccos(distance / (2 * radius)), np.arctan2(apart[1], apart[0])
    turn = np.linspace(-half, half, ARC)
    x = [first[0] + radius * np.cos(towards + turn), second[0] - radius * np.cos(towards + turn)]
    y = [first[1] + radius * np.sin(towards + turn), second[1] - radius * np.sin(towards + turn)]
    return np.concatenate(x).tolist(), np.concatenate(y).tolist()


def _thinned(reports: PositionReports | None) -> PositionReports | None:
    if reports is None or len(reports) <= MOST_POINTS:
        return reports
    return reports.only(np.arange(0, len(reports), -(-len(reports) // MOST_POINTS)))
