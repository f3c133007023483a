"""Candidate legs on the map, their ends to be dragged, with what they would leave of the ellipse."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, LogColorMapper, PointDrawTool
from bokeh.palettes import Cividis256

from dashboards.palette import ESTIMATE
from dashboards.pictures.legend import legend_entry
from dashboards.pictures.mercator import mercator
from trackerlib.beacon.planning import Forecast
from trackerlib.beacon.result import BeaconFix

MOST_LEGS = 5  # candidates drawn beside the one chosen
DOTTED = {"line_color": ESTIMATE, "line_dash": "dotted"}


class LegLayer:
    """Legs from where the ship is; the first of them is the one chosen."""

    def __init__(self, fig):
        self._figure = fig
        self.legs = ColumnDataSource({"xs": [], "ys": [], "width": [], "alpha": []}, name="legs")
        self.ends = ColumnDataSource({"x": [], "y": [], "error": []}, name="leg ends")
        self.forecast = ColumnDataSource({"x": [], "y": []}, name="forecast")
        self.attainable = ColumnDataSource(
            {name: [] for name in ("image", "x", "y", "dw", "dh")}, name="attainable"
        )
        self._shade = fig.image(
            "image", "x", "y", "dw", "dh",
            source=self.attainable, color_mapper=LogColorMapper(Cividis256[::-1]), alpha=0.45, level="image",
        )  # fmt: skip
        fig.add_tools(HoverTool(renderers=[self._shade], tooltips=[("expected error", "@image{0.0} m")]))
        lines = fig.multi_line("xs", "ys", source=self.legs, line_width="width", line_alpha="alpha", **DOTTED)
        ends = fig.scatter(
            "x", "y", source=self.ends, marker="triangle", size=12, fill_alpha=0.3, color=ESTIMATE, name="leg ends"
        )  # fmt: skip
        ahead = fig.line("x", "y", source=self.forecast, line_alpha=0.8, **DOTTED)
        self._shown = [lines, ends, ahead]
        tips = [("leg to here leaves", "@error{0.0} m")]
        fig.add_tools(
            HoverTool(renderers=[ends], tooltips=tips),
            PointDrawTool(renderers=[ends], add=False, description="drag the end of a candidate leg"),
        )

    def add_legend(self) -> None:
        """Its entries in the legend, hidden until there is a plan."""
        self._entries = [
            legend_entry(
                self._figure, "candidate legs, forecast ellipse", self._shown,
                marker="triangle", size=10, color=ESTIMATE, alpha=0.5, visible=False,
            ),
            legend_entry(
                self._figure, "error after a leg to there, pale: less", [self._shade],
                marker="square", size=10, color=Cividis256[128], alpha=0.6, visible=False,
            ),
        ]  # fmt: skip

    def clear(self) -> None:
        """No legs."""
        for source in (self.legs, self.ends, self.forecast, self.attainable):
            source.data = {name: [] for name in source.data}
        for entry in self._entries:
            entry.visible = False

    def show(self, fix: BeaconFix, forecasts: tuple[Forecast, ...], ring: dict | None) -> None:
        """The leg chosen, strong, and those beside it; `ring` is the ellipse that the chosen one would leave."""
        xs, ys = [], []
        for forecast in forecasts[: MOST_LEGS + 1]:
            ends = np.column_stack([[forecast.leg.start, forecast.leg.end], np.zeros(2)])
            lat, lon, _ = fix.frame.to_geodetic(ends)
            x, y = mercator(lat, lon)
            xs.append(x)
            ys.append(y)
        chosen = np.arange(len(xs)) == 0
        self.legs.data = {
            "xs": xs,
            "ys": ys,
            "width": np.where(chosen, 2.5, 1.0),
            "alpha": np.where(chosen, 0.9, 0.5),
        }
        self.ends.data = {
            "x": np.array([x[1] for x in xs]),
            "y": np.array([y[1] for y in ys]),
            "error": np.array([forecast.rms_m for forecast in forecasts[: MOST_LEGS + 1]]),
        }
        self.forecast.data = ring or {"x": [], "y": []}
        self._entries[0].visible = True

    def dragged(self) -> tuple[int, float, float] | None:
        """Which leg's end is not where its line ends, and its mercator place; None where all are."""
        ends = self.ends.data
        if len(ends["x"]) != len(self.legs.data["xs"]):
            return None
        for k, (x, y) in enumerate(zip(self.legs.data["xs"], self.legs.data["ys"], strict=True)):
            if abs(ends["x"][k] - x[1]) + abs(ends["y"][k] - y[1]) > 0.5:
                return k, float(ends["x"][k]), float(ends["y"][k])
        return None

    def shade(self, fix: BeaconFix, east: np.ndarray, north: np.ndarray, error: np.ndarray) -> None:
        """Expected error [m] after a leg to each place of a grid, lighter where it is less, by its logarithm."""
        corners = np.array([[east[0], north[0], 0.0], [east[-1], north[-1], 0.0]])
        lat, lon, _ = fix.frame.to_geodetic(corners)
        (left, right), (bottom, top) = mercator(lat, lon)
        dx, dy = (right - left) / (len(east) - 1), (top - bottom) / (len(north) - 1)
        self.attainable.data = {
            "image": [error.astype("f4")],
            "x": [left - dx / 2],
            "y": [bottom - dy / 2],
            "dw": [right - left + dx],
            "dh": [top - bottom + dy],
        }
        self._entries[1].visible = True
