"""Tab "Timing": offset and drift of one clock, turned by hand or fitted, and what they say of the run."""

from __future__ import annotations

import html

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.q_contours import QContours
from dashboards.pictures.track_views import TrackViews
from dashboards.session import same_set
from dashboards.tabs.crossover_words import doubts_words
from dashboards.tabs.pages import Pages, above, button, fill, words
from dashboards.tabs.tab import Tab, TypedSlider, alone, choice, heading
from dashboards.tabs.timing_apply import ApplyPage
from dashboards.tabs.timing_causes import CausesPage
from dashboards.tabs.timing_constancy import ConstancyPage
from dashboards.tabs.timing_profile import ProfilePage
from dashboards.tabs.timing_sets import SetsPage
from dashboards.tabs.timing_words import numbers, sentence, set_name
from trackerlib.commands.timing import document, offsets_csv
from trackerlib.textfiles import InputError
from trackerlib.timing.correction import corrected_tracks, estimate_timing, stretches

OFFSET_LIMIT_MS = 10.0
DRIFT_LIMIT_MS = 0.05
AT_ONCE = 300  # sets that are fitted without being asked
METHODS = {"every direction alike (the report)": "report", "directions by their noise (joint)": "joint"}
OUTLIERS = {"left out of all": "out", "left out of M alone": "noise", "left in": "in"}
ASPECTS = {
    "plan true, side stretched": (True, False),
    "both true": (True, True),
    "both stretched": (False, False),
}
TRACK, Q, PROFILE, SETS, CONSTANCY, CAUSES, APPLY = (
    "Track", "Q", "Profile", "Sets", "Constancy", "Causes", "Apply"
)  # fmt: skip


