"""When Python looks for garbage: a page has gone and no other is used. A look stops every page for 0.2 s."""

from __future__ import annotations

import gc
import time
from functools import cache

import panel.io.document
from tornado.ioloop import IOLoop

QUIET_S = 2.0  # without a change in any page: nobody drags anything
LONGEST_S = 60.0  # to wait for that: a live hunt changes its page for hours

_last_change = 0.0


@cache
def collect_between_pages() -> None:
    """Looks once, then never while a page is used; what is imported by now is never looked at again."""
    gc.collect()
    gc.freeze()
    young, middle, _ = gc.get_threshold()
    gc.set_threshold(young, middle, 1000)
    panel.io.document._garbage_collect = _collect_when_quiet  # Panel calls it 5 s after a page has gone


def watch(document) -> None:
    """Takes every change of a page, from either side, as a sign that it is used."""
    document.on_change(_note_change)


def _note_change(_event) -> None:
    global _last_change
    _last_change = time.monotonic()


def _collect_when_quiet(until: float | None = None) -> None:
    now = time.monotonic()
    until = now + LONGEST_S if until is None else until
    if now < until and now - _last_change < QUIET_S:
        IOLoop.current().call_later(QUIET_S, _collect_when_quiet, until)
    else:
        gc.collect()
