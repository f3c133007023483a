"""What could part the tracks besides the clock: every cause and every two, compared on a set or on all of a run."""

from __future__ import annotations

import pandas as pd
import panel as pn

from dashboards.session import Session
from dashboards.tabs.pages import button, words
from dashboards.tabs.tab import Results, choice
from dashboards.tabs.timing_words import parameters_words, ranking_sentence
from trackerlib.textfiles import InputError
from trackerlib.timing.causes import Ranking, compare_causes

ALL, ONE = "all sets of the run together", "the chosen set alone"
LISTED = 40


class CausesPage:
    """A ranking by AICc and by sets held out, with what the geometry cannot separate."""

    def __init__(self, session: Session):
        self.session = session
        self.scope = choice("Compare on", {ALL: ALL, ONE: ONE}, ALL)
        self.scope.param.watch(lambda event: self.compare(), "value")
        self.button = button("Compare causes", self.compare)
        self.words = words("14px")
        self.table = Results()
        self._stale = True
        self.ranking: Ranking | None = None
        self.pane = pn.Column(
            pn.Row(pn.Column(self.scope, width=300, margin=0), self.button, margin=0),
            self.words,
            self.table,
            sizing_mode="stretch_both",
            scroll="y",
            margin=0,
        )

    def forget(self) -> None:
        """Other data are open: what is shown holds no longer."""
        self._stale = True

    def show(self) -> None:
        """Compares the causes, if that was not done for the data in sight."""
        if self._stale:
            self.compare()

    def compare(self) -> None:
        """Compares the causes off the event loop."""
        session = self.session
        if session.crossover is None or session.survey is None or session.profile is None:
            self.words.object = "Sets, their arrays and a sound-speed profile are wanted first."
            return
        one = self.scope.value == ONE
        kept = session.edits.kept(session.crossover, session.gating.mode)
        sets, survey, profile = ((kept,) if one else session.kept_sets), session.survey, session.profile
        pair = "arrays {} and {}".format(*session.crossover.pair)
        scope = f"the set of {pair}" if one else f"the {len(sets)} sets of the run"
        self._stale = False
        self.table.clear()
        self.words.object = "Comparing causes …"

        def work(progress):
            try:
                usable = [s for s in sets if s.points]
                return compare_causes(usable, survey, profile, progress=progress)
            except (InputError, ValueError) as error:
                return str(error)

        session.jobs.start("Compare causes", work, lambda found: self._show(found, scope))

    def _show(self, found: Ranking | str, scope: str) -> None:
        if isinstance(found, str):
            self.ranking, self.words.object = None, f"<b>Causes cannot be compared:</b> {found}."
            return
        self.ranking = found
        self.words.object = ranking_sentence(found, scope)
        self.table.show(
            table_of_causes(found), 15, widths={"cause": "27%", "AICc above best": "10%", "estimate": "43%"},
            formatters={"cause": {"type": "textarea"}, "estimate": {"type": "textarea"}},
        )  # fmt: skip


def table_of_causes(ranking: Ranking) -> pd.DataFrame:
    """The best causes, a row each."""
    return pd.DataFrame(
        [
            {
                "cause": fit.name,
                "AICc above best": round(fit.aicc, 1),
                "chi² per number": round(fit.chi_square / fit.count, 3),
                "held out": None if fit.held_out is None else round(fit.held_out, 3),
                "estimate": parameters_words(fit),
            }
            for fit in ranking.leading(LISTED)
        ]
    )
