"""Tab "Monte Carlo": how good a fix of a simulated beacon is, and whether it knows it."""

from __future__ import annotations

import csv
import io
import time
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
import panel as pn
import panel_material_ui as pmui

from dashboards.jobs import Cancelled
from dashboards.pictures.study_views import METHOD_NAMES, StudyViews, unit_of
from dashboards.tabs.tab import Results, Tab, alone, choice, number
from trackerlib.commands.study import COLUMNS, one_row
from trackerlib.simulation.hexagon import SCENARIOS, Scenario
from trackerlib.simulation.study import (
    STUDY_METHODS,
    SWEEPS,
    StudyPoint,
    coverage_words,
    study_points,
)
from trackerlib.textfiles import InputError

SWEEP_NAMES = dict(zip(("number of experiments", "spacing of receptions"), SWEEPS, strict=True))
OWN = 0  # a beacon of the analyst's own, among the numbers of scenarios
SHORT = {"all-pings": "all", "thesis": "thesis", "usual": "usual"}  # for a narrow column
BETWEEN_DRAWINGS_S = 0.5  # while a study runs
MOST = 1000  # experiments or spacing
FIRST_TRIALS = 100  # of the study that the tab opens with


@dataclass(frozen=True)
class Asked:
    """What a study was run for."""

    sweep: str
    scenario: int  # OWN, or a row of Table 4-1
    beacon: Scenario
    gps_rms_m: float
    points: tuple[StudyPoint, ...] = ()
    trials: int = FIRST_TRIALS
    seed: int = 1
    speed_mps: float = 5.0


def scenario_name(number: int) -> str:
    """A row of Table 4-1 in words."""
    one = SCENARIOS[number]
    x, y, z = one.position
    return f"{number}: {'moves from' if one.moving else 'lies at'} {x:g}, {y:g}, {z:g} m"


