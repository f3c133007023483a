"""A route that tells how many documents are alive in the server; loaded with --plugins by the tests."""

from __future__ import annotations

import gc
import json

from bokeh.document import Document
from tornado.web import RequestHandler


class Probe(RequestHandler):
    """Live documents after a full collection."""

    def get(self):
        for _ in range(3):
            gc.collect()
        alive = sum(type(one) is Document for one in gc.get_objects())
        self.write(json.dumps({"documents": alive}))


ROUTES = [("/probe", Probe)]