class TimingTab(Tab):
    """Sliders that stretch both versions of a track, the fit that brings them together, the run as a whole."""

    title = "Timing"
    watches = (
        "crossover", "gating", "profile", "survey", "correction", "edits", "timing_options", "fits", "offsets"
    )  # fmt: skip

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.views, self.q = TrackViews(), QContours()
        self.profile_page, self.sets_page = ProfilePage(self.session), SetsPage(self.session)
        self.constancy, self.causes = ConstancyPage(self.session), CausesPage(self.session)
        self.apply_page = ApplyPage(self.session, self._clock)
        self._set = None
        self._stretches = None
        self._doubts = ""  # of the set, as HTML
        self._quiet = False
        self.words, self.run_words, self.numbers = words("14px"), words("14px"), words()
        self.sliders_words = words("14px")  # apart, so that no other word is laid out while a slider moves
        self.sliders_words.margin = (-6, 10, 6, 10)
        self._make_controls()
        self._make_pages()

    # -- parts ---------------------------------------------------------------------------------

    def _make_controls(self) -> None:
        self.chosen = choice("Set", {}, None)
        self.chosen.margin = (10, 8, 5, 8)
        self.chosen.param.watch(lambda event: self._choose(event.new), "value")
        self.offset_ms = TypedSlider("Offset (ms)", OFFSET_LIMIT_MS, 0.001, format="0.000")
        self.drift_ms = TypedSlider("Drift (ms per count)", DRIFT_LIMIT_MS, 0.0001, format="0.0000")
        for slider in (self.offset_ms, self.drift_ms):
            slider.param.watch(lambda event: self._turned(), "value")
        self.fit = button("Fit", self._fit, variant="contained", margin=(6, 4, 2, 8))
        self.zero = button("Zero", lambda: self._put(0.0, 0.0), margin=(6, 4, 2, 4))
        self.fit_all = button("Fit every set", self.session.fit_every_set, margin=(6, 4))
        self.show_before = pmui.Checkbox(label="Show as reported", value=True, margin=(0, 8))
        self.show_before.param.watch(lambda event: self._draw_before(), "value")
        self.aspect = choice("Aspect", {name: name for name in ASPECTS}, next(iter(ASPECTS)))
        self.aspect.param.watch(lambda event: self.views.aspect(*ASPECTS[event.new]), "value")
        self.method = choice("Directions weigh", METHODS, "report")
        self.outliers = choice("Outliers", OUTLIERS, "out")
        for widget, name in ((self.method, "method"), (self.outliers, "outliers")):
            widget.param.watch(lambda event, name=name: self._set_option(name, event.new), "value")

    def _make_pages(self) -> None:
        self.pages = Pages(
            {
                TRACK: above(fill(self.views.plan), fill(self.views.side), fill(self.views.gap)),
                Q: fill(self.q.figure),
                PROFILE: self.profile_page.pane,
                SETS: self.sets_page.pane,
                CONSTANCY: self.constancy.pane,
                CAUSES: self.causes.pane,
                APPLY: self.apply_page.pane,
            }
        )
        self.pages.on_show(self._show_page)

    def controls(self):
        return [
            self.chosen,
            heading("Clock"),
            self.offset_ms,
            self.drift_ms,
            pn.Row(self.fit, self.zero, self.fit_all, margin=0),
            self.show_before,
            self.aspect,
        ]

    def more(self):
        return {"How it is fitted": [self.method, self.outliers]}

    def picture(self):
        return self.pages

    def answer(self):
        return pn.Column(self.words, self.sliders_words, self.run_words, self.numbers, margin=0)

    # -- what is shown -------------------------------------------------------------------------

    def refresh(self, changed):
        session = self.session
        self._show_controls(changed)
        if changed & {"gating", "profile", "survey", "edits"}:
            self.causes.forget()
        missing = [name for name in ("crossover", "survey", "profile") if getattr(session, name) is None]
        if missing:
            self._refuse(
                f"<b>Nothing to correct yet:</b> no {', no '.join(missing)}. Open a T-file and its arrays."
            )
            return
        if changed & {"crossover", "survey", "profile", "gating", "edits", "timing_options"}:
            self._take_set()
        if session.correction is not None and "correction" in changed and self._set is not None:
            self.q.show(session.correction)
            self._put(1e3 * session.correction.offset_s, 1e3 * session.correction.drift_s_per_count)
        if changed & {"fits", "gating", "crossover", "offsets"}:
            self._show_run("fits" in changed or "gating" in changed)
        self._show_page()

    def _show_controls(self, changed: set[str]) -> None:
        session = self.session
        self._quiet = True
        if "gating" in changed and session.gating is not None:
            self.chosen.options = {set_name(one): k for k, one in enumerate(session.gating.sets)}
        for widget, name in ((self.method, "method"), (self.outliers, "outliers")):
            widget.value = session.timing_options[name]
        self._quiet = False

    def _refuse(self, why: str) -> None:
        """No tracks to move, and the reason where the answer would stand."""
        self._set = None
        self.views.clear()
        self.q.show(None)
        self.words.object, self.sliders_words.object, self.numbers.object = why, "", ""

    def _show_run(self, anew: bool) -> None:
        """What every set's fit says of the run; a run of no great size is fitted unasked."""
        session = self.session
        sets = () if session.gating is None else session.gating.sets
        if not session.fits and 0 < len(sets) <= AT_ONCE:
            self.run_words.object = ""
            session.fit_every_set()
            return
        if not anew:
            self.sets_page.choose()
            return
        told = self.sets_page.show()
        self.run_words.object = told
        self.apply_page.verdict = self.sets_page.verdict

    def _show_page(self) -> None:
        """Brings the page in sight up to date."""
        shown = self.pages.shown
        if shown == Q:
            self.q.move(self.offset_ms.value, self.drift_ms.value)
        elif shown == PROFILE:
            self.profile_page.show()
        elif shown == CONSTANCY:
            self.constancy.show(self.sets_page.verdict, self.run_words.object)
        elif shown == CAUSES:
            self.causes.show()
        elif shown == APPLY:
            self.apply_page.apply()

    # -- the set -------------------------------------------------------------------------------

    def _take_set(self) -> None:
        session = self.session
        crossover = session.crossover
        try:
            self._stretches = stretches(crossover, session.survey, session.profile)
        except InputError as error:
            self._refuse(f"<b>This set cannot be corrected:</b> {html.escape(str(error))}.")
            return
        self._set = crossover
        self._doubts = doubts_words(crossover, session.survey, session.profile)
        self._quiet = True
        if session.gating is not None:
            at = (k for k, one in enumerate(session.gating.sets) if same_set(one, crossover))
            self.chosen.value = next(at, None)
        self._quiet = False
        self.views.show(crossover)
        self._draw_before()
        self._fit()

    def _choose(self, index) -> None:
        if not self._quiet and index is not None:
            self.session.param.update(correction=None, crossover=self.session.gating.sets[index])

    def _set_option(self, name: str, value: str) -> None:
        if not self._quiet:
            self.session.edit(timing_options=self.session.timing_options | {name: value})

    # -- the clock -----------------------------------------------------------------------------

    def _clock(self) -> tuple[float, float, float]:
        """Offset [s], drift [s/count] and t0 as the sliders stand."""
        return 1e-3 * self.offset_ms.value, 1e-3 * self.drift_ms.value, self._t0()

    def _put(self, offset_ms: float, drift_ms: float) -> None:
        """Sets both sliders at once, widening their ends where the numbers ask for it."""
        self._quiet = True
        for slider, value, limit in (
            (self.offset_ms, offset_ms, OFFSET_LIMIT_MS),
            (self.drift_ms, drift_ms, DRIFT_LIMIT_MS),
        ):
            limit = max(limit, 1.5 * abs(value))
            slider.param.update(start=-limit, end=limit, value=float(value))
        self._quiet = False
        self._turned()

    def _turned(self) -> None:
        """Redraws both tracks for the sliders as they stand."""
        if self._quiet or self._set is None:
            return
        x, y = corrected_tracks(self._set, *self._stretches, *self._clock())
        with pn.io.hold():
            self.views.move(x, y)
            if self.pages.shown == Q:
                self.q.move(self.offset_ms.value, self.drift_ms.value)
            self._tell(x - y)

    def _t0(self) -> float:
        correction = self.session.correction
        if correction is not None:
            return correction.t0
        return 0.0 if self._set is None else float(np.mean(self._set.point_count))

    def _fit(self) -> None:
        session = self.session
        if self._set is None:
            return
        left_out = session.left_out(self._set)
        correction = estimate_timing(self._set, *self._stretches, left_out=left_out, **session.timing_options)
        session.correction = correction
        why = np.where(left_out, "left out by hand", np.where(correction.excluded, "outlier", "used"))
        self.views.leave_out(correction.excluded, why)
        if not self.active:  # the session's change is only followed in sight
            self._put(1e3 * correction.offset_s, 1e3 * correction.drift_s_per_count)

    def _draw_before(self) -> None:
        self.views.show_before(self._set if self.show_before.value else None)

    # -- words ---------------------------------------------------------------------------------

    def _tell(self, gap: np.ndarray) -> None:
        correction = self.session.correction
        keep = np.ones(len(gap), bool) if correction is None else ~correction.excluded
        rms = float(np.sqrt(np.mean(np.sum(gap[keep] ** 2, axis=1)))) if keep.any() else 0.0
        if correction is None:
            self.words.object = (
                f"The gap is {rms:.1f} ft (root mean square). <b>Fit</b> finds the offset that closes it."
            )
            self.sliders_words.object = ""
            return
        fitted = abs(1e3 * correction.offset_s - self.offset_ms.value) < 5e-4
        self.words.object = sentence(self._set, correction) + self._in_shadow() + self._doubts
        self.sliders_words.object = (
            "" if fitted else f"At the sliders the gap is {rms:.1f} ft; <b>Fit</b> goes back to the best."
        )
        self.numbers.object = numbers(correction)

    def _in_shadow(self) -> str:
        """Words on points that no direct ray reaches, as HTML."""
        missed = int(np.sum(~(self._stretches[0].reached & self._stretches[1].reached)))
        if not missed:
            return ""
        return (
            f" Refraction turns the rays away from {missed} of {self._set.points} points; they take no part. "
            "<b>Profile</b> shows which."
        )

    def export(self):
        if self.session.correction is None or self._set is None:
            return None
        session = self.session
        label = "# SIMULATED DATA\n" if session.simulated else ""
        answers = [document(self._set.source, self._set, session.correction)]
        if session.fits:
            pairs = zip(session.gating.sets, session.fits, strict=True)
            answers = [document(one.source, one, fit) for one, fit in pairs if fit is not None]
        return "offsets.csv", label + offsets_csv(answers, *session.day_and_run)


alone(__name__, "dashboards.tabs.timing:TimingTab")
