"""What opens files in the page: a dialog to drop them in or type their path; choices among what they hold."""

from __future__ import annotations

import html
from collections.abc import Callable

import panel as pn
import panel_material_ui as pmui

from dashboards.opening import UPLOAD_LIMIT_MB
from dashboards.session import Session
from trackerlib.textfiles import InputError

WORDS = f"""
Drop files here or choose them; at most {UPLOAD_LIMIT_MB} MB each. They stay on this machine.

Survey logs (SIO, WHOI), pings (`lat_deg, lon_deg, oneway_s`), arrivals (`arrival_s`) with a ship's positions beside
them, or a profile (`depth_m, speed_mps`) as CSV, T-files, array tables, VELOCITY.DAT, crossover files, OFFSETS.csv,
logs of edited points, session files; recordings (WAV, RF64, FLAC), a ship's positions (NMEA 0183, or CSV with `utc`
or `time_s, lat_deg, lon_deg`), and stored receiver sessions for the chart.
"""
PATH_WORDS = """
Or type the path of a file on the machine that this program runs on: one of any size, or a **campaign** (JSON or TOML),
whose days, runs and vehicles can then be chosen in the page's head.
"""

TROUBLE = {
    "border-left": "4px solid #C62828",
    "padding-left": "8px",
    "font-weight": "600",
}  # read in the dark too


class OpenDialog:
    """The dialog; `pane` goes into the page."""

    def __init__(self, session: Session):
        self.session = session
        self.dropper = pn.widgets.FileDropper(
            multiple=True,
            chunk_size=5_000_000,
            max_file_size=f"{UPLOAD_LIMIT_MB}MB",
            height=120,
            sizing_mode="stretch_width",
        )
        self.dropper.param.watch(lambda event: self._dropped(event.new or {}), "value")
        self.path = pmui.TextInput(
            label="Path of a file or campaign", size="small", sizing_mode="stretch_width", margin=(5, 8)
        )
        self.path.param.watch(lambda event: self._typed(), "enter_pressed")
        button = pmui.Button(label="Open", size="small", variant="outlined", margin=(12, 8))
        button.on_click(lambda event: self._typed())
        # The status line lies in the dialog's shade, so what went wrong is told here too.
        self.trouble = pn.pane.HTML(visible=False, sizing_mode="stretch_width", styles=TROUBLE, margin=(4, 8))
        self.pane = pmui.Dialog(
            pn.pane.Markdown(WORDS),
            self.dropper,
            pn.pane.Markdown(PATH_WORDS),
            pn.Row(self.path, button, sizing_mode="stretch_width", margin=0),
            self.trouble,
            title="Open",
            width_option="sm",
            show_close_button=True,
            close_on_click=True,  # beside it; Escape too
        )

    def show(self) -> None:
        """Brings the dialog in sight."""
        self.trouble.visible = False
        self.pane.open = True

    def _dropped(self, files: dict) -> None:
        for name, content in files.items():
            content = content if isinstance(content, bytes) else content.encode()
            self._try(lambda name=name, content=content: self.session.open_file(name, content))
        if files:
            self.dropper.value = {}

    def _typed(self) -> None:
        if self.path.value_input.strip():
            self._try(lambda: self.session.open_path(self.path.value_input))

    def _try(self, opened: Callable[[], None]) -> None:
        """Opens and closes the dialog, or says why not and leaves it."""
        try:
            opened()
            self.pane.open = False
        except Exception as error:
            self.session.report(error)
            self.trouble.param.update(object=html.escape(self.session.message), visible=True)


class HeadChoice:
    """A list in the page's head of what an open file holds, one for all tabs; hidden while there is none."""

    watched: tuple[str, ...]  # parameters of the session
    width: int

    def __init__(self, session: Session):
        self.session = session
        self._quiet = False
        self.pane = pmui.Select(options={}, size="small", width=self.width, margin=(2, 8), visible=False)
        self.pane.param.watch(lambda event: self._choose(event.new), "value")
        session.param.watch(lambda *events: self.show(), [*self.watched])

    def held(self) -> tuple[dict, object]:
        """What can be chosen by the words for it, and what is chosen."""
        raise NotImplementedError

    def choose(self, value) -> None:
        """Opens another; raises InputError where it is no use."""
        raise NotImplementedError

    def show(self) -> None:
        """Lists what is held, the one in sight chosen."""
        options, chosen = self.held()
        self._quiet = True
        self.pane.param.update(options=options, value=chosen, visible=bool(options))
        self._quiet = False

    def _choose(self, value) -> None:
        if self._quiet or value is None:
            return
        try:
            self.choose(value)
        except InputError as error:
            self.session.report(error)
            self.show()


class RunChoice(HeadChoice):
    """Day, run and vehicle of a campaign."""

    watched = ("campaign", "campaign_run")
    width = 320

    def held(self):
        campaign, chosen = self.session.campaign, self.session.campaign_run
        runs = () if campaign is None else campaign.runs
        return {str(one): k for k, one in enumerate(runs)}, runs.index(chosen) if chosen in runs else None

    def choose(self, value: int) -> None:
        self.session.open_run(self.session.campaign.runs[value])


class TransponderChoice(HeadChoice):
    """Which transponder of a survey of several is fixed."""

    watched = ("transponders", "transponder")
    width = 120

    def held(self):
        return {name: name for name in self.session.transponders}, self.session.transponder or None

    def choose(self, value: str) -> None:
        self.session.open_transponder(value)
