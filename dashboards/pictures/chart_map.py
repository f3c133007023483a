"""A small map beside the paper: the ship at the line pointed at, the bearing lines, where they meet."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource

from dashboards.palette import ESTIMATE, SECOND_ARRAY, SHIP, TRUTH
from dashboards.pictures.beacon_map import ellipse_ring
from dashboards.pictures.bearing_layer import BearingLayer
from dashboards.pictures.legend import legend_entry, style_legend
from dashboards.pictures.mercator import map_figure, mercator, show_box
from trackerlib.beacon.result import BeaconFix

POINTED = {"marker": "circle", "size": 11, "fill_color": SECOND_ARRAY, "line_color": SECOND_ARRAY}
STRONG = {"size": 9, "line_color": ESTIMATE, "line_width": 2, "fill_color": ESTIMATE}
REACH_M = 50_000.0  # from the ship, beyond which a thing is of another hunt
LARGEST_DRAWN_M = 20_000.0


class ChartMap:
    """Track of the lines on the paper; `pointed` is set in the browser."""

    def __init__(self, beside: ColumnDataSource):
        self.beside = beside
        self.pointed = ColumnDataSource({"x": [], "y": []}, name="ship pointed at")
        self.fix = ColumnDataSource({"x": [], "y": [], "fill": []}, name="fix beside the paper")
        self.ellipse = ColumnDataSource({"x": [], "y": []})
        self.truth = ColumnDataSource({"x": [], "y": []})
        self.figure, self.home = map_figure("chart map")
        fig = self.figure
        fig.toolbar_location = None
        track = fig.line("ship_x", "ship_y", source=beside, color=SHIP, line_width=1)
        self.bearings = BearingLayer(fig)
        place = [
            fig.patch("x", "y", source=self.ellipse, fill_color=ESTIMATE, fill_alpha=0.15, line_color=ESTIMATE),
            fig.scatter("x", "y", source=self.fix, fill_alpha="fill", **STRONG),
        ]  # fmt: skip
        truth = fig.scatter("x", "y", source=self.truth, marker="diamond", size=12, color=TRUTH)
        pointed = fig.scatter("x", "y", source=self.pointed, **POINTED)
        legend_entry(fig, "ship", [track], line=True, line_color=SHIP)
        legend_entry(fig, "ship at the line pointed at", [pointed], **POINTED)
        self.bearings.add_legend()
        self._fix_entry = legend_entry(fig, "beacon fix", place, visible=False, **STRONG)
        self._truth_entry = legend_entry(
            fig, "truth (simulated)", [truth], visible=False, marker="diamond", size=12, color=TRUTH
        )
        style_legend(fig)
        legend = fig.legend[0]  # below: in so small a map it would lie on the beacon
        fig.center.remove(legend)
        fig.add_layout(legend, "below")
        for axis in (*fig.xaxis, *fig.yaxis):
            axis.ticker.desired_num_ticks = 3
        fig.min_border = 2

    def show(self, fix: BeaconFix | None, truth: dict | None, lines: tuple) -> None:
        """What is known of the beacon."""
        self.bearings.show(lines)
        ring, place = {"x": [], "y": []}, {"x": [], "y": [], "fill": []}
        if fix is not None and fix.position is not None:
            now = fix.present
            x, y = mercator(now.lat_deg, now.lon_deg)
            place = {"x": [float(x)], "y": [float(y)], "fill": [float(fix.converged)]}
            if now.ellipse is not None and now.ellipse.semi_major_m < LARGEST_DRAWN_M:
                ring = ellipse_ring(fix, now.position, now.ellipse)
        self.fix.data, self.ellipse.data = place, ring
        self._fix_entry.visible = bool(place["x"])
        self._truth_entry.visible = truth is not None
        x, y = ([], []) if truth is None else mercator([truth["lat_deg"]], [truth["lon_deg"]])
        self.truth.data = {"x": x, "y": y}
        self.frame()

    def frame(self) -> None:
        """Holds ship, lines and truth in the home box."""
        x, y = self.bearings.points()
        track = np.array([self.beside.data[name] for name in ("ship_x", "ship_y")], float)
        track = track[:, np.isfinite(track[0])]
        others = np.array(
            [[*more, *self.truth.data[name]] for more, name in ((x, "x"), (y, "y"))], float
        )  # fmt: skip
        if track.size:  # what belongs to another hunt must not shrink this one to a dot
            near = np.abs(others - np.median(track, axis=1)[:, None]).max(axis=0, initial=0) < REACH_M
            others = others[:, near]
        points = np.concatenate([track, others], axis=1)
        if points.size:
            show_box(self.home, *points)
