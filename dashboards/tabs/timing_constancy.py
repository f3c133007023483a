"""Is one offset enough? Arrays left out one by one, variance components, and the test of each run like Table 4."""

from __future__ import annotations

import numpy as np
import pandas as pd
import panel as pn

from dashboards.opening import DATA
from dashboards.session import Session
from dashboards.tabs.pages import words
from dashboards.tabs.tab import Results, choice
from dashboards.tabs.timing_words import p_words
from trackerlib.rangefiles.offsets_file import read_offsets
from trackerlib.rounding import value_with_sigma
from trackerlib.timing.constancy import (
    Constancy,
    component_intervals,
    components_of,
    pair_effects,
    runs_constant,
    variances_of,
)
from trackerlib.timing.offsets import OffsetTable
from trackerlib.timing.one_run import Agreement, RunVerdict

SESSION, OPENED, REPORT = (
    "the vehicles of this session",
    "the OFFSETS.csv that is open",
    "Read (1990), Table 1",
)
NAMES = ("day", "run", "residual")
ALONE = 0.01  # a p-value below which a run's offsets are not one


class ConstancyPage:
    """Agreement within one run by its own sigmas; REML and the report's test over any table of offsets."""

    def __init__(self, session: Session):
        self.session = session
        self._runs: dict[tuple[str, str], list[tuple[str, float]]] = {}
        self.source = choice("Offsets of", {SESSION: SESSION, REPORT: REPORT}, SESSION)
        self.source.param.watch(lambda event: self.show_table(), "value")
        self.words, self.table_words = words(), words()
        self.arrays, self.runs, self.pairs, self.pivot = (Results() for _ in range(4))
        tables = pn.Tabs(
            ("Arrays left out", self.arrays), ("Runs (Table 4)", self.runs), ("Pairs", self.pairs),
            ("By run and pair (Table 2)", self.pivot), dynamic=False, sizing_mode="stretch_width",
        )  # fmt: skip
        self.pane = pn.Column(
            pn.Row(pn.Column(self.source, width=320, margin=0), margin=0),
            self.words,
            self.table_words,
            tables,
            sizing_mode="stretch_both",
            scroll="y",
            margin=0,
        )

    def show(self, verdict: RunVerdict | None, told: str) -> None:
        """The verdict on the run in sight, and the table that is chosen."""
        self.words.object = told
        if verdict is None:
            self.arrays.clear()
        else:
            wrapped = {"drift (ms/count)": {"type": "textarea"}}
            self.arrays.show(table_of_arrays(verdict), 20, formatters=wrapped)
        self._remember()
        options = {SESSION: SESSION, REPORT: REPORT}
        if self.session.offsets is not None:
            options = {SESSION: SESSION, OPENED: OPENED, REPORT: REPORT}
        self.source.options = options
        self.show_table()

    def _remember(self) -> None:
        """Keeps the offsets of every vehicle fitted so far, each a run of its own."""
        session = self.session
        if session.gating is None or len(session.fits) != len(session.gating.sets):
            return
        self._runs[session.day_and_run] = [
            ("{}-{}".format(*one.pair), fit.offset_s)
            for one, fit in zip(session.gating.sets, session.fits, strict=True)
            if fit is not None and fit.sigma_offset_s is not None
        ]

    def chosen_table(self) -> OffsetTable | None:
        """The table of offsets that is chosen."""
        if self.source.value == REPORT:
            return read_offsets(DATA / "read-1990" / "offsets.csv")[0]
        if self.source.value == OPENED:
            return self.session.offsets
        rows = [
            (day, run, pair, offset) for (day, run), offsets in self._runs.items() for pair, offset in offsets
        ]
        if not rows:
            return None
        day, run, pair, offset = zip(*rows, strict=True)
        return OffsetTable(
            np.array(day), np.array(run), np.array(pair), np.array(offset), "this session",
            self.session.simulated,
        )  # fmt: skip

    def show_table(self) -> None:
        """Components, runs and pairs of the table chosen, off the event loop."""
        table = self.chosen_table()
        if table is None:
            self.table_words.object = "No offset with a sigma yet: <b>Fit every set</b> makes them."
            return

        def work(progress):
            return analysed(table)

        self.session.jobs.start("Variance components", work, lambda found: self._show(table, found))

    def _show(self, table: OffsetTable, found) -> None:
        for place in (self.runs, self.pairs, self.pivot):
            place.clear()
        self.pivot.show(table_by_run(table), 20)
        if isinstance(found, str):
            self.table_words.object = f"<b>{table.source}: no variance components.</b> {found}"
            return
        components, intervals, runs, pairs = found
        self.table_words.object = components_words(table, components, intervals, runs)
        self.runs.show(table_of_tests(runs, "run"), 20)
        self.pairs.show(table_of_tests(pairs.coherence, "pair"), 20)


