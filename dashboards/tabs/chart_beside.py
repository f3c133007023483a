"""What may stand below the paper: residuals of the hyperbola, the SAIL terminal, detection curves, the front end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import panel as pn
import panel_material_ui as pmui
from panel_splitjs import Split

from dashboards.pictures.receiver_views import DetectionView, FrontEndView, LevelView, PassView
from dashboards.session import Session
from dashboards.tabs.chart_live import LiveReceiver
from dashboards.tabs.front_end_words import design_words
from dashboards.tabs.pages import Pages
from dashboards.tabs.tab import drawn, number
from trackerlib.receiver.cells import MatchedFilter
from trackerlib.receiver.detection_curve import detection_curve
from trackerlib.receiver.front_end import Attenuator
from trackerlib.receiver.front_end_design import FrontEnd
from trackerlib.receiver.level_curve import level_curve
from trackerlib.receiver.report_receiver import ReceiverSettings
from trackerlib.textfiles import InputError

PANES = ("Hyperbola", "Terminal", "Detection", "Front\u00a0end")
CURVES = PANES[2:]
LOW, HIGH = (74, 26), (40, 60)  # shares of the paper and of the pane below it
ENDED_BY_RETURN = ("?M", "!M", "!T")  # their last number ends there
FALSE_ALARMS = np.geomspace(1e-4, 0.1, 10)
RATIOS_DB = np.array([6.0, 9.0, 12.0, 15.0])
PULSES = 200  # simulated at each ratio
REPORTS, LEVEL_RATE_HZ = ReceiverSettings(attenuator=Attenuator(False, 0)), 24_000


class Beside:
    """The panes, one in sight; `say` sends a line that a person typed."""

    def __init__(self, session: Session, say: Callable[[str], None]):
        self.session, self._say = session, say
        self.residuals, self.front_end = PassView(), FrontEndView()
        self.detection, self.levels = DetectionView(), LevelView()
        self._make_terminal()
        self._make_front_end()
        self._curves_drawn = False
        self.pages = self._make_pages()
        self.pages.on_show(self._show)

    def _make_pages(self) -> Pages:
        panes = {
            PANES[0]: drawn(self.residuals.figure),
            PANES[1]: pn.Column(
                pn.Row(self.command, self.hint, margin=0), self.terminal, sizing_mode="stretch_both", margin=0
            ),
            PANES[2]: pn.Row(
                drawn(self.detection.figure), drawn(self.levels.figure), sizing_mode="stretch_both", margin=0
            ),
            PANES[3]: pn.Row(
                pn.Column(self.carrier, self.bandwidth, width=140, margin=0),
                pn.Column(
                    drawn(self.front_end.figure), drawn(self.front_end.impedance), sizing_mode="stretch_both",
                    margin=0,
                ),
                pn.Column(self.design_words, width=300, scroll="y", margin=0), sizing_mode="stretch_both",
                margin=0,
            ),
        }  # fmt: skip
        return Pages(panes)

    def under(self, paper):
        """The paper with the panes below it; curves are given more room than the others."""
        split = Split(paper, self.pages, orientation="vertical", sizes=LOW, sizing_mode="stretch_both")
        self.pages.on_show(lambda: split.param.update(sizes=HIGH if self.pages.shown in CURVES else LOW))
        return split

    def _show(self) -> None:
        if self.pages.shown == "Detection" and not self._curves_drawn:
            self._draw_curves()
        if self.pages.shown == PANES[3] and not len(self.front_end.source.data["khz"]):
            self._design()

    # -- terminal ------------------------------------------------------------------------------

    def _make_terminal(self) -> None:
        self.terminal = pn.widgets.Terminal(
            options={"fontSize": 12, "convertEol": True, "scrollback": 2000, "cursorBlink": False},
            sizing_mode="stretch_both",
            min_height=60,
            margin=(2, 8),
        )
        self.terminal.param.watch(self._keyed, "value")
        self._line = ""
        self.command = pmui.TextInput(
            label="Say on the line", placeholder="#PTR H", size="small", width=220, margin=(4, 8)
        )
        self.command.param.watch(self._entered, "enter_pressed")
        self.hint = pn.pane.HTML(
            "#PTR is the receiver, #GPS the GPS: <code>#PTR H</code> helps, <code>AA</code> sets automatic gain, "
            "<code>#GPS ?L</code> asks for a position.",
            styles={"font-size": "12px"},
            margin=(12, 4),
        )

    def _entered(self, event) -> None:
        if self.command.value_input:
            self._send(self.command.value_input)
            self.command.param.update(value="", value_input="")

    def _keyed(self, event) -> None:
        """Keys pressed in the terminal make a line; Enter says it."""
        for key in event.new or "":
            if key in "\r\n":
                line, self._line = self._line, ""
                self._send(line)
            elif key in "\x7f\b":
                if self._line:
                    self._line = self._line[:-1]
                    self.terminal.write("\b \b")
            elif key.isprintable():
                self._line += key
                self.terminal.write(key)

    def _send(self, line: str) -> None:
        self.terminal.write("\n")
        ended = any(command in line for command in ENDED_BY_RETURN)
        self._say(line + "\r" if ended else line)

    def hear(self, live: LiveReceiver) -> None:
        """Shows what the line said since the last time, while the terminal is in sight."""
        if live.said and self.pages.shown == "Terminal":
            said, live.said = live.said, b""
            text = "".join(chr(c) if 32 <= c < 127 or c in (10, 13) else "" for c in said)
            self.terminal.write(text)

    # -- curves and design ---------------------------------------------------------------------

    def _draw_curves(self) -> None:
        self._curves_drawn = True
        matched = MatchedFilter(48_000, 10_000.0, 0.01)

        def work(progress):
            progress(0.0, "of the matched filter")
            modern = detection_curve(matched, FALSE_ALARMS, RATIOS_DB, pulses=PULSES)
            progress(0.5, "of the report's chain")
            return modern, level_curve(REPORTS, LEVEL_RATE_HZ, RATIOS_DB, periods=PULSES)

        def show(curves):
            self.detection.show(curves[0])
            self.levels.show(curves[1])

        self.session.jobs.start("Detection curves", work, show)

    def _make_front_end(self) -> None:
        defaults = FrontEnd()
        self.carrier = number(
            "Carrier (Hz)",
            defaults.carrier_hz,
            "The two stages are tuned to it; 10 kHz unless told",
            step=100.0,
        )
        self.bandwidth = number(
            "Bandwidth (Hz)",
            defaults.bandwidth_hz,
            "Between −3 dB points of both stages; 120 Hz was measured",
            step=10.0,
        )
        self.design_words = pn.pane.HTML(styles={"font-size": "12px"}, margin=(4, 8))
        for widget in (self.carrier, self.bandwidth):
            widget.param.watch(lambda event: self._design(), "value")

    def _design(self) -> None:
        carrier, bandwidth = self.carrier.value or 0.0, self.bandwidth.value or 0.0
        if not (1000 <= carrier <= 100_000 and 1 <= bandwidth <= 10_000):
            self.session.report(
                InputError("a carrier of 1 to 100 kHz and a bandwidth of 1 to 10,000 Hz are wanted")
            )
            return
        design = FrontEnd(carrier_hz=carrier, bandwidth_hz=bandwidth)
        self.front_end.show(design)
        self.design_words.object = design_words(design)
