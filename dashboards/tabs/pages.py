"""Several pictures in one place, one of them in sight."""

from __future__ import annotations

from collections.abc import Callable

import panel as pn
import panel_material_ui as pmui
from panel_splitjs import Split


class Pages(pn.Column):
    """A row of names and the picture of the name chosen.

    A picture comes into the page when it is first shown, so that none waits for those nobody looks at; later
    it is hidden, not taken out: what is drawn meanwhile must find its figure.
    """

    def __init__(self, pages: dict, beside: tuple = ()):
        self.choice = pmui.RadioButtonGroup(
            options=list(pages), value=next(iter(pages)), size="small", margin=(2, 8), button_type="primary"
        )
        self._pictures, self._told = pages, []
        # In a column each: a bare figure, once shown, would not hide again.
        self.pages = {name: pn.Column(sizing_mode="stretch_both", margin=0) for name in pages}
        super().__init__(
            pn.Row(self.choice, *beside, margin=0), *self.pages.values(), sizing_mode="stretch_both", margin=0
        )
        self.choice.param.watch(lambda event: self._show(), "value")
        self._show()

    @property
    def shown(self) -> str:
        """Name of the picture in sight."""
        return self.choice.value

    def on_show(self, told: Callable[[], None]) -> None:
        """Calls back whenever another picture comes in sight, before it does."""
        self._told.append(told)

    def _show(self) -> None:
        for told in self._told:  # first: a table that the page is building misses what changes meanwhile
            told()
        for name, page in self.pages.items():
            page.visible = name == self.choice.value
            if page.visible and not len(page):
                page.append(self._pictures[name])


def fill(figure):
    """A figure that fills its pane."""
    return pn.pane.Bokeh(figure, sizing_mode="stretch_both", margin=0)


def above(upper, *lower, sizes: tuple[int, int] = (62, 38)):
    """A picture above one or more that stand side by side, with borders that can be dragged."""
    below = lower[0] if len(lower) == 1 else Split(*lower, sizing_mode="stretch_both")
    return Split(upper, below, orientation="vertical", sizes=sizes, sizing_mode="stretch_both")


def words(size: str = "13px"):
    """A place for sentences and tables."""
    return pn.pane.HTML(sizing_mode="stretch_width", margin=(6, 10), styles={"font-size": size})


def button(label: str, act: Callable[[], None], **options):
    """A small button that does one thing."""
    made = pmui.Button(label=label, size="small", **{"variant": "outlined", "margin": (4, 4, 4, 8)} | options)
    made.on_click(lambda event: act())
    return made
