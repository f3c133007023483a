"""Bearing lines read off the chart, and where they meet, on any map."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool

from dashboards.palette import SECOND_ARRAY
from dashboards.pictures.legend import legend_entry
from dashboards.pictures.mercator import mercator
from trackerlib.beacon.bearing_lines import BearingFix, fix_from_bearing_lines
from trackerlib.frames import LocalFrame
from trackerlib.receiver.hyperbola import BearingLine
from trackerlib.rounding import value_with_sigma

FAR_M = 5000.0  # to each side, of a line that has no distance
STRONG = {"size": 11, "line_color": SECOND_ARRAY, "line_width": 2, "fill_color": SECOND_ARRAY}


class BearingLayer:
    """Each line goes both ways from the ship's closest approach, as far as its distance; two or more give a fix."""

    def __init__(self, fig):
        self._figure = fig
        self.lines = ColumnDataSource({name: [] for name in ("xs", "ys", "distance")}, name="bearing lines")
        self.approaches = ColumnDataSource({"x": [], "y": []}, name="closest approaches")
        self.ellipse = ColumnDataSource({"x": [], "y": []}, name="bearing ellipse")
        self.place = ColumnDataSource({"x": [], "y": [], "fill": []}, name="bearing fix")
        drawn = fig.multi_line(
            "xs", "ys", source=self.lines, line_color=SECOND_ARRAY, line_dash="dashed", line_width=1.5
        )
        self._shown = [
            drawn,
            fig.scatter("x", "y", source=self.approaches, marker="cross", size=9, color=SECOND_ARRAY),
            fig.patch(
                "x", "y", source=self.ellipse, fill_color=SECOND_ARRAY, fill_alpha=0.15, line_color=SECOND_ARRAY
            ),
            fig.scatter("x", "y", source=self.place, fill_alpha="fill", **STRONG),
        ]  # fmt: skip
        fig.add_tools(HoverTool(renderers=[drawn], tooltips=[("closest approach", "@distance")]))
        self.fix: BearingFix | None = None

    def add_legend(self) -> None:
        """Its entry in the legend, hidden until there is a line."""
        self._entry = legend_entry(
            self._figure, "closest approach, bearing line", self._shown,
            line=True, line_color=SECOND_ARRAY, line_dash="dashed", visible=False,
        )  # fmt: skip

    def show(self, lines: tuple[BearingLine, ...]) -> None:
        """These lines, and the place where they meet with its 95 % ellipse, or hollow the places it may be."""
        self._entry.visible = bool(lines)
        shapes = [_line(line) for line in lines]
        self.lines.data = {
            "xs": [x for x, _ in shapes],
            "ys": [y for _, y in shapes],
            "distance": [distance_text(line) for line in lines],
        }
        self.approaches.data = {"x": [x[1] for x, _ in shapes], "y": [y[1] for _, y in shapes]}
        self.fix = fix_from_bearing_lines(lines) if lines else None
        self._show_fix(self.fix)

    def _show_fix(self, fix: BearingFix | None) -> None:
        ring, place = {"x": [], "y": []}, {"x": [], "y": [], "fill": []}
        if fix is not None:
            found = [(fix.lat_deg, fix.lon_deg)] if fix.converged else list(fix.alternatives)
            x, y = mercator([each[0] for each in found], [each[1] for each in found])
            place = {"x": x, "y": y, "fill": np.full(len(x), float(fix.converged))}
            if fix.converged:
                ring = _ring(fix)
        self.ellipse.data, self.place.data = ring, place

    def points(self) -> tuple[list, list]:
        """Mercator points that a map should hold."""
        ends = [np.ravel(shape) for shape in (self.lines.data["xs"], self.lines.data["ys"])]
        return [*ends[0], *self.place.data["x"]], [*ends[1], *self.place.data["y"]]


def distance_text(line: BearingLine) -> str:
    """Slant distance at closest approach with its sigma, or that it is not known."""
    if line.distance_m is None:
        return "distance not known"
    return value_with_sigma(line.distance_m, line.sigma_m, "m")


def _line(line: BearingLine) -> tuple[np.ndarray, np.ndarray]:
    ends = line.ends(line.distance_m or FAR_M)
    return mercator(
        [ends[0, 0], line.lat_deg, ends[1, 0]],
        [ends[0, 1], line.lon_deg, ends[1, 1]],
    )


def _ring(fix: BearingFix, points: int = 73) -> dict:
    shape, angle = fix.ellipse, np.linspace(0, 2 * np.pi, points)
    bearing = np.radians(shape.bearing_deg)
    along, across = shape.semi_major_m * np.cos(angle), shape.semi_minor_m * np.sin(angle)
    east = along * np.sin(bearing) + across * np.cos(bearing)
    north = along * np.cos(bearing) - across * np.sin(bearing)
    lat, lon, _ = LocalFrame(fix.lat_deg, fix.lon_deg).to_geodetic(
        np.column_stack([east, north, np.zeros(points)])
    )
    x, y = mercator(lat, lon)
    return {"x": x, "y": y}
