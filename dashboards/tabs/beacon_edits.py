"""Pings left out by hand and put back, by their number, each with its reason."""

from __future__ import annotations

from dataclasses import replace

import panel as pn
import panel_material_ui as pmui

from dashboards.session import Session
from dashboards.tabs.beacon_words import edits_table
from dashboards.tabs.tab import choice

OTHER = "other, typed below"
REASONS = ("false return", "ship's position in doubt", "ship turning", "noise", OTHER)


class Edits:
    """Controls that leave pings out and restore them.

    chosen : gives the numbers of the pings selected in the pictures, and clears the selection
    """

    def __init__(self, session: Session, chosen):
        self.session, self._chosen = session, chosen
        self.reason = choice("Reason", {reason: reason for reason in REASONS}, REASONS[0])
        self.typed = pmui.TextInput(
            label="Other reason", size="small", sizing_mode="stretch_width", margin=(5, 8), visible=False
        )
        self.reason.param.watch(lambda event: self.typed.param.update(visible=event.new == OTHER), "value")
        small = {"size": "small", "variant": "outlined", "margin": (3, 8)}
        self.leave_out_button = pmui.Button(label="Leave out selected pings", **small)
        self.restore_button = pmui.Button(label="Restore selected", **small)
        self.restore_all_button = pmui.Button(label="Restore all", **small)
        self.leave_out_button.on_click(lambda event: self.leave_out())
        self.restore_button.on_click(lambda event: self.restore())
        self.restore_all_button.on_click(lambda event: self.restore_all())
        self.list = pn.pane.HTML(sizing_mode="stretch_width", margin=(2, 10), styles={"font-size": "13px"})

    def controls(self) -> list:
        """What stands in the folded section."""
        return [
            self.reason,
            self.typed,
            self.leave_out_button,
            pn.Row(self.restore_button, self.restore_all_button, margin=0),
            self.list,
        ]

    def show(self) -> None:
        """The pings left out by hand, with their reasons."""
        left_out = self.session.fix_settings.left_out
        self.list.object = edits_table({n: self.session.reasons.get(n, "") for n in sorted(left_out)})
        self.restore_button.disabled = self.restore_all_button.disabled = not left_out

    def leave_out(self) -> None:
        """Leaves out the pings selected, for the reason chosen."""
        numbers = self._selected()
        if numbers:
            why = self.typed.value.strip() if self.reason.value == OTHER else self.reason.value
            self._edit(self.session.fix_settings.left_out | numbers, dict.fromkeys(numbers, why))
            self.session.say(
                f"{counted(numbers)} left out by hand ({why or 'no reason told'}); Ctrl+Z undoes"
            )

    def restore(self) -> None:
        """Puts back those of the pings selected that were left out by hand."""
        numbers = self._selected() & self.session.fix_settings.left_out
        if numbers:
            self._edit(self.session.fix_settings.left_out - numbers, {})
            self.session.say(f"{counted(numbers)} restored")
        elif not self.session.failed:
            self.session.say("None of the pings selected was left out by hand")

    def restore_all(self) -> None:
        """Puts back all that were left out by hand."""
        self._edit(frozenset(), {})

    def _selected(self) -> frozenset[int]:
        numbers = self._chosen()
        if not numbers:
            self.session.say("Choose pings on the map or among the residuals first (box select or click)")
        return numbers

    def _edit(self, left_out: frozenset[int], new: dict[int, str]) -> None:
        reasons = {n: why for n, why in (self.session.reasons | new).items() if n in left_out}
        settings = replace(self.session.fix_settings, left_out=left_out)
        self.session.edit(fix_settings=settings, reasons=reasons)


def counted(numbers) -> str:
    """So many pings, or which one."""
    return f"ping {min(numbers)}" if len(numbers) == 1 else f"{len(numbers)} pings"
