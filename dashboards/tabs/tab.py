"""The frame of one tab: what you can turn, one large picture, the answer.

A tab is a subclass of `Tab`:

    class TimingTab(Tab):
        title = "Timing"                      # exactly what stands on the tab
        watches = ("crossover", "profile")    # parameters of the session that change the picture

        def controls(self): ...   # widgets at the left, at most nine
        def more(self): ...       # further widgets, folded
        def picture(self): ...    # the large picture
        def strips(self): ...     # one or two figures below it that share its axis or selection
        def answer(self): ...     # the sentence, the numbers, tables
        def refresh(self, changed): ...   # redraw what depends on the session's `changed` names
        def export(self): ...     # (file name, text) for the Export menu
        def tick(self, seconds): ...      # what goes on by itself, in sight or not
        def close(self): ...      # the page is gone: threads and ports end

`refresh` is called only while the tab is in sight: a hidden tab is marked stale and refreshed when
it is shown. An exception there or in a widget's callback is shown in words by the page; raise
InputError for what the analyst can mend. Work of more than 100 ms goes through
`self.session.jobs.start(purpose, work, done)`; edits that Undo should take back through
`self.session.edit(name=value)`. Never watch an object that outlives the session.

Served alone: a tab's file ends with `alone(__name__, "dashboards.tabs.timing:TimingTab")`. In a notebook
`TimingTab()` shows itself.
"""

from __future__ import annotations

import logging

import pandas as pd
import panel as pn
import panel_material_ui as pmui
import param
from panel.viewable import Viewer
from panel_splitjs import Split

from dashboards.session import Session

log = logging.getLogger("workbench")

# Stylesheet of a small table.
TABLE = """
:host .tabulator { font-size: 12px; }
.tabulator-cell, .tabulator-col { padding: 2px 4px !important; }
.tabulator-row, .tabulator-row .tabulator-cell { min-height: 22px !important; height: auto !important; }
.tabulator-col .tabulator-col-title { white-space: normal !important; padding-right: 12px !important; }
.tabulator-col .tabulator-col-content { padding: 2px !important; }
.tabulator-col .tabulator-col-sorter { right: 0 !important; }
"""
# An accordion's title as small as the controls above it.
FOLDED = {
    "& .MuiAccordionSummary-root": {"minHeight": "30px", "padding": "0 8px"},
    "& .MuiAccordionSummary-content": {"margin": "4px 0"},
    "& .MuiAccordionSummary-content *": {"fontSize": "13px", "fontWeight": 500},
    "& .MuiAccordionDetails-root": {"padding": "0"},
}


class Tab(Viewer):
    """Base of every tab; see the module."""

    session = param.ClassSelector(class_=Session, constant=True)
    active = param.Boolean(default=False, doc="in sight")

    title = ""
    watches: tuple[str, ...] = ()

    def __init__(self, session: Session | None = None, **params):
        super().__init__(session=session or Session(), **params)
        self._stale: set[str] = set(self.watches)
        self._layout = None
        if self.watches:
            self.session.param.watch(self._session_changed, list(self.watches))

    # -- what a subclass says ------------------------------------------------------------------

    def controls(self) -> list:
        """Widgets at the left, at most nine."""
        return []

    def more(self) -> list | dict[str, list]:
        """Further widgets, folded away; as a dict, in sections with these titles."""
        return []

    def picture(self):
        """The large picture."""
        return pn.Spacer()

    def strips(self) -> list:
        """Figures below the picture."""
        return []

    def answer(self):
        """What stands at the right."""
        return pn.Spacer()

    def refresh(self, changed: set[str]) -> None:
        """Redraws what depends on these parameters of the session."""

    def export(self) -> tuple[str, str] | None:
        """A file for the Export menu, or None while there is nothing to export."""
        return None

    def play_or_pause(self) -> None:
        """What the space bar does."""
        self.session.play()

    def tick(self, seconds: float) -> None:
        """Goes on by some seconds of real time, in sight or not."""

    def close(self) -> None:
        """Ends what the tab has running; its page is gone."""

    # -- in sight or not -----------------------------------------------------------------------

    def activate(self) -> None:
        """Brings the tab up to date and keeps it so."""
        self.active = True
        self._catch_up()

    def deactivate(self) -> None:
        """Stops redrawing until the tab is shown again."""
        self.active = False

    def _session_changed(self, *events) -> None:
        self._stale |= {event.name for event in events}
        if self.active:
            self._catch_up()

    def _catch_up(self) -> None:
        if self._layout is None:
            self._layout = self._build()
        changed, self._stale = self._stale, set()
        if changed:
            try:
                with pn.io.hold():
                    self.refresh(changed)
            except Exception as error:
                self.session.report(error)

    # -- layout --------------------------------------------------------------------------------

    def _build(self):
        left = [*self.controls()]
        if folded := self.more():
            left.append(_sections(folded if isinstance(folded, dict) else {"More": folded}))
        controls = pn.Column(
            *left,
            scroll="y",
            sizing_mode="stretch_both",
            min_height=0,
            margin=(8, 0, 0, 0),  # the label of the first control stands on its frame
            css_classes=["controls"],
        )
        middle = self.picture()
        if strips := self.strips():
            below = Split(*strips, sizing_mode="stretch_both") if len(strips) == 2 else strips[0]
            middle = Split(middle, below, orientation="vertical", sizes=(66, 34), sizing_mode="stretch_both")
        answer = pn.Column(self.answer(), scroll="y", sizing_mode="stretch_both", min_height=0, margin=0)
        inner = Split(middle, answer, sizes=(74, 26), min_size=(240, 180), sizing_mode="stretch_both")
        return Split(controls, inner, sizes=(19, 81), min_size=(200, 400), sizing_mode="stretch_both")

    def __panel__(self):
        if not self.active:
            self.activate()
        return self._layout


