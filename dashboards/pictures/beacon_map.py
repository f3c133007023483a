"""The map of a beacon hunt and the strips below it, over one shared source of pings."""

from __future__ import annotations

import numpy as np
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    HoverTool,
    Legend,
    LegendItem,
    LinearColorMapper,
    PointDrawTool,
    Span,
)
from bokeh.palettes import Cividis256
from bokeh.plotting import figure
from bokeh.plotting.contour import contour_data

from dashboards.palette import DIVERGING, ESTIMATE, REJECTED, SHIP, TRUTH
from dashboards.pictures.mercator import map_figure, mercator, show_box
from trackerlib.beacon.diagnosis import MisfitSurface
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.planning import Forecast
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.uncertainty import Ellipse

PING_COLUMNS = ("number", "x", "y", "residual_ms", "shade_ms", "used", "utc", "kind", "moves_m")
LEVELS = (2.3, 6.0, 9.2, 20.0, 50.0, 100.0)  # of chi-square; 6.0 holds 95 % in two dimensions
LEGEND = {
    "location": "top_left",
    "click_policy": "hide",
    "label_text_font_size": "11px",
    "spacing": 0,
    "padding": 4,
    "glyph_height": 14,
    "background_fill_alpha": 0.7,
}


def style_legend(fig) -> None:
    """A small legend inside the picture; a click hides what it names."""
    for name, value in LEGEND.items():
        setattr(fig.legend, name, value)


def legend_entry(fig, label: str, shown: list, **mark):
    """A legend entry with a mark of its own; a click on it hides or shows the renderers it stands for.

    The mark stands for itself because Bokeh draws the legend of a data-coloured renderer from its data,
    and fails when these grow fewer or are none.
    """
    mark = fig.scatter([np.nan], [np.nan], **mark)
    for renderer in shown:
        mark.js_link("visible", renderer, "visible")
    if not fig.legend:
        fig.add_layout(Legend())
    entry = LegendItem(label=label, renderers=[mark])
    fig.legend[0].items.append(entry)
    return entry