class MonteCarloTab(Tab):
    """Scenario and grid at the left; error against bound, efficiency and coverage; a table of it all."""

    title = "Monte Carlo"
    watches = ("playing",)

    def __init__(self, session=None, **params):
        super().__init__(session, **params)
        self.views = StudyViews()
        self.rows: list[dict] = []
        self.ran = Asked(SWEEPS[0], 2, SCENARIOS[2], 3.0)  # what the rows are of
        self.state = ""  # how far the study is, unless it is whole
        self.scenario = choice("Beacon", {scenario_name(k): k for k in SCENARIOS} | {"one of my own": OWN}, 2)
        self.place = numbers(
            "Its east, north, up (m)", "0, 500, -1500", "From the hexagon's centre; up is negative"
        )
        self.velocity = numbers("Its velocity (m/s)", "0, 0, 0", "East, north, up; 0, 0, 0 lies still")
        self.sweep = choice("Sweep", SWEEP_NAMES, SWEEPS[0])
        self.methods = pmui.CheckBoxGroup(
            label="Estimators",
            options={METHOD_NAMES[method]: method for method in STUDY_METHODS},
            value=list(STUDY_METHODS),
            margin=(5, 8),
        )
        self.gps = number(
            "Ship position rms (m)", 3.0, "Each of east and north, independent from ping to ping"
        )
        self.speed = number("Ship's speed (m/s)", 5.0, "5 in the thesis's text; its remarks on legs fit 1")
        self.trials = number(
            "Trials a point", FIRST_TRIALS, "Simulated surveys of each point; 1000 settle a ratio to 2 %"
        )
        self.every = number("Every n-th point", 5, "1: all 46 to 89 points of the thesis's sweep")
        self.first = number("Sweep from", 5, "First number of experiments, or spacing", start=1)
        self.last = number("Sweep to", 50, "Last number of experiments, or spacing", start=1)
        self.held = number(
            "Held at", 45, "Spacing while experiments are swept, and the other way round", start=1
        )
        self.seed = number("Seed", 1, "The same seed gives the same trials")
        self.component = choice("Drawn", {"depth": "z", "east": "x", "north": "y"}, "z")
        self.component.param.watch(lambda event: self._draw(), "value")
        self.start = pmui.Button(label="Run", icon="play_arrow", size="small", margin=(6, 8))
        self.start.on_click(lambda event: self.run())
        self.resume = pmui.Button(
            label="Resume", icon="redo", size="small", variant="outlined", margin=(6, 8), visible=False,
            description="Goes on with the study that was cancelled, as it was asked for",
        )  # fmt: skip
        self.resume.on_click(lambda event: self.go_on())
        for widget in (self.scenario, self.sweep, self.velocity):
            widget.param.watch(lambda event: self._grid_of_thesis(), "value")
        self._grid_of_thesis()
        self.words = pn.pane.HTML(sizing_mode="stretch_width", margin=(6, 10), styles={"font-size": "14px"})
        self.table = Results()

    def controls(self):
        return [
            self.scenario,
            self.place,
            self.velocity,
            self.sweep,
            self.methods,
            self.gps,
            self.trials,
            self.component,
            pn.Row(self.start, self.resume, margin=0),
        ]

    def more(self):
        return {
            "Grid": [self.first, self.last, self.every, self.held],
            "Ship and trials": [self.speed, self.seed],
        }

    def picture(self):
        return pn.pane.Bokeh(self.views.error, sizing_mode="stretch_both", margin=0)

    def strips(self):
        return [
            pn.pane.Bokeh(figure, sizing_mode="stretch_both", margin=0)
            for figure in (self.views.ratio, self.views.coverage)
        ]

    def answer(self):
        return pn.Column(self.words, self.table, margin=0)

    def refresh(self, changed):
        if not self.rows:
            self.run()

    # -- the study -----------------------------------------------------------------------------

    def beacon(self) -> Scenario:
        """The beacon simulated; raises InputError for what makes no sense."""
        if self.scenario.value != OWN:
            return SCENARIOS[self.scenario.value]
        place, velocity = three(self.place), three(self.velocity)
        if not place[2] < 0:
            raise InputError(
                f"Its east, north, up: found {place[2]:g} m up; wanted it below the surface, less than 0"
            )
        return Scenario(place, velocity)

    def _grid_of_thesis(self) -> None:
        """Puts the thesis's own grid into the controls."""
        own = self.scenario.value == OWN
        self.place.visible = self.velocity.visible = own
        try:
            moving = self.beacon().moving
        except InputError:
            return  # told when the study is run
        sweep = self.sweep.value
        points = study_points((4 if moving else 1,), (sweep,), (3.0,), ("all-pings",))
        held = points[0].spacing if sweep == "experiments" else points[0].experiments
        self.first.value, self.last.value, self.held.value = points[0].abscissa, points[-1].abscissa, held

    def points(self) -> list[StudyPoint]:
        """The points that the controls ask for; raises InputError for what makes no sense."""
        if not self.methods.value or self.trials.value < 1 or self.every.value < 1 or not self.gps.value > 0:
            raise InputError(
                f"found {len(self.methods.value)} estimators, {self.trials.value} trials, every {self.every.value}-th "
                f"point, {self.gps.value} m of ship position error; wanted at least one of each and more than 0 m"
            )
        if not 0 < self.speed.value < 100:
            raise InputError(f"found a ship's speed of {self.speed.value} m/s; wanted more than 0, below 100")
        first, last, held = self.first.value, self.last.value, self.held.value
        if not (1 <= first <= last <= MOST and 1 <= held <= MOST):
            raise InputError(
                f"found a sweep from {first} to {last}, held at {held}; wanted 1 to {MOST}, first to last"
            )
        by_count = self.sweep.value == "experiments"
        return [
            StudyPoint(
                self.scenario.value,
                self.sweep.value,
                turned if by_count else held,
                held if by_count else turned,
                self.gps.value,
                method,
            )
            for method in self.methods.value
            for turned in range(first, last + 1, self.every.value)
        ]

    def run(self) -> None:
        """Runs the study that the controls ask for; Cancel in the status line stops it."""
        try:
            points, beacon = self.points(), self.beacon()
        except InputError as error:
            self.session.report(error)
            return
        asked = Asked(
            self.sweep.value, self.scenario.value, beacon, self.gps.value, tuple(points),
            self.trials.value, self.seed.value, self.speed.value,
        )  # fmt: skip
        self._study(asked, [])

    def go_on(self) -> None:
        """Runs the points that a cancelled study left, as they were asked for."""
        self._study(self.ran, self.rows)

    def _study(self, asked: Asked, done: list[dict]) -> None:
        """Runs the points not done yet off the event loop, and draws all."""
        points, how = asked.points, (asked.trials, asked.seed, asked.speed_mps, asked.beacon)

        def work(progress):
            rows = list(done)
            shown = time.monotonic()
            progress.meanwhile(lambda: self._begin(len(points) - len(rows)))
            try:
                for k in range(len(rows), len(points)):
                    progress(k / len(points), f"point {k + 1} of {len(points)}")
                    rows.append(one_row(points[k], *how))
                    if time.monotonic() - shown > BETWEEN_DRAWINGS_S:
                        shown = time.monotonic()
                        so_far = f"Simulating: {len(rows)} of {len(points)} points so far."
                        progress.meanwhile(partial(self._show, list(rows), asked, so_far))
            except Cancelled:
                return rows, f"Cancelled: {len(rows)} of {len(points)} points were done and are kept."
            return rows, ""

        def finish(done) -> None:
            self._show(done[0], asked, done[1])
            self.resume.visible = len(self.rows) < len(self.ran.points)

        self.session.jobs.start("Monte Carlo", work, finish, long=True)

    def _begin(self, points: int) -> None:
        self.resume.visible = False
        self.words.object = f"Simulating {points} points…"

    def _show(self, rows: list[dict], asked: Asked, state: str = "") -> None:
        """Draws a study, whole or as far as it is; one without a row leaves the rows of before."""
        self.state = state
        if not rows:
            self.words.object = state
            self._draw()
            return
        self.rows, self.ran = rows, asked
        names = {"depth": "z", "east": "x", "north": "y"}
        if asked.beacon.moving:
            names |= {"velocity up": "vz", "velocity east": "vx", "velocity north": "vy"}
        kept = self.component.value if self.component.value in names.values() else "z"
        self.component.param.update(options=names, value=kept)
        self._draw()

    def _draw(self) -> None:
        if not self.rows:
            return
        sweep, component = self.ran.sweep, self.component.value
        self.views.show(self.rows, sweep, component)
        self.words.object = f"{self.state} {sentence(self.rows, self.ran, component)}".strip()
        self.table.show(table(self.rows, sweep, component), 18, sortable=False)

    def export(self):
        if not self.rows:
            return None
        text = io.StringIO()
        text.write("# SIMULATED DATA\n")
        writer = csv.DictWriter(text, COLUMNS)
        writer.writeheader()
        writer.writerows(self.rows)
        return "study.csv", text.getvalue()


