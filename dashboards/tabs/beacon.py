"""Tab "Beacon fix": a survey replayed on a map, the fix with its ellipse, and how sure it is."""

from __future__ import annotations

import html
import io
import json
import tempfile
from dataclasses import fields, replace
from pathlib import Path

import panel as pn
import panel_material_ui as pmui

from dashboards.guard import tile_address
from dashboards.keys import Copy
from dashboards.pictures.beacon_map import BeaconMap
from dashboards.pictures.mercator import from_mercator
from dashboards.session import SPEEDS
from dashboards.tabs.beacon_words import models_table, position_texts, sentence, table
from dashboards.tabs.tab import Tab, alone, choice, heading, number
from trackerlib.beacon.choice import compare_models, usual_models
from trackerlib.beacon.diagnosis import influence, misfit_surface
from trackerlib.beacon.fix import fix_history
from trackerlib.beacon.motion import MOTIONS
from trackerlib.beacon.planning import (
    FASTEST_MPS,
    Leg,
    accuracy_map,
    error_budget,
    forecast_leg,
    plan_next_leg,
    surveys_so_far,
)
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.settings import METHODS, FixSettings
from trackerlib.commands.fix import document
from trackerlib.commands.plan import route_text
from trackerlib.exports.export import LAYOUTS, export_fix
from trackerlib.textfiles import InputError

OPTIONAL = (
    "gps_rms_m",
    "sample_interval_ms",
    "interval_s",
    "experiments",
    "spacing",
    "step",
)  # may be left empty
WHOLE = ("experiments", "spacing", "step")  # whole numbers
BELOW = {
    "history of the depth": "",
    "contours, east and north": "east, north",
    "contours, east and depth": "east, depth",
    "contours, north and depth": "north, depth",
}
EXPORT_NAMES = {
    "GPX 1.1 (plotters)": "gpx-1.1",
    "GPX 1.0": "gpx-1.0",
    "KML (globes)": "kml",
    "GeoJSON": "geojson",
    "CSV of the pings": "csv",
    "NetCDF (CF-1.11)": "netcdf",
    "Report (HTML)": "html",
}
MOTION_NAMES = dict(
    zip(("lies still", "sinks or rises", "drifts level", "moves freely"), MOTIONS, strict=True)
)
METHOD_NAMES = dict(zip(("every ping", "the thesis's experiments"), METHODS, strict=True))
MAP_CELLS = 21  # along each side of the map of attainable accuracy
MOST_LEGS = 200  # that a plan keeps while the analyst drags
HISTORY_FIXES = 60  # fixes that "Fix history" spreads over the survey


