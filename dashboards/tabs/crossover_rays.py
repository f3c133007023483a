"""Why a wrong clock parts two tracks: radial lines of the chosen set, and of a made-up one to learn by."""

from __future__ import annotations

import numpy as np
import panel as pn

from dashboards.pictures.radial_lines import RadialLines
from dashboards.session import Session
from dashboards.tabs.pages import fill, words
from dashboards.tabs.tab import TypedSlider, choice
from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.simulation.crossover_runs import ClockTruth, simulate_crossover
from trackerlib.textfiles import InputError
from trackerlib.timing.correction import corrected_tracks, stretches

SET, EXAMPLE = "the chosen set", "a teaching example (simulated)"
EXAMPLE_OFFSET_MS = 60.0
EXAMPLE_ARRAYS = np.array([[0.0, 0.0, -1300.0], [6000.0, 0.0, -1300.0]])
LIMIT_MS = {SET: 10.0, EXAMPLE: 100.0}


class RadialPage:
    """The picture with one slider: how much time is given back to every transit."""

    def __init__(self, session: Session):
        self.session = session
        self.picture = RadialLines()
        self.what = choice("Lines of", {name: name for name in LIMIT_MS}, SET)
        self.offset_ms = TypedSlider(
            "Time given back to every transit (ms)", LIMIT_MS[SET], 0.01, format="0.00"
        )
        self.words = words()
        self.what.param.watch(lambda event: self.show(), "value")
        self.offset_ms.param.watch(lambda event: self._turned(), "value")
        self._set: CrossoverSet | None = None
        self._stretches = None
        self._row = 0
        self.pane = pn.Column(
            pn.Row(pn.Column(self.what, width=260, margin=0), self.offset_ms, margin=0),
            self.words,
            pn.Row(fill(self.picture.whole), fill(self.picture.close), sizing_mode="stretch_both", margin=0),
            sizing_mode="stretch_both",
            margin=0,
        )

    def show(self, row: int | None = None) -> None:
        """Draws the set or the example; row is the point whose gap is drawn close by."""
        session = self.session
        if self.what.value == EXAMPLE:
            crossover, survey, profile = teaching_example()
        else:
            crossover, survey, profile = session.crossover, session.survey, session.profile
        if crossover is None or survey is None or profile is None:
            self._set = None
            self.words.object = (
                "A set, its arrays and a sound-speed profile are wanted; the teaching example needs none."
            )
            return
        try:
            self._stretches = stretches(crossover, survey, profile)
            places = np.stack([survey.position_of(number) for number in crossover.pair])
        except InputError as error:
            self._set, self.words.object = None, f"<b>No lines can be drawn:</b> {error}."
            return
        self._set = crossover
        self._row = crossover.points // 2 if row is None else row
        names = tuple(f"array {number}" for number in crossover.pair)
        limit = LIMIT_MS[self.what.value]
        self.offset_ms.param.update(start=-limit, end=limit, value=0.0)
        self.picture.show(places, names, crossover.x, crossover.y, self._row)
        self._turned()

    def _turned(self) -> None:
        if self._set is None:
            return
        x, y = corrected_tracks(self._set, *self._stretches, 1e-3 * self.offset_ms.value, 0.0, 0.0)
        with pn.io.hold():
            self.picture.move(x, y)
            self.words.object = self._sentence(x, y)

    def _sentence(self, x: np.ndarray, y: np.ndarray) -> str:
        here = float(np.linalg.norm((x - y)[self._row]))
        whole = float(np.sqrt(np.mean(np.sum((x - y) ** 2, axis=1))))
        simulated = (
            f" <b>SIMULATED</b>, its transit times {EXAMPLE_OFFSET_MS:.0f} ms too short so that the eye can see it."
            if self.what.value == EXAMPLE
            else ""
        )
        if not np.isfinite(here):
            return "No direct ray reaches this point from both arrays."
        return (
            f"Each array puts the vehicle along its own line at the transit time times the speed of sound. With "
            f"{self.offset_ms.value:.2f} ms given back to every transit the two places of count "
            f"{self._set.point_count[self._row]} lie {here:.1f} ft apart, all of them {whole:.1f} ft (root mean "
            f"square). At the clock's true offset the lines meet.{simulated}"
        )


def teaching_example() -> tuple[CrossoverSet, ArraySurvey, SoundSpeedProfile]:
    """A made-up run past two arrays whose clock is far off, without noise."""
    count = np.arange(1, 41)
    track = np.column_stack([2000 + 50.0 * count, np.full(40, 2600.0), np.full(40, -300.0)])
    profile = SoundSpeedProfile.constant(4900.0)
    crossover = simulate_crossover(
        track, count, tuple(EXAMPLE_ARRAYS), profile, ClockTruth(1e-3 * EXAMPLE_OFFSET_MS),
        np.random.default_rng(0), noise_ft=0.0,
    )  # fmt: skip
    survey = ArraySurvey(
        np.array([1, 2]), EXAMPLE_ARRAYS, np.full(2, "NaT", "datetime64[D]"), np.zeros(2, bool), "simulated"
    )
    return crossover, survey, profile
