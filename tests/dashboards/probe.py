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
        held = [one for one in gc.get_objects() if type(one) is Document]
        # A destroyed document has lost its attributes; what still has roots is alive.
        alive = sum(bool(getattr(one, "_roots", ())) for one in held)
        self.write(json.dumps({"documents": alive, "held": len(held)}))


ROUTES = [("/probe", Probe)]
