"""The page: menu, tabs, status line, keys. Builds it for one browser session."""

from __future__ import annotations

import html
import logging
from datetime import date
from importlib import import_module

import panel as pn
import panel_material_ui as pmui

from dashboards import garbage, guard, in_order
from dashboards.keys import Keys
from dashboards.open_dialog import OpenDialog, RunChoice, TransponderChoice
from dashboards.session import Session
from dashboards.tabs.tab import Tab
from trackerlib import __version__
from trackerlib.compiled import warm_in_background
from trackerlib.textfiles import InputError

log = logging.getLogger("workbench")

NAME = "Tracker workbench"
TABS = (
    "dashboards.tabs.chart:ChartTab",
    "dashboards.tabs.crossover:CrossoverTab",
    "dashboards.tabs.timing:TimingTab",
    "dashboards.tabs.beacon:BeaconTab",
    "dashboards.tabs.montecarlo:MonteCarloTab",
)
TICK_MS = 200


def _theme(primary: str, bar: str) -> dict:
    return {
        "palette": {"primary": {"main": primary}},
        "typography": {"fontSize": 12.5, "button": {"textTransform": "none"}},
        "components": {
            "MuiAppBar": {
                "styleOverrides": {"root": {"backgroundColor": f"{bar} !important", "color": "white"}}
            },
            "MuiTab": {
                "styleOverrides": {"root": {"textTransform": "none", "minHeight": 34, "padding": "4px 14px"}}
            },
            "MuiTabs": {"styleOverrides": {"root": {"minHeight": 34}}},
            "MuiToolbar": {
                "styleOverrides": {"root": {"minHeight": "40px !important", "padding": "0 12px !important"}}
            },
        },
    }


# Small text, low header; a brighter primary colour where the ground is dark.
THEME = {"light": _theme("#0B5E8A", bar="#0B5E8A"), "dark": _theme("#5BB4E0", bar="#0B3A55")}
DENSE = """
.controls { font-size: 13px; }
#header, .header { min-height: 40px !important; height: 40px !important; }
body { overflow: hidden; }
"""

HELP = """
**Open** reads a survey log (SIO, WHOI), pings or a sound-speed profile as CSV, a T-file, an array table, a
VELOCITY.DAT, crossover files, a table of timing offsets, a log of edited points, a session file, a recording of sound
(WAV, RF64, FLAC) or a stored receiver session; which it is, is seen from the file. A campaign file is opened by its
path: its days, runs and vehicles then stand in the page's head, one choice for all tabs.

Keys: **space** plays and pauses the replay, **Ctrl+S** saves the session, **Ctrl+Z** and **Ctrl+Shift+Z** undo
and redo, **Ctrl+O** opens. Arrow keys nudge a number; double click on a slider's name puts its default back.
The panes' borders can be dragged; *View* sets them by keyboard. Figures: wheel zooms, *box select* marks points
on every view, *reset* shows everything again; a click on a legend entry hides it.

Everything runs on this machine; nothing is fetched from anywhere else.
"""


def extension() -> None:
    """Readies Panel for a page: once for each session."""
    pn.extension(
        "tabulator",
        "filedropper",
        "terminal",
        raw_css=[DENSE],
        notifications=True,
        reconnect=False,
        disconnect_notification="The server has gone away. Your last picture stays; reload the page to go on.",
        exception_handler=_unexpected,
    )


def _unexpected(error: Exception) -> None:
    """Any exception of a callback, in words; it never ends the session."""
    session = pn.state.cache.get(_session_key())
    if session is not None:
        session.report(error)
    else:
        log.error("unexpected", exc_info=error)
        if pn.state.notifications is not None:
            pn.state.notifications.error(html.escape(str(error)), duration=0)


def _session_key() -> str:
    document = pn.state.curdoc
    return f"session-{id(document)}"


def _forget(document) -> None:
    """Lets go of the notification area of a closed page, which Panel 1.9.4 would keep for ever."""
    for ref, view in list(pn.state._views.items()):
        if view[2] is document:
            del pn.state._views[ref]


def _without_busy_light(page):
    """The page, no longer following Panel's own busy state: that sends messages at every event and is never undone."""
    for watcher in list(pn.state.param.watchers.get("busy", {}).get("value", ())):
        if getattr(getattr(watcher.fn, "__self__", None), "self", None) is page:
            pn.state.param.unwatch(watcher)
    return page