class BeaconTab(Tab):
    """Map, residuals and history of a beacon hunt."""

    title = "Beacon fix"
    watches = ("pings", "fix", "fix_settings", "truth", "heard", "playing")

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.map = BeaconMap(tile_address())
        self._shown_pings = None
        self._quiet = False
        self.sentence = pn.pane.HTML(
            sizing_mode="stretch_width", margin=(6, 10), styles={"font-size": "14px"}
        )
        self.help_words = pn.pane.HTML(
            sizing_mode="stretch_width", margin=(0, 10), styles={"font-size": "14px"}, visible=False
        )
        self.numbers = pn.pane.HTML(sizing_mode="stretch_width", margin=(0, 10), styles={"font-size": "13px"})
        self.copies = {
            name: Copy(label=f"Copy {name}", margin=(2, 4))
            for name in ("degrees", "minutes", "seconds", "UTM", "everything")
        }
        self.layout = choice("Export as", EXPORT_NAMES, "gpx-1.1")
        self.layout.param.watch(lambda event: self._name_export(), "value")
        self.download = pmui.FileDownload(
            label="Export the fix",
            callback=self._export_file,
            filename="beacon-fix.gpx",
            size="small",
            margin=(6, 8),
        )
        self._make_controls()

    # -- controls ------------------------------------------------------------------------------

    def _make_controls(self) -> None:
        session, settings = self.session, self.session.fix_settings
        self.play = pmui.Button(label="Play", icon="play_arrow", size="small", margin=(6, 4, 2, 8))
        self.at_once = pmui.Button(label="At once", size="small", variant="outlined", margin=(6, 4, 2, 4))
        self.play.on_click(lambda event: session.play())
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
        self.sound_speed = number(
            "Sound speed (m/s)",
            settings.sound_speed_mps,
            "Mean speed of sound, 1500 unless told; not used with a profile",
        )
        self.speed_sigma = number(
            "Its sigma (m/s)",
            settings.speed_sigma_mps,
            "Standard error of the mean speed: 2, or 0.5 with a profile",
            step=0.1,
            start=0.0,
        )
        self.use_profile = pmui.Checkbox(
            label="Rays through the profile", value=settings.profile is not None, margin=(0, 8)
        )
        self.gps = optional(
            "Ship position rms (m)",
            settings.gps_rms_m,
            "not known",
            "Each of east and north, independent from ping to ping; empty: not known, slow errors are allowed for",
        )
        self.reject = pmui.Checkbox(
            label="Leave out false returns", value=settings.reject == "auto", margin=(0, 8)
        )
        self.max_range = number(
            "Greatest range (m)", settings.max_range_m, "Search region, from the ship's mean position"
        )
        self.max_depth = number(
            "Greatest depth (m)", settings.max_depth_m, "Search region, below the sea surface"
        )
        self.hydrophone = number(
            "Hydrophone depth (m)",
            settings.hydrophone_depth_m,
            "For surveys that do not say; used when a file is opened",
        )
        self.sample = optional(
            "Step of times (ms)",
            settings.sample_interval_ms,
            "found in the file",
            "Step in which one-way times were logged; empty: found in the file",
        )
        self.emission = pmui.Checkbox(
            label="Emission time known", value=settings.emission_known, margin=(0, 8)
        )
        self.motion = choice("The beacon", MOTION_NAMES, settings.motion)
        self.method = choice("Estimator", METHOD_NAMES, settings.method)
        self.max_speed = number(
            "Greatest speed (m/s)", settings.max_speed_mps, "Search region, of a beacon that moves"
        )
        self.interval = optional(
            "Interval of the pinger (s)",
            settings.interval_s,
            "times are not folded",
            "Where times are known up to whole intervals only; empty: they are not folded",
        )
        self.experiments = optional(
            "Experiments",
            settings.experiments,
            "all there are",
            "Pairs of receptions of the thesis's estimator",
        )
        self.spacing = optional(
            "Spacing (receptions)",
            settings.spacing,
            "the thesis's least",
            "From the first of a pair to the second",
        )
        self.step = optional(
            "Step (receptions)", settings.step, "as the spacing", "From one pair to the next; empty: chained"
        )
        self.below = choice("Beside the residuals", BELOW, "")
        self.below.param.watch(lambda event: self._show_below(), "value")
        self.leave_out = pmui.Button(
            label="Leave out selected pings", size="small", variant="outlined", margin=(6, 8)
        )
        self.leave_out.on_click(lambda event: self._leave_out())
        self.restore = pmui.Button(label="Restore all", size="small", variant="outlined", margin=(2, 8))
        self.restore.on_click(lambda event: self._set(left_out=frozenset()))
        self.history_button = pmui.Button(
            label="Fix history", size="small", variant="outlined", margin=(6, 8)
        )
        self.history_button.on_click(lambda event: self._compute_history())
        self.compare_button = pmui.Button(
            label="Compare models", size="small", variant="outlined", margin=(6, 8)
        )
        self.compare_button.on_click(lambda event: self._compare())
        self.models = pn.pane.HTML(
            sizing_mode="stretch_width", margin=(4, 10), styles={"font-size": "13px"}, visible=False
        )
        self.budget = number(
            "Time for the next leg (min)", 30.0, "Candidates sail no longer than this", start=1.0
        )
        self.ship_speed = number(
            "Ship's speed (m/s)",
            FASTEST_MPS,
            "At most; above 5 m/s the flow past the hydrophone drowns the beacon",
        )
        self.plan_button = pmui.Button(
            label="What would help?", size="small", variant="outlined", margin=(6, 8)
        )
        self.plan_button.on_click(lambda event: self._plan())
        self.save_route = pmui.FileDownload(
            label="Save the leg as GPX route", callback=self._route_file, filename="next-leg.gpx", size="small",
            visible=False, margin=(6, 8),
        )  # fmt: skip
        self._surveys, self._plan_shown = [], None
        self.map.leg_end.on_change("data", lambda name, old, new: self._leg_dragged())
        self.defaults = pmui.Button(label="Defaults", size="small", variant="text", margin=(2, 8))
        self.defaults.on_click(lambda event: self._restore_defaults())
        self._setting_widgets = {
            "sound_speed_mps": self.sound_speed,
            "sound_speed_sigma_mps": self.speed_sigma,
            "gps_rms_m": self.gps,
            "max_range_m": self.max_range,
            "max_depth_m": self.max_depth,
            "hydrophone_depth_m": self.hydrophone,
            "sample_interval_ms": self.sample,
            "emission_known": self.emission,
            "motion": self.motion,
            "method": self.method,
            "max_speed_mps": self.max_speed,
            "interval_s": self.interval,
            "experiments": self.experiments,
            "spacing": self.spacing,
            "step": self.step,
        }
        for name, widget in self._setting_widgets.items():
            widget.param.watch(lambda event, name=name: self._set(**{name: event.new}), "value")
        self.reject.param.watch(lambda event: self._set(reject="auto" if event.new else "none"), "value")
        self._profile = settings.profile
        self.use_profile.param.watch(
            lambda event: self._set(profile=self._profile if event.new else None), "value"
        )

    def controls(self):
        return [
            pn.Row(self.play, self.at_once, margin=0),
            self.heard,
            self.speed,
            self.sound_speed,
            self.use_profile,
            self.gps,
            self.motion,
            self.reject,
            pn.Row(self.plan_button, self.history_button, margin=0),
        ]

    def more(self):
        return [
            self.speed_sigma,
            self.max_range,
            self.max_depth,
            self.hydrophone,
            self.sample,
            self.emission,
            self.interval,
            self.max_speed,
            self.below,
            heading("Estimator"),
            self.method,
            self.experiments,
            self.spacing,
            self.step,
            self.compare_button,
            heading("Next leg"),
            self.budget,
            self.ship_speed,
            self.save_route,
            heading("Edits"),
            self.leave_out,
            self.restore,
            self.defaults,
            heading("Files"),
            self.layout,
            self.download,
        ]

    # -- picture and answer --------------------------------------------------------------------

    def picture(self):
        return pn.pane.Bokeh(self.map.map, sizing_mode="stretch_both", margin=0)

    def strips(self):
        self._history_pane, self._contour_pane = (
            pn.pane.Bokeh(figure, sizing_mode="stretch_both", margin=0)
            for figure in (self.map.depths, self.map.contours)
        )
        self._beside = pn.Column(self._history_pane, sizing_mode="stretch_both", margin=0)
        return [
            pn.pane.Bokeh(self.map.residuals, sizing_mode="stretch_both", margin=0),
            self._beside,
        ]

    def answer(self):
        return pn.Column(
            self.sentence,
            self.help_words,
            self.models,
            self.numbers,
            pn.FlexBox(*self.copies.values(), margin=(4, 8)),
            margin=0,
        )

    def refresh(self, changed):
        session = self.session
        if session.pings is None:
            self.sentence.object = "<b>No survey is open.</b> File, Open… reads a survey log or pings as CSV."
            return
        if session.pings is not self._shown_pings or "truth" in changed:
            self._shown_pings = session.pings
            self._profile = session.fix_settings.profile
            self.map.show_survey(session.pings, session.truth)
            if session.heard >= len(session.pings):
                self._compute_history()
        self._show_controls()
        if session.fix is not None and changed & {"fix", "pings"}:
            moves = None
            if session.fix.converged and not session.playing:
                heard = session.pings.only(slice(0, len(session.fix.number)))
                moves = influence(heard, session.fix, session.fix_settings)
            self.map.show_fix(session.pings, session.fix, moves)
            self._show_below()
            self._clear_plan()
            if session.playing:
                self.map.add_history(session.fix)
            self._show_answer(session.fix)

    def _show_controls(self) -> None:
        session, settings = self.session, self.session.fix_settings
        self._quiet = True
        try:
            self.heard.param.update(end=max(len(session.pings), 1), value=session.heard)
            self.play.param.update(
                label="Pause" if session.playing else "Play",
                icon="pause" if session.playing else "play_arrow",
            )
            for name, widget in self._setting_widgets.items():
                value = (
                    settings.speed_sigma_mps if name == "sound_speed_sigma_mps" else getattr(settings, name)
                )
                widget.value = ("" if value is None else f"{value:g}") if name in OPTIONAL else value
            self._profile = settings.profile or self._profile
            self.use_profile.param.update(value=settings.profile is not None, disabled=self._profile is None)
            self.sound_speed.disabled = settings.profile is not None
            self.reject.value = settings.reject == "auto"
        finally:
            self._quiet = False

    def _show_answer(self, fix: BeaconFix) -> None:
        self.sentence.object = sentence(fix)
        heard = self.session.pings.only(slice(0, len(fix.number)))
        known = fix.uncertainty is not None and fix.position is not None
        self.numbers.object = table(
            fix, error_budget(heard, fix, self.session.fix_settings) if known else None
        )
        texts = position_texts(fix)
        for name, copy in self.copies.items():
            copy.text = texts.get(name, "")
            copy.visible = bool(texts)

    # -- what the analyst does -----------------------------------------------------------------

    def _set(self, **changes) -> None:
        if self._quiet:
            return
        try:
            changes = {name: typed(value) if name in OPTIONAL else value for name, value in changes.items()}
            for name in WHOLE:
                if changes.get(name) is not None:
                    changes[name] = int(changes[name])
            self.session.edit(fix_settings=replace(self.session.fix_settings, **changes))
        except (TypeError, ValueError) as error:
            self.session.report(InputError(str(error)))
            self._show_controls()

    def _restore_defaults(self) -> None:
        kept = {"profile": self._profile, "left_out": self.session.fix_settings.left_out}
        self._set(**({field.name: field.default for field in fields(FixSettings)} | kept))

    def _hear(self, count: int) -> None:
        if not self._quiet:
            self.session.param.update(playing=False, heard=count)

    def _to_the_end(self) -> None:
        if self.session.pings is not None:
            self.session.param.update(playing=False, heard=len(self.session.pings))

    def _leave_out(self) -> None:
        chosen = self.map.pings.selected.indices
        if not chosen:
            self.session.say("Choose pings on the map or among the residuals first (box select or click)")
            return
        numbers = {int(self.map.pings.data["number"][k]) for k in chosen}
        self.map.pings.selected.indices = []
        self._set(left_out=self.session.fix_settings.left_out | numbers)
        self.session.say(f"{len(numbers)} pings left out by hand; Undo brings them back")

    def _show_below(self) -> None:
        """History or contours beside the residuals, as chosen."""
        names, fix = self.below.value, self.session.fix
        wanted = self._contour_pane if names else self._history_pane
        if self._beside[0] is not wanted:
            self._beside[:] = [wanted]
        if not names:
            return
        surface = None
        if fix is not None and fix.converged:
            heard = self.session.pings.only(slice(0, len(fix.number)))
            surface = misfit_surface(heard, fix, self.session.fix_settings, tuple(names.split(", ")))
        self.map.show_contours(surface)

    # -- models --------------------------------------------------------------------------------

    def _compare(self) -> None:
        session = self.session
        if session.pings is None or session.heard == 0:
            session.say("There are no pings to compare models on yet")
            return
        heard, settings = session.pings.only(slice(0, session.heard)), session.fix_settings

        def show(scores) -> None:
            self.models.param.update(object=models_table(scores), visible=True)

        session.jobs.start(
            "Compare models", lambda progress: compare_models(heard, usual_models(settings)), show
        )

    # -- the next leg --------------------------------------------------------------------------

    def _clear_plan(self) -> None:
        if self._plan_shown is not None:
            self._surveys, self._plan_shown = [], None
            self.map.show_leg(self.session.fix, None)
            self.help_words.visible = self.save_route.visible = False
        self.models.visible = False

    def _plan(self) -> None:
        session = self.session
        fix, settings, budget_s = session.fix, session.fix_settings, 60 * self.budget.value
        if fix is None:
            session.say("There is no fix to plan from yet")
            return
        heard, speed = session.pings.only(slice(0, len(fix.number))), self.ship_speed.value

        def work(progress):
            try:
                plan = plan_next_leg(heard, fix, settings, budget_s, speed)
            except ValueError as error:
                raise InputError(f"No leg can be planned: {error}") from None
            surveys = surveys_so_far(heard, fix, settings)
            progress(0.3, "map")
            reach = min(budget_s * speed, 3 * abs(plan.best.leg.length_m) + 500)
            return plan, surveys, accuracy_map(surveys[0], reach, speed, cells=MAP_CELLS)

        def done(found):
            if session.fix is fix:
                self._show_plan(*found)

        session.jobs.start("Plan", work, done)

    def _show_plan(self, plan, surveys, shading) -> None:
        fix = self.session.fix
        self._surveys, self._plan_shown = surveys, plan
        self.map.show_leg(fix, plan.best)
        self.map.shade(fix, *shading)
        self._tell_plan(plan.words)

    def _tell_plan(self, words: str) -> None:
        self.help_words.param.update(object=f"<b>What would help:</b> {html.escape(words)}", visible=True)
        self.save_route.visible = True

    def _leg_dragged(self) -> None:
        """Forecasts the leg that the analyst drags out."""
        end, fix = self.map.leg_end.data, self.session.fix
        if self._plan_shown is None or len(end["x"]) != 1 or len(self.map.leg.data["x"]) != 2:
            return
        if abs(end["x"][0] - self.map.leg.data["x"][1]) + abs(end["y"][0] - self.map.leg.data["y"][1]) < 0.5:
            return
        lat, lon = from_mercator(end["x"][0], end["y"][0])
        place = fix.frame.to_local(lat, lon, 0.0)
        leg = Leg(self._plan_shown.best.leg.start, place[:2], self.ship_speed.value)
        forecast = forecast_leg(self._surveys, leg)
        plan = replace(self._plan_shown, forecasts=(forecast, *self._plan_shown.forecasts))
        self._plan_shown = replace(plan, forecasts=plan.forecasts[:MOST_LEGS])
        self.map.show_leg(fix, forecast, move_end=False)
        self._tell_plan(plan.words)

    def _route_file(self) -> io.BytesIO:
        return io.BytesIO(route_text(self._plan_shown, self.session.fix).encode())

    def _compute_history(self) -> None:
        pings, settings = self.session.pings, self.session.fix_settings
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
            if self.session.pings is pings:  # another survey may be open by now
                self.map.set_history(fixes)

        self.session.jobs.start("Fix history", work, done)

    def _name_export(self) -> None:
        suffix = LAYOUTS[self.layout.value][0]
        self.download.filename = f"beacon-fix{suffix}"

    def _export_file(self) -> io.BytesIO:
        """The fix in the layout chosen, as a file for the browser to save."""
        session = self.session
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / self.download.filename
            if session.fix is not None:
                heard = session.pings.only(slice(0, len(session.fix.number)))
                export_fix(session.fix, path, self.layout.value, pings=heard, settings=session.fix_settings)
            return io.BytesIO(path.read_bytes() if path.exists() else b"")

    def export(self):
        fix = self.session.fix
        if fix is None:
            return None
        answer = {"survey": self.session.pings.source, **document(fix)}
        return "beacon-fix.json", json.dumps(answer, indent=1)


def optional(label: str, value: float | None, empty: str, tip: str):
    """A number that may be left empty."""
    text = "" if value is None else f"{value:g}"
    return pmui.TextInput(
        label=label,
        value=text,
        placeholder=empty,
        description=tip,
        size="small",
        sizing_mode="stretch_width",
        margin=(5, 8),
    )


def typed(value):
    """What was typed, as a number where it is text; None where nothing was. Raises ValueError for words."""
    if not isinstance(value, str):
        return value
    try:
        return float(value.replace(",", ".")) if value.strip() else None
    except ValueError:
        raise InputError(f"found {value!r}; wanted a number or nothing") from None


alone(__name__, "dashboards.tabs.beacon:BeaconTab")
