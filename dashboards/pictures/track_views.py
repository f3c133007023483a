"""Two versions of one track in plan and from the side, over one shared source of points."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Span
from bokeh.plotting import figure

from dashboards.palette import BEFORE, FIRST_ARRAY, REJECTED, SECOND_ARRAY
from dashboards.pictures.beacon_map import style_legend
from trackerlib.crossover.pairs import CrossoverSet

POINT_COLUMNS = ("count", "x0", "x1", "x2", "y0", "y1", "y2", "gap0", "gap1", "gap2", "used")


class TrackViews:
    """Plan view, side view and gap against point count; a selection in one is a selection in all."""

    def __init__(self):
        self.points = ColumnDataSource({name: [] for name in POINT_COLUMNS}, name="points")
        self.before = ColumnDataSource({name: [] for name in ("x0", "x1", "x2", "y0", "y1", "y2", "gap")})
        self.lines = ColumnDataSource(
            {name: [] for name in ("x0", "x1", "x2", "y0", "y1", "y2")}, name="lines"
        )
        self.plan = self._view("plan", "downrange (ft)", "crossrange (ft)", (0, 1), aspect=True)
        self.side = self._view("side", "downrange (ft)", "vertical (ft)", (0, 2), aspect=False)
        self.gap = self._gap()

    # -- figures -------------------------------------------------------------------------------

    def _view(self, name, x_label, y_label, axes, aspect):
        fig = figure(
            name=name, sizing_mode="stretch_both", tools="pan,wheel_zoom,box_zoom,box_select,lasso_select,reset,save",
            active_scroll="wheel_zoom", x_axis_label=x_label, y_axis_label=y_label, match_aspect=aspect,
        )  # fmt: skip
        h, v = axes
        versions = (
            ("x", FIRST_ARRAY, "first array", "circle"),
            ("y", SECOND_ARRAY, "second array", "square"),
        )
        for letter, colour, label, marker in versions:
            fig.scatter(
                f"{letter}{h}", f"{letter}{v}", source=self.before, size=4, color=BEFORE, alpha=0.5, marker=marker,
                legend_label="as reported",
            )  # fmt: skip
            fig.line(
                f"{letter}{h}",
                f"{letter}{v}",
                source=self.lines,
                color=colour,
                line_width=1,
                legend_label=label,
            )
            dots = fig.scatter(
                f"{letter}{h}", f"{letter}{v}", source=self.points, size=6, color=colour, marker=marker,
                line_color=None, legend_label=label, nonselection_fill_alpha=0.15,
            )  # fmt: skip
            fig.add_tools(
                HoverTool(renderers=[dots], tooltips=[("count", "@count"), (label, ""), ("", "@used")])
            )
        fig.yaxis.formatter.use_scientific = fig.xaxis.formatter.use_scientific = False
        style_legend(fig)
        return fig

    def _gap(self):
        fig = figure(
            name="gap", sizing_mode="stretch_both", tools="xpan,xwheel_zoom,box_select,reset,save",
            active_scroll="xwheel_zoom", x_axis_label="point count", y_axis_label="gap, first minus second (ft)",
        )  # fmt: skip
        for axis, (label, colour) in enumerate(
            (("downrange", FIRST_ARRAY), ("crossrange", SECOND_ARRAY), ("vertical", "#009E73"))
        ):
            dots = fig.scatter(
                "count", f"gap{axis}", source=self.points, size=5, color=colour, line_color=None, legend_label=label,
                nonselection_fill_alpha=0.15,
            )  # fmt: skip
            fig.add_tools(
                HoverTool(renderers=[dots], tooltips=[("count", "@count"), (label, f"@gap{axis}{{0.0}} ft")])
            )
        fig.add_layout(Span(location=0, dimension="width", line_color=REJECTED, line_width=1))
        style_legend(fig)
        return fig

    # -- data ----------------------------------------------------------------------------------

    def show(self, crossover: CrossoverSet, x=None, y=None, excluded=None, lines=None) -> None:
        """A set, its tracks moved to x and y (T, 3) where those are given, its straight lines if any.

        excluded : (T,) points that an estimate leaves out
        lines : straight lines (2, 3) of the first and of the second version: their two ends
        """
        x, y = crossover.x if x is None else x, crossover.y if y is None else y
        used = (
            np.full(crossover.points, "used") if excluded is None else np.where(excluded, "left out", "used")
        )
        self.points.data = {"count": crossover.point_count.astype(np.int32), "used": used, **_columns(x, y)}
        if lines is None:
            self.lines.data = {name: [] for name in self.lines.data}
        else:
            self.lines.data = {
                f"{letter}{k}": ends[:, k] for letter, ends in zip("xy", lines, strict=True) for k in range(3)
            }

    def move(self, x: np.ndarray, y: np.ndarray) -> None:
        """The same points at new places: only the columns that change are sent."""
        self.points.data.update(_columns(x, y))

    def show_before(self, crossover: CrossoverSet | None) -> None:
        """Faint marks where both versions were reported, or none."""
        empty = np.zeros((0, 3))
        x, y = (empty, empty) if crossover is None else (crossover.x, crossover.y)
        columns = _columns(x, y)
        self.before.data = {name: columns[name] for name in ("x0", "x1", "x2", "y0", "y1", "y2")} | {
            "gap": columns["gap0"]
        }


def _columns(x: np.ndarray, y: np.ndarray) -> dict:
    """Columns of both tracks and of their gap, single precision: a twentieth of an inch at 50,000 ft."""
    tracks = {
        f"{letter}{k}": track[:, k].astype("f4") for letter, track in (("x", x), ("y", y)) for k in range(3)
    }
    return tracks | {f"gap{k}": (x - y)[:, k].astype("f4") for k in range(3)}
