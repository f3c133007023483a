"""Changes reach a page in the order in which they were written down, on whichever way they go.

Bokeh writes a change down when it is made and sends it when its callback ends; Panel sends its own at once,
or some time later where the line is busy. A message names the models that earlier ones have told. Where one
way overtakes the other, on a slow machine or line, the page says "reference isn't known" and the change is
lost. So both ways end in one queue for each connection.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable
from weakref import WeakKeyDictionary

import panel.io.document
from bokeh.server.connection import ServerConnection

_waiting: WeakKeyDictionary[ServerConnection, deque] = WeakKeyDictionary()


def _write_down(connection, events) -> None:
    _waiting.setdefault(connection, deque()).append(connection.protocol.create("PATCH-DOC", events))


async def _send(connection) -> None:
    waiting = _waiting[connection]
    while waiting:  # the socket sends one message after the other, in the order in which it is asked to
        await connection._socket.send_message(waiting.popleft())


def _send_bokehs(connection, event) -> Awaitable[None]:
    _write_down(connection, [event])
    return _send(connection)


def _send_panels(document, connections, events) -> None:
    for connection in connections:
        _write_down(connection, events)
        panel.io.document._dispatch_write_task(document, _send, connection)


def install() -> None:
    """Makes every page of this process be told in order; twice is once."""
    ServerConnection.send_patch_document = _send_bokehs
    panel.io.document.write_events = panel.io.document.schedule_write_events = _send_panels
