"""Wet paper at 20 lines a second: what server, wire and browser spend on it, against replacing the whole image.

The app itself replays simulated sound in the Wet-paper chart, everything beside the paper included (strip, map,
words); the peer shows an image alone and makes nothing. Both with a real browser attached, in the same run. The peer is
cheaper in the server, which only hands one array on; what it costs is on the wire and in the browser.

.venv/bin/python tests/benchmarks/bench_paper.py
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from playwright.sync_api import sync_playwright

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS / "dashboards"))
from served import find_chromium, serving  # noqa: E402

SECONDS, LIMIT_PERCENT, RATE_HZ = 20.0, 25.0, 20.0
LATE_MS = 50.0  # of a frame: two were dropped before it
FRAMES = """window.frameTimes = []; (function next(now) {
    if (now) window.frameTimes.push(now); requestAnimationFrame(next) })()"""
IDLE = "window.Bokeh && Bokeh.documents.length && Bokeh.documents.every(d => d.is_idle)"
# 20 lines a second: sound folded at 1 s, 20 times as fast as time.
FOLD_S, SPEED = "1", "x20"
OURS = "Bokeh.documents[0].get_model_by_name('wet paper').y_range.start"
PEER = "Bokeh.documents[0]._all_models.values().find(m => m.data?.lines)?.data.lines[0] ?? 0"


def processor_s(pid: int) -> float:
    """Processor time [s] that a process has used, all its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Cost:
    """Of lines that scroll by."""

    server_percent: float  # of one core
    browser_percent: float  # of the time, in which the page's main thread is busy
    kilobytes: float  # a line, on the wire
    lines: float  # a second that reached the page
    longest_frame_ms: float  # between two frames: what one sees as a stutter
    late_frames: float  # share of frames later than LATE_MS


def measure(page, pid: int, lines: str) -> Cost:
    """What it costs while lines come for SECONDS, after some to settle."""
    received = [0]
    wire = page.context.new_cdp_session(page)
    wire.send("Network.enable")
    wire.send("Performance.enable")
    wire.on("Network.webSocketFrameReceived", lambda frame: received.append(_bytes(frame["response"])))
    page.wait_for_timeout(6000)
    page.evaluate(FRAMES)
    sent, busy = len(received), _busy_s(wire)
    began, used, had = time.monotonic(), processor_s(pid), page.evaluate(lines)
    page.wait_for_timeout(1e3 * SECONDS)
    seconds, used = time.monotonic() - began, processor_s(pid) - used
    busy, came = _busy_s(wire) - busy, page.evaluate(lines) - had
    frames = page.evaluate("window.frameTimes")
    gaps = [after - before for before, after in pairwise(frames)]
    return Cost(
        100 * used / seconds,
        100 * busy / seconds,
        sum(received[sent:]) / 1e3 / max(came, 1),
        came / seconds,
        max(gaps, default=0.0),
        sum(gap > LATE_MS for gap in gaps) / max(len(gaps), 1),
    )


def _bytes(frame: dict) -> int:
    text = frame["payloadData"]
    return len(text) if frame["opcode"] == 1 else len(text) * 3 // 4  # others are told in base64


def _busy_s(wire) -> float:
    metrics = wire.send("Performance.getMetrics")["metrics"]
    return next(each["value"] for each in metrics if each["name"] == "TaskDuration")


def select(page, shown: str, option: str) -> None:
    """Chooses in the drop-down list that shows this now."""
    page.locator(".MuiSelect-select:visible").filter(has_text=shown).first.click()
    page.locator("li, [role=option]").filter(has_text=option).first.click()
    page.wait_for_timeout(500)


def play_sound(page) -> None:
    """Simulated sound, heard and then replayed at 20 lines a second."""
    select(page, "Survey log", "Simulated sound")
    page.get_by_role("button", name="Simulate and hear").click()
    page.get_by_text("1000 s heard").first.wait_for(timeout=120_000)
    interval = page.get_by_label("Fold interval").first
    interval.press("Control+a")
    interval.press_sequentially(FOLD_S)
    interval.press("Enter")
    select(page, "x100", SPEED)
    page.get_by_role("button", name="Play", exact=True).first.click()


def main() -> None:
    """Prints both and their ratio; fails above the limit, or where the paper falls behind."""
    peer_app = str(TESTS / "benchmarks" / "peer_whole_paper.py")
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder) / "ours") as ours,
        serving(
            Path(folder) / "peer", "--address", "127.0.0.1",
            command=("-m", "panel", "serve", peer_app), page="peer_whole_paper",
        ) as peer,
        sync_playwright() as playwright,
    ):  # fmt: skip
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=["--no-sandbox"])
        found = {}
        for name, server, lines in (("wet paper in the app", ours, OURS), ("whole images", peer, PEER)):
            page = browser.new_page(viewport={"width": 1366, "height": 768})
            page.goto(server.url)
            page.wait_for_function(IDLE, timeout=60_000)
            if server is ours:
                play_sound(page)
            found[name] = measure(page, server.pid, lines)
            page.close()
    print(
        f"{'':22}{'server':>9}{'browser':>9}{'wire':>14}{'lines':>9}{'longest frame':>16}{'late frames':>13}"
    )
    for name, cost in found.items():
        print(
            f"{name:22}{cost.server_percent:7.1f} %{cost.browser_percent:7.1f} %{cost.kilobytes:7.1f} kB/line"
            f"{cost.lines:7.1f}/s{cost.longest_frame_ms:13.0f} ms{100 * cost.late_frames:11.1f} %"
        )
    ours, peer = found.values()
    print(
        f"whole images / wet paper: server {peer.server_percent / ours.server_percent:.2f}, browser "
        f"{peer.browser_percent / ours.browser_percent:.2f}, bytes {peer.kilobytes / ours.kilobytes:.0f}; "
        f"wanted at most {LIMIT_PERCENT:g} % of the server for the paper"
    )
    if ours.server_percent > LIMIT_PERCENT or ours.lines < 0.95 * RATE_HZ:
        sys.exit(f"the paper takes {ours.server_percent:.1f} % at {ours.lines:.1f} lines a second")


if __name__ == "__main__":
    main()
