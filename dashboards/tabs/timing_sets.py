"""Every set's offset in a table like Table 1 of Read (1990), by pair like Table 2, and against t0 like Figure 4."""

from __future__ import annotations

import pandas as pd
import panel as pn
from bokeh.models.widgets.tables import NumberFormatter

from dashboards.pictures.offset_views import OffsetsByTime
from dashboards.session import Session, same_set
from dashboards.tabs.pages import above, fill
from dashboards.tabs.tab import TABLE, Results
from dashboards.tabs.timing_words import run_sentence
from trackerlib.rounding import value_with_sigma
from trackerlib.timing.correction import TimingCorrection
from trackerlib.timing.one_run import RunVerdict, judge_run

COLUMNS = {
    "pair": str, "pass": int, "T": int, "offset (ms)": float, "± (ms)": float, "drift (ms/ count)": float,
    "± drift": float, "corr.": float, "t0": float, "before (ft)": float, "after (ft)": float, "remarks": str,
}  # fmt: skip
DIGITS = {
    **dict.fromkeys(("offset (ms)", "± (ms)"), "0.000"),
    **dict.fromkeys(("drift (ms/ count)", "± drift"), "0.0000"),
    **dict.fromkeys(("t0", "before (ft)", "after (ft)"), "0.0"),
    "corr.": "0.00",
}


def _formats() -> dict:
    """How the columns are written: made for each table, since a table that is gone lives on in what it shares."""
    return {name: NumberFormatter(format=digits) for name, digits in DIGITS.items()} | {
        "remarks": {"type": "textarea"}
    }


class SetsTable(pn.widgets.Tabulator):
    """A table that the page alone sorts.

    Panel 1.9.4 sorts its copy of the rows too, but not those that the page has; what is then selected is another row.
    """

    def _sort_df(self, df: pd.DataFrame) -> pd.DataFrame:
        return df


class SetsPage:
    """The table, the pivot and the picture, linked: what is chosen in one is the set everywhere."""

    def __init__(self, session: Session):
        self.session = session
        self.by_time = OffsetsByTime()
        self.by_time.source.selected.on_change("indices", lambda attr, old, new: self._clicked(new))
        self.verdict: RunVerdict | None = None
        self.table = SetsTable(
            table_of_sets((), ()), show_index=False, disabled=True, sizing_mode="stretch_both", theme="simple",
            layout="fit_columns", stylesheets=[TABLE], margin=(4, 4), min_height=60, formatters=_formats(),
            selectable=1,
        )  # fmt: skip
        # Not on_click: once the page has sorted the rows, it tells of no click any more.
        self.table.param.watch(lambda event: self._selected(event.new), "selection")
        self.pivot = Results()
        by_pair = pn.Column(self.pivot, scroll="y", sizing_mode="stretch_both", margin=0)
        self.pane = above(self.table, by_pair, fill(self.by_time.figure), sizes=(52, 48))

    def show(self) -> str:
        """Shows the fits; what they say of the run, as HTML."""
        session = self.session
        sets, fits = (session.gating.sets if session.gating is not None else ()), session.fits
        if not fits or len(fits) != len(sets):
            self.verdict = None
            return ""
        try:
            self.verdict = judge_run(sets, fits)
            told = run_sentence(self.verdict)
        except ValueError as error:
            self.verdict, told = None, f"The run cannot be judged: {error}."
        serves = None if self.verdict is None else self.verdict.simplest
        self.by_time.show(sets, fits, serves)
        self.table.value = table_of_sets(sets, fits)
        self.pivot.show(table_of_pairs(sets, fits), 100)
        self.choose()
        return told

    def choose(self) -> None:
        """Marks the session's set in table and picture."""
        sets = self.session.gating.sets if self.session.gating is not None else ()
        row = next((k for k, one in enumerate(sets) if same_set(one, self.session.crossover)), None)
        self.by_time.choose(row)
        shown = list(self.table.value.index)
        self.table.selection = [shown.index(row)] if row in shown else []

    def _clicked(self, rows: list[int]) -> None:
        if rows:
            self._choose(int(self.by_time.source.data["row"][rows[0]]))
            self.by_time.source.selected.indices = []

    def _selected(self, places: list[int]) -> None:
        if places:
            self._choose(int(self.table.value.index[places[0]]))

    def _choose(self, row: int) -> None:
        chosen = self.session.gating.sets[row]
        if not same_set(chosen, self.session.crossover):
            self.session.param.update(correction=None, crossover=chosen)


def table_of_sets(sets, fits) -> pd.DataFrame:
    """A row for each set that has a fit, its index the set's place."""
    rows = {k: _row(one, fit) for k, (one, fit) in enumerate(zip(sets, fits, strict=True)) if fit is not None}
    columns = list(zip(*rows.values(), strict=True)) or [()] * len(COLUMNS)
    typed = {
        name: pd.Series(column, index=list(rows), dtype=kind)
        for (name, kind), column in zip(COLUMNS.items(), columns, strict=True)
    }
    return pd.DataFrame(typed)


def _row(one, fit: TimingCorrection) -> list:
    def rounded(value, digits, factor=1.0):
        return None if value is None else round(factor * value, digits)

    return [
        "{}-{}".format(*one.pair),
        one.pass_number,
        fit.points,
        rounded(fit.offset_s, 3, 1e3),
        rounded(fit.sigma_offset_s, 3, 1e3),
        rounded(fit.drift_s_per_count, 4, 1e3) if fit.points > 1 else None,
        rounded(fit.sigma_drift_s_per_count, 4, 1e3),
        rounded(fit.correlation, 2),
        round(fit.t0, 1),
        round(fit.rms_before, 1),
        round(fit.rms_after, 1),
        f"apart {', '.join(fit.separated)}" if fit.separated else fit.reason or "",
    ]


def table_of_pairs(sets, fits) -> pd.DataFrame:
    """Offsets (ms) with their sigmas by pair, a column a pass."""
    passes = sorted({one.pass_number for one in sets})
    rows: dict[str, dict] = {}
    for one, fit in zip(sets, fits, strict=True):
        name = "{}-{}".format(*one.pair)
        cells = rows.setdefault(name, {"pair": name} | {f"pass {k} (ms)": "" for k in passes})
        if fit is not None and fit.points:
            cells[f"pass {one.pass_number} (ms)"] = (
                f"{1e3 * fit.offset_s:.3f}"
                if fit.sigma_offset_s is None
                else value_with_sigma(1e3 * fit.offset_s, 1e3 * fit.sigma_offset_s, "").strip()
            )
    return pd.DataFrame(list(rows.values()))