class BeaconMap:
    """Map, residuals and history of one hunt; `show` replaces only what changed."""

    def __init__(self, tile_address: str = ""):
        empty = {name: [] for name in PING_COLUMNS}
        self.pings = ColumnDataSource(empty, name="pings")
        self.track = ColumnDataSource({"x": [], "y": []})
        self.ship = ColumnDataSource({"x": [], "y": [], "angle": []})
        self.fix = ColumnDataSource({"x": [], "y": [], "fill": [], "label": []}, name="fix")
        self.ellipse = ColumnDataSource({"x": [], "y": []}, name="ellipse")
        self.hollow_ellipse = ColumnDataSource({"x": [], "y": []})
        self.alternatives = ColumnDataSource({"x": [], "y": [], "label": []}, name="alternatives")
        self.truth = ColumnDataSource({"x": [], "y": []}, name="truth")
        self.drift = ColumnDataSource({"x": [], "y": []}, name="drift")
        self.leg = ColumnDataSource({"x": [], "y": []}, name="leg")
        self.leg_end = ColumnDataSource({"x": [], "y": []}, name="leg end")
        self.forecast = ColumnDataSource({"x": [], "y": []}, name="forecast")
        self.attainable = ColumnDataSource(
            {name: [] for name in ("image", "x", "y", "dw", "dh")}, name="attainable"
        )
        self.history = ColumnDataSource(
            {name: [] for name in ("number", "depth", "low", "high", "major")}, name="history"
        )
        self.colour = LinearColorMapper(DIVERGING, low=-1, high=1, nan_color=REJECTED)
        self.map, self.home = self._map(tile_address)
        self.residuals = self._residuals()
        self.depths = self._history()
        self.contours, self._contour, self._contour_centre = self._contours()

    # -- figures -------------------------------------------------------------------------------

    def _map(self, tile_address):
        fig, home = map_figure("beacon map", tile_address)
        shade = fig.image(
            "image",
            "x",
            "y",
            "dw",
            "dh",
            source=self.attainable,
            palette=Cividis256[::-1],
            alpha=0.45,
            level="image",
        )
        fig.add_tools(HoverTool(renderers=[shade], tooltips=[("expected error", "@image{0.0} m")]))
        track = fig.line("x", "y", source=self.track, color=SHIP, line_width=1)
        now = fig.scatter("x", "y", source=self.ship, marker="triangle", angle="angle", size=13, color=SHIP)
        points = fig.scatter(
            "x",
            "y",
            source=self.pings,
            size=6,
            color={"field": "residual_ms", "transform": self.colour},
            line_color=None,
            marker="kind",
            nonselection_fill_alpha=0.15,
            nonselection_line_alpha=0.15,
        )
        tips = [("ping", "@number"), ("residual", "@residual_ms{0.00} ms"), ("UTC", "@utc"), ("", "@used")]
        fig.add_tools(HoverTool(renderers=[points], tooltips=tips))
        ring = fig.patch(
            "x", "y", source=self.ellipse, fill_color=ESTIMATE, fill_alpha=0.15, line_color=ESTIMATE
        )
        dashed = fig.line("x", "y", source=self.hollow_ellipse, line_color=ESTIMATE, line_dash="dashed")
        strong = {"size": 12, "line_color": ESTIMATE, "line_width": 2, "fill_color": ESTIMATE}
        drift = fig.line("x", "y", source=self.drift, line_color=ESTIMATE, line_width=2, line_dash="dotted")
        place = fig.scatter("x", "y", source=self.fix, fill_alpha="fill", **strong)
        others = fig.scatter("x", "y", source=self.alternatives, fill_alpha=0, **strong)
        words = fig.text(
            "x",
            "y",
            text="label",
            source=self.alternatives,
            x_offset=9,
            text_font_size="11px",
            text_color=ESTIMATE,
        )
        dotted = {"line_color": ESTIMATE, "line_dash": "dotted", "line_alpha": 0.8}
        leg = fig.line("x", "y", source=self.leg, line_width=2, **dotted)
        end = fig.scatter(
            "x",
            "y",
            source=self.leg_end,
            marker="triangle",
            size=13,
            fill_alpha=0.3,
            color=ESTIMATE,
            name="leg end",
        )
        ahead = fig.line("x", "y", source=self.forecast, **dotted)
        fig.add_tools(PointDrawTool(renderers=[end], add=False, description="drag the end of the next leg"))
        truth = fig.scatter("x", "y", source=self.truth, marker="diamond", size=14, color=TRUTH)
        legend_entry(fig, "ship", [track, now], marker="triangle", size=10, color=SHIP)
        legend_entry(fig, "ping, by residual", [points], size=6, color=SHIP)
        legend_entry(fig, "fix, 95 % ellipse", [place, ring, dashed, drift], **strong)
        legend_entry(fig, "fits as well", [others, words], fill_alpha=0, **strong)
        self._leg_entry = legend_entry(
            fig,
            "next leg, forecast",
            [leg, end, ahead, shade],
            marker="triangle",
            size=10,
            color=ESTIMATE,
            alpha=0.5,
        )
        self._leg_entry.visible = False
        self._truth_entry = legend_entry(
            fig, "truth (simulated)", [truth], marker="diamond", size=14, color=TRUTH
        )
        bar = ColorBar(
            color_mapper=self.colour, title="ms", width=8, padding=4, major_label_text_font_size="10px"
        )
        fig.add_layout(bar, "right")
        style_legend(fig)
        return fig, home

    def _residuals(self):
        fig = figure(
            name="residuals",
            sizing_mode="stretch_both",
            tools="xpan,xwheel_zoom,box_select,tap,reset,save",
            active_scroll="xwheel_zoom",
            x_axis_label="ping",
            y_axis_label="residual (ms)",
        )
        ink = {"field": "shade_ms", "transform": self.colour}
        points = fig.scatter(
            "number",
            "residual_ms",
            source=self.pings,
            size=5,
            color=ink,
            marker="kind",
            nonselection_fill_alpha=0.15,
        )
        fig.add_layout(Span(location=0, dimension="width", line_color=SHIP, line_width=1))
        fig.add_tools(
            HoverTool(
                renderers=[points],
                tooltips=[
                    ("ping", "@number"),
                    ("residual", "@residual_ms{0.00} ms"),
                    ("moves the fix by", "@moves_m{0.00} m"),
                ],
            )
        )
        return fig

    def _history(self):
        fig = figure(
            name="history",
            sizing_mode="stretch_both",
            tools="xpan,xwheel_zoom,reset,save",
            active_scroll="xwheel_zoom",
            x_axis_label="ping",
            y_axis_label="depth (m), 95 % band",
        )
        fig.y_range.flipped = True
        fig.varea("number", "low", "high", source=self.history, fill_color=ESTIMATE, fill_alpha=0.2)
        line = fig.line("number", "depth", source=self.history, line_color=ESTIMATE, line_width=2)
        fig.add_tools(
            HoverTool(
                renderers=[line],
                mode="vline",
                tooltips=[("ping", "@number"), ("depth", "@depth{0.0} m"), ("ellipse", "@major{0.0} m")],
            )
        )
        return fig

    def _contours(self):
        fig = figure(
            name="contours",
            sizing_mode="stretch_both",
            tools="pan,wheel_zoom,reset,save",
            active_scroll="wheel_zoom",
            match_aspect=True,
        )
        blank = np.zeros((2, 2))
        drawn = fig.contour([0, 1], [0, 1], blank, list(LEVELS), line_color=ESTIMATE, line_alpha=0.8)
        centre = ColumnDataSource({"x": [], "y": []})
        fig.scatter("x", "y", source=centre, size=9, color=ESTIMATE)
        return fig, drawn, centre

    # -- data ----------------------------------------------------------------------------------

    def show_survey(self, pings: Pings, truth: dict | None) -> None:
        """Starts a new survey: the whole track as home box, the truth where it is known."""
        x, y = mercator(pings.lat_deg, pings.lon_deg)
        show_box(self.home, x, y)
        self.truth.data = {"x": [], "y": []}
        if truth is not None:
            tx, ty = mercator(truth["lat_deg"], truth["lon_deg"])
            self.truth.data = {"x": [float(tx)], "y": [float(ty)]}
        self._truth_entry.visible = truth is not None
        self.history.data = {name: [] for name in self.history.data}

    def show_contours(self, surface: MisfitSurface | None) -> None:
        """Chi-square contours about the fix, 95 % the second of them; None clears them."""
        blank = np.zeros((2, 2))
        grid = ([0, 1], [0, 1], blank) if surface is None else (surface.across_m, surface.up_m, surface.rise)
        self._contour.set_data(contour_data(*grid, list(LEVELS)))
        self._contour_centre.data = {"x": [], "y": []}
        if surface is not None:
            row, column = np.unravel_index(np.argmin(surface.rise), surface.rise.shape)
            self._contour_centre.data = {"x": [surface.across_m[column]], "y": [surface.up_m[row]]}
            self.contours.xaxis.axis_label = f"{surface.names[0]} (m)"
            self.contours.yaxis.axis_label = f"{surface.names[1]} (m)"
            self.contours.y_range.flipped = surface.names[1] == "depth"

    def show_fix(self, pings: Pings, fix: BeaconFix, moves_m: np.ndarray | None = None) -> None:
        """The pings heard so far, coloured by what this fix leaves of them, and the fix itself.

        moves_m : (N,) how far the fix would move without each ping
        """
        count = min(len(pings), len(fix.number))
        x, y = mercator(pings.lat_deg[:count], pings.lon_deg[:count])
        self.track.data = {"x": x, "y": y}
        self.ship.data = _ship_now(x, y)
        residual = np.full(count, np.nan) if fix.residual_s is None else 1e3 * fix.residual_s[:count]
        used = fix.used[:count]
        limit = max(3 * np.nanstd(residual[used]) if used.any() and fix.residual_s is not None else 1.0, 0.1)
        self.colour.update(low=-float(limit), high=float(limit))
        self.pings.data = {
            "number": fix.number[:count].astype(np.int32),
            "x": x,
            "y": y,
            "residual_ms": np.where(used, residual, np.clip(residual, -4 * limit, 4 * limit)).astype("f4"),
            "shade_ms": np.where(used, residual, np.nan).astype("f4"),  # grey where left out
            "used": np.where(used, "used", "left out"),
            "utc": np.where(np.isnat(pings.utc[:count]), "", pings.utc[:count].astype(str)),
            "kind": np.where(used, "circle", "x"),
            "moves_m": np.full(count, np.nan, "f4") if moves_m is None else moves_m[:count].astype("f4"),
        }
        self._show_place(fix)
        self._keep_in_sight(fix)

    def _keep_in_sight(self, fix: BeaconFix) -> None:
        """Widens the home box where an answer lies outside it."""
        self._widen(
            [*self.fix.data["x"], *self.alternatives.data["x"]],
            [*self.fix.data["y"], *self.alternatives.data["y"]],
        )

    def _widen(self, x: list, y: list) -> None:
        """Makes the home box hold these points too, if they are not far out."""
        x0, x1, y0, y1 = self.home.tags
        reach = 5 * max(x1 - x0, y1 - y0)  # a wild first guess must not shrink the survey to a dot
        near = [k for k in range(len(x)) if abs(x[k] - x0) < reach and abs(y[k] - y0) < reach]
        if any(not (x0 <= x[k] <= x1 and y0 <= y[k] <= y1) for k in near):
            show_box(
                self.home,
                np.array([x0, x1, *(x[k] for k in near)]),
                np.array([y0, y1, *(y[k] for k in near)]),
                margin=0.05,
            )

    def _show_place(self, fix: BeaconFix) -> None:
        full, hollow, drift = {"x": [], "y": []}, {"x": [], "y": []}, {"x": [], "y": []}
        place = {"x": [], "y": [], "fill": [], "label": []}
        if fix.position is not None:
            now = fix.present
            px, py = mercator(now.lat_deg, now.lon_deg)
            place = {
                "x": [float(px)],
                "y": [float(py)],
                "fill": [1.0 if fix.converged else 0.0],
                "label": [""],
            }
            if now.ellipse is not None and now.ellipse.semi_major_m < 50_000:
                ring = ellipse_ring(fix, now.position, now.ellipse)
                full, hollow = (ring, hollow) if fix.converged else (full, ring)
            if fix.velocity is not None:
                then_x, then_y = mercator(fix.lat_deg, fix.lon_deg)
                drift = {"x": [float(then_x), float(px)], "y": [float(then_y), float(py)]}
        self.fix.data, self.ellipse.data, self.hollow_ellipse.data = place, full, hollow
        self.drift.data = drift
        ax, ay = mercator([a.lat_deg for a in fix.alternatives], [a.lon_deg for a in fix.alternatives])
        self.alternatives.data = {
            "x": ax,
            "y": ay,
            "label": [f"also fits: {a.depth_m:.0f} m deep" for a in fix.alternatives],
        }

    def show_leg(self, fix: BeaconFix, forecast: Forecast | None, move_end: bool = True) -> None:
        """The leg of a forecast and the ellipse it would leave; None clears both.

        move_end : not while the analyst drags it
        """
        self._leg_entry.visible = forecast is not None
        if forecast is None:
            for source in (self.leg, self.leg_end, self.forecast):
                source.data = {"x": [], "y": []}
            self.attainable.data = {name: [] for name in self.attainable.data}
            return
        ends = np.column_stack([[forecast.leg.start, forecast.leg.end], np.zeros(2)])
        lat, lon, _ = fix.frame.to_geodetic(ends)
        x, y = mercator(lat, lon)
        self.leg.data = {"x": x, "y": y}
        if move_end:
            self.leg_end.data = {"x": x[1:], "y": y[1:]}
            self._widen(list(x), list(y))
        place = fix.present.position if fix.position is not None else None
        drawn = place is not None and forecast.ellipse.semi_major_m < 50_000
        self.forecast.data = ellipse_ring(fix, place, forecast.ellipse) if drawn else {"x": [], "y": []}

    def shade(self, fix: BeaconFix, east: np.ndarray, north: np.ndarray, error: np.ndarray) -> None:
        """Expected error [m] after a leg to each place of a grid, darker where it is less."""
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

    def add_history(self, fix: BeaconFix) -> None:
        """One more fix at the end of the history, if it is believed and later than the last one there."""
        known = self.history.data["number"]
        if fix.converged and (not len(known) or fix.number[-1] > known[-1]):
            self.history.stream(history_row(fix), rollover=5000)

    def set_history(self, fixes: list[BeaconFix]) -> None:
        """The whole history at once."""
        rows = [history_row(fix) for fix in fixes if fix.converged]
        self.history.data = {name: [row[name][0] for row in rows] for name in self.history.data}


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


def ellipse_ring(fix: BeaconFix, centre: np.ndarray, shape: Ellipse, points: int = 73) -> dict:
    """Mercator outline of an ellipse about a place (3,) in the frame of a fix."""
    angle = np.linspace(0, 2 * np.pi, points)
    bearing = np.radians(shape.bearing_deg)
    along, across = shape.semi_major_m * np.cos(angle), shape.semi_minor_m * np.sin(angle)
    east = centre[0] + along * np.sin(bearing) + across * np.cos(bearing)
    north = centre[1] + along * np.cos(bearing) - across * np.sin(bearing)
    lat, lon, _ = fix.frame.to_geodetic(np.column_stack([east, north, np.full(points, centre[2])]))
    x, y = mercator(lat, lon)
    return {"x": x, "y": y}


def _ship_now(x: np.ndarray, y: np.ndarray) -> dict:
    """The ship at its last ping, a triangle along its course over the pings before."""
    if not len(x):
        return {"x": [], "y": [], "angle": []}
    back = max(len(x) - 8, 0)
    course = np.arctan2(y[-1] - y[back], x[-1] - x[back]) - np.pi / 2
    return {"x": x[-1:], "y": y[-1:], "angle": [float(course)]}
