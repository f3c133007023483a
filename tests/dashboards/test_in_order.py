"""What Bokeh and Panel send of one page arrives in the order in which it was made, on a busy line too."""

from __future__ import annotations

import asyncio
import json
import threading
from types import SimpleNamespace

import panel.io.document
import pytest
from bokeh.document import Document
from bokeh.io.doc import patch_curdoc
from bokeh.models import Column, Div
from bokeh.protocol import Protocol
from bokeh.server.connection import ServerConnection
from bokeh.server.session import ServerSession
from bokeh.server.views.ws import WSHandler
from panel.io.document import unlocked
from panel.io.state import state
from tornado.ioloop import IOLoop
from tornado.locks import Lock

from dashboards import in_order


class Line(WSHandler):
    """A websocket that notes what goes over it."""

    def __init__(self):
        self.write_lock = Lock()
        self.parts = []
        self.ws_connection = SimpleNamespace(is_closing=lambda: False, write_message=self.note)

    def note(self, part, binary=False):
        self.parts.append(part)
        done = asyncio.get_running_loop().create_future()
        done.set_result(None)
        return done

    @property
    def patches(self):
        """The contents of the messages: each is a header, metadata and the content."""
        return [json.loads(part) for part in self.parts[2::3]]


class Page:
    """A document of a server, its line, and the browser's copy of it."""

    def __init__(self):
        self.column = Column(children=[])
        self.document = Document()
        self.document.add_root(self.column)
        self.copy = Document.from_json(self.document.to_json())
        self.document.models.flush_synced()
        self.session = ServerSession("a", self.document, io_loop=IOLoop.current())
        self.line = Line()
        self.connection = ServerConnection(Protocol(), self.line, None, self.session)
        context = self._context = SimpleNamespace(session=self.session, server_context=None, id="a")
        self.document._session_context = lambda: context
        state._loaded[self.document] = state._connected[self.document] = True
        state._thread_id_[self.document] = threading.get_ident()

    async def run(self, callback):
        """Runs a callback as the server does: under the document's lock; what it sends is sent."""

        def with_page():
            with patch_curdoc(self.document):
                callback()

        await self.session.with_document_locked(with_page)

    def replay(self):
        """The browser's texts after all patches; raises where one names a model it was not told of."""
        for patch in self.line.patches:
            self.copy.apply_json_patch(patch)
        return [child.text for child in self.copy.roots[0].children]


@pytest.fixture
def page_runs(monkeypatch):
    """Runs a story of a page, told in order, and gives the texts the browser then shows."""
    for owner, name in (
        (ServerConnection, "send_patch_document"),
        (panel.io.document, "write_events"),
        (panel.io.document, "schedule_write_events"),
    ):
        monkeypatch.setattr(owner, name, getattr(owner, name))  # put back after the test
    in_order.install()

    def run(story):
        async def whole():
            page = Page()
            await story(page)
            await asyncio.sleep(0.1)
            return page.replay()

        return asyncio.run(whole())

    return run


def test_bokehs_change_waits_for_panels_where_the_line_is_busy(page_runs):
    async def story(page):
        words = Div(text="drawing")

        def show():
            with unlocked():
                page.column.children = [words]

        def result():
            words.text = "drawn"

        await page.line.write_lock.acquire()
        await page.run(show)
        changed = asyncio.ensure_future(page.run(result))
        await asyncio.sleep(0.05)
        page.line.write_lock.release()
        await changed

    assert page_runs(story) == ["drawn"]


def test_panels_change_waits_for_bokehs_made_before_it(page_runs):
    async def story(page):
        words = Div(text="drawing")

        def show_and_change():
            page.column.children = [words]
            with unlocked():
                words.text = "drawn"

        await page.run(show_and_change)

    assert page_runs(story) == ["drawn"]
