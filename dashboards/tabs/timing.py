"""Tab "Timing": offset and drift of one clock, turned by hand or fitted, over the corrected tracks."""

from __future__ import annotations

import html

import numpy as np
import pandas as pd
import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.track_views import TrackViews
from dashboards.tabs.tab import Results, Tab, alone, heading
from trackerlib.commands.timing import document, offsets_csv
from trackerlib.rounding import value_with_sigma
from trackerlib.timing.correction import TimingCorrection, corrected_tracks, fit_timing, stretches

OFFSET_LIMIT_MS = 10.0
DRIFT_LIMIT_MS = 0.05


class TimingTab(Tab):
    """Sliders that stretch both versions of a track, and the fit that brings them together."""

    title = "Timing"
    watches = ("crossover", "gating", "profile", "survey", "correction")

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.views = TrackViews()
        self._set = None
        self._stretches = None
        self._quiet = False
        self.words = pn.pane.HTML(sizing_mode="stretch_width", margin=(6, 10), styles={"font-size": "14px"})
        self.numbers = pn.pane.HTML(sizing_mode="stretch_width", margin=(0, 10), styles={"font-size": "13px"})
        self.chosen = pmui.Select(
            label="Set", options=[], size="small", sizing_mode="stretch_width", margin=(10, 8, 5, 8)
        )
        self.chosen.param.watch(lambda event: self._choose(event.new), "value")
        self.offset_ms = _slider("Offset (ms)", OFFSET_LIMIT_MS, 0.001, "0.000")
        self.drift_ms = _slider("Drift (ms per count)", DRIFT_LIMIT_MS, 0.0001, "0.0000")
        for slider in (self.offset_ms, self.drift_ms):
            slider.param.watch(lambda event: self._turned(), "value")
        self.fit = pmui.Button(label="Fit", icon="auto_fix_high", size="small", margin=(6, 4, 2, 8))
        self.fit.on_click(lambda event: self._fit())
        self.zero = pmui.Button(label="Zero", size="small", variant="outlined", margin=(6, 4, 2, 4))
        self.zero.on_click(lambda event: self._put(0.0, 0.0))
        self.show_before = pmui.Checkbox(label="Show as reported", value=True, margin=(0, 8))
        self.show_before.param.watch(lambda event: self._draw_before(), "value")
        self.fit_all = pmui.Button(label="Fit every set", size="small", variant="outlined", margin=(6, 8))
        self.fit_all.on_click(lambda event: self._fit_all())
        self.table = Results()
        self._answers: list[dict] = []

    def controls(self):
        return [
            self.chosen,
            heading("Clock"),
            self.offset_ms,
            self.drift_ms,
            pn.Row(self.fit, self.zero, margin=0),
            self.show_before,
            self.fit_all,
        ]

    def picture(self):
        return pn.pane.Bokeh(self.views.plan, sizing_mode="stretch_both", margin=0)

    def strips(self):
        return [
            pn.pane.Bokeh(figure, sizing_mode="stretch_both", margin=0)
            for figure in (self.views.side, self.views.gap)
        ]

    def answer(self):
        return pn.Column(self.words, self.numbers, self.table, margin=0)

    def refresh(self, changed):
        session = self.session
        if changed & {"gating"} and session.gating is not None:
            self._quiet = True
            self.chosen.options = {set_name(one): k for k, one in enumerate(session.gating.sets)}
            self._quiet = False
            self._answers = []
            self.table.clear()
        missing = [name for name in ("crossover", "survey", "profile") if getattr(session, name) is None]
        if missing:
            self.words.object = (
                f"<b>Nothing to correct yet:</b> no {', no '.join(missing)}. Open a T-file and its arrays."
            )
            return
        if changed & {"crossover", "survey", "profile", "gating"}:
            self._take_set()
        if session.correction is not None and "correction" in changed:
            self._put(1e3 * session.correction.offset_s, 1e3 * session.correction.drift_s_per_count)

    # -- the set -------------------------------------------------------------------------------

    def _take_set(self) -> None:
        session = self.session
        self._set = session.crossover
        self._stretches = stretches(self._set, session.survey, session.profile)
        self._quiet = True
        if session.gating is not None and any(one is self._set for one in session.gating.sets):
            self.chosen.value = next(k for k, one in enumerate(session.gating.sets) if one is self._set)
        self._quiet = False
        self.views.show(self._set, excluded=None)
        self._draw_before()
        self._put(0.0, 0.0)
        if session.correction is None:
            self._fit()

    def _choose(self, index) -> None:
        if not self._quiet and index is not None:
            self.session.param.update(correction=None, crossover=self.session.gating.sets[index])

    # -- the clock -----------------------------------------------------------------------------

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
        x, y = corrected_tracks(
            self._set, *self._stretches, 1e-3 * self.offset_ms.value, 1e-3 * self.drift_ms.value, self._t0()
        )
        with pn.io.hold():
            self.views.move(x, y)
            self._tell(x - y)

    def _t0(self) -> float:
        correction = self.session.correction
        return float(np.mean(self._set.point_count)) if correction is None else correction.t0

    def _fit(self) -> None:
        session = self.session
        if self._set is None:
            return
        correction = fit_timing(self._set, session.survey, session.profile)
        session.correction = correction
        self.views.leave_out(correction.excluded)
        if not self.active:  # the session's change is only followed in sight
            self._put(1e3 * correction.offset_s, 1e3 * correction.drift_s_per_count)

    def _draw_before(self) -> None:
        self.views.show_before(self._set if self.show_before.value else None)

    # -- words ---------------------------------------------------------------------------------

    def _tell(self, gap: np.ndarray) -> None:
        correction = self.session.correction
        keep = np.ones(len(gap), bool) if correction is None else ~correction.excluded
        rms = float(np.sqrt(np.mean(np.sum(gap[keep] ** 2, axis=1)))) if keep.any() else 0.0
        fitted = correction is not None and abs(1e3 * correction.offset_s - self.offset_ms.value) < 5e-4
        if correction is None:
            self.words.object = (
                f"The gap is {rms:.1f} ft (root mean square). <b>Fit</b> finds the offset that closes it."
            )
        else:
            self.words.object = sentence(self._set, correction) + (
                ""
                if fitted
                else f"<br>At the sliders the gap is {rms:.1f} ft; <b>Fit</b> goes back to the best."
            )
            self.numbers.object = numbers(correction)

    def _fit_all(self) -> None:
        session = self.session
        if session.gating is None or session.profile is None:
            session.say("Open a T-file and its array table first")
            return
        sets, survey, profile = session.gating.sets, session.survey, session.profile

        def work(progress):
            answers = []
            for k, one in enumerate(sets):
                progress(k / len(sets), f"set {k + 1} of {len(sets)}")
                answers.append(document(one.source, one, fit_timing(one, survey, profile)))
            return answers

        session.jobs.start("Fit every set", work, self._show_all)

    def _show_all(self, answers: list[dict]) -> None:
        self._answers = answers
        frame = pd.DataFrame(
            {
                "pair": ["{}-{}".format(*one["pair"]) for one in answers],
                "T": [one["points"] for one in answers],
                "offset (ms)": [round(one["offset_ms"], 3) for one in answers],
                "± (ms)": [
                    None if one["sigma_offset_ms"] is None else round(one["sigma_offset_ms"], 3)
                    for one in answers
                ],
                "after (ft)": [round(one["rms_after_ft"], 1) for one in answers],
            }
        )
        self.table.show(frame, 12)

    def export(self):
        if self.session.correction is None or self._set is None:
            return None
        answers = self._answers or [document(self._set.source, self._set, self.session.correction)]
        label = "# SIMULATED DATA\n" if self.session.simulated else ""
        return "offsets.csv", label + offsets_csv(answers, "", "")


