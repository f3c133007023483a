"""Strangers are kept out of the served app, and its pages load nothing from elsewhere."""

from __future__ import annotations

import socket

import psutil
import pytest
from served import serving

from dashboards.guard import content_policy, refusal


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("serve") / "log") as running:
        yield running


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        ("127.0.0.1", None, None),
        ("localhost", "http://localhost:5006", None),
        ("127.0.0.1", "http://evil.example", 403),
        ("evil.example", None, 421),
        ("evil.example", "http://evil.example:5006", 421),  # a foreign name that resolves to 127.0.0.1
        ("", None, 421),
    ],
)
def test_who_is_refused(host, origin, status):
    assert refusal(host, origin) == status


def test_further_names_can_be_allowed(monkeypatch):
    monkeypatch.setenv("TRACKERLIB_HOSTS", "ship, 10.0.0.5")
    assert refusal("ship", "http://10.0.0.5:5006") is None
    assert refusal("shore", None) == 421


def test_only_a_set_tile_address_opens_the_policy(monkeypatch):
    assert "http:" not in content_policy()
    monkeypatch.setenv("TRACKERLIB_TILES", "http://plotter:8080/{Z}/{X}/{Y}.png")
    assert "img-src 'self' blob: data: http://plotter:8080;" in content_policy()


def test_the_very_first_answer_carries_the_policy(server):
    status, headers, _ = server.get()
    assert status == 200
    assert headers["Content-Security-Policy"] == content_policy()
    assert server.get("/../static/js/bokeh.min.js")[1]["Content-Security-Policy"] == content_policy()


def test_a_foreign_host_is_refused_and_the_app_stays_up(server):
    assert server.get(headers={"Host": f"evil.example:{server.port}"})[0] == 421
    assert server.get(headers={"Origin": "http://evil.example"})[0] == 403
    assert server.get()[0] == 200


def websocket_status(server, host: str, origin: str) -> int:
    """Status line of a websocket handshake."""
    request = (
        f"GET /app/ws HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Protocol: bokeh, none\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", server.port), timeout=20) as line:
        line.sendall(request.encode())
        return int(line.recv(200).split()[1])


def test_the_websocket_refuses_a_rebound_name(server):
    evil = f"evil.example:{server.port}"
    assert websocket_status(server, evil, f"http://{evil}") == 421
    assert websocket_status(server, f"127.0.0.1:{server.port}", "http://evil.example") == 403
    # Ours gets past the guard (and then lacks a session token).
    assert websocket_status(server, f"127.0.0.1:{server.port}", server.url) not in (403, 421)


def test_it_listens_on_this_machine_only(server):
    listening = [
        c for c in psutil.Process(server.pid).net_connections("inet") if c.status == psutil.CONN_LISTEN
    ]
    assert listening
    assert {c.laddr.ip for c in listening} == {"127.0.0.1"}


@pytest.mark.parametrize("tab", ["chart", "crossover", "timing", "beacon"])
def test_a_tab_served_alone_is_guarded_too(tab, tmp_path):
    command = ("-m", "panel", "serve", f"dashboards/tabs/{tab}.py", "--setup", "dashboards/guard.py")
    with serving(tmp_path / "log", "--address", "127.0.0.1", command=command, page=tab) as alone:
        assert alone.get(headers={"Host": "evil.example"})[0] == 421
        status, headers, _ = alone.get()
        assert status == 200
        assert "Content-Security-Policy" in headers
        assert "Traceback" not in alone.log.read_text()