def serve_page(tabs=TABS) -> None:
    """Builds the page and makes it what is served, or serves the reason why it cannot be built, in words."""
    guard.install()
    in_order.install()
    warm_in_background()  # started before the first page, so that its first fit finds its kernels
    try:
        extension()
        garbage.collect_between_pages()
        garbage.watch(pn.state.curdoc)
        page = Workbench(tabs).page()
    except Exception as error:
        log.error("the page could not be built", exc_info=error)
        page = pn.Column(
            pn.pane.Alert(
                f"**{NAME} could not start.**\n\n{type(error).__name__}: {html.escape(str(error))}\n\n"
                "The terminal in which it was started shows the details.",
                alert_type="danger",
            )
        )
    page.servable(title=NAME)


def _place():
    """Where a tab will stand, with a word that it is coming."""
    word = pn.pane.HTML("<span style='opacity:.6'>Drawing…</span>", margin=(12, 14))
    return pn.Column(word, sizing_mode="stretch_both", margin=0)


class Workbench:
    """One browser session's page."""

    def __init__(self, tabs=TABS, session: Session | None = None):
        self.session = session or Session()
        self._kinds = [self._kind(one) for one in tabs]
        self._made: dict[int, Tab] = {}  # those shown so far, by their place
        self._shown = None
        self._tabs = pmui.Tabs(
            *((kind.title, _place()) for kind in self._kinds),
            sizing_mode="stretch_both",
            dynamic=False,
            margin=0,
        )
        self._tabs.param.watch(self._show, "active")
        self._dialog = OpenDialog(self.session)
        self._keys = Keys(
            {
                "ctrl+s": self._save,
                "ctrl+o": self._dialog.show,
                "ctrl+z": self.session.undo,
                "ctrl+y": self.session.redo,
                "ctrl+shift+z": self.session.redo,
                "space": lambda: self.tab.play_or_pause(),
            },
            typing=("ctrl+s", "ctrl+o"),
        )
        self._help = pmui.Dialog(
            pn.pane.Markdown(HELP + f"\n\nVersion {__version__}"),
            title=NAME,
            width_option="md",
            show_close_button=True,
            close_on_click=True,  # beside it; Escape too
        )

    @property
    def tab(self) -> Tab:
        """The tab in sight, made on its first showing."""
        place = self._tabs.active
        if place not in self._made:
            self._made[place] = self._kinds[place](session=self.session)
        return self._made[place]

    @staticmethod
    def _kind(one) -> type[Tab]:
        if not isinstance(one, str):
            return one
        module, name = one.split(":")
        return getattr(import_module(module), name)

    # -- parts ---------------------------------------------------------------------------------

    def page(self):
        """The whole page, with its demo data open and its first tab drawn."""
        self._join_document()
        main = pn.Column(
            pn.Row(
                self._menu(),
                RunChoice(self.session).pane,
                TransponderChoice(self.session).pane,
                pn.HSpacer(),
                self._badge(),
                sizing_mode="stretch_width",
                margin=0,
                height=38,
            ),
            self._tabs,
            self._status(),
            self._keys,
            self._dialog.pane,
            self._help,
            sizing_mode="stretch_both",
            margin=0,
        )
        page = _without_busy_light(
            pmui.Page(title=NAME, main=[main], theme_config=THEME, busy_indicator=None)
        )
        self._open_demos()
        self._show()
        return page

    def _join_document(self) -> None:
        document = pn.state.curdoc
        if document is None or document.session_context is None:
            return
        key = _session_key()
        pn.state.cache[key] = self.session
        self.session.jobs.document = document

        def ended(context) -> None:
            pn.state.cache.pop(key, None)
            self.session.jobs.cancel()
            for tab in list(self._made.values()):
                tab.close()
            self.session.close()
            _forget(document)

        document.on_session_destroyed(ended)
        document.add_periodic_callback(self._tick, TICK_MS)
        if pn.state.location is not None:
            pn.state.location.sync(self._tabs, {"active": "tab"})

    def _tick(self) -> None:
        try:
            for tab in list(self._made.values()):
                tab.tick(TICK_MS / 1e3)
            self.session.tick(TICK_MS / 1e3)
        except Exception as error:
            self.session.param.update(playing=False)
            self.session.report(error)

    def _open_demos(self) -> None:
        try:
            self.session.open_range_demo()
            self.session.open_beacon_demo()
            self.session.say("Simulated data that come with the program are open. Open… reads yours.")
        except InputError as error:
            self.session.report(error)

    def _menu(self):
        sizes = {"Narrow controls": 14, "Usual controls": 19, "Wide controls": 30}
        items = [
            {
                "label": "File",
                "items": [
                    {"label": "Open…", "icon": "folder_open", "hint": "Ctrl+O"},
                    {"label": "Open simulated survey", "icon": "sailing"},
                    {"label": "Open simulated range run", "icon": "route"},
                    {"label": "Save session", "icon": "save", "hint": "Ctrl+S"},
                    {"label": "Export this tab", "icon": "file_download"},
                ],
            },
            {
                "label": "Edit",
                "items": [
                    {"label": "Undo", "icon": "undo", "hint": "Ctrl+Z"},
                    {"label": "Redo", "icon": "redo", "hint": "Ctrl+Shift+Z"},
                ],
            },
            {"label": "View", "items": [{"label": label} for label in sizes]},
            {"label": "Help", "items": [{"label": "How to use it"}]},
        ]
        actions = {
            "Open…": self._dialog.show,
            "Open simulated survey": self.session.open_beacon_demo,
            "Open simulated range run": self.session.open_range_demo,
            "Save session": self._save,
            "Export this tab": self._export,
            "Undo": self.session.undo,
            "Redo": self.session.redo,
            "How to use it": lambda: self._help.param.update(open=True),
            **{label: (lambda share=share: self._resize(share)) for label, share in sizes.items()},
        }
        menu = pmui.MenuBar(items=items, margin=0)
        menu.on_click(lambda item: actions.get(item.get("label"), lambda: None)())
        return menu

    def _resize(self, share: int) -> None:
        layout = self.tab._layout
        if layout is not None:
            layout.sizes = (share, 100 - share)

    def _badge(self):
        session = self.session

        badge = ' <b style="background:#B35900;color:white;border-radius:4px;padding:1px 7px">SIMULATED</b>'

        def text(pings, tfile):
            sources = []
            if pings is not None:
                sources.append((pings.source, pings.simulated))
            if tfile is not None:
                sources.append((tfile.reports.source, tfile.simulated))
            return " &nbsp; ".join(
                short(html.escape(name)) + badge * simulated for name, simulated in sources
            )

        def short(name):
            style = "display:inline-block;vertical-align:bottom;max-width:300px;overflow:hidden;text-overflow:ellipsis"
            return f'<span style="{style}" title="{name}">{name}</span>'

        return pn.pane.HTML(
            pn.bind(text, session.param.pings, session.param.tfile),
            margin=(9, 12),
            styles={"font-size": "13px"},
        )

    def _status(self):
        session = self.session

        def words(message, failed, work):
            mark = "border-left:4px solid #C62828;padding-left:8px;font-weight:600" if failed else ""
            running = f"<b>{html.escape(work)}</b> &nbsp; " if work else ""
            message = html.escape(message)
            return f'{running}<span style="{mark}" role="status" title="{message}">{message}</span>'

        cancel = pmui.Button(
            label="Cancel",
            size="small",
            variant="outlined",
            margin=(2, 6),
            on_click=lambda event: session.jobs.cancel(),
            visible=session.param.work.rx() != "",
        )
        bar = pmui.LinearProgress(
            value=(session.param.progress.rx() * 100).rx.pipe(int),
            width=120,
            margin=(12, 8),
            variant="determinate",
            visible=session.param.progress.rx() > 0,
        )
        line = pn.pane.HTML(
            pn.bind(words, session.param.message, session.param.failed, session.param.work),
            margin=(5, 10),
            styles={
                "font-size": "13px",
                "white-space": "nowrap",
                "overflow": "hidden",
                "text-overflow": "ellipsis",
            },
            sizing_mode="stretch_width",
        )
        return pn.Row(line, bar, cancel, sizing_mode="stretch_width", height=34, margin=0)

    # -- actions -------------------------------------------------------------------------------

    def _show(self, *events) -> None:
        """Fills the tab in sight on its first showing, and pauses the one before."""
        place, kind = self._tabs[self._tabs.active], self._kinds[self._tabs.active]
        if self._shown is not None:
            self._shown.deactivate()
            self._shown = None
        try:
            tab = self._shown = self.tab
            tab.activate()
            if (layout := tab.__panel__()) is not place[0]:
                place[:] = [layout]
        except Exception as error:
            log.error("tab %s could not be drawn", kind.title, exc_info=error)
            place[:] = [
                pn.pane.Alert(f"{kind.title} cannot be drawn: {html.escape(str(error))}", alert_type="danger")
            ]

    def _save(self) -> None:
        self._keys.save(f"workbench-{date.today().isoformat()}.json", self.session.to_json())
        self.session.say("Session saved to your downloads")

    def _export(self) -> None:
        exported = self.tab.export()
        if exported is None:
            self.session.say("There is nothing to export in this tab yet")
            return
        self._keys.save(*exported)
        self.session.say(f"{exported[0]} saved to your downloads")
