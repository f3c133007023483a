"""Offsets of every set against point count (Figure 4 of Read 1990), and jumps at hand-overs."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, FactorRange, HoverTool, TapTool
from bokeh.plotting import figure

from dashboards.palette import BEFORE, ESTIMATE, FIRST_ARRAY, REJECTED, SECOND_ARRAY
from dashboards.pictures.legend import legend_entry, style_legend
from trackerlib.timing.correction import TimingCorrection
from trackerlib.timing.one_run import Agreement
from trackerlib.timing.run_track import HandOver

COLUMNS = ("t0", "offset", "low", "high", "pair", "points", "row", "ink", "mark")


class OffsetsByTime:
    """Offset with its 95 % bar against t0; sets of a suspected array in another colour; a click chooses a set."""

    def __init__(self):
        self.source = ColumnDataSource({name: [] for name in COLUMNS}, name="offsets")
        self.chosen = ColumnDataSource({"x": [], "y": []})
        self.figure = fig = figure(
            name="offset_by_t0",
            sizing_mode="stretch_both",
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_scroll="wheel_zoom",
            x_axis_label="point count t0",
            y_axis_label="offset (ms)",
        )
        self.line = ColumnDataSource({"x": [], "y": []})
        line = fig.line("x", "y", source=self.line, line_color=ESTIMATE, line_width=1.5)
        fig.segment(
            "t0", "low", "t0", "high", source=self.source, line_color="ink", nonselection_line_alpha=1.0
        )
        dots = fig.scatter(
            "t0", "offset", source=self.source, size=7, color="ink", marker="mark", nonselection_alpha=1.0
        )
        fig.scatter("x", "y", source=self.chosen, size=15, fill_color=None, line_color=ESTIMATE, line_width=2)
        fig.add_tools(
            TapTool(renderers=[dots]),
            HoverTool(
                renderers=[dots],
                tooltips=[("arrays", "@pair"), ("offset", "@offset{0.000} ms"), ("points", "@points")],
            ),
        )
        legend_entry(fig, "offset of a set, 95 % bar", [], color=FIRST_ARRAY, size=7)
        legend_entry(fig, "array that stands in the way", [], color=SECOND_ARRAY, size=7)
        legend_entry(fig, "too few for a sigma", [], color=REJECTED, marker="x", size=7)
        legend_entry(fig, "what they agree on", [line], line=True, line_color=ESTIMATE)
        style_legend(fig)
        fig.legend.ncols = 2
        fig.add_layout(fig.legend[0], "above")

    def show(self, sets, fits, serves: Agreement | None) -> None:
        """Every set that has a fit; `serves` is what the run's offsets agree on, if anything."""
        rows = [(k, one, fit) for k, (one, fit) in enumerate(zip(sets, fits, strict=True)) if fit is not None]
        suspect = None if serves is None else serves.left_out
        self.source.data = {
            "t0": [fit.t0 for _, _, fit in rows],
            "offset": [1e3 * fit.offset_s for _, _, fit in rows],
            "low": [1e3 * (fit.offset_s - 1.96 * _sigma(fit)) for _, _, fit in rows],
            "high": [1e3 * (fit.offset_s + 1.96 * _sigma(fit)) for _, _, fit in rows],
            "pair": ["{} and {}".format(*one.pair) for _, one, _ in rows],
            "points": [fit.points for _, _, fit in rows],
            "row": [k for k, _, _ in rows],
            "ink": [_ink(one, fit, suspect) for _, one, fit in rows],
            "mark": ["x" if fit.sigma_offset_s is None else "circle" for _, _, fit in rows],
        }
        self._show_serving(serves)

    def _show_serving(self, serves: Agreement | None) -> None:
        counts = self.source.data["t0"]
        if serves is None or not counts:
            self.line.data = {"x": [], "y": []}
            return
        ends = np.array([min(counts), max(counts)])
        offset = serves.offset_s + serves.drift_s_per_count * (ends - serves.mean_count)
        self.line.data = {"x": ends, "y": 1e3 * offset}

    def choose(self, row: int | None) -> None:
        """Rings the set chosen."""
        data = self.source.data
        at = [k for k, one in enumerate(data["row"]) if one == row]
        self.chosen.data = {"x": [data["t0"][k] for k in at], "y": [data["offset"][k] for k in at]}


def _sigma(fit: TimingCorrection) -> float:
    return 0.0 if fit.sigma_offset_s is None else fit.sigma_offset_s


def _ink(one, fit: TimingCorrection, suspect: int | None) -> str:
    if fit.sigma_offset_s is None:
        return REJECTED
    return SECOND_ARRAY if suspect in one.pair else FIRST_ARRAY


class Jumps:
    """Step of the track at each hand-over, as reported and corrected."""

    def __init__(self):
        self.source = ColumnDataSource({"name": [], "before": [], "after": [], "counts": []}, name="jumps")
        self.figure = fig = figure(
            name="jumps",
            sizing_mode="stretch_both",
            tools="reset,save",
            x_range=FactorRange(),
            y_axis_label="step at the hand-over (ft)",
        )
        fig.xaxis.major_label_orientation = 1.2
        fig.y_range.start = 0
        before = fig.scatter("name", "before", source=self.source, size=7, color=BEFORE, marker="square")
        after = fig.scatter("name", "after", source=self.source, size=8, color=ESTIMATE)
        fig.segment("name", "before", "name", "after", source=self.source, line_color=BEFORE, line_alpha=0.6)
        tips = [("", "@name, counts @counts"), ("before", "@before{0.0} ft"), ("after", "@after{0.0} ft")]
        fig.add_tools(HoverTool(renderers=[before, after], tooltips=tips))
        legend_entry(fig, "as reported", [before], color=BEFORE, marker="square", size=7)
        legend_entry(fig, "corrected", [after], color=ESTIMATE, size=8)
        style_legend(fig)
        fig.legend.location = "top_right"

    def show(self, hand_overs: tuple[HandOver, ...]) -> None:
        """Hand-overs in order of point count."""
        names = [f"{one.pair[0]}-{one.pair[1]} at {one.first}" for one in hand_overs]
        self.figure.x_range.factors = names
        self.source.data = {
            "name": names,
            "before": [one.jump_before for one in hand_overs],
            "after": [one.jump_after for one in hand_overs],
            "counts": [f"{one.first} to {one.last}" for one in hand_overs],
        }
