"""Radial lines from each array to the places it reported: why a wrong clock parts two tracks.

Figure 3 of Read (1990): with the transit times too short by one offset, each array puts the vehicle too near
itself along its own line, and the two places of one point count part.
"""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, Range1d
from bokeh.plotting import figure

from dashboards.palette import ESTIMATE, FIRST_ARRAY, SECOND_ARRAY
from dashboards.pictures.legend import legend_entry, style_legend
from dashboards.pictures.mercator import equal_scale

MOST_LINES = 14
INKS = (FIRST_ARRAY, SECOND_ARRAY)


class RadialLines:
    """Both arrays with lines to some points, and one point count close by with its gap vector."""

    def __init__(self):
        self.whole, self.home = _plan("radial", "downrange (ft)", "crossrange (ft)")
        self.close, self.near = _plan("radial_close", "downrange from the middle (ft)", "crossrange (ft)")
        self.arrays = ColumnDataSource({"x": [], "y": [], "name": [], "ink": []})
        self.lines = ColumnDataSource({"x": [], "y": [], "x1": [], "y1": [], "ink": []}, name="radial lines")
        self.vector = ColumnDataSource({"x": [], "y": [], "x1": [], "y1": []}, name="gap vector")
        self.ends = ColumnDataSource({"x": [], "y": [], "x1": [], "y1": [], "ink": []}, name="ends")
        self._chosen = 0
        self._rows = np.zeros(0, int)
        self._places = np.zeros((2, 3))
        self._draw()

    def _draw(self) -> None:
        fig = self.whole
        fig.segment("x", "y", "x1", "y1", source=self.lines, line_color="ink", line_alpha=0.5)
        fig.scatter("x1", "y1", source=self.lines, size=6, color="ink")
        fig.scatter("x", "y", source=self.arrays, size=11, marker="triangle", color="ink")
        fig.text(
            "x",
            "y",
            "name",
            source=self.arrays,
            x_offset=8,
            y_offset=-4,
            text_color="ink",
            text_font_size="12px",
        )
        close = self.close
        close.segment("x", "y", "x1", "y1", source=self.ends, line_color="ink", line_width=2)
        close.scatter("x1", "y1", source=self.ends, size=10, color="ink")
        gap = close.segment("x", "y", "x1", "y1", source=self.vector, line_color=ESTIMATE, line_width=3)
        legend_entry(close, "line from the first array", [], line=True, line_color=FIRST_ARRAY, line_width=2)
        legend_entry(
            close, "line from the second array", [], line=True, line_color=SECOND_ARRAY, line_width=2
        )
        legend_entry(close, "gap of one point count", [gap], line=True, line_color=ESTIMATE, line_width=3)
        style_legend(close)

    def show(
        self, places: np.ndarray, names: tuple[str, str], x: np.ndarray, y: np.ndarray, chosen: int
    ) -> None:
        """Arrays at places (2, 3), two versions (T, 3) of a track, and the point whose gap is drawn close by."""
        self._chosen, self._places = chosen, places
        few = np.unique(np.linspace(0, len(x) - 1, min(len(x), MOST_LINES)).astype(int))
        self._rows = np.unique(np.append(few, chosen))
        self.arrays.data = {"x": places[:, 0], "y": places[:, 1], "name": list(names), "ink": list(INKS)}
        middle = (x[chosen] + y[chosen]) / 2
        reach = max(1.2 * float(np.linalg.norm((x - y)[chosen, :2])), 5.0)
        self.near.tags = [-reach, reach, -reach, reach]
        self._middle = middle
        everything = np.concatenate([places[:, :2], x[self._rows, :2], y[self._rows, :2]])
        low, high = np.nanmin(everything, axis=0), np.nanmax(everything, axis=0)
        room = 0.18 * (high - low).max()
        self.home.tags = [float(v) for v in (low[0] - room, high[0] + room, low[1] - room, high[1] + room)]
        self.move(x, y)

    def move(self, x: np.ndarray, y: np.ndarray) -> None:
        """The same points at new places."""
        rows, places = self._rows, self._places
        ends = np.concatenate([x[rows], y[rows]])
        begins = np.repeat(places, len(rows), axis=0)
        self.lines.data = {
            "x": begins[:, 0], "y": begins[:, 1], "x1": ends[:, 0], "y1": ends[:, 1],
            "ink": [INKS[0]] * len(rows) + [INKS[1]] * len(rows),
        }  # fmt: skip
        pair = np.stack([x[self._chosen], y[self._chosen]]) - self._middle
        away = places - self._middle
        self.ends.data = {
            "x": away[:, 0], "y": away[:, 1], "x1": pair[:, 0], "y1": pair[:, 1], "ink": list(INKS)
        }  # fmt: skip
        self.vector.data = {"x": pair[1:, 0], "y": pair[1:, 1], "x1": pair[:1, 0], "y1": pair[:1, 1]}


def _plan(name: str, across: str, up: str):
    fig = figure(
        name=name,
        sizing_mode="stretch_both",
        tools="pan,wheel_zoom,reset,save",
        active_scroll="wheel_zoom",
        x_axis_label=across,
        y_axis_label=up,
        x_range=Range1d(0, 1000),
        y_range=Range1d(0, 1000),
    )
    fig.xaxis.formatter.use_scientific = fig.yaxis.formatter.use_scientific = False
    return fig, equal_scale(fig)