def analysed(table: OffsetTable):
    """Components with intervals, run and pair tests of a table; or a sentence why there are none."""
    try:
        components = components_of(table)
    except ValueError as error:
        return f"{error}."
    variances = variances_of(components)
    return (
        components,
        component_intervals(table, components),
        runs_constant(table, variances),
        pair_effects(table, variances),
    )


def components_words(table: OffsetTable, components, intervals, runs: tuple[Constancy, ...]) -> str:
    """Components with their intervals and what the tests say, as HTML."""
    values = 1e6 * np.append(components.variance, components.residual)
    parts = []
    for name, value, (low, high) in zip(NAMES, values, 1e6 * intervals, strict=True):
        if name in components.not_estimable:
            parts.append(f"{name}: cannot be told, the pairs take it up")
        else:
            parts.append(f"{name} {value:.3g} ms² ({low:.2g} to {high:.2g})")
    refused = [one.name for one in runs if one.dof and one.p_value < ALONE]
    many = sum(one.dof > 0 for one in runs)
    simulated = " <b>SIMULATED.</b>" if table.simulated else ""
    told = f"<b>{table.source}, {len(table)} offsets.</b>{simulated} Variance components by REML, 95 % intervals: "
    told += "; ".join(parts) + ". "
    if refused:
        return told + f"<b>One offset is not enough for run {', '.join(refused)}</b> (p below {ALONE:g})."
    return told + f"In none of {many} runs is one offset refused (p below {ALONE:g})."


def table_of_arrays(verdict: RunVerdict) -> pd.DataFrame:
    """The agreement of all, and with each array left out, the best first."""
    return pd.DataFrame([_agreement(one) for one in (verdict.whole, verdict.drifting, *verdict.without)])


def _agreement(one: Agreement) -> dict:
    name = "none" if one.left_out is None else f"array {one.left_out}"
    drift = value_with_sigma(1e3 * one.drift_s_per_count, 1e3 * one.sigma_drift_s_per_count, "")
    return {
        "left out": name + (", drift allowed" if one.drift_s_per_count else ""),
        "offsets": one.offsets,
        "offset (ms)": value_with_sigma(1e3 * one.offset_s, 1e3 * one.sigma_offset_s, "").strip(),
        "drift (ms/count)": drift.strip() if one.drift_s_per_count else "",
        "chi-square": round(one.distance, 1),
        "dof": one.dof,
        "p": p_words(one.p_value)[2:],
    }


def table_of_tests(tests, what: str) -> pd.DataFrame:
    """Tests of runs or pairs, like Table 4."""
    return pd.DataFrame(
        [
            {
                what: one.name,
                "mean offset (ms)": value_with_sigma(1e3 * one.mean_s, 1e3 * one.sigma_mean_s, "").strip(),
                "K": one.effects,
                "distance": round(one.distance, 2),
                "dof": one.dof,
                "p, chi-square": f"{one.p_value:.2g}",
                "p, variance estimated": "-"
                if one.p_value_estimated is None
                else f"{one.p_value_estimated:.2g}",
                "distance/SD": round(one.distance_over_sd, 2),
            }
            for one in tests
        ]
    )


def table_by_run(table: OffsetTable) -> pd.DataFrame:
    """Offsets (ms) by pair, a column a run; several of one pair and run stand side by side."""
    cells: dict[str, dict[str, str]] = {}
    for name, rows in table.runs.items():
        for pair, offset in zip(table.pair[rows], table.offset_s[rows], strict=True):
            row = cells.setdefault(str(pair), {"pair": str(pair)} | dict.fromkeys(table.runs, ""))
            row[name] = f"{row[name]}, {1e3 * offset:.2f}".strip(", ")
    return pd.DataFrame(list(cells.values()))
