"""A route that tells how many documents are alive in the server, and who sends; loaded with --plugins by the tests."""

from __future__ import annotations

import gc
import json

from bokeh.document import Document
from bokeh.server.connection import ServerConnection
from panel.io import document as panels
from tornado.web import RequestHandler


def senders():
    """The functions by which Bokeh and Panel send changes."""
    return ServerConnection.send_patch_document, panels.write_events, panels.schedule_write_events


class Probe(RequestHandler):
    """Live documents after a full collection, and the modules that send a page its changes."""

    def get(self):
        for _ in range(3):
            gc.collect()
        alive = sum(type(one) is Document for one in gc.get_objects())
        self.write(json.dumps({"documents": alive, "senders": sorted({one.__module__ for one in senders()})}))


ROUTES = [("/probe", Probe)]
