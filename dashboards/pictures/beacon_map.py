"""The map of a beacon hunt: ship, pings, fixes, their ellipses, what else fits, what the chart showed."""

from __future__ import annotations

import numpy as np
from bokeh.core.properties import value
from bokeh.models import ColorBar, ColumnDataSource, HoverTool, LinearColorMapper

from dashboards.palette import DIVERGING, ESTIMATE, REJECTED, SECOND_ARRAY, SHIP, TRUTH
from dashboards.pictures.bearing_layer import BearingLayer
from dashboards.pictures.leg_layer import LegLayer
from dashboards.pictures.legend import legend_entry, style_legend
from dashboards.pictures.mercator import map_figure, mercator, show_box
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix, chi_square_words
from trackerlib.beacon.uncertainty import Ellipse

PING_COLUMNS = ("number", "x", "y", "residual_ms", "shade_ms", "used", "utc", "kind", "moves_m")
MOST_DRAWN = 4000  # pings; of more, every second, third, ... is drawn
LARGEST_DRAWN_M = 50_000.0  # half axis of an ellipse
STRONG = {"size": 12, "line_color": ESTIMATE, "line_width": 2, "fill_color": ESTIMATE}


class BeaconMap:
    """The map; `show_survey` and `show_fix` replace only what changed."""

    def __init__(self, tile_address: str = ""):
        self.pings = ColumnDataSource({name: [] for name in PING_COLUMNS}, name="pings")
        self.track = _points("track")
        self.ship = ColumnDataSource({"x": [], "y": [], "angle": []})
        self.trail = _points("trail", "number")
        self.fix = _points("fix", "fill")
        self.ellipse, self.hollow_ellipse = _points("ellipse"), _points("hollow ellipse")
        self.alternatives = _points("alternatives", "label")
        self.compared = _points("compared", "label", "below_px")
        self.compared_rings = ColumnDataSource({"xs": [], "ys": []}, name="compared rings")
        self.truth = _points("truth")
        self.drift = _points("drift")
        self.pointed = _points("pointed")
        self.colour = LinearColorMapper(DIVERGING, low=-1, high=1, nan_color=REJECTED)
        self.map, self.home = map_figure("beacon map", tile_address)
        self.leg = LegLayer(self.map)
        self._draw_survey()
        self._draw_answer()
        self._draw_reference()
        self._add_legend()

    # -- layers --------------------------------------------------------------------------------

    def _draw_survey(self) -> None:
        fig = self.map
        self._track = [
            fig.line("x", "y", source=self.track, color=SHIP, line_width=1),
            fig.scatter("x", "y", source=self.ship, marker="triangle", angle="angle", size=13, color=SHIP),
        ]
        self._dots = fig.scatter(
            "x",
            "y",
            source=self.pings,
            size=6,
            color={"field": "shade_ms", "transform": self.colour},
            line_color={"field": "shade_ms", "transform": self.colour},
            line_width=0.5,
            marker="kind",
            nonselection_fill_alpha=0.15,
            nonselection_line_alpha=0.15,
        )
        tips = [("ping", "@number"), ("residual", "@residual_ms{0.00} ms"), ("UTC", "@utc"), ("", "@used")]
        fig.add_tools(HoverTool(renderers=[self._dots], tooltips=tips))

    def _draw_answer(self) -> None:
        fig = self.map
        self._trail = [
            fig.line("x", "y", source=self.trail, line_color=ESTIMATE, line_alpha=0.5),
            fig.scatter("x", "y", source=self.trail, size=4, color=ESTIMATE, alpha=0.5),
        ]
        fig.add_tools(
            HoverTool(renderers=self._trail[1:], tooltips=[("fix after ping", "@number")], name="trail hover")
        )
        self._rings = [
            fig.patch(
                "x", "y", source=self.ellipse, fill_color=ESTIMATE, fill_alpha=0.15, line_color=ESTIMATE
            ),
            fig.line("x", "y", source=self.hollow_ellipse, line_color=ESTIMATE, line_dash="dashed"),
        ]
        self._place = [
            fig.line("x", "y", source=self.drift, line_color=ESTIMATE, line_width=2, line_dash="dotted"),
            fig.scatter("x", "y", source=self.fix, fill_alpha="fill", **STRONG),
        ]
        words = {"x_offset": 9, "text_font_size": "11px", "text_font_style": "bold", "text": "label"}
        self._others = [
            fig.scatter("x", "y", source=self.alternatives, fill_alpha=0, **STRONG),
            fig.text("x", "y", source=self.alternatives, text_color=ESTIMATE, **words),
        ]
        ink = {"line_color": ESTIMATE, "line_alpha": 0.8}
        self._compared = [
            fig.multi_line("xs", "ys", source=self.compared_rings, line_dash="dotdash", **ink),
            fig.scatter("x", "y", source=self.compared, size=9, fill_alpha=0, line_width=1.5, **ink),
            fig.text("x", "y", source=self.compared, y_offset="below_px", text_color=ESTIMATE, **words),
        ]

    def _draw_reference(self) -> None:
        fig = self.map
        self.bearings = BearingLayer(fig)
        self._pointed = [
            fig.scatter(
                "x", "y", source=self.pointed, size=16, fill_alpha=0, line_color=SECOND_ARRAY, line_width=2
            )
        ]
        self._truth = [fig.scatter("x", "y", source=self.truth, marker="diamond", size=14, color=TRUTH)]

    def _add_legend(self) -> None:
        fig = self.map
        faint = {"color": ESTIMATE, "alpha": 0.5}
        legend_entry(fig, "ship", self._track, marker="triangle", size=10, color=SHIP)
        self._pings_entry = legend_entry(fig, "ping, by residual", [self._dots], size=6, color=SHIP)
        legend_entry(fig, "fix", self._place, **STRONG)
        legend_entry(fig, "95 % ellipse", self._rings, line=True, line_color=ESTIMATE)
        self._others_entry = legend_entry(fig, "fits as well", self._others, fill_alpha=0, **STRONG)
        self._trail_entry = legend_entry(fig, "earlier fixes", self._trail, size=4, **faint)
        self._compared_entry = legend_entry(
            fig, "other estimators", self._compared, size=9, fill_alpha=0, line_color=ESTIMATE
        )
        self.bearings.add_legend()
        self._pointed_entry = legend_entry(
            fig, "line pointed at in the chart", self._pointed, size=12, fill_alpha=0, line_color=SECOND_ARRAY
        )
        self.leg.add_legend()
        self._truth_entry = legend_entry(
            fig, "truth (simulated)", self._truth, marker="diamond", size=14, color=TRUTH
        )
        for entry in (self._others_entry, self._trail_entry, self._compared_entry, self._pointed_entry):
            entry.visible = False
        style_legend(fig)
        bar = ColorBar(
            color_mapper=self.colour,
            title="residual (ms)",
            width=8,
            padding=4,
            major_label_text_font_size="10px",
        )
        fig.add_layout(bar, "right")

    # -- data ----------------------------------------------------------------------------------

    def show_survey(self, pings: Pings | None, truth: dict | None) -> None:
        """Starts a new survey: the whole track as home box, the truth where it is known."""
        self._show_trail([])
        self.truth.data = {"x": [], "y": []}
        self._truth_entry.visible = truth is not None
        if truth is not None:
            tx, ty = mercator(truth["lat_deg"], truth["lon_deg"])
            self.truth.data = {"x": [float(tx)], "y": [float(ty)]}
        if pings is not None:
            show_box(self.home, *mercator(pings.lat_deg, pings.lon_deg))

    def keep_ship_in_sight(self, pings: Pings) -> None:
        """Makes the home box hold a track that grows."""
        x, y = mercator(pings.lat_deg, pings.lon_deg)
        x0, x1, y0, y1 = self.home.tags
        if np.nanmin(x) < x0 or np.nanmax(x) > x1 or np.nanmin(y) < y0 or np.nanmax(y) > y1:
            show_box(self.home, x, y, margin=0.5)

    def show_moves(self, moves_m: np.ndarray) -> None:
        """How far (N,) [m] the fix shown would move without each ping."""
        every = max(-(-len(moves_m) // MOST_DRAWN), 1)
        self.pings.data["moves_m"] = moves_m[::every].astype("f4")

    def show_fix(self, pings: Pings, fix: BeaconFix) -> None:
        """The pings heard so far, coloured by what this fix leaves of them, and the fix itself."""
        count = min(len(pings), len(fix.number))
        every = -(-count // MOST_DRAWN)
        drawn = np.arange(0, count, max(every, 1))
        x, y = mercator(pings.lat_deg[drawn], pings.lon_deg[drawn])
        self.track.data = {"x": x, "y": y}
        self.ship.data = _ship_now(x, y)
        thinned = "" if every < 2 else f" (1 of {every} drawn)"
        self._pings_entry.label = value(f"ping, by residual{thinned}")
        residual = np.full(count, np.nan) if fix.residual_s is None else 1e3 * fix.residual_s[:count]
        used = fix.used[:count]
        limit = max(3 * np.nanstd(residual[used]) if used.any() and fix.residual_s is not None else 1.0, 0.1)
        self.colour.update(low=-float(limit), high=float(limit))
        used, residual = used[drawn], residual[drawn]
        utc = pings.utc[drawn]
        self.pings.data = {
            "number": fix.number[drawn].astype(np.int32),
            "x": x,
            "y": y,
            "residual_ms": np.where(used, residual, np.clip(residual, -4 * limit, 4 * limit)).astype("f4"),
            "shade_ms": np.where(used, residual, np.nan).astype("f4"),  # grey where left out
            "used": np.where(used, "used", "left out"),
            "utc": np.where(np.isnat(utc), "", utc.astype(str)),
            "kind": np.where(used, "circle", "x"),
            "moves_m": np.full(len(drawn), np.nan, "f4"),
        }
        self._show_place(fix)
        self.widen(
            [*self.fix.data["x"], *self.alternatives.data["x"]],
            [*self.fix.data["y"], *self.alternatives.data["y"]],
        )

    def widen(self, x: list, y: list) -> None:
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
        place = {"x": [], "y": [], "fill": []}
        if fix.position is not None:
            now = fix.present
            px, py = mercator(now.lat_deg, now.lon_deg)
            place = {"x": [float(px)], "y": [float(py)], "fill": [1.0 if fix.converged else 0.0]}
            if now.ellipse is not None and now.ellipse.semi_major_m < LARGEST_DRAWN_M:
                ring = ellipse_ring(fix, now.position, now.ellipse)
                full, hollow = (ring, hollow) if fix.converged else (full, ring)
            if fix.velocity is not None:
                then_x, then_y = mercator(fix.lat_deg, fix.lon_deg)
                drift = {"x": [float(then_x), float(px)], "y": [float(then_y), float(py)]}
        self.fix.data, self.ellipse.data, self.hollow_ellipse.data = place, full, hollow
        self.drift.data = drift
        ax, ay = mercator([a.lat_deg for a in fix.alternatives], [a.lon_deg for a in fix.alternatives])
        self._others_entry.visible = bool(fix.alternatives)
        self.alternatives.data = {
            "x": ax,
            "y": ay,
            "label": [
                f"also fits: {a.depth_m:.0f} m deep, {chi_square_words(a.misfit)}" for a in fix.alternatives
            ],
        }

    def show_compared(self, fixes: dict[str, BeaconFix]) -> None:
        """What other estimators say, each with its ellipse where it believes one; none clears them."""
        placed = {name: fix for name, fix in fixes.items() if fix.position is not None}
        self._compared_entry.visible = bool(placed)
        rings = [
            ellipse_ring(fix, fix.present.position, fix.present.ellipse)
            for fix in placed.values()
            if fix.uncertainty is not None and fix.present.ellipse.semi_major_m < LARGEST_DRAWN_M
        ]
        self.compared_rings.data = {axis + "s": [ring[axis] for ring in rings] for axis in ("x", "y")}
        now = [fix.present for fix in placed.values()]
        x, y = mercator([place.lat_deg for place in now], [place.lon_deg for place in now])
        below = 13 * np.arange(1, len(placed) + 1)  # pixels, so that names of one place stand in a list
        self.compared.data = {"x": x, "y": y, "label": list(placed), "below_px": below}
        self.widen(list(x), list(y))

    def show_bearings(self, lines: tuple) -> None:
        """Bearing lines read off the chart, and the place where they meet."""
        self.bearings.show(lines)
        if lines:
            self.widen(*self.bearings.points())

    def show_pointed(self, place: tuple[float, float] | None) -> None:
        """Where the ship was at the line of the chart that is pointed at."""
        self._pointed_entry.visible = place is not None
        x, y = mercator(*place) if place is not None else ([], [])
        self.pointed.data = {"x": np.atleast_1d(x), "y": np.atleast_1d(y)}

    def show_trail(self, fixes: list[BeaconFix]) -> None:
        """Where the fixes of a history stood."""
        self._show_trail([fix for fix in fixes if fix.converged])

    def add_to_trail(self, fix: BeaconFix) -> None:
        """One more of them."""
        if fix.converged:
            x, y = mercator(fix.present.lat_deg, fix.present.lon_deg)
            self._trail_entry.visible = True
            row = {"x": [float(x)], "y": [float(y)], "number": [int(fix.number[-1])]}
            self.trail.stream(row, rollover=2000)

    def _show_trail(self, fixes: list[BeaconFix]) -> None:
        x, y = mercator([fix.present.lat_deg for fix in fixes], [fix.present.lon_deg for fix in fixes])
        self.trail.data = {"x": x, "y": y, "number": [int(fix.number[-1]) for fix in fixes]}
        self._trail_entry.visible = bool(fixes)


def _points(name: str, *more: str) -> ColumnDataSource:
    return ColumnDataSource({column: [] for column in ("x", "y", *more)}, name=name)


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
