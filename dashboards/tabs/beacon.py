"""Tab "Beacon fix": a survey replayed on a map, the fix with its ellipse, and how sure it is."""

from __future__ import annotations

import json

import panel as pn
import panel_material_ui as pmui

from dashboards.guard import tile_address
from dashboards.keys import Copy
from dashboards.pictures.beacon_map import BeaconMap
from dashboards.pictures.beacon_strips import Contours, DepthHistory, Iterations, Residuals
from dashboards.session import SPEEDS
from dashboards.tabs.beacon_edits import Edits
from dashboards.tabs.beacon_files import FixFiles
from dashboards.tabs.beacon_intervals import IntervalControls
from dashboards.tabs.beacon_models import SideBySide
from dashboards.tabs.beacon_plan import NextLeg
from dashboards.tabs.beacon_positions import PositionControls
from dashboards.tabs.beacon_settings import FixControls
from dashboards.tabs.beacon_words import log_table, position_texts, sentence, table
from dashboards.tabs.tab import FOLDED, Tab, alone, choice
from trackerlib.beacon.diagnosis import free_coordinates, influence, misfit_surface
from trackerlib.beacon.error_budget import error_budget
from trackerlib.beacon.fix import fix_history
from trackerlib.beacon.result import BeaconFix
from trackerlib.commands import plain
from trackerlib.commands.fix_document import document, interval_document

HISTORY_FIXES = 20  # fixes that "Fix history" spreads over the survey
BESIDE = ("History", "Contours", "Iterations", "Estimators")  # what may stand beside the residuals


