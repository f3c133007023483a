"""Scrolling wet paper: one Bokeh image a strip of lines, so that a new line patches one strip only."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, LinearColorMapper, Range1d
from bokeh.palettes import Cividis256, Greys256
from bokeh.plotting import figure

from dashboards.palette import paper_colours

STRIP = 50  # lines a strip; cost a line does not depend on how many strips there are
LOOKS = {"paper": paper_colours(), "grey": list(reversed(Greys256)), "colour": list(Cividis256)}


class WetPaper:
    """A ring of strips of `columns` x STRIP lines; newest line at the bottom."""

    def __init__(self, columns: int, history: int = 1000):
        self.columns, self.history = columns, history
        self.strips = -(-history // STRIP) + 1  # one spare: the one being filled
        self.count = 0  # lines ever added
        self._paper = np.zeros((self.strips, STRIP, columns), np.uint8)
        self._top = [float((k - self.strips) * STRIP) for k in range(self.strips)]
        self._dirty: dict[int, int] = {}  # strip -> first line to send, -1 for all of it
        self.source = ColumnDataSource(
            {
                "image": [strip.copy() for strip in self._paper],
                "y": list(self._top),
                "dw": [1.0] * self.strips,
            },
            name="wet paper",
        )
        self.marks = ColumnDataSource({"x": [], "y": [], "number": [], "used": []}, name="marks")
        self.lines = Range1d(history, 0)  # downwards: the newest line is at the bottom
        self.across = Range1d(0, 1)
        self.colours = LinearColorMapper(LOOKS["paper"], low=0, high=255)
        self.figure = self._figure()

    def _figure(self):
        fig = figure(
            name="wet paper",
            sizing_mode="stretch_both",
            x_range=self.across,
            y_range=self.lines,
            tools="pan,wheel_zoom,box_zoom,reset,save",
            active_scroll=None,
            x_axis_label="arrival, folded (s)",
            y_axis_label="ping",
        )
        fig.grid.visible = False
        fig.image(
            "image",
            x=0,
            y="y",
            dw="dw",
            dh=STRIP,
            source=self.source,
            level="underlay",
            color_mapper=self.colours,
            origin="bottom_left",
        )
        crosses = fig.scatter(
            "x",
            "y",
            source=self.marks,
            marker="x",
            size=9,
            line_width=2,
            color="#D55E00",
            legend_label="left out of the fix",
        )
        fig.legend.location, fig.legend.click_policy = "top_left", "hide"
        fig.legend.label_text_font_size, fig.legend.padding, fig.legend.glyph_height = "11px", 4, 14
        fig.add_tools(
            HoverTool(renderers=[crosses], tooltips=[("ping", "@number"), ("", "left out of the fix")])
        )
        return fig

    def look(self, name: str, contrast: float) -> None:
        """Paper, grey or colour; the contrast darkens marks and grain alike."""
        self.colours.update(palette=LOOKS[name], low=0, high=float(255 / contrast))

    def clear(self, interval_s: float) -> None:
        """Empty paper of that many seconds across."""
        self.count = 0
        self._paper[:] = 0
        self._top = [float((k - self.strips) * STRIP) for k in range(self.strips)]
        self._dirty = {}
        self.across.update(start=0.0, end=float(interval_s))
        self.figure.x_range.reset_start, self.figure.x_range.reset_end = 0.0, float(interval_s)
        self.source.data = {
            "image": [strip.copy() for strip in self._paper],
            "y": list(self._top),
            "dw": [float(interval_s)] * self.strips,
        }
        self._follow()

    def add(self, lines: np.ndarray) -> None:
        """Adds lines (N, columns) at the bottom; nothing is sent before `flush`."""
        for line in lines:
            strip, row = (self.count // STRIP) % self.strips, self.count % STRIP
            if row == 0:
                self._paper[strip] = 0
                self._top[strip] = float(self.count)
                self._dirty[strip] = -1
            self._paper[strip, row] = line
            self._dirty.setdefault(strip, row)
            self.count += 1

    def flush(self, whole: bool = False) -> None:
        """Sends what changed, patching the strips it touches, or everything at once."""
        if whole:
            self.source.data = dict(
                self.source.data, image=[strip.copy() for strip in self._paper], y=list(self._top)
            )
        elif self._dirty:
            self.source.patch(self._patches())
        self._dirty = {}
        self._follow()

    def _patches(self) -> dict:
        images, tops = [], []
        last, end = ((self.count - 1) // STRIP) % self.strips, (self.count - 1) % STRIP + 1
        for strip, first in self._dirty.items():
            stop = end if strip == last and first >= 0 else STRIP
            first = max(first, 0)
            images.append(((strip, slice(first, stop), slice(None)), self._paper[strip, first:stop].ravel()))
            tops.append((strip, self._top[strip]))
        return {"image": images, "y": tops}

    def _follow(self) -> None:
        """Keeps the newest line in sight; the paper above stays reachable by scrolling back."""
        shown = min(self.history, max(self.count, 60))
        bottom = float(max(self.count, 60))
        self.lines.update(start=bottom, end=bottom - shown, reset_start=bottom, reset_end=bottom - shown)
