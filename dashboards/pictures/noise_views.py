"""Noise of a set: residuals about smooth courses with their ellipses, and how the noise repeats in time."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d
from bokeh.plotting import figure
from scipy.stats import chi2

from dashboards.palette import ESTIMATE, FIRST_ARRAY, SECOND_ARRAY, SHIP
from dashboards.pictures.legend import legend_entry, style_legend
from trackerlib.crossover.noise import Autocorrelation, ResidualNoise, autocorrelation, displacement

AXES = ("downrange", "crossrange", "vertical")
SERIES = (*AXES, "displacement")
AROUND = np.linspace(0, 2 * np.pi, 73)
INKS = (FIRST_ARRAY, SECOND_ARRAY)


class NoiseViews:
    """Residuals from above and from the side, on the tracks' own source, and four autocorrelations."""

    def __init__(self, points: ColumnDataSource):
        self.level = self._residuals("residuals_level", points, 0, 1)
        self.upright = self._residuals("residuals_upright", points, 0, 2)
        self._lags = [
            ColumnDataSource({"lag": [], "first": [], "second": [], "band": [], "below": []}) for _ in SERIES
        ]
        self.correlations = [
            self._correlation(name, source) for name, source in zip(SERIES, self._lags, strict=True)
        ]

    def _residuals(self, name, points, across, up):
        fig = figure(
            name=name,
            sizing_mode="stretch_both",
            tools="pan,wheel_zoom,box_select,lasso_select,tap,reset,save",
            active_scroll="wheel_zoom",
            x_axis_label=f"{AXES[across]} residual (ft)",
            y_axis_label=f"{AXES[up]} residual (ft)",
            x_range=Range1d(-10, 10),
            y_range=Range1d(-10, 10),
        )
        fig.tags = [across, up]
        rings = ColumnDataSource({"xs": [], "ys": [], "ink": []}, name="ellipses")
        fig.multi_line("xs", "ys", source=rings, line_color="ink", line_width=2)
        labels = ("first array", "second array")
        for letter, ink, label, mark in zip("xy", INKS, labels, ("circle", "square"), strict=True):
            dots = fig.scatter(
                f"r{letter}{across}", f"r{letter}{up}", source=points, size=4, marker=f"mark{letter}",
                fill_color=f"ink{letter}", line_color=f"edge{letter}", alpha=0.7, nonselection_alpha=0.1,
            )  # fmt: skip
            fig.add_tools(
                HoverTool(
                    renderers=[dots],
                    tooltips=[("count", "@count"), ("line", f"@line{letter}"), ("", "@used")],
                )
            )
            legend_entry(fig, label, [dots], color=ink, size=6, marker=mark)
        legend_entry(fig, "gap, first less second: M", [], line=True, line_color=ESTIMATE, line_width=2)
        style_legend(fig)
        return fig

    def _correlation(self, name, source):
        fig = figure(
            name=f"autocorrelation_{name}",
            sizing_mode="stretch_both",
            tools="xpan,reset,save",
            x_axis_label="lag (counts)",
            title=name,
            y_range=Range1d(-1, 1.05),
        )
        fig.title.text_font_size = "12px"
        fig.varea("lag", "below", "band", source=source, fill_color=SHIP, fill_alpha=0.18)
        for column, ink in zip(("first", "second"), INKS, strict=True):
            line = fig.line("lag", column, source=source, line_color=ink, line_width=1.5)
            fig.scatter("lag", column, source=source, size=4, color=ink)
            fig.add_tools(
                HoverTool(renderers=[line], tooltips=[("lag", "@lag"), ("R(h)/R(0)", f"@{column}{{0.00}}")])
            )
        return fig

    def show(self, noise: ResidualNoise | None, point_count: np.ndarray, keep: np.ndarray) -> None:
        """Ellipses that hold 95 % and autocorrelations of the points kept; None clears them."""
        for fig in (self.level, self.upright):
            self._show_ellipses(fig, noise)
        for k, source in enumerate(self._lags):
            if noise is None:
                source.data = {name: [] for name in source.data}
                continue
            first, second = (
                _of(residual[keep], point_count[keep], k) for residual in (noise.residual_x, noise.residual_y)
            )
            source.data = {
                "lag": first.lag,
                "first": first.value,
                "second": second.value,
                "band": first.band,
                "below": -first.band,
            }

    def _show_ellipses(self, fig, noise: ResidualNoise | None) -> None:
        across, up = fig.tags
        rings = fig.renderers[0].data_source
        if noise is None:
            rings.data = {"xs": [], "ys": [], "ink": []}
            return
        outlines = [ellipse(c, across, up) for c in (noise.first, noise.second, noise.gap)]
        rings.data = {
            "xs": [outline[0].tolist() for outline in outlines],
            "ys": [outline[1].tolist() for outline in outlines],
            "ink": [*INKS, ESTIMATE],
        }
        reach = 1.5 * float(np.abs(outlines).max())
        for axis in (fig.x_range, fig.y_range):
            axis.update(start=-reach, end=reach, reset_start=-reach, reset_end=reach)


def ellipse(covariance: np.ndarray, across: int, up: int, share: float = 0.95) -> np.ndarray:
    """Outline (2, N) about zero of the ellipse that holds a share of two components with this covariance (3, 3)."""
    values, vectors = np.linalg.eigh(covariance[np.ix_([across, up], [across, up])])
    half = np.sqrt(np.maximum(values, 0.0) * chi2.ppf(share, 2))
    return vectors @ (half[:, None] * np.stack([np.cos(AROUND), np.sin(AROUND)]))


def _of(residual: np.ndarray, point_count: np.ndarray, k: int) -> Autocorrelation:
    series = displacement(residual) if k == len(AXES) else residual[:, k]
    return autocorrelation(series, point_count)
