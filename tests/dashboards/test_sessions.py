"""Many pages opened and closed leave nothing behind."""

from __future__ import annotations

import asyncio
import json
import re
import time
import urllib.request

import psutil
from served import serving
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

SESSIONS = 25


async def visit(url: str) -> None:
    """Opens a page as a browser does (page, then websocket), stays for a moment, goes away."""
    page = await AsyncHTTPClient().fetch(url, request_timeout=60)
    token = re.search(r'"token":"([^"]+)"', page.body.decode())[1]
    request = HTTPRequest(url.replace("http", "ws") + "/ws", headers={"Origin": url})
    line = await websocket_connect(request, subprotocols=["bokeh", token], max_message_size=50 << 20)
    await line.read_message()
    await asyncio.sleep(0.1)
    line.close()


def probe(server) -> dict:
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/probe", timeout=60) as answer:
        return json.load(answer)


def documents(server) -> int:
    return probe(server)["documents"]


def test_25_sessions_opened_and_closed_leave_no_document_and_no_work(tmp_path):
    """Sessions are given up after 1 s instead of 15, so that what a minute brings is seen within seconds.

    How often the server looks for them is left as users have it: each look wakes it, and where a
    virtual machine wakes slowly, looks twice a second were more than what is measured here.
    """
    options = ("--unused-session-lifetime", "1000", "--plugins", "probe")
    with serving(tmp_path / "log", *options) as server:

        async def many():
            for _ in range(SESSIONS):
                await visit(server.url)

        assert probe(server)["senders"] == ["dashboards.in_order"]
        before_any = documents(server)  # those of the warmed-up page
        asyncio.run(many())
        deadline = time.monotonic() + 60
        while documents(server) > before_any and time.monotonic() < deadline:
            time.sleep(1)
        assert documents(server) <= before_any
        time.sleep(10)  # the probe's own collections end
        process = psutil.Process(server.pid)
        before = sum(process.cpu_times()[:2])
        time.sleep(15)
        busy = (sum(process.cpu_times()[:2]) - before) / 15
        assert busy < 0.01, f"{100 * busy:.1f} % of a core"
        assert "Traceback" not in server.log.read_text()
