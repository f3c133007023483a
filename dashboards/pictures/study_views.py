"""Curves of a Monte Carlo study: error against the bound, its efficiency, and how often the ellipsoid holds."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, FixedTicker, HoverTool, PrintfTickFormatter, Span
from bokeh.plotting import figure

from dashboards.palette import COMPONENTS, ESTIMATE, SHIP
from dashboards.pictures.legend import style_legend

METHOD_INK = {"all-pings": ESTIMATE, "thesis": COMPONENTS[1], "usual": COMPONENTS[2]}
METHOD_NAMES = {"all-pings": "every ping", "thesis": "thesis's experiments", "usual": "usual least squares"}
COLUMNS = ("abscissa", "rmse", "stated", "bound", "ratio", "coverage", "low", "high", "converged")
# Of the axis of errors: Bokeh's own logarithmic ticks leave most of two decades without a number.
TICKS = [step * 10.0**power for power in range(-5, 6) for step in (1, 1.5, 2, 3, 5, 7)]
LABELS = {"experiments": "number of experiments", "spacing": "spacing (receptions)"}


class StudyViews:
    """Error of one component, its ratio to the bound, and coverage, over what a sweep turns."""

    def __init__(self):
        empty = {name: [] for name in COLUMNS}
        self.curves = {method: ColumnDataSource(empty, name=method) for method in METHOD_INK}
        self.error = self._figure("study error", "error", "log")
        self.ratio = self._figure("study ratio", "error over bound", "log")
        self.coverage = self._figure("study coverage", "inside the 95 % ellipsoid", "linear")
        for method, ink in METHOD_INK.items():
            source, name = self.curves[method], METHOD_NAMES[method]
            dots = self.error.scatter("abscissa", "rmse", source=source, size=6, color=ink, legend_label=name)
            self.error.line("abscissa", "rmse", source=source, color=ink, legend_label=name)
            self.error.line(
                "abscissa",
                "stated",
                source=source,
                color=ink,
                line_dash="dotted",
                legend_label=f"{name}, stated",
            )
            self.error.line(
                "abscissa",
                "bound",
                source=source,
                color=SHIP,
                line_dash="dashed",
                legend_label="Cramér-Rao bound",
            )
            tips = [
                ("", "@abscissa"),
                ("error", "@rmse{0.000}"),
                ("stated", "@stated{0.000}"),
                ("bound", "@bound{0.000}"),
                ("converged", "@converged{0.0 %}"),
            ]
            self.error.add_tools(HoverTool(renderers=[dots], tooltips=tips))
            self.ratio.line("abscissa", "ratio", source=source, color=ink)
            self.ratio.scatter("abscissa", "ratio", source=source, size=4, color=ink)
            self.coverage.varea("abscissa", "low", "high", source=source, fill_color=ink, fill_alpha=0.2)
            self.coverage.line("abscissa", "coverage", source=source, color=ink)
        self.error.yaxis.ticker = self.error.ygrid.ticker = FixedTicker(ticks=TICKS)
        self.error.yaxis.formatter = PrintfTickFormatter(format="%g")
        style_legend(self.error)
        self.error.legend.location = "top_right"
        self.ratio.add_layout(Span(location=1, dimension="width", line_color=SHIP, line_dash="dashed"))
        self.coverage.add_layout(Span(location=0.95, dimension="width", line_color=SHIP, line_dash="dashed"))
        self.coverage.y_range.start, self.coverage.y_range.end = 0.0, 1.02

    @staticmethod
    def _figure(name, label, scale):
        return figure(
            name=name,
            sizing_mode="stretch_both",
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_scroll="wheel_zoom",
            y_axis_type=scale,
            y_axis_label=label,
        )

    def show(self, rows: list[dict], sweep: str, component: str) -> None:
        """Draws rows of a study (see `trackerlib.commands.study.one_row`) for a component such as "z" or "vx"."""
        self.error.yaxis.axis_label = (
            f"SIMULATED: root-mean-square error of {component} ({unit_of(component)})"
        )
        for fig in (self.error, self.ratio, self.coverage):
            fig.xaxis.axis_label = LABELS[sweep]
        for method, source in self.curves.items():
            source.data = curve([row for row in rows if row["method"] == method], sweep, component)


def unit_of(component: str) -> str:
    """Unit of a component such as "z" or "vx"."""
    return "m/s" if component.startswith("v") else "m"


def curve(rows: list[dict], sweep: str, component: str) -> dict:
    """Columns of one method's curve; gaps where no trial converged or the bound is infinite."""
    rows = sorted(rows, key=lambda row: row[sweep])

    def column(name):
        values = np.array([row.get(name, np.nan) for row in rows], float)
        return np.where(np.isfinite(values), values, np.nan)

    rmse, bound, coverage = column(f"rmse.{component}"), column(f"crlb.{component}"), column("coverage95")
    converged = np.array([row["converged"] for row in rows], float)
    trials = np.array([row["trials"] for row in rows], float)
    half = 1.96 * np.sqrt(coverage * (1 - coverage) / np.maximum(converged, 1))
    return {
        "abscissa": np.array([row[sweep] for row in rows], float),
        "rmse": rmse,
        "stated": column(f"mean_sigma.{component}"),
        "bound": bound,
        "ratio": rmse / bound,
        "coverage": coverage,
        "low": np.clip(coverage - half, 0, 1),
        "high": np.clip(coverage + half, 0, 1),
        "converged": converged / np.maximum(trials, 1),
    }
