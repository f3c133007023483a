"""Tab "Wet-paper chart": the survey's arrivals folded at an interval, as the old recorder drew them."""

from __future__ import annotations

import html

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.wet_paper import LOOKS, WetPaper
from dashboards.session import SPEEDS
from dashboards.tabs.tab import Tab, alone, number
from trackerlib.receiver.chart import ChartSettings, chart_lines, fold
from trackerlib.textfiles import InputError

PATCH_AT_MOST = 200  # more new lines than this are sent as whole strips


class ChartTab(Tab):
    """Paper that scrolls with the replay."""

    title = "Wet-paper chart"
    watches = ("pings", "heard", "fix", "playing")

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.settings = ChartSettings()
        self.paper = WetPaper(self.settings.columns)
        self._pings = None
        self._quiet = False
        self.words = pn.pane.HTML(sizing_mode="stretch_width", margin=(6, 10), styles={"font-size": "14px"})
        self.play = pmui.Button(label="Play", icon="play_arrow", size="small", margin=(6, 4, 2, 8))
        self.play.on_click(lambda event: self.session.play())
        self.at_once = pmui.Button(label="At once", size="small", variant="outlined", margin=(6, 4, 2, 4))
        self.at_once.on_click(lambda event: self._to_the_end())
        self.speed = pmui.Select.from_param(
            self.session.param.speed,
            label="Speed",
            options={f"x{speed}": speed for speed in SPEEDS},
            size="small",
            sizing_mode="stretch_width",
            margin=(5, 8),
        )
        self.interval = number(
            "Fold interval (s)",
            self.settings.interval_s,
            "Period at which arrivals are folded: one line of paper. Steps of 0.1 ms; 2 s unless told",
            step=0.0001,
            format="0.0000",
        )
        self.left_edge = number(
            "Left edge (s)",
            self.settings.offset_s,
            "Arrival time that falls on the left edge of the paper",
            step=0.01,
        )
        self.slower = pmui.Button(label="- 1 ms", size="small", variant="outlined", margin=(4, 4, 4, 8))
        self.faster = pmui.Button(label="+ 1 ms", size="small", variant="outlined", margin=(4, 4))
        self.slower.on_click(lambda event: self._nudge(-1e-3))
        self.faster.on_click(lambda event: self._nudge(1e-3))
        self.look = pmui.Select(
            label="Look",
            value="paper",
            options=list(LOOKS),
            size="small",
            sizing_mode="stretch_width",
            margin=(5, 8),
        )
        self.contrast = pmui.FloatSlider(
            label="Contrast",
            value=1.0,
            start=0.5,
            end=3.0,
            step=0.1,
            size="small",
            sizing_mode="stretch_width",
            margin=(0, 14),
        )
        for widget in (self.interval, self.left_edge):
            widget.param.watch(lambda event: self._fold_again(), "value")
        for widget in (self.look, self.contrast):
            widget.param.watch(lambda event: self.paper.look(self.look.value, self.contrast.value), "value")

    def controls(self):
        return [
            pn.Row(self.play, self.at_once, margin=0),
            self.speed,
            self.interval,
            pn.Row(self.slower, self.faster, margin=0),
            self.left_edge,
            self.look,
            self.contrast,
        ]

    def picture(self):
        return pn.pane.Bokeh(self.paper.figure, sizing_mode="stretch_both", margin=0)

    def answer(self):
        return self.words

    def refresh(self, changed):
        session = self.session
        self.play.param.update(
            label="Pause" if session.playing else "Play", icon="pause" if session.playing else "play_arrow"
        )
        if session.pings is None:
            self.words.object = "<b>No survey is open.</b> File, Open… reads a survey log or pings as CSV."
            return
        if session.pings is not self._pings or session.heard < self.paper.count:
            self._pings = session.pings
            self.paper.clear(self.settings.interval_s)
        self._draw_heard()
        self._draw_left_out()
        self._tell()

    def _draw_heard(self) -> None:
        """Adds the pings heard since the last drawing."""
        first, heard = self.paper.count, self.session.heard
        if heard <= first:
            return
        lines = chart_lines(self._pings.arrival_s[first:heard], self.settings, first_line=first)
        self.paper.add(lines)
        self.paper.flush(whole=len(lines) > PATCH_AT_MOST)

    def _draw_left_out(self) -> None:
        """Strikes through the pings that the fix does not rest on."""
        fix, heard = self.session.fix, self.session.heard
        if fix is None or len(fix.number) > heard:
            return
        lost = np.flatnonzero(~fix.used)
        folded = fold(self._pings.arrival_s[lost], self.settings.interval_s, self.settings.offset_s)
        self.paper.marks.data = {
            "x": folded,
            "y": lost + 0.5,
            "number": fix.number[lost],
            "used": np.full(len(lost), "left out"),
        }

    def _tell(self) -> None:
        session, pings = self.session, self._pings
        name = html.escape(pings.source)
        kind = " (simulated)" if pings.simulated else ""
        text = [
            f"<b>{session.heard} of {len(pings)} pings</b> of {name}{kind}, a line each, newest at the bottom, "
            f"{self.settings.interval_s:.4f} s across."
        ]
        if session.heard:
            now = float(
                fold(pings.arrival_s[session.heard - 1], self.settings.interval_s, self.settings.offset_s)
            )
            text.append(f"The last one fell at {now:.4f} s.")
        text.append(
            "<br><br>A survey log holds times, not sound: every mark is drawn alike, 10 ms long, and the grain is the "
            "paper's. A ping's time is that of its log line plus its travel time plus an unknown constant, so only "
            "how the trace bends counts."
        )
        text.append(
            "<br><br>Nudge the interval to slant the trace; set the left edge to bring it to the middle."
        )
        self.words.object = " ".join(text)

    def _to_the_end(self) -> None:
        if self.session.pings is not None:
            self.session.param.update(playing=False, heard=len(self.session.pings))

    def _nudge(self, seconds: float) -> None:
        self.interval.value = round(self.interval.value + seconds, 6)

    def _fold_again(self) -> None:
        try:
            self.settings = ChartSettings(
                interval_s=self.interval.value or 0.0, offset_s=self.left_edge.value or 0.0
            )
        except ValueError as error:
            self.session.report(InputError(str(error)))
            return
        self._pings = None
        if self.active:
            with pn.io.hold():
                self.refresh({"pings"})

    def export(self):
        pings = self.session.pings
        if pings is None:
            return None
        heard = pings.only(slice(0, self.session.heard))
        folded = fold(heard.arrival_s, self.settings.interval_s, self.settings.offset_s)
        label = "# SIMULATED DATA\n" if pings.simulated else ""
        head = f"# {pings.source}, folded at {self.settings.interval_s:.6f} s\nping,utc,arrival_s,fold_s\n"
        rows = (
            f"{n},{'' if np.isnat(u) else f'{u}Z'},{t:.6f},{f:.6f}\n"
            for n, u, t, f in zip(heard.number, heard.utc, heard.arrival_s, folded, strict=True)
        )
        return "arrivals.csv", label + head + "".join(rows)


alone(__name__, "dashboards.tabs.chart:ChartTab")
