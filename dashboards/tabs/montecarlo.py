"""Tab "Monte Carlo": how good a fix of a simulated beacon is, and whether it knows it."""

from __future__ import annotations

import csv
import io

import numpy as np
import pandas as pd
import panel as pn
import panel_material_ui as pmui

from dashboards.pictures.study_views import StudyViews
from dashboards.tabs.tab import Results, Tab, alone, choice, number
from trackerlib.commands.study import COLUMNS, one_row
from trackerlib.simulation.hexagon import METHODS, SCENARIOS
from trackerlib.simulation.study import SWEEPS, StudyPoint, study_points
from trackerlib.textfiles import InputError

SWEEP_NAMES = dict(zip(("number of experiments", "spacing of receptions"), SWEEPS, strict=True))
FIRST_TRIALS = 100  # of the study that the tab opens with


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
        self.ran: tuple[str, int, float] = (SWEEPS[0], 2, 3.0)  # sweep, scenario, GPS rms of the rows
        self.scenario = choice("Beacon", {scenario_name(k): k for k in SCENARIOS}, 2)
        self.sweep = choice("Sweep", SWEEP_NAMES, SWEEPS[0])
        self.methods = pmui.CheckBoxGroup(
            label="Estimators", options=list(METHODS), value=list(METHODS), margin=(5, 8)
        )
        self.gps = number(
            "Ship position rms (m)", 3.0, "Each of east and north, independent from ping to ping"
        )
        self.speed = number("Ship's speed (m/s)", 5.0, "5 in the thesis's text; its remarks on legs fit 1")
        self.trials = number(
            "Trials a point", FIRST_TRIALS, "Simulated surveys of each point; 1000 settle a ratio to 2 %"
        )
        self.every = number("Every n-th point", 5, "1: all 46 to 89 points of the thesis's sweep")
        self.seed = number("Seed", 1, "The same seed gives the same trials")
        self.component = choice("Drawn", {"depth": "z", "east": "x", "north": "y"}, "z")
        self.component.param.watch(lambda event: self._draw(), "value")
        self.start = pmui.Button(label="Run", icon="play_arrow", size="small", margin=(6, 8))
        self.start.on_click(lambda event: self.run())
        self.words = pn.pane.HTML(sizing_mode="stretch_width", margin=(6, 10), styles={"font-size": "14px"})
        self.table = Results()

    def controls(self):
        return [
            self.scenario,
            self.sweep,
            self.methods,
            self.gps,
            self.speed,
            self.trials,
            self.every,
            self.start,
        ]

    def more(self):
        return [self.component, self.seed]

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

    def points(self) -> list[StudyPoint]:
        """The points that the controls ask for; raises InputError for what makes no sense."""
        if not self.methods.value or self.trials.value < 1 or self.every.value < 1 or not self.gps.value > 0:
            raise InputError(
                f"found {len(self.methods.value)} estimators, {self.trials.value} trials, every {self.every.value}-th "
                f"point, {self.gps.value} m of ship position error; wanted at least one of each and more than 0 m"
            )
        if not 0 < self.speed.value < 100:
            raise InputError(f"found a ship's speed of {self.speed.value} m/s; wanted more than 0, below 100")
        every = study_points(
            (self.scenario.value,), (self.sweep.value,), (self.gps.value,), self.methods.value
        )
        return [
            point
            for method in self.methods.value
            for point in [one for one in every if one.method == method][:: self.every.value]
        ]

    def run(self) -> None:
        """Runs the study off the event loop and draws it; Cancel in the status line stops it."""
        try:
            points = self.points()
        except InputError as error:
            self.session.report(error)
            return
        how = (self.trials.value, self.seed.value, self.speed.value)
        asked = (self.sweep.value, self.scenario.value, self.gps.value)

        def work(progress):
            rows = []
            for k, point in enumerate(points):
                progress(k / len(points), f"point {k + 1} of {len(points)}")
                rows.append(one_row(point, *how))
            return rows

        self.words.object = "Simulating…"
        self.session.jobs.start("Monte Carlo", work, lambda rows: self._show(rows, asked))

    def _show(self, rows: list[dict], asked: tuple[str, int, float]) -> None:
        self.rows, self.ran = rows, asked
        names = {"depth": "z", "east": "x", "north": "y"}
        if SCENARIOS[asked[1]].moving:
            names |= {"velocity up": "vz", "velocity east": "vx", "velocity north": "vy"}
        kept = self.component.value if self.component.value in names.values() else "z"
        self.component.param.update(options=names, value=kept)
        self._draw()

    def _draw(self) -> None:
        if not self.rows:
            return
        sweep, component = self.ran[0], self.component.value
        self.views.show(self.rows, sweep, component)
        self.words.object = sentence(self.rows, self.ran[1], self.ran[2], component)
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


def sentence(rows: list[dict], scenario: int, gps_rms_m: float, component: str) -> str:
    """What a study came to, as a person would read it aloud, as HTML."""
    words = [f"<b>Simulated:</b> beacon {scenario}, ship position {gps_rms_m:g} m."]
    typical = {}
    for method in METHODS:
        mine = [row for row in rows if row["method"] == method and row["converged"]]
        if not mine:
            if any(row["method"] == method for row in rows):
                words.append(f"<b>{method}</b>: no fix converged; the geometry does not show the beacon.")
            continue
        ratio = np.array([row[f"rmse.{component}"] / row[f"crlb.{component}"] for row in mine])
        trials = sum(row["converged"] for row in mine)
        coverage = sum(row["coverage95"] * row["converged"] for row in mine) / trials
        share = trials / sum(row["trials"] for row in rows if row["method"] == method)
        typical[method] = float(np.median(ratio))
        words.append(
            f"<b>{method}</b>: {typical[method]:.2f} times the bound in {component} (median of {len(mine)} points), "
            f"the truth inside {100 * coverage:.1f} % of the stated 95 % ellipsoids, {100 * share:.1f} % converged."
        )
    if len(typical) == 2:
        gain = typical["thesis"] / typical["all-pings"]
        words.append(
            f"Using every ping is <b>{gain:.1f} times</b> as accurate as the thesis's chained pairs."
        )
    return " ".join(words)


def table(rows: list[dict], sweep: str, component: str) -> pd.DataFrame:
    """One row a point: error, efficiency and coverage."""
    return pd.DataFrame(
        {
            "method": [row["method"] for row in rows],
            "n" if sweep == "experiments" else "K": [row[sweep] for row in rows],
            "error": [f"{row[f'rmse.{component}']:.3g}" for row in rows],
            "/bound": [f"{row[f'rmse.{component}'] / row[f'crlb.{component}']:.2f}" for row in rows],
            "in 95 %": [f"{100 * row['coverage95']:.0f} %" for row in rows],
        }
    )


alone(__name__, "dashboards.tabs.montecarlo:MonteCarloTab")