def _slider(label: str, limit: float, step: float, digits: str):
    """A slider whose number can also be typed; every step of a drag is painted."""
    slider = pmui.EditableFloatSlider(
        label=label, value=0.0, start=-limit, end=limit, step=step, format=digits, size="small",
        sizing_mode="stretch_width", margin=(2, 12),
    )  # fmt: skip
    slider._debounce = 1  # ms that Panel waits for further changes, 50 unless told
    return slider


def set_name(crossover) -> str:
    """A set as lists name it."""
    first, second = crossover.pair
    return f"{first}-{second}, pass {crossover.pass_number} ({crossover.points} points)"


def sentence(crossover, correction: TimingCorrection) -> str:
    """The correction as a person would read it aloud, as HTML."""
    first, second = crossover.pair
    sigma = None if correction.sigma_offset_s is None else 1e3 * correction.sigma_offset_s
    way = "too short" if correction.offset_s > 0 else "too long"
    words = (
        f"<b>Transit times were {way} by {value_with_sigma(abs(1e3 * correction.offset_s), sigma, 'ms')}</b> "
        f"at point count {correction.t0:.0f}, as arrays {first} and {second} saw it: correcting it takes the gap from "
        f"{correction.rms_before:.1f} to {correction.rms_after:.1f} ft."
    )
    return words + (f" {html.escape(correction.reason)}." if correction.reason else "")


def numbers(correction: TimingCorrection) -> str:
    """The numbers of a correction, as an HTML table."""
    drift_sigma = (
        None if correction.sigma_drift_s_per_count is None else 1e3 * correction.sigma_drift_s_per_count
    )
    offset_sigma = None if correction.sigma_offset_s is None else 1e3 * correction.sigma_offset_s

    def feet(vector):
        return ", ".join(f"{value:.1f}" for value in vector) + " ft"

    rows = [
        ("offset", value_with_sigma(1e3 * correction.offset_s, offset_sigma, "ms")),
        ("drift", value_with_sigma(1e3 * correction.drift_s_per_count, drift_sigma, "ms/count")),
        ("at point count (t0)", f"{correction.t0:.1f}"),
        ("points used", f"{correction.points} of {len(correction.excluded)}"),
        ("mean gap before", feet(correction.mean_before)),
        ("mean gap after", feet(correction.mean_after)),
        ("track", "bends" if correction.curved else "straight"),
    ]
    if correction.correlation is not None:
        rows.insert(3, ("correlation of the two", f"{correction.correlation:.2f}"))
    cells = "".join(
        f'<tr><td style="opacity:.75;padding:1px 8px 1px 0">{html.escape(name)}</td><td>{html.escape(text)}</td></tr>'
        for name, text in rows
    )
    return f"<table>{cells}</table><div style='opacity:.75'>gaps: downrange, crossrange, vertical</div>"


alone(__name__, "dashboards.tabs.timing:TimingTab")
