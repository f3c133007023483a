"""What stands beside each line of the paper: level, noise, signal to noise, gain, missed pings."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, LinearAxis, Range1d
from bokeh.plotting import figure

from dashboards.palette import FIRST_ARRAY, REJECTED, SECOND_ARRAY
from dashboards.pictures.legend import legend_entry, style_legend
from dashboards.pictures.mercator import mercator
from trackerlib.receiver.rolls import LineValues

COLUMNS = ("line", "y", "level", "noise", "snr_db", "attenuation_db", "missed_x", "ship_x", "ship_y")
INK = "#8C6D46"


class LineStrip:
    """A narrow figure that shares the paper's lines."""

    def __init__(self, lines: Range1d, history: int):
        self.history = history
        self.source = ColumnDataSource({name: [] for name in COLUMNS}, name="line values")
        self.figure = fig = figure(
            name="beside",
            width=230,
            sizing_mode="stretch_height",
            y_range=lines,
            x_range=Range1d(0, 255),
            tools="ywheel_pan,reset",
            active_scroll="ywheel_pan",
            x_axis_label="level, noise (of 255)",
            toolbar_location=None,
        )
        fig.extra_x_ranges = {"db": Range1d(0, 80)}
        fig.add_layout(
            LinearAxis(x_range_name="db", axis_label="signal/noise, attenuation (dB)"), "below"
        )  # fmt: skip
        for axis in fig.xaxis:
            axis.ticker.desired_num_ticks = 4
        fig.yaxis.visible = False
        fig.ygrid.visible = False
        self._draw()

    def _draw(self) -> None:
        fig, source = self.figure, self.source
        looks = {
            "level": ("level", {"line_color": INK}),
            "noise": ("noise", {"line_color": REJECTED, "line_dash": "dotted"}),
            "snr_db": ("signal to noise", {"line_color": FIRST_ARRAY}),
            "attenuation_db": ("attenuation", {"line_color": SECOND_ARRAY, "line_dash": "dashed"}),
        }
        for name, (label, ink) in looks.items():
            where = {"x_range_name": "db"} if name.endswith("_db") else {}
            line = fig.line(name, "y", source=source, **ink, **where)
            legend_entry(fig, label, [line], line=True, **ink)
        gone = {"marker": "dash", "size": 12, "color": "#C62828"}
        ticks = fig.scatter("missed_x", "y", source=source, **gone)
        legend_entry(fig, "missed", [ticks], **gone)
        style_legend(fig)
        fig.legend.location = "bottom_right"
        fig.legend.background_fill_alpha = 0.8
        tips = [
            ("line", "@line"),
            ("level", "@level{0}"),
            ("noise", "@noise{0}"),
            ("signal to noise", "@snr_db{0.0} dB"),
            ("attenuation", "@attenuation_db{0} dB"),
        ]
        fig.add_tools(HoverTool(renderers=[fig.renderers[0], ticks], tooltips=tips, mode="hline"))

    def clear(self) -> None:
        """Nothing beside the paper."""
        self.source.data = {name: np.empty(0) for name in COLUMNS}

    def add(self, first: int, values: LineValues) -> None:
        """Values of the next lines, the first of which has that number."""
        line = first + np.arange(len(values.level))
        x, y = mercator(values.lat_deg, values.lon_deg)
        self.source.stream(
            {
                "line": line,
                "y": line + 0.5,
                "level": np.where(values.missed, np.nan, values.level),
                "noise": values.noise,
                "snr_db": np.where(values.missed, np.nan, values.snr_db),
                "attenuation_db": values.attenuation_db,
                "missed_x": np.where(values.missed, 8.0, np.nan),
                "ship_x": x,
                "ship_y": y,
            },
            rollover=self.history,
        )

    @property
    def missed(self) -> int:
        """How many of the lines shown have nothing above the threshold."""
        return int(np.isfinite(np.asarray(self.source.data["missed_x"], float)).sum())