def _sections(folded: dict[str, list]):
    """Folded sections by title; the widgets of one come into the page when it is first opened."""
    places = [pn.Column(margin=0) for _ in folded]
    sections = pmui.Accordion(
        *zip(folded, places, strict=True), margin=(4, 0), sizing_mode="stretch_width", sx=FOLDED
    )

    def fill(event) -> None:
        for k, (place, widgets) in enumerate(zip(places, folded.values(), strict=True)):
            if k in event.new and not len(place):
                place.extend(widgets)

    sections.param.watch(fill, "active")
    return sections


def drawn(figure, **options):
    """A figure that fills its place."""
    return pn.pane.Bokeh(figure, **({"sizing_mode": "stretch_both", "margin": 0} | options))


def number(label: str, value, tip: str, **options):
    """A typed number with its unit in the label and a tooltip; arrows nudge."""
    kind = pmui.IntInput if isinstance(value, int) and not isinstance(value, bool) else pmui.FloatInput
    return kind(
        label=label,
        value=value,
        description=tip,
        size="small",
        sizing_mode="stretch_width",
        margin=(5, 8),
        **options,
    )


def choice(label: str, names: dict, value):
    """A drop-down list of words for values."""
    return pmui.Select(
        label=label, options=names, value=value, size="small", sizing_mode="stretch_width", margin=(5, 8)
    )


class TypedSlider(pmui.EditableFloatSlider):
    """A slider whose number can also be typed; every step of a drag is painted."""

    value = param.Number(default=0.0, allow_None=True, doc="None for a moment where the box was emptied")

    def __init__(self, label: str, limit: float, step: float, **options):
        super().__init__(
            label=label, start=-limit, end=limit, step=step, size="small", sizing_mode="stretch_width",
            margin=(2, 12), **options,
        )  # fmt: skip
        self._debounce = 1  # ms that Panel waits for further changes, 50 unless told
        self.param.watch(self._keep, "value")

    def _keep(self, event) -> None:
        if event.new is None:
            self.value = event.old


class Results(pn.Column):
    """Place of a small table, empty until `show` puts one there."""

    def __init__(self):
        super().__init__(margin=0, sizing_mode="stretch_width")

    def show(self, frame: pd.DataFrame, page_size: int, *, sortable: bool = True, **options) -> None:
        """Puts a new table in the place of the last one; options are the Tabulator's.

        Always a new one: a page that is still building a Tabulator fails on a change of its columns.
        """
        self.objects = [
            pn.widgets.Tabulator(
                frame, disabled=True, show_index=False, pagination="local", page_size=page_size,
                sizing_mode="stretch_width", theme="simple", layout="fit_columns", margin=(6, 8),
                stylesheets=[TABLE], configuration={"columnDefaults": {"headerSort": sortable}}, **options,
            )
        ]  # fmt: skip

    @property
    def frame(self) -> pd.DataFrame | None:
        """What the table shows; None while there is none."""
        return self[0].value if len(self) else None


def heading(text: str):
    """A small heading among controls."""
    return pmui.Typography(text, variant="overline", margin=(6, 8, 0, 8))


def alone(name: str, tab: str) -> None:
    """Serves a tab by itself when its file is given to `panel serve`; does nothing when it is imported.

    name : the file's __name__
    tab : where the class is imported from, such as "dashboards.tabs.timing:TimingTab"
    """
    if name.startswith("bokeh_app"):
        from dashboards.frame import serve_page

        serve_page([tab])
