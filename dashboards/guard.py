"""Keeps strangers out: `panel serve ... --setup dashboards/guard.py`.

A page on the web can point a name of its own at 127.0.0.1 and so reach a local server from a
browser; Tornado then sees an Origin that equals the Host and lets the websocket through. Requests
whose Host is not ours are therefore answered with 421, an Origin that is not ours with 403, and a
content policy forbids our own pages to load anything from elsewhere.

Served under other names: TRACKERLIB_HOSTS=name,name panel serve ...
Map tiles from another address: TRACKERLIB_TILES=http://plotter:8080/{Z}/{X}/{Y}.png
"""

from __future__ import annotations

import os
from urllib.parse import urlsplit

from tornado.web import Application, ErrorHandler, RequestHandler


def our_hosts() -> set[str]:
    """Names under which this server may be asked."""
    told = os.environ.get("TRACKERLIB_HOSTS", "")
    return {"localhost", "127.0.0.1", "::1"} | {name.strip() for name in told.split(",") if name.strip()}


def tile_address() -> str:
    """Address of map tiles, empty unless the user set one."""
    return os.environ.get("TRACKERLIB_TILES", "")


def content_policy() -> str:
    """The Content-Security-Policy of every page."""
    tiles = urlsplit(tile_address())
    images = f" {tiles.scheme}://{tiles.netloc}" if tiles.netloc else ""
    return (
        "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; "
        f"img-src 'self' blob: data:{images}; connect-src 'self' ws: blob: data:{images}; "
        "frame-ancestors 'self'; form-action 'self'; base-uri 'self'; object-src 'none'"
    )


def refusal(host: str, origin: str | None) -> int | None:
    """HTTP status with which a request is refused, or None if it may pass."""
    if host not in our_hosts():
        return 421
    if origin and origin != "null" and urlsplit(origin).hostname not in our_hosts():
        return 403
    return None


def install() -> None:
    """Puts the guard before every request of this process; twice is once."""
    if getattr(Application, "_guarded", False):
        return
    find_handler, clear = Application.find_handler, RequestHandler.clear

    def guarded(self, request, **options):
        status = refusal(request.host_name, request.headers.get("Origin"))
        if status is not None:
            return self.get_handler_delegate(request, ErrorHandler, {"status_code": status})
        return find_handler(self, request, **options)

    def with_policy(self):
        clear(self)
        self.set_header("Content-Security-Policy", content_policy())
        self.set_header("X-Content-Type-Options", "nosniff")

    Application._guarded = True
    Application.find_handler, RequestHandler.clear = guarded, with_policy


install()