def numbers(label: str, value: str, tip: str):
    """Three numbers in one field."""
    return pmui.TextInput(
        label=label, value=value, description=tip, size="small", sizing_mode="stretch_width", margin=(5, 8),
        visible=False,
    )  # fmt: skip


def three(field) -> tuple[float, float, float]:
    """What such a field holds; raises InputError for anything but three numbers."""
    try:
        east, north, up = (float(part) for part in field.value.replace(";", ",").split(","))
        if not np.isfinite([east, north, up]).all():
            raise ValueError
    except ValueError:
        raise InputError(f"{field.label}: found {field.value!r}; wanted three numbers with commas") from None
    return east, north, up


def sentence(rows: list[dict], ran: Asked, component: str) -> str:
    """What a study came to, as a person would read it aloud, as HTML."""
    which = "of my own" if ran.scenario == OWN else str(ran.scenario)
    words = [f"<b>Simulated:</b> beacon {which}, ship position {ran.gps_rms_m:g} m."]
    typical = {}
    for method, name in METHOD_NAMES.items():
        mine = [row for row in rows if row["method"] == method and row["converged"]]
        if not mine:
            if any(row["method"] == method for row in rows):
                words.append(f"<b>{name}</b>: no fix converged; the geometry does not show the beacon.")
            continue
        ratio = np.array([row[f"rmse.{component}"] / row[f"crlb.{component}"] for row in mine])
        trials = sum(row["converged"] for row in mine)
        coverage = sum(row["coverage95"] * row["converged"] for row in mine) / trials
        share = trials / sum(row["trials"] for row in rows if row["method"] == method)
        typical[method] = float(np.median(ratio))
        words.append(
            f"<b>{name}</b>: {typical[method]:.2f} times the bound in {component} (median of {len(mine)} points), "
            f"{coverage_words(coverage, trials)}, {100 * share:.1f} % converged."
        )
    for method, worse in (("thesis", "the thesis's chained pairs"), ("usual", "the usual least squares")):
        if {method, "all-pings"} <= set(typical):
            gain = typical[method] / typical["all-pings"]
            words.append(f"Using every ping is <b>{gain:.1f} times</b> as accurate as {worse}.")
    return "".join(f"<p style='margin:0 0 6px'>{one}</p>" for one in words)


def table(rows: list[dict], sweep: str, component: str) -> pd.DataFrame:
    """One row a point: error, efficiency and coverage."""
    unit = unit_of(component)
    return pd.DataFrame(
        {
            "way": [SHORT[row["method"]] for row in rows],
            "n" if sweep == "experiments" else "K": [row[sweep] for row in rows],
            f"error ({unit})": [f"{row[f'rmse.{component}']:.3g}" for row in rows],
            "ratio": [f"{row[f'rmse.{component}'] / row[f'crlb.{component}']:.2f}" for row in rows],
            "in 95 %": [f"{100 * row['coverage95']:.0f} %" for row in rows],
        }
    )


alone(__name__, "dashboards.tabs.montecarlo:MonteCarloTab")