class BeaconTab(Tab):
    """Map, residuals and history of a beacon hunt."""

    title = "Beacon fix"
    watches = (
        "opened", "pings", "fix", "fix_settings", "live", "truth", "heard", "playing", "reasons", "bearing_lines",
        "listening", "pointed", "placed", "position_limits", "antenna_offset_m",
    )  # fmt: skip

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        session = self.session
        self.map = BeaconMap(tile_address())
        self.residuals = Residuals(self.map.pings, self.map.colour)
        self.history, self.contours, self.iterations = DepthHistory(), Contours(), Iterations()
        self.settings = FixControls(session)
        self.positions = PositionControls(session)
        self.edits = Edits(session, self._selected)
        self.leg = NextLeg(session, self.map)
        self.intervals = IntervalControls(session)
        self.files = FixFiles(session, self.intervals)
        self.models = SideBySide(session, self.map, lambda: self.beside.param.update(value="Estimators"))
        self._make_replay()
        self._make_beside()
        self._make_answer()
        self._shown_survey = -1
        self._quiet = False

    # -- parts ---------------------------------------------------------------------------------

    def _make_replay(self) -> None:
        session = self.session
        self.play = pmui.Button(label="Play", icon="play_arrow", size="small", margin=(6, 4, 2, 8))
        self.play.on_click(lambda event: session.stop_listening() if session.listening else session.play())
        self.at_once = pmui.Button(label="To the end", size="small", variant="outlined", margin=(6, 8))
        self.at_once.on_click(lambda event: self._to_the_end())
        self.speed = pmui.Select.from_param(
            session.param.speed,
            label="Speed",
            options={f"x{speed}": speed for speed in SPEEDS},
            size="small",
            sizing_mode="stretch_width",
            margin=(5, 8),
        )
        self.heard = pmui.IntSlider(
            label="Pings heard",
            value=0,
            start=0,
            end=1,
            size="small",
            sizing_mode="stretch_width",
            margin=(0, 14),
        )
        # Throttled: only the analyst's own hand sets it, while the replay moves the slider itself.
        self.heard.param.watch(lambda event: self._hear(event.new), "value_throttled")
        self.history_button = pmui.Button(
            label="Fix history", size="small", variant="outlined", margin=(6, 8)
        )
        self.history_button.on_click(lambda event: self._compute_history())

    def _make_beside(self) -> None:
        self.beside = pmui.RadioButtonGroup(
            options=list(BESIDE), value=BESIDE[0], size="small", margin=(2, 8), button_type="primary"
        )
        self.beside.param.watch(lambda event: self._show_beside(), "value")
        self.across, self.up = (choice(label, {"east": "east"}, "east") for label in ("across", "up"))
        for widget in (self.across, self.up):
            widget.param.watch(lambda event: self._show_beside(), "value")
        self._panes = {
            "History": pn.Column(_fill(self.history.figure), sizing_mode="stretch_both", margin=0),
            "Contours": pn.Row(
                _fill(self.contours.figure), pn.Column(self.across, self.up, width=130, margin=0),
                sizing_mode="stretch_both", margin=0,
            ),
            "Iterations": pn.Column(_fill(self.iterations.figure), sizing_mode="stretch_both", margin=0),
            "Estimators": self.models.panel(),
        }  # fmt: skip
        for name, pane in self._panes.items():
            pane.visible = name == BESIDE[0]

    def _make_answer(self) -> None:
        words = {"sizing_mode": "stretch_width", "margin": (6, 10)}
        self.sentence = pn.pane.HTML(styles={"font-size": "14px"}, **words)
        self.numbers = pn.pane.HTML(styles={"font-size": "13px"}, **words)
        self.log = pn.pane.HTML(styles={"font-size": "12px"}, **words)
        self.copies = {
            name: Copy(label=f"Copy {name}", margin=(2, 4))
            for name in ("degrees", "minutes", "seconds", "UTM", "everything")
        }

    def controls(self):
        settings = self.settings
        return [
            self.play,
            self.heard,
            settings.estimator,
            settings.motion,
            settings.ship_errors,
            settings.gps,
            settings.water,
            settings.sound_speed,
            self.leg.button,
        ]

    def more(self):
        settings = self.settings
        return {
            "Edits": self.edits.controls(),
            "Replay": [self.speed, pn.Row(self.at_once, self.history_button, margin=0)],
            "Sound and ship": [
                settings.correlation, settings.speed_sigma, settings.fit_speed, settings.hydrophone, *settings.antenna,
            ],
            "Ship's positions": self.positions.controls(),
            "Times": [
                settings.reject, settings.emission, settings.sample, settings.interval, settings.fit_interval,
                settings.fit_drift,
            ],
            "Search region": [settings.max_range, settings.max_depth, settings.max_speed, self._defaults()],
            "The thesis's experiments": [settings.experiments, settings.spacing, settings.step],
            "Intervals": [self.intervals.way, self.intervals.button],
            "Next leg": [self.leg.budget, self.leg.ship_speed, self.leg.save],
            "Files": [self.files.layout, self.files.button],
        }  # fmt: skip

    def _defaults(self):
        button = pmui.Button(
            label="All settings to their defaults", size="small", variant="text", margin=(2, 8)
        )
        button.on_click(lambda event: self.settings.restore_defaults())
        return button

    def picture(self):
        return _fill(self.map.map)

    def strips(self):
        beside = pn.Column(self.beside, *self._panes.values(), sizing_mode="stretch_both", margin=0)
        return [_fill(self.residuals.figure), beside]

    def answer(self):
        how = pmui.Accordion(
            ("How the fix came about", self.log), margin=(4, 4), sizing_mode="stretch_width", sx=FOLDED
        )
        copies = pn.FlexBox(*self.copies.values(), margin=(4, 8))
        return pn.Column(
            self.sentence, self.leg.words, self.intervals.words, self.numbers, copies, how, margin=0
        )

    # -- what is shown -------------------------------------------------------------------------

    def refresh(self, changed):
        session = self.session
        self._show_controls()
        if "bearing_lines" in changed:
            self.map.show_bearings(session.bearing_lines)
        if "pointed" in changed:
            self.map.show_pointed(session.pointed)
        if session.opened != self._shown_survey or "truth" in changed:
            self._begin_survey()
        elif "placed" in changed:
            self._show_history([])  # it was of the pings before
        if session.pings is None:
            self.sentence.object = (
                f"<b>Listening to {session.listening}:</b> no ping yet."
                if session.listening
                else "<b>No survey is open.</b> File, Open… reads a survey log or pings as CSV."
            )
            self.numbers.object = ""
        elif session.fix is not None and changed & {"fix", "pings"}:
            self._show_fix(session.fix)

    def _begin_survey(self) -> None:
        session = self.session
        self._shown_survey = session.opened
        self.settings.forget_profile()
        self.map.show_survey(session.pings, session.truth)
        self.history.show([])
        self.leg.clear()
        self.intervals.clear()
        self.models.clear()
        if session.pings is not None and not session.listening and session.heard >= len(session.pings):
            self._compute_history()

    def _show_controls(self) -> None:
        session = self.session
        self.settings.show()
        self.positions.show()
        self.edits.show()
        count = 0 if session.pings is None else len(session.pings)
        self.heard.param.update(end=max(count, 1), value=session.heard, disabled=bool(session.listening))
        label, icon = ("Pause", "pause") if session.playing else ("Play", "play_arrow")
        if session.listening:
            label, icon = "Stop listening", "stop"
        self.play.param.update(label=label, icon=icon)
        self.leg.save.disabled = not self.leg.save.visible
        self._quiet = True
        free = {name: name for name in free_coordinates(session.fix_settings.motion)}
        for widget, usual in ((self.across, "east"), (self.up, "depth")):
            widget.param.update(options=free, value=widget.value if widget.value in free else usual)
        if self.across.value == self.up.value:
            self.up.value = "north" if self.across.value == "east" else "east"
        self._quiet = False

    def _show_fix(self, fix: BeaconFix) -> None:
        session = self.session
        running = session.playing or bool(session.listening)
        self.map.show_fix(session.pings, fix)
        if running:
            if self.history.add(fix):
                self.map.add_to_trail(fix)
            if session.listening:
                self.map.keep_ship_in_sight(session.pings)
        self.leg.clear()
        self.intervals.clear()
        self.models.clear()
        self._show_beside()
        self.sentence.object = sentence(fix)
        self.numbers.object = table(fix)
        if fix.converged and not running:
            self._look_closer(fix)
        self.log.object = log_table(fix.log) if fix.log else "The live estimator and refusals keep no log."
        texts = position_texts(fix)
        for name, copy in self.copies.items():
            copy.text = texts.get(name, "")
            copy.visible = name in texts

    def _look_closer(self, fix: BeaconFix) -> None:
        """What each ping moves and where the sigma comes from, off the event loop."""
        session = self.session
        settings, heard = session.fix_settings, session.pings.only(slice(0, len(fix.number)))

        def work(progress):
            return influence(heard, fix, settings), error_budget(heard, fix, settings)

        def done(found):
            if session.fix is fix:
                self.map.show_moves(found[0])
                self.numbers.object = table(fix, found[1])

        session.jobs.start("closer look", work, done)

    def _show_beside(self) -> None:
        """What was chosen to stand beside the residuals."""
        chosen, fix = self.beside.value, self.session.fix
        # Hidden, not taken out: what is drawn meanwhile must find its figure.
        for name, pane in self._panes.items():
            pane.visible = name == chosen
        if fix is None or self._quiet:
            return
        if chosen == "Iterations":
            self.iterations.show(fix.log)
        if chosen == "Contours" and self.across.value != self.up.value:
            self._draw_contours(fix)

    def _draw_contours(self, fix: BeaconFix) -> None:
        """Contours about a fix, off the event loop; none about a refusal."""
        session, names = self.session, (self.across.value, self.up.value)
        if not fix.converged:
            self.contours.show(None)
            return
        settings, heard = session.fix_settings, session.pings.only(slice(0, len(fix.number)))

        def done(surface):
            if session.fix is fix:
                self.contours.show(surface)

        session.jobs.start("Contours", lambda progress: misfit_surface(heard, fix, settings, names), done)

    # -- what the analyst does -----------------------------------------------------------------

    def _hear(self, count: int) -> None:
        self.session.param.update(playing=False, heard=count)

    def _to_the_end(self) -> None:
        if self.session.pings is not None:
            self.session.param.update(playing=False, heard=len(self.session.pings))

    def _selected(self) -> frozenset[int]:
        """Numbers of the pings selected in the pictures; the selection is let go."""
        chosen = self.map.pings.selected.indices
        numbers = frozenset(int(self.map.pings.data["number"][k]) for k in chosen)
        self.map.pings.selected.indices = []
        return numbers

    def _compute_history(self) -> None:
        session = self.session
        pings, settings, of = session.pings, session.fix_settings, (session.opened, session.placed)
        if pings is None:
            return
        step = max(len(pings) // HISTORY_FIXES, 1)

        def work(progress):
            fixes = []
            for count, fix in fix_history(pings, settings, first=step, step=step):
                fixes.append(fix)
                progress(count / len(pings), f"ping {count} of {len(pings)}")
            return fixes

        def done(fixes):
            if (session.opened, session.placed) == of:  # other pings may be open by now
                self._show_history(fixes)

        session.jobs.start("Fix history", work, done, long=True)

    def _show_history(self, fixes: list[BeaconFix]) -> None:
        self.history.show(fixes)
        self.map.show_trail(fixes)

    def export(self):
        fix = self.session.fix
        if fix is None:
            return None
        answer = {"survey": self.session.pings.source, **document(fix)}
        answer["left_out_by_hand"] = {str(k): why for k, why in sorted(self.session.reasons.items())}
        if (intervals := self.intervals.found) is not None:
            answer["interval95_m"] = interval_document(intervals)
        if (placed := self.session.placed) is not None:
            answer["refused"] = {"positions": dict(placed.fixes_refused), "arrivals": dict(placed.refused)}
        return "beacon-fix.json", json.dumps(plain(answer), indent=1)


def _fill(figure):
    return pn.pane.Bokeh(figure, sizing_mode="stretch_both", margin=0)


alone(__name__, "dashboards.tabs.beacon:BeaconTab")
