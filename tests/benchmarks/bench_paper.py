"""Wet paper at 20 lines a second: what the server spends on it, against replacing the whole image.

The app itself replays simulated sound in the Wet-paper chart, everything beside the paper included (strip, map,
words); the peer shows an image alone. Both with a real browser attached, in the same run.

.venv/bin/python tests/benchmarks/bench_paper.py
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS / "dashboards"))
from served import find_chromium, serving  # noqa: E402

SECONDS, LIMIT_PERCENT, RATE_HZ = 20.0, 25.0, 20.0
IDLE = "window.Bokeh && Bokeh.documents.length && Bokeh.documents.every(d => d.is_idle)"
# 20 lines a second: sound folded at 1 s, 20 times as fast as time.
FOLD_S, SPEED = "1", "x20"
OURS = "Bokeh.documents[0].get_model_by_name('wet paper').y_range.start"
PEER = "Bokeh.documents[0]._all_models.values().find(m => m.data?.lines)?.data.lines[0] ?? 0"


def processor_s(pid: int) -> float:
    """Processor time [s] that a process has used, all its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure(page, pid: int, lines: str) -> tuple[float, float]:
    """Share of one core [%] that the server takes, and lines a second that the browser got."""
    page.wait_for_timeout(6000)
    began, used, had = time.monotonic(), processor_s(pid), page.evaluate(lines)
    page.wait_for_timeout(1e3 * SECONDS)
    seconds = time.monotonic() - began
    return 100 * (processor_s(pid) - used) / seconds, (page.evaluate(lines) - had) / seconds


def select(page, place: int, option: str) -> None:
    """Chooses in the drop-down list of that place among those in sight."""
    page.locator(".MuiSelect-select:visible").nth(place).click()
    page.locator("li, [role=option]").filter(has_text=option).first.click()
    page.wait_for_timeout(500)


def play_sound(page) -> None:
    """Simulated sound, heard and then replayed at 20 lines a second."""
    select(page, 0, "Simulated sound")
    page.get_by_role("button", name="Simulate and hear").click()
    page.get_by_text("1000 s heard").first.wait_for(timeout=120_000)
    interval = page.get_by_label("Fold interval").first
    interval.press("Control+a")
    interval.press_sequentially(FOLD_S)
    interval.press("Enter")
    select(page, 2, SPEED)
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
    for name, (share, rate) in found.items():
        print(f"{name:22} {share:5.1f} % of one core at {rate:.1f} lines a second")
    (share, rate), (peer_share, _) = found.values()
    print(
        f"whole images / wet paper: {peer_share / share:.2f}; wanted at most {LIMIT_PERCENT:g} % for the paper"
    )
    if share > LIMIT_PERCENT or rate < 0.95 * RATE_HZ:
        sys.exit(f"the paper takes {share:.1f} % at {rate:.1f} lines a second")


if __name__ == "__main__":
    main()
