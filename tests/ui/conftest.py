"""A real browser before the served app, with a record of everything it asked for and complained of."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1] / "dashboards"))
from served import find_chromium, serving

IDLE = "window.Bokeh && Bokeh.documents.length && Bokeh.documents.every(d => d.is_idle)"


@dataclass
class Record:
    """What a page did that it should not have done."""

    foreign: list[str] = field(default_factory=list)  # requests that leave this machine
    errors: list[str] = field(default_factory=list)  # of the console, and uncaught ones


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("ui") / "log") as running:
        yield running


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=find_chromium(), args=["--no-sandbox"])


@pytest.fixture
def open_page(browser):
    """Opens an address in a browser of its own (other cookies, other session) and waits until it is drawn."""
    contexts = []

    def open_(url: str, width: int = 1366, height: int = 768):
        context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        contexts.append(context)
        page, record = context.new_page(), Record()
        page.on(
            "console", lambda message: record.errors.append(message.text) if message.type == "error" else None
        )
        page.on("pageerror", lambda error: record.errors.append(str(error)))
        ours = ("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:")
        page.on("request", lambda r: None if r.url.startswith(ours) else record.foreign.append(r.url))
        page.on("websocket", lambda w: None if w.url.startswith(ours) else record.foreign.append(w.url))
        page.goto(url, timeout=60_000)
        page.wait_for_function(IDLE, timeout=60_000)
        return page, record

    yield open_
    for context in contexts:
        context.close()
