"""Scrolling wet paper: one Bokeh image a strip of lines, so that a new line patches one strip only."""

from __future__ import annotations

import numpy as np
from bokeh.events import MouseMove
from bokeh.models import ColumnDataSource, CustomJS, HoverTool, Legend, LinearColorMapper, Range1d
from bokeh.palettes import Cividis256, Greys256
from bokeh.plotting import figure

from dashboards.palette import ESTIMATE, FIRST_ARRAY, SECOND_ARRAY, paper_colours
from dashboards.pictures.legend import legend_entry, style_legend

STRIP = 50  # lines a strip; cost a line does not depend on how many strips there are
LOOKS = {"paper": paper_colours(), "grey": list(reversed(Greys256)), "colour": list(Cividis256)}
LEAST_SHOWN = 60  # lines that the paper is high at least
NEAR_LINES = 0.5  # short of the newest line, at which a view still stands at it
VIEW = 500  # newest lines in sight unless one zooms; the others are reached by scrolling back
ARRIVAL_COLUMNS = ("x", "y", "line", "ms", "level", "snr_db", "row")

# The line under the pointer, looked up in the values beside the paper: all in the browser.
_POINT = """
const lines = beside.data.line;
if (!lines || !lines.length) return;
const wanted = Math.floor(cb_obj.y), k = wanted - lines[0];
if (!(k >= 0 && k < lines.length)) return;
const x = beside.data.ship_x[k], y = beside.data.ship_y[k];
rule.data = {y: [wanted + 0.5]};
pointed.data = Number.isFinite(x) ? {x: [x], y: [y]} : {x: [], y: []};
"""


