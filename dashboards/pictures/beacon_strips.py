"""What stands below the map of a hunt: residuals, history of the depth, contours of the misfit, iterations."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Span
from bokeh.plotting import figure
from bokeh.plotting.contour import contour_data

from dashboards.palette import ESTIMATE, SHIP
from trackerlib.beacon.convergence import Step
from trackerlib.beacon.diagnosis import MisfitSurface
from trackerlib.beacon.result import BeaconFix

LEVELS = (2.3, 6.0, 9.2, 20.0, 50.0, 100.0)  # of chi-square; 6.0 holds 95 % in two dimensions
NO_HISTORY = "No fix believed yet: its depth will stand here"
HISTORY_COLUMNS = ("number", "depth", "low", "high", "major")


def strip(name: str, tools: str, across: str, up: str, **options):
    """A figure that fills its pane; the wheel zooms as its tools say."""
    return figure(
        name=name,
        sizing_mode="stretch_both",
        tools=f"{tools},reset,save",
        active_scroll="xwheel_zoom" if "xwheel_zoom" in tools else "wheel_zoom",
        x_axis_label=across,
        y_axis_label=up,
        **options,
    )


class Residuals:
    """Residual against ping number, on the map's own source, so that a selection is one in both."""

    def __init__(self, pings: ColumnDataSource, colour):
        self.figure = fig = strip("residuals", "xpan,xwheel_zoom,box_select,tap", "ping", "residual (ms)")
        ink = {"field": "shade_ms", "transform": colour}
        points = fig.scatter(
            "number", "residual_ms", source=pings, size=5, color=ink, line_color=ink, marker="kind",
            nonselection_fill_alpha=0.15,
        )  # fmt: skip
        fig.add_layout(Span(location=0, dimension="width", line_color=SHIP, line_width=1))
        tips = [
            ("ping", "@number"),
            ("residual", "@residual_ms{0.00} ms"),
            ("moves the fix by", "@moves_m{0.00} m"),
        ]
        fig.add_tools(HoverTool(renderers=[points], tooltips=tips))


class DepthHistory:
    """Depth with its 95 % band after more and more pings."""

    def __init__(self):
        self.source = ColumnDataSource({name: [] for name in HISTORY_COLUMNS}, name="history")
        self.figure = fig = strip("history", "xpan,xwheel_zoom", "ping", "depth (m), 95 %")
        fig.y_range.flipped = True
        fig.varea("number", "low", "high", source=self.source, fill_color=ESTIMATE, fill_alpha=0.2)
        line = fig.line("number", "depth", source=self.source, line_color=ESTIMATE, line_width=2)
        tips = [("ping", "@number"), ("depth", "@depth{0.0} m"), ("ellipse", "@major{0.0} m")]
        fig.add_tools(HoverTool(renderers=[line], mode="vline", tooltips=tips))
        fig.title.update(text=NO_HISTORY, text_font_style="normal")

    def add(self, fix: BeaconFix) -> bool:
        """One more fix at the end, if it is believed and later than the last one there; whether it was added."""
        known = self.source.data["number"]
        later = fix.converged and (not len(known) or fix.number[-1] > known[-1])
        if later:
            self.source.stream(history_row(fix), rollover=5000)
            self.figure.title.text = ""
        return later

    def show(self, fixes: list[BeaconFix]) -> None:
        """The whole history at once."""
        rows = [history_row(fix) for fix in fixes if fix.converged]
        self.figure.title.text = "" if rows else NO_HISTORY
        self.source.data = {name: [row[name][0] for row in rows] for name in HISTORY_COLUMNS}


def history_row(fix: BeaconFix) -> dict:
    """Depth with its 95 % band and the ellipse's half axis after the last ping of a fix."""
    now = fix.present
    half = 1.96 * float(now.sigma[2])
    return {
        "number": [int(fix.number[-1])],
        "depth": [now.depth_m],
        "low": [now.depth_m - half],
        "high": [now.depth_m + half],
        "major": [now.ellipse.semi_major_m],
    }


class Contours:
    """Chi-square over two coordinates of the beacon."""

    def __init__(self):
        self.figure = fig = strip("contours", "pan,wheel_zoom", "", "", match_aspect=True)
        fig.xaxis.ticker.desired_num_ticks = 4
        blank = np.zeros((2, 2))
        self.drawn = fig.contour([0, 1], [0, 1], blank, list(LEVELS), line_color=ESTIMATE, line_alpha=0.8)
        self.centre = ColumnDataSource({"x": [], "y": []})
        fig.scatter("x", "y", source=self.centre, size=9, color=ESTIMATE)

    def show(self, surface: MisfitSurface | None) -> None:
        """Contours about the fix, 95 % the second of them; None clears them."""
        fig, blank = self.figure, np.zeros((2, 2))
        grid = ([0, 1], [0, 1], blank) if surface is None else (surface.across, surface.up, surface.rise)
        self.drawn.set_data(contour_data(*grid, list(LEVELS), want_fill=False))
        self.centre.data = {"x": [], "y": []}
        if surface is None:
            return
        row, column = np.unravel_index(np.argmin(surface.rise), surface.rise.shape)
        self.centre.data = {"x": [surface.across[column]], "y": [surface.up[row]]}
        for axis, name in ((fig.xaxis, surface.names[0]), (fig.yaxis, surface.names[1])):
            axis.axis_label = f"{name} ({'m/s' if name.startswith('velocity') else 'm'})"
        fig.y_range.flipped = surface.names[1] == "depth"
        fig.match_aspect = len({name.startswith("velocity") for name in surface.names}) == 1


class Iterations:
    """Misfit against iteration, stage after stage."""

    def __init__(self):
        columns = ("step", "rms_ms", "stage", "iteration", "step_m")
        self.source = ColumnDataSource({name: [] for name in columns}, name="iterations")
        self.figure = fig = strip(
            "iterations", "xpan,xwheel_zoom", "iteration", "rms residual (ms)", y_axis_type="log"
        )
        fig.line("step", "rms_ms", source=self.source, line_color=ESTIMATE)
        dots = fig.scatter("step", "rms_ms", source=self.source, size=5, color=ESTIMATE)
        tips = [("", "@stage, @iteration"), ("rms", "@rms_ms{0.000} ms"), ("moved", "@step_m{0.000} m")]
        fig.add_tools(HoverTool(renderers=[dots], tooltips=tips))

    def show(self, log: tuple[Step, ...]) -> None:
        """The log of one fix."""
        self.source.data = {
            "step": list(range(1, len(log) + 1)),
            "rms_ms": [np.nan if step.rms_ms is None else step.rms_ms for step in log],
            "stage": [step.stage for step in log],
            "iteration": [step.iteration for step in log],
            "step_m": [np.nan if step.step_m is None else step.step_m for step in log],
        }
