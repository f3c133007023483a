"""Tab "Wet-paper chart": arrivals folded as the old recorder drew them, from a log, from sound or from the line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import panel as pn
from bokeh.events import SelectionGeometry, Tap

from dashboards.pictures.chart_map import ChartMap
from dashboards.pictures.line_strip import LineStrip
from dashboards.pictures.wet_paper import VIEW, WetPaper
from dashboards.tabs.chart_beside import Beside
from dashboards.tabs.chart_controls import (
    COLUMNS,
    DECK,
    NUDGE_S,
    RECEIVER,
    RECORDING,
    SIMULATION,
    STORED,
    SURVEY,
    ChartControls,
)
from dashboards.tabs.chart_deck import LiveDeck
from dashboards.tabs.chart_export import ChartFiles, OnPaper, arrivals_text
from dashboards.tabs.chart_inputs import Inputs
from dashboards.tabs.chart_live import LiveReceiver
from dashboards.tabs.chart_marks import TraceMarks
from dashboards.tabs.chart_sources import SoundSource
from dashboards.tabs.chart_trace import TraceActions
from dashboards.tabs.chart_words import (
    LOG_HOLDS_TIMES,
    bearing_words,
    paper_words,
    pass_words,
)
from dashboards.tabs.tab import Tab, alone, drawn, heading
from trackerlib.exports.paper_print import PaperPrint
from trackerlib.receiver.chart import left_edge
from trackerlib.receiver.rolls import PingRoll, Roll
from trackerlib.textfiles import InputError

PATCH_AT_MOST = 200  # more new lines than this are sent as whole strips
EMPTY = {
    SURVEY: "<b>No survey is open.</b> File, Open… reads a survey log or pings as CSV.",
    RECORDING: "<b>No recording is open.</b> Name one on this machine, or File, Open… takes WAV, RF64 and FLAC.",
    SIMULATION: "<b>Nothing is simulated yet.</b> Simulate and hear makes the sound of two passes of a beacon.",
    STORED: "<b>No stored session is open.</b> Name one, or File, Open… takes it.",
}
WORDS = {"sizing_mode": "stretch_width", "margin": (4, 10), "styles": {"font-size": "13px"}}


class ChartTab(Inputs, TraceActions, Tab):
    """Paper that scrolls with what is heard."""

    title = "Wet-paper chart"
    watches = (
        "pings", "heard", "fix", "playing", "fold_s", "chart_marks", "bearing_lines", "truth", "recording", "hunt_file",
        "navigation_file",
    )  # fmt: skip

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.controls_ = controls = ChartControls(self.session)
        self.settings = controls.chart_settings()
        self.paper = WetPaper(COLUMNS, controls.history.value)
        self.strip = LineStrip(self.paper.lines, controls.history.value)
        self.map = ChartMap(self.strip.source)
        self.paper.point(self.strip.source, self.map.pointed)
        self.live, self.deck = LiveReceiver(self.session), LiveDeck(self.session)
        self.marks = TraceMarks(self.session)
        self.files = ChartFiles(self.session, self._on_paper)
        self.beside = Beside(self.session, self._type)
        self.roll: Roll | None = None
        self._drawn = ""  # source of what lies on the paper
        self.sound: SoundSource | None = None
        self._rolls: dict[str, Roll] = {}  # of each kind of source, so that a look at another loses nothing
        self._sounds: dict[str, SoundSource] = {}
        self._accepted: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # pings' numbers and times of arrival
        self._hearing = 0  # counts what is heard, so that what is old stops
        self._clock_s, self._running = math.inf, False  # of a replay of sound
        self._taken: dict[str, object] = {}  # files that File, Open… has put into the session
        self._navigation: tuple[Path, str] | None = None  # positions for the recording, and their name
        self._quiet = False
        self._strip_pane = drawn(self.strip.figure, sizing_mode="stretch_height", width=230)
        self._strip_pane.visible = False  # a survey log has nothing to show there
        self.words, self.status_words = pn.pane.HTML(**WORDS), pn.pane.HTML(**WORDS)
        self.pass_words, self.bearing_words = pn.pane.HTML(**WORDS), pn.pane.HTML(**WORDS)
        self._bind()

    # -- layout --------------------------------------------------------------------------------

    def controls(self):
        return self.controls_.in_sight()

    def more(self):
        return self.controls_.folded() | {"Export": self.files.controls()}

    def picture(self):
        paper = pn.Row(
            drawn(self.paper.figure),
            self._strip_pane,
            sizing_mode="stretch_both",
            margin=0,
        )
        return self.beside.under(paper)

    def answer(self):
        return pn.Column(
            self.words,
            self.status_words,
            self.pass_words,
            self.bearing_words,
            heading("Where the ship was"),
            drawn(self.map.figure, sizing_mode="stretch_width", height=310, margin=(0, 6)),
            margin=0,
        )

    def _bind(self) -> None:
        c = self.controls_
        clicks = {
            c.play: self.play_or_pause, c.at_once: self._to_the_end, c.clear: self._clear,
            c.open_path: lambda: self._open_recording(Path(c.path.value.strip()).expanduser()),
            c.open_navigation: lambda: self._open_navigation(Path(c.navigation.value.strip()).expanduser()),
            c.open_stored: lambda: self._open_stored(Path(c.stored.value.strip()).expanduser()),
            c.simulate: self._simulate, c.connect: self._connect, c.emulate: self._emulate,
            c.shorter: lambda: self._nudge(-NUDGE_S), c.longer: lambda: self._nudge(NUDGE_S),
            c.straighten: self._straighten, c.fit: self._fit, c.keep_line: self._keep_line, c.accept: self._accept,
            c.measured: self._take_measured,
            c.unmark: self.marks.clear, c.unline: lambda: self.session.edit(bearing_lines=()),
            c.send: self._tell_receiver,
        }  # fmt: skip
        for button, action in clicks.items():
            button.on_click(lambda event, action=action: self._try(action))
        changes = {
            self._choose_source: (c.source,),
            self._fold_again: (c.interval, c.left_edge),
            self._hear_again: (c.detector, c.carrier, c.pulse, c.sample),
            self._change_threshold: (c.threshold,),
            self._change_attenuator: (c.attenuator,),
            self._change_baud: (c.baud,),
            self._change_channel: (c.channel,),
            self._place_recording: (c.began,),
            self._look: (c.look, c.contrast),
            self._keep_lines: (c.history,),
        }
        for action, widgets in changes.items():
            for widget in widgets:
                widget.param.watch(lambda event, action=action: self._quiet or self._try(action), "value")
        c.feed.param.watch(lambda event: setattr(self.live, "feeding", event.new), "value")
        self.paper.figure.on_event(Tap, lambda event: self._try(lambda: self._tapped(event.x, event.y)))
        self.paper.figure.on_event(SelectionGeometry, lambda event: event.final and self._try(self._dragged))

    def _try(self, action) -> None:
        """Does it, or says why not."""
        try:
            with pn.io.hold():
                action()
        except ValueError as error:
            self.session.report(error if isinstance(error, InputError) else InputError(str(error)))

    # -- what is shown -------------------------------------------------------------------------

    @property
    def kind(self) -> str:
        """Which kind of source is chosen; a deck unit's pings are drawn as a survey log's."""
        source = self.controls_.source.value
        return SURVEY if source == DECK else source

    @property
    def threshold(self) -> float:
        """Level below which there is no mark."""
        return 0.0 if self.kind == SURVEY else float(self.controls_.threshold.value or 0)

    def refresh(self, changed):
        session = self.session
        self._take_files()
        if session.fold_s != self.settings.interval_s:
            self._quiet = True
            self.controls_.interval.value = session.fold_s
            self._quiet = False
            self._fold_again()
        if self.kind == SURVEY and changed & {"pings", "heard"}:
            self._show_survey()
        if "chart_marks" in changed:
            self.marks.forget()
            self._show_marks()
        self._draw()
        if changed & {"fix", "pings"}:
            self._draw_left_out()
        if changed & {"fix", "truth", "bearing_lines", "pings"}:
            self.map.show(session.fix, session.truth, session.bearing_lines)
        self._tell()

    def _show_survey(self) -> None:
        pings, roll = self.session.pings, self.roll
        if pings is None:
            self.roll = None
        elif not isinstance(roll, PingRoll) or roll.pings is not pings:
            self.roll = self._rolls[SURVEY] = PingRoll(pings)
            self._draw(again=True)
            self.map.frame()

    def _stop(self) -> int:
        """Number of the line after the last one to be shown."""
        roll = self.roll
        if isinstance(roll, PingRoll):
            return min(self.session.heard, len(roll.pings))
        whole = roll.whole_lines(self.settings)
        if not math.isfinite(self._clock_s):
            return whole
        played = int((self._clock_s - left_edge(self.settings, 0)) / self.settings.interval_s)
        return max(min(whole, played), 0)

    def _draw(self, again: bool = False) -> None:
        """Adds the lines that are new, or lays all of them on new paper."""
        if self.roll is None:
            self.paper.clear(self.settings.interval_s)
            self.strip.clear()
            self._drawn = ""
            return
        first, stop, history = self.paper.count, self._stop(), self.paper.history
        if again or stop < first or stop - first > history:
            first = max(stop - history, 0)
            self.paper.view_lines = history if self.kind == SURVEY else VIEW
            same = stop > first and self._drawn == self.roll.source
            self.paper.clear(self.settings.interval_s, first, keep_view=same)
            self.strip.clear()
        self._drawn = self.roll.source
        if stop <= first:
            return
        roll, settings = self.roll, self.settings
        lines = roll.lines(settings, first, stop, self.threshold)
        self.paper.add(lines)
        self.paper.flush(whole=len(lines) > PATCH_AT_MOST)
        self.strip.add(first, roll.beside(settings, first, lines, self.threshold))
        self._draw_arrivals(first, stop)

    def _draw_arrivals(self, first: int, stop: int) -> None:
        arrivals, line, folded = self.roll.placed(self.settings)
        rows = np.flatnonzero((line >= first) & (line < stop) & (arrivals.level >= self.threshold))
        line, folded = line[rows], folded[rows]
        self.paper.show_arrivals(
            {
                "x": folded,
                "y": line + 0.5,
                "line": line,
                "ms": 1e3 * folded,
                "level": arrivals.level[rows],
                "snr_db": arrivals.snr_db[rows],
                "row": rows,
            }
        )

    def _draw_left_out(self) -> None:
        """Strikes through the pings that the fix does not rest on."""
        fix, roll = self.session.fix, self.roll
        if fix is None or roll is None:
            self.paper.show_lost([], [], [])
            return
        lost = fix.number[~fix.used]
        if isinstance(roll, PingRoll):
            row = np.flatnonzero(~fix.used)
            row = row[row < min(self.session.heard, len(roll.pings))]
            lost, times = roll.pings.number[row], roll.pings.arrival_s[row]
            line, folded = row, roll.placed(self.settings)[2][row]
        else:
            number, arrival_s = (
                self.live.followed if self.kind == RECEIVER else self._accepted.get(self.kind, ([], []))
            )
            there = np.isin(number, lost)
            times, lost = np.asarray(arrival_s)[there], np.asarray(number)[there]
            line, folded = roll.where(self.settings, times)
        seen = line >= self.paper.first
        self.paper.show_lost(folded[seen], line[seen], lost[seen])

    def _show_marks(self) -> None:
        marks = self.marks.marks
        self.paper.show_chosen([mark[1] for mark in marks], [mark[0] for mark in marks])
        curve = self.marks.curve(self.roll, self.settings) if self.roll is not None else ((), ())
        self.paper.show_hyperbola(*curve)
        found = self.marks.found
        if found is None or found.line is None:
            self.beside.residuals.show([], [])
        else:
            self.beside.residuals.show(self.marks.fitted_lines, found.residual_s)

    def _tell(self) -> None:
        session, roll = self.session, self.roll
        running = session.playing if self.kind == SURVEY else self._running
        label, icon = ("Pause", "pause") if running else ("Play", "play_arrow")
        if self.kind == RECEIVER:
            label, icon = ("Hold", "pause") if not math.isfinite(self._clock_s) else ("Go on", "play_arrow")
        self.controls_.play.param.update(label=label, icon=icon)
        idle = self.live.receiver is None and not self.deck.listening
        self.controls_.connect.label = "Connect" if idle else "Disconnect"
        self.controls_.emulate.label = "Start emulator" if self.live.emulator is None else "Stop emulator"
        text = EMPTY.get(self.controls_.source.value, "")
        if roll is not None:
            text = paper_words(roll, self.settings, self.paper.count, self.strip.missed, self.threshold)
            notes = self.sound.notes[1:] + self.sound.position_notes if self.sound is not None else []
            if isinstance(roll, PingRoll):
                notes = [LOG_HOLDS_TIMES]
            text += "".join(
                f"<br>{note[0].upper()}{note[1:]}." if note[-1] != "." else f"<br><br>{note}"
                for note in notes
            )
        self.words.object = text
        self._tell_line()
        self.pass_words.object = pass_words(self.marks.found, len(self.marks.marks), self._when())
        self.bearing_words.object = bearing_words(self.map.bearings.fix, len(session.bearing_lines))

    def _when(self) -> str:
        """The time of closest approach, as a person would say it."""
        found, roll = self.marks.found, self.roll
        if found is None or found.closest_emission is None or roll is None:
            return ""
        if isinstance(roll, PingRoll):
            row = min(round(found.closest_emission), len(roll.pings) - 1)
            utc = roll.pings.utc[row]
            return f"at ping {roll.pings.number[row]}" if np.isnat(utc) else f"at {str(utc)[:19]}Z"
        seconds = float(roll.time_of(self.settings, found.closest_emission, 0.0))
        clock = self.live if self.kind == RECEIVER else self.sound
        utc = None if clock is None else clock.utc_of(seconds)
        return f"{seconds:.0f} s into the sound" if utc is None else f"at {str(utc)[:19]}Z"

    # -- what goes on by itself ----------------------------------------------------------------

    def tick(self, seconds: float) -> None:
        """Takes what the receiver said, lets the replay of sound go on, draws what is new."""
        begun = self.live.poll()
        self.deck.poll()
        if self.kind == RECEIVER and self.live.roll is not self.roll:
            self.roll = self._rolls[RECEIVER] = self.live.roll
            begun = True
        if self._running and self.roll is not None:
            self._clock_s += seconds * self.session.speed
            if self._clock_s >= self.roll.until_s:
                self._clock_s, self._running = math.inf, False
        if not self.active or self._layout is None:
            return
        with pn.io.hold():
            self.beside.hear(self.live)
            if self.kind != SURVEY and self.roll is not None:
                before = self.paper.count
                self._draw(again=begun)
                if self.paper.count != before or begun:
                    if self.paper.first == before or begun or before < LEAST_FRAMED:
                        self.map.frame()
                    self._tell()
            if self.controls_.source.value in (RECEIVER, DECK):
                self._tell()

    def close(self) -> None:
        """Lets go of receiver and emulator."""
        self._hearing += 1
        self.live.close()
        self.deck.disconnect()

    def activate(self) -> None:
        super().activate()
        if self.kind != SURVEY:
            with pn.io.hold():
                self._draw()
                self._draw_left_out()
                self.map.frame()
                self._tell()

    # -- the paper -----------------------------------------------------------------------------

    def _fold_again(self) -> None:
        try:
            settings = self.controls_.chart_settings()
        except ValueError as error:
            self.session.report(InputError(str(error)))
            return
        if settings.interval_s != self.settings.interval_s and self.session.chart_marks:
            self.session.chart_marks = ()  # they are places on the old paper
        self.settings = settings
        if self.session.fold_s != settings.interval_s:
            self.session.edit(fold_s=settings.interval_s)
        if self.active and self._layout is not None:
            self._redraw()

    def _nudge(self, seconds: float) -> None:
        self.controls_.interval.value = round((self.controls_.interval.value or 0.0) + seconds, 6)

    def _straighten(self) -> None:
        if self.roll is None:
            raise InputError("there is no trace yet")
        interval_s, sigma_s, echo = self.marks.straight(self.roll, self.settings, self.threshold)
        self.controls_.interval.value = round(interval_s, 7)
        self.session.say(
            f"The trace stands upright at {1e3 * interval_s:.4f} ± {1e3 * sigma_s:.2g} ms; "
            f"{echo + '; ' if echo else ''}Undo goes back"
        )

    def _change_threshold(self) -> None:
        self.live.threshold = self.threshold
        if self.live._followed is not None:
            self.live._followed.follower.threshold = self.threshold
        if self.kind != SURVEY and self.roll is not None:
            self._redraw()

    def _look(self) -> None:
        self.paper.look(self.controls_.look.value, self.controls_.contrast.value)

    def _keep_lines(self) -> None:
        """As many lines as are now wanted: the paper is laid anew."""
        history = int(np.clip(self.controls_.history.value or 500, 500, 2000))
        self.strip.history = history
        self.paper.keep(history)
        self._redraw()

    def play_or_pause(self) -> None:
        """Plays or pauses what is on the paper."""
        if self.kind == SURVEY:
            self.session.play()
            return
        if self.roll is None:
            raise InputError("there is nothing to play yet")
        if self.kind == RECEIVER:
            self._clock_s = self.roll.until_s if not math.isfinite(self._clock_s) else math.inf
        else:
            if not self._running and not math.isfinite(self._clock_s):
                self._clock_s = 0.0
            self._running = not self._running
        self._tell()

    def _to_the_end(self) -> None:
        self._clock_s, self._running = math.inf, False
        if self.kind == SURVEY and self.session.pings is not None:
            self.session.param.update(playing=False, heard=len(self.session.pings))
        elif self.roll is not None:
            self._draw()
        self._tell()

    def _clear(self) -> None:
        """Bare paper; a replay begins again, a live line goes on below."""
        self.session.chart_marks = ()
        if self.kind == SURVEY:
            self.session.param.update(playing=False, heard=0)
        elif self.kind == RECEIVER and self.roll is not None:
            self.paper.clear(self.settings.interval_s, self._stop())
            self.strip.clear()
        else:
            self._clock_s, self._running = 0.0, False
            self._draw()
        self._tell()

    # -- export --------------------------------------------------------------------------------

    def _on_paper(self) -> OnPaper | None:
        if self.roll is None or self.paper.count == self.paper.first:
            return None
        c, marks = self.controls_, self.marks.marks
        words = [
            f"left edge {self.settings.offset_s:g} s",
            f"look {c.look.value}, contrast {c.contrast.value:g}",
        ]
        if self.kind != SURVEY:
            words += [
                f"threshold {self.threshold:g}",
                f"detector {c.detector.value}" if self.sound else "the receiver's",
            ]
        curve = self.marks.curve(self.roll, self.settings)
        paper = PaperPrint(
            np.minimum(self.paper.shown() * c.contrast.value, 255).astype(np.uint8),
            self.paper.first,
            self.settings.interval_s,
            self.roll.source,
            self.roll.simulated,
            tuple(words),
            (np.array([m[1] for m in marks]), np.array([m[0] + 0.5 for m in marks])) if marks else None,
            (curve[0], curve[1] + 0.5) if len(curve[0]) else None,
        )
        return OnPaper(self.roll, paper, self.sound)

    def export(self):
        shown = self._on_paper()
        return None if shown is None else ("arrivals.csv", arrivals_text(shown))


LEAST_FRAMED = 5  # lines after which the small map first finds its place

alone(__name__, "dashboards.tabs.chart:ChartTab")