class WetPaper:
    """A ring of strips of `columns` x STRIP lines; newest line at the bottom."""

    def __init__(self, columns: int, history: int = 1000):
        self.columns, self.history = columns, history
        self.view_lines = VIEW
        self.strips = -(-history // STRIP) + 1  # one spare: the one being filled
        self.first = self.count = 0  # lines from `first` to `count` have been added
        self._paper = np.zeros((self.strips, STRIP, columns), np.uint8)
        self._top = [0.0] * self.strips
        self._dirty: dict[int, int] = {}  # strip -> first line to send, -1 for all of it
        self.source = ColumnDataSource({"image": [], "y": [], "dw": []}, name="paper strips")
        self.marks = ColumnDataSource({"x": [], "y": [], "number": [], "used": []}, name="marks")
        self.arrivals = ColumnDataSource({name: [] for name in ARRIVAL_COLUMNS}, name="arrivals")
        self.chosen = ColumnDataSource({"x": [], "y": []}, name="chosen marks")
        self.hyperbola = ColumnDataSource({"x": [], "y": []}, name="hyperbola")
        self.rule = ColumnDataSource({"y": []}, name="line pointed at")
        self.lines = Range1d(LEAST_SHOWN, 0)  # downwards: the newest line is at the bottom
        self.across = Range1d(0, 1)
        self.colours = LinearColorMapper(LOOKS["paper"], low=0, high=255)
        self.figure = self._figure()
        self._draw_marks()
        self.clear(1.0)

    def _figure(self):
        fig = figure(
            name="wet paper",
            sizing_mode="stretch_both",
            x_range=self.across,
            y_range=self.lines,
            tools="pan,wheel_zoom,ywheel_pan,box_zoom,box_select,lasso_select,reset,save",
            active_scroll="ywheel_pan",
            active_drag="box_select",
            x_axis_label="arrival, folded (s)",
            y_axis_label="line of paper",
        )
        fig.grid.visible = False
        fig.min_border_right, fig.min_border_top = 12, 4
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
        return fig

    def _draw_marks(self) -> None:
        fig = self.figure
        ring = {"size": 9, "fill_alpha": 0, "line_color": FIRST_ARRAY, "line_width": 2}
        lost = {"marker": "x", "size": 9, "line_width": 2, "color": SECOND_ARRAY}
        marked = {"marker": "square", "size": 4, "fill_alpha": 0, "line_color": ESTIMATE, "line_width": 1}
        # Not seen on the paper, but there to be pointed at and dragged over.
        dots = fig.scatter(
            "x", "y", source=self.arrivals, line_alpha=0, hover_line_alpha=1, hover_fill_alpha=0,
            hover_line_color=FIRST_ARRAY, nonselection_line_alpha=0, nonselection_fill_alpha=0, **ring,
        )  # fmt: skip
        crosses = fig.scatter("x", "y", source=self.marks, **lost)
        squares = fig.scatter("x", "y", source=self.chosen, **marked)
        curve = fig.line("x", "y", source=self.hyperbola, line_color=ESTIMATE, line_width=1.5)
        fig.hspan("y", source=self.rule, line_color=SECOND_ARRAY, line_alpha=0.4)
        fig.add_layout(Legend(orientation="horizontal"), "above")  # the paper is bright in the dark, too
        self._lost_entry = legend_entry(fig, "left out of the fix", [crosses], visible=False, **lost)
        self._chosen_entry = legend_entry(fig, "marked", [squares], visible=False, **marked)
        self._curve_entry = legend_entry(
            fig, "hyperbola", [curve], line=True, line_color=ESTIMATE, line_width=2, visible=False
        )
        style_legend(fig)
        tips = [("ping", "@number"), ("", "left out of the fix")]
        heard = [
            ("line", "@line"),
            ("arrival", "@ms{0.0} ms"),
            ("level", "@level{0} of 255"),
            ("signal over noise", "@snr_db{0.0} dB"),
        ]
        fig.add_tools(
            HoverTool(renderers=[crosses], tooltips=tips),
            HoverTool(renderers=[dots], tooltips=heard, description="arrivals"),
        )

    def point(self, beside: ColumnDataSource, pointed: ColumnDataSource) -> None:
        """Lets the line under the pointer show, in the browser, where the ship was."""
        arguments = {"beside": beside, "rule": self.rule, "pointed": pointed}
        self.figure.js_on_event(MouseMove, CustomJS(args=arguments, code=_POINT))

    def look(self, name: str, contrast: float) -> None:
        """Paper, grey or colour; the contrast darkens marks and grain alike."""
        self.colours.update(palette=LOOKS[name], low=0, high=float(255 / contrast))

    def keep(self, history: int) -> None:
        """Another number of lines kept, on bare paper: `clear` it and add them again."""
        self.history, self.strips = history, -(-history // STRIP) + 1
        self._paper = np.zeros((self.strips, STRIP, self.columns), np.uint8)
        self._top = [0.0] * self.strips

    def clear(self, interval_s: float, first: int = 0, keep_view: bool = False) -> None:
        """Empty paper of that many seconds across, whose next line has the number `first`.

        keep_view : the same lines come again, and a view scrolled back shall find them where they were
        """
        self.first = self.count = first
        self._paper[:] = 0
        block = first // STRIP  # strips are laid from here on; the others wait above the paper, bare
        for ahead in range(self.strips):
            behind = ahead if ahead == 0 else ahead - self.strips
            self._top[(block + ahead) % self.strips] = float((block + behind) * STRIP)
        self._dirty = {}
        self.across.update(start=0.0, end=float(interval_s))
        self.figure.x_range.reset_start, self.figure.x_range.reset_end = 0.0, float(interval_s)
        self.source.data = {
            "image": [strip.copy() for strip in self._paper],
            "y": list(self._top),
            "dw": [float(interval_s)] * self.strips,
        }
        self.arrivals.data = {name: np.empty(0) for name in ARRIVAL_COLUMNS}
        self.rule.data = {"y": []}
        if not keep_view:
            self._stand_at_the_newest()

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
        self.first = max(self.first, self.count - self.history)

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

    def shown(self) -> np.ndarray:
        """The lines (N, columns) that are kept, oldest first."""
        numbers = np.arange(self.first, self.count)
        return self._paper[(numbers // STRIP) % self.strips, numbers % STRIP]

    def show_arrivals(self, rows: dict, replace: bool = False) -> None:
        """Adds rings for arrivals (columns of ARRIVAL_COLUMNS), or puts these in their place."""
        if replace:
            self.arrivals.data = rows
        elif len(rows["x"]):
            self.arrivals.stream(rows, rollover=8 * self.history)

    def show_lost(self, x, line, number) -> None:
        """Strikes through the pings that the fix does not rest on."""
        self._lost_entry.visible = bool(len(x))
        self.marks.data = {
            "x": np.asarray(x),
            "y": np.asarray(line) + 0.5,
            "number": np.asarray(number),
            "used": np.full(len(x), "left out"),
        }

    def show_chosen(self, x, line) -> None:
        """The analyst's own marks."""
        self._chosen_entry.visible = bool(len(x))
        self.chosen.data = {"x": np.asarray(x, float), "y": np.asarray(line, float) + 0.5}

    def show_hyperbola(self, x, line) -> None:
        """The curve through the marks; NaN where it leaves the paper."""
        self._curve_entry.visible = bool(len(x))
        self.hyperbola.data = {"x": np.asarray(x, float), "y": np.asarray(line, float) + 0.5}

    def _newest(self) -> tuple[float, float]:
        """Bottom and top of the view that stands at the newest line."""
        bottom = float(max(self.count, self.first + LEAST_SHOWN))
        return bottom, max(float(self.first), bottom - self.view_lines)

    def _stand_at_the_newest(self) -> None:
        bottom, top = self._newest()
        self._stood = bottom, top
        self.lines.update(start=bottom, end=top, reset_start=bottom, reset_end=top)

    def _follow(self) -> None:
        """Keeps the newest line in sight, at the height that was chosen; a view scrolled back stays on its lines."""
        view, (bottom, top) = self.lines, self._newest()
        height, usual = view.start - view.end, self._stood[0] - self._stood[1]
        if view.start < self._stood[0] - NEAR_LINES:  # scrolled back
            down = max(self.first - view.end, 0.0)
        elif abs(height - usual) > NEAR_LINES:  # zoomed, and at the newest line
            down = bottom - view.start
        else:
            self._stand_at_the_newest()
            return
        if view.start + down > bottom:  # what was looked at is not kept any more
            self._stand_at_the_newest()
            return
        self._stood = bottom, top
        view.update(start=view.start + down, end=view.end + down, reset_start=bottom, reset_end=top)
