"""Points of a set left out by hand and put back, each with its reason; repeats chosen the other way."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import panel as pn
import panel_material_ui as pmui

from dashboards.session import Session
from dashboards.tabs.crossover_words import counted, edits_words
from dashboards.tabs.pages import button, words
from dashboards.tabs.tab import choice
from trackerlib.crossover.edits import edits_csv

OTHER = "other, typed below"
REASONS = ("wild position", "vehicle turning", "repeat of another report", "noise", OTHER)


class PointEditing:
    """Controls that leave points out and restore them.

    chosen : gives the rows of the chosen set that are selected in the pictures, and lets them go
    """

    def __init__(self, session: Session, chosen: Callable[[], np.ndarray]):
        self.session, self._chosen = session, chosen
        self.reason = choice("Reason", {reason: reason for reason in REASONS}, REASONS[0])
        self.typed = pmui.TextInput(
            label="Other reason", size="small", sizing_mode="stretch_width", margin=(5, 8), visible=False
        )
        self.reason.param.watch(lambda event: self.typed.param.update(visible=event.new == OTHER), "value")
        self.exclude_button = button("Exclude selected", self.exclude)
        self.restore_button = button("Restore selected", self.restore, margin=(4, 4))
        self.restore_all_button = button("Restore all of this set", self.restore_all)
        self.log = pmui.FileDownload(
            label="Edit log", callback=self.log_file, filename="edits.csv", size="small", margin=(6, 8)
        )
        self.list = words()
        self.repeat = pmui.Select(
            label="Array that reported twice", options={}, size="small", sizing_mode="stretch_width", margin=(5, 8)
        )  # fmt: skip
        self.other_report = button("Keep the other report", self.keep_other)

    def controls(self) -> list:
        """What stands in sight: the reason and the two buttons."""
        return [self.reason, self.typed, pn.Row(self.exclude_button, self.restore_button, margin=0)]

    def more(self) -> dict[str, list]:
        """What is folded away."""
        return {
            "Edits": [self.restore_all_button, self.log],
            "Repeated reports": [self.repeat, self.other_report],
        }

    def show(self) -> None:
        """What is left out now, and which repeats there are."""
        session = self.session
        gating = session.gating
        self.list.object = "" if gating is None else edits_words(session.edits, gating.mode)
        choices = () if gating is None else gating.choices
        self.repeat.options = {
            f"array {c.array}, count {c.point_count}: line {c.kept_line} kept": k for k, c in enumerate(choices)
        }  # fmt: skip
        self.other_report.disabled = not len(choices)

    def exclude(self) -> None:
        """Leaves out the points selected, for the reason chosen."""
        rows = self._rows()
        if len(rows):
            why = self.typed.value.strip() if self.reason.value == OTHER else self.reason.value
            session = self.session
            session.edit(edits=session.edits.exclude(session.crossover, rows, session.gating.mode, why))
            session.say(
                f"{counted(len(rows), 'is', 'are')} left out ({why or 'no reason told'}); Ctrl+Z undoes"
            )

    def restore(self) -> None:
        """Puts back those of the points selected that were left out by hand."""
        rows = self._rows()
        if len(rows):
            self._restore(rows)

    def restore_all(self) -> None:
        """Puts back every point of the set."""
        if self.session.crossover is not None:
            self._restore(range(self.session.crossover.points))

    def _restore(self, rows) -> None:
        session = self.session
        edits = session.edits.restore(session.crossover, rows, session.gating.mode)
        put_back = len(edits) - len(session.edits)
        if put_back:
            session.edit(edits=edits)
            session.say(f"{counted(put_back, 'is', 'are')} restored")
        else:
            session.say("None of these points was left out by hand")

    def _rows(self) -> np.ndarray:
        rows = self._chosen()
        if not len(rows):
            self.session.say("Select points in any picture first (box, lasso or click)")
        return rows

    def keep_other(self) -> None:
        """Keeps the other of an array's two reports at one count, in place of the one that was chosen."""
        session = self.session
        if self.repeat.value is None or session.gating is None:
            return
        chosen = session.gating.choices[self.repeat.value]
        kept = tuple(line for line in session.keep_lines if line != chosen.kept_line)
        session.edit(keep_lines=(*kept, chosen.dropped_lines[0]))
        session.say(
            f"Line {chosen.dropped_lines[0]} is kept in place of line {chosen.kept_line}; Ctrl+Z undoes"
        )

    def log_file(self) -> io.BytesIO:
        """The edit log as CSV, for the browser to save."""
        label = "# SIMULATED DATA\n" if self.session.simulated else ""
        return io.BytesIO((label + edits_csv(self.session.edits)).encode())
