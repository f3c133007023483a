"""Tab "Wet-paper chart": arrivals folded at an interval as the old recorder drew them, from a log, sound or the line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import panel as pn
from bokeh.events import SelectionGeometry, Tap

from dashboards.jobs import Cancelled
from dashboards.pictures.chart_map import ChartMap
from dashboards.pictures.line_strip import LineStrip
from dashboards.pictures.wet_paper import WetPaper
from dashboards.tabs.chart_beside import Beside
from dashboards.tabs.chart_controls import (
    COLUMNS,
    NUDGE_S,
    RECEIVER,
    RECORDING,
    SIMULATION,
    STORED,
    SURVEY,
    ChartControls,
)
from dashboards.tabs.chart_export import ChartFiles, OnPaper, arrivals_text
from dashboards.tabs.chart_live import LiveReceiver
from dashboards.tabs.chart_marks import TraceMarks
from dashboards.tabs.chart_sources import RecordedSound, SimulatedHuntSound, SoundSource, stored_hunt
from dashboards.tabs.chart_words import (
    LOG_HOLDS_TIMES,
    bearing_words,
    paper_words,
    pass_words,
    receiver_words,
)
from dashboards.tabs.tab import Tab, alone, drawn, heading
from panel_splitjs import Split
from trackerlib.beacon.pings import Pings
from trackerlib.exports.paper_print import PaperPrint
from trackerlib.receiver.chart import left_edge
from trackerlib.receiver.following import PingFollower
from trackerlib.receiver.hyperbola import Marks
from trackerlib.receiver.rolls import PingRoll, Roll
from trackerlib.textfiles import InputError

PATCH_AT_MOST = 200  # more new lines than this are sent as whole strips
EMULATOR_RATE = 20.0  # of an emulator started here, unless told
EMPTY = {
    SURVEY: "<b>No survey is open.</b> File, Open… reads a survey log or pings as CSV.",
    RECORDING: "<b>No recording is open.</b> Name one on this machine, or File, Open… takes WAV, RF64 and FLAC.",
    SIMULATION: "<b>Nothing is simulated yet.</b> Simulate and hear makes the sound of two passes of a beacon.",
    STORED: "<b>No stored session is open.</b> Name one, or File, Open… takes it.",
    RECEIVER: "",
}
WORDS = {"sizing_mode": "stretch_width", "margin": (4, 10), "styles": {"font-size": "13px"}}


class ChartTab(Tab):
    """Paper that scrolls with what is heard."""

    title = "Wet-paper chart"
    watches = (
        "pings", "heard", "fix", "playing", "fold_s", "chart_marks", "bearing_lines", "truth", "recording", "hunt_file",
    )  # fmt: skip

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.controls_ = controls = ChartControls(self.session)
        self.settings = controls.chart_settings()
        self.paper = WetPaper(COLUMNS, controls.history.value)
        self.strip = LineStrip(self.paper.lines, controls.history.value)
        self.map = ChartMap(self.strip.source)
        self.paper.point(self.strip.source, self.map.pointed)
        self.live = LiveReceiver(self.session)
        self.marks = TraceMarks(self.session)
        self.files = ChartFiles(self.session, self._on_paper)
        self.beside = Beside(self.session, self._type)
        self.roll: Roll | None = None
        self.sound: SoundSource | None = None
        self._rolls: dict[str, Roll] = {}  # of each kind of source, so that a look at another loses nothing
        self._sounds: dict[str, SoundSource] = {}
        self._accepted: dict[str, tuple[np.ndarray, np.ndarray]] = {}  # pings' numbers and times of arrival
        self._hearing = 0  # counts what is heard, so that what is old stops
        self._clock_s, self._running = math.inf, False  # of a replay of sound
        self._opened_files: tuple = (None, None)
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
        return Split(paper, self.beside.panel(), orientation="vertical", sizes=(74, 26), sizing_mode="stretch_both")

    def answer(self):
        return pn.Column(
            self.words,
            self.status_words,
            self.pass_words,
            self.bearing_words,
            heading("Where the ship was"),
            drawn(self.map.figure, sizing_mode="stretch_width", height=260, margin=(0, 6)),
            margin=0,
            sizing_mode="stretch_width",
        )

    def _bind(self) -> None:
        c = self.controls_
        clicks = {
            c.play: self.play, c.at_once: self._to_the_end, c.clear: self._clear,
            c.open_path: lambda: self._open_recording(Path(c.path.value.strip()).expanduser()),
            c.open_stored: lambda: self._open_stored(Path(c.stored.value.strip()).expanduser()),
            c.simulate: self._simulate, c.connect: self._connect, c.emulate: self._emulate,
            c.shorter: lambda: self._nudge(-NUDGE_S), c.longer: lambda: self._nudge(NUDGE_S),
            c.straighten: self._straighten, c.fit: self._fit, c.keep_line: self._keep_line, c.accept: self._accept,
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
        """Which kind of source is chosen."""
        return self.controls_.source.value

    @property
    def threshold(self) -> float:
        """Level below which there is no mark."""
        return 0.0 if self.kind == SURVEY else float(self.controls_.threshold.value or 0)

    def refresh(self, changed):
        session = self.session
        if (session.recording, session.hunt_file) != self._opened_files:
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

    def _take_files(self) -> None:
        """What File, Open… has put into the session."""
        session, before = self.session, self._opened_files
        self._opened_files = (session.recording, session.hunt_file)
        for file, known, take in (
            (session.recording, before[0], self._open_recording),
            (session.hunt_file, before[1], self._open_stored),
        ):
            if file is not None and file is not known:
                self._try(lambda take=take, file=file: take(file.path, file.name))

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
            return
        first, stop, history = self.paper.count, self._stop(), self.paper.history
        if again or stop < first or stop - first > history:
            first = max(stop - history, 0)
            self.paper.clear(self.settings.interval_s, first)
            self.strip.clear()
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
            number, arrival_s = self.live.followed if self.kind == RECEIVER else self._accepted.get(self.kind, ([], []))
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
        status = self.live.status
        self.controls_.connect.label = "Connect" if status is None else "Disconnect"
        self.controls_.emulate.label = "Start emulator" if self.live.emulator is None else "Stop emulator"
        text = EMPTY[self.kind]
        if roll is not None:
            text = paper_words(roll, self.settings, self.paper.count, self.strip.missed, self.threshold)
            notes = self.sound.notes[1:] if self.sound is not None else []
            if isinstance(roll, PingRoll):
                notes = [LOG_HOLDS_TIMES]
            text += "".join(f"<br>{note[0].upper()}{note[1:]}." if note[-1] != "." else f"<br><br>{note}" for note in notes)
        self.words.object = text
        self.status_words.visible = self.kind == RECEIVER
        if self.kind == RECEIVER:
            kept = "" if self.live.file is None or status is None else str(self.live.file)
            self.status_words.object = receiver_words(status, len(self.live.followed[0]), self.live.unplaced, kept)
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
        utc = self.live.utc_of(seconds) if self.kind == RECEIVER else None
        return f"{seconds:.0f} s into the sound" if utc is None else f"at {str(utc)[:19]}Z"

    # -- what goes on by itself ----------------------------------------------------------------

    def tick(self, seconds: float) -> None:
        """Takes what the receiver said, lets the replay of sound go on, draws what is new."""
        begun = self.live.poll()
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
            if self.kind == RECEIVER:
                self._tell()

    def close(self) -> None:
        """Lets go of receiver and emulator."""
        self._hearing += 1
        self.live.close()

    def activate(self) -> None:
        super().activate()
        if self.kind != SURVEY:
            with pn.io.hold():
                self._draw()
                self._draw_left_out()
                self.map.frame()
                self._tell()

    # -- sources -------------------------------------------------------------------------------

    def _choose_source(self) -> None:
        self.controls_.show_source()
        self._strip_pane.visible = self.kind != SURVEY
        self.roll, self.sound = self._rolls.get(self.kind), self._sounds.get(self.kind)
        self._clock_s, self._running = math.inf, False
        self.session.chart_marks = ()
        if self.kind == SURVEY:
            self._show_survey()
        if self.kind == RECEIVER:
            self.roll = self.live.roll
        self._redraw()

    def _redraw(self) -> None:
        self._draw(again=True)
        self._draw_left_out()
        self._show_marks()
        self.map.frame()
        self._tell()

    def _show_as(self, kind: str) -> None:
        """Turns the source's menu to a kind, without what follows a person's doing so."""
        self._quiet = True
        self.controls_.source.value = kind
        self._quiet = False
        self._choose_source()

    def _open_recording(self, path: Path, name: str | None = None) -> None:
        if str(path) in ("", "."):
            raise InputError("name a recording on this machine, or use File, Open…")
        sound = RecordedSound(path, name)
        self._sounds[RECORDING] = sound
        self._show_as(RECORDING)
        self._hear_again()

    def _simulate(self) -> None:
        c = self.controls_
        seed, sea_state = c.seed.value or 0, c.sea_state.value

        def done(sound):
            self._sounds[SIMULATION] = sound
            self._show_as(SIMULATION)
            self._try(self._hear_again)

        self.session.jobs.start("Simulate", lambda progress: SimulatedHuntSound(seed, sea_state), done)

    def _hear_again(self) -> None:
        """Hears the sound from its beginning, off the event loop; lines come as they are heard."""
        sound = self._sounds.get(self.kind)
        if sound is None:
            return
        settings, detector = self.controls_.receiver_settings(), self.controls_.detector.value
        roll = sound.new_roll(settings)
        self.roll, self.sound = roll, sound
        self._rolls[self.kind] = roll
        self._hearing += 1
        mine, self._clock_s, self._running = self._hearing, math.inf, False
        self._redraw()

        def work(progress):
            def told(share, text):
                if self._hearing != mine:
                    raise Cancelled
                progress(share, text)

            try:
                return sound.listen(detector, settings, roll, told)
            except ValueError as error:
                raise error if isinstance(error, InputError) else InputError(f"{sound.name}: {error}") from None

        def done(heard):
            if self.roll is heard:
                self._draw()
                self.map.frame()
                self._tell()
                label = "SIMULATED sound" if sound.simulated else "recording"
                self.session.say("; ".join([f"{sound.name}: {label}, {heard.until_s:.0f} s heard", *sound.notes[1:]]))

        self.session.jobs.start("Hear", work, done)

    def _open_stored(self, path: Path, name: str | None = None) -> None:
        if str(path) in ("", "."):
            raise InputError("name a stored session on this machine, or use File, Open…")

        def done(found):
            self._rolls[STORED], settings = found
            self._show_as(STORED)
            self.session.say(
                f"{found[0].source}: {len(np.unique(found[0].arrivals.period))} periods, "
                f"{len(found[0].fixes.time_s)} positions, by {settings.get('port', 'an unknown port')}"
            )

        self.session.jobs.start("Open", lambda progress: stored_hunt(path, name or path.name), done)

    def _emulate(self) -> None:
        c = self.controls_
        if self.live.emulator is not None:
            self.live.disconnect()
            self.live.stop_emulator()
            self.session.say("The emulator has stopped")
            self._tell()
            return
        rate = c.rate.value if (c.rate.value or 1.0) != 1.0 else EMULATOR_RATE
        emulator = self.live.emulate(c.scenario.value, rate, c.emulator_port.value or 0)
        c.rate.value = rate
        c.address.value = emulator.line.address
        self.session.say(
            f"SIMULATED receiver and GPS at {emulator.line.address}, {rate:g} times as fast as time; press Connect"
        )
        self._tell()

    def _connect(self) -> None:
        c = self.controls_
        if self.live.receiver is not None:
            self.live.disconnect()
            self.session.say("Disconnected; what was heard stays")
            self._tell()
            return
        self.live.threshold, self.live.feeding = self.threshold, c.feed.value
        self.live.connect(c.address.value, c.line_settings(), self.session.fold_s, c.rate.value or 1.0, c.folder.value)
        self.roll = self._rolls[RECEIVER] = self.live.roll
        self._redraw()

    # -- the receiver's menus ------------------------------------------------------------------

    def _tell_receiver(self) -> None:
        parameters = self.controls_.parameters()
        if self.live.receiver is not None and self.kind == RECEIVER:
            self.live.receiver.set_parameters(parameters)
            self.session.say("The receiver is told as soon as its line is free; sampling then begins anew")
        else:
            self._hear_again()

    def _change_attenuator(self) -> None:
        if self.live.receiver is not None:
            self.live.receiver.set_attenuation(self.controls_.attenuation)
        if self.kind != RECEIVER:
            self._hear_again()

    def _change_baud(self) -> None:
        if self.live.receiver is not None:
            self.live.receiver.set_baud(self.controls_.baud.value)

    def _type(self, text: str) -> None:
        if self.live.receiver is None:
            self.session.say("No receiver is connected; choose the source Receiver on its line, and connect")
            return
        self.live.receiver.type(text.encode("ascii", "replace"))

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
        interval_s, sigma_s = self.marks.straight(self.roll, self.settings, self.threshold)
        self.controls_.interval.value = round(interval_s, 7)
        self.session.say(
            f"The trace stands upright at {1e3 * interval_s:.4f} ± {1e3 * sigma_s:.2g} ms; Undo goes back"
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

    def play(self) -> None:
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

    # -- marks, hyperbola, fix -----------------------------------------------------------------

    def _tapped(self, x: float, y: float) -> None:
        if self.roll is None or x is None:
            return
        self.marks.click(self.roll, self.settings, y, x, self.threshold)
        if 0 <= y < self._stop():
            lat, lon = self.roll.ship(np.atleast_1d(self.roll.line_time(self.settings, int(y))))
            self.session.pointed = (float(lat[0]), float(lon[0])) if np.isfinite(lat[0]) else None

    def _dragged(self) -> None:
        source = self.paper.arrivals
        chosen = [k for k in source.selected.indices if k < len(source.data["row"])]
        if chosen and self.roll is not None:
            source.selected.indices = []
            self.marks.choose(self.roll, self.settings, np.asarray(source.data["row"])[chosen])

    def _fit(self) -> None:
        if self.roll is None:
            raise InputError("there is no trace yet")
        settings = self._known_settings()
        self.marks.fit(
            self.roll,
            self.settings,
            settings.sound_speed_mps,
            settings.speed_sigma_mps,
            1e-6 * (self.controls_.clock_sigma.value or 0.0),
        )
        self._show_marks()
        self._tell()

    def _keep_line(self) -> None:
        found = self.marks.found
        if found is None or found.line is None:
            raise InputError("mark a trace and press Hyperbola first: the bearing line comes from it")
        self.session.edit(bearing_lines=(*self.session.bearing_lines, found.line))
        self.session.say("The bearing line is on the map beside and in the tab Beacon fix; Undo takes it back")

    def _known_settings(self):
        """Settings of a fix, with what is known of simulated water."""
        settings = self.session.fix_settings
        if isinstance(self.sound, SimulatedHuntSound) and self.kind == SIMULATION:
            hunt = self.sound.hunt
            settings = replace(
                settings, profile=None, sound_speed_mps=hunt.sound_speed_mps, gps_rms_m=hunt.gps_rms_m,
                hydrophone_depth_m=hunt.hydrophone_depth_m, sample_interval_ms=1.0,
            )  # fmt: skip
        return settings

    def _accept(self) -> None:
        """The marked trace, or without marks the pinger followed through all arrivals, as pings of the beacon fix."""
        if self.roll is None:
            raise InputError("there is no trace yet")
        if isinstance(self.roll, PingRoll):
            raise InputError("a survey log's pings are in the beacon fix already")
        if self.kind == RECEIVER and self.live.receiver is not None:
            raise InputError("a connected receiver's pings go to the beacon fix as they come; disconnect first")
        settings, interval_s = self._known_settings(), self.settings.interval_s
        if self.marks.marks:
            line, time_s, sigma = self.marks.times(self.roll, self.settings)
            fold_s, nowhere = time_s - self.roll.time_of(self.settings, line, 0.0), np.zeros(len(line))
            travel_s = Marks(line, fold_s, sigma, nowhere, nowhere, interval_s).unfolded_s()
            emission = line
        else:
            followed = PingFollower(interval_s, self.threshold).feed(self.roll.arrivals)
            if not followed:
                raise InputError(
                    f"no pings at about {interval_s:g} s can be followed through these arrivals; straighten the interval, "
                    "change the threshold, or mark the trace"
                )
            emission = np.array([ping.emission for ping in followed])
            time_s = np.array([ping.arrival_s for ping in followed])
            travel_s = time_s - emission * interval_s
        lat, lon = self.roll.ship(time_s)
        known = np.isfinite(lat)
        if known.sum() < 3:
            raise InputError("where the ship was is not known for three of these arrivals, so they cannot make a fix")
        number = emission[known] + 1
        pings = Pings(
            number, lat[known], lon[known], np.full(known.sum(), -settings.hydrophone_depth_m), travel_s[known],
            np.full(known.sum(), np.datetime64("NaT", "ms")), clock_s=emission[known] * interval_s,
            source=self.roll.source, simulated=self.roll.simulated,
        )  # fmt: skip
        self._accepted[self.kind] = (number, time_s[known])
        with pn.io.hold():
            if settings is not self.session.fix_settings:
                self.session.fix_settings = settings
            self.session.take_pings(
                pings,
                f"{len(pings)} arrivals of {self.roll.source} are the pings of the tab Beacon fix",
                self.sound.truth if self.sound is not None else None,
            )

    # -- export --------------------------------------------------------------------------------

    def _on_paper(self) -> OnPaper | None:
        if self.roll is None or self.paper.count == self.paper.first:
            return None
        c, marks = self.controls_, self.marks.marks
        words = [f"left edge {self.settings.offset_s:g} s", f"look {c.look.value}, contrast {c.contrast.value:g}"]
        if self.kind != SURVEY:
            words += [f"threshold {self.threshold:g}", f"detector {c.detector.value}" if self.sound else "the receiver's"]
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
