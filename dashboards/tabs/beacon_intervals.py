"""95 % intervals that need no ellipse, worked out when they are asked for."""

from __future__ import annotations

import html

import panel as pn
import panel_material_ui as pmui

from dashboards.session import Session
from dashboards.tabs.tab import choice
from trackerlib.beacon.intervals import (
    Interval,
    bootstrap_intervals,
    interval_words,
    profile_intervals,
)
from trackerlib.beacon.result import BeaconFix
from trackerlib.rounding import rounded
from trackerlib.textfiles import InputError

WAYS = {"profile likelihood": profile_intervals, "resampled residuals": bootstrap_intervals}
CELL = "style='opacity:.75;padding:1px 8px 1px 0'"


class IntervalControls:
    """The way to work them out, the button, and the words that stand beside the ellipse's numbers."""

    def __init__(self, session: Session):
        self.session = session
        self.way = choice("By", {name: name for name in WAYS}, next(iter(WAYS)))
        self.button = pmui.Button(
            label="95 % intervals", size="small", variant="outlined", margin=(6, 8),
            description="Follow the misfit as it is, bent or lopsided, where the ellipse takes it for a parabola",
        )  # fmt: skip
        self.button.on_click(lambda event: self.compute())
        self.words = pn.pane.HTML(
            sizing_mode="stretch_width", margin=(0, 10), styles={"font-size": "13px"}, visible=False
        )
        self._found: tuple[BeaconFix, dict[str, Interval]] | None = None

    @property
    def found(self) -> dict[str, Interval] | None:
        """Those of the fix in sight; None where there are none."""
        return self._found[1] if self._found is not None and self._found[0] is self.session.fix else None

    def clear(self) -> None:
        """Takes them away: they were of another fix."""
        self._found, self.words.visible = None, False

    def compute(self) -> None:
        """Works them out, off the event loop."""
        session, way = self.session, self.way.value
        fix, settings = session.fix, session.fix_settings
        if fix is None or not fix.converged:
            session.say("Intervals are about a fix, and there is none yet")
            return
        heard = session.pings.only(slice(0, len(fix.number)))

        def work(progress):
            try:
                found = WAYS[way](heard, fix, settings, progress=progress)
                return found, interval_words(fix, found)
            except ValueError as error:
                raise InputError(f"No interval: {error}") from None

        def done(found) -> None:
            if session.fix is fix:
                self._found = fix, found[0]
                self.words.param.update(object=words(fix, way, *found), visible=True)

        session.jobs.start("Intervals", work, done, long=True)


def words(fix: BeaconFix, way: str, intervals: dict[str, Interval], warning: str | None) -> str:
    """Each interval beside what the ellipse says, as HTML."""
    rows = "".join(
        f"<tr><td {CELL}>{name}</td><td style='padding-right:10px'>{interval}</td>"
        f"<td>± {rounded(1.96 * sigma)} m</td></tr>"
        for (name, interval), sigma in zip(intervals.items(), fix.sigma, strict=True)
    )
    when = "" if fix.velocity is None else ", at the first ping"
    note = "" if warning is None else f"<p style='margin:4px 0'><b>Note:</b> {html.escape(warning)}.</p>"
    head = "".join(f"<td {CELL}>{title}</td>" for title in (f"95 %{when}", f"by {way}", "by the ellipse"))
    return f"<table><tr>{head}</tr>{rows}</table>{note}"
