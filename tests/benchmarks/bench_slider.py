"""From a drag of the Timing tab's offset slider to its three painted views, against a HoloViews DynamicMap.

Both show a simulated set of 200 points, which the Timing tab opens as a file. Times run in a real browser from
the pointer's event to the end of the frame in which all three views show that position of the slider or a newer one.

.venv/bin/python tests/benchmarks/bench_slider.py
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright
from set_of_200 import POINTS, set_of_200

from dashboards.session import Session
from trackerlib.rangefiles.crossover_file import write_crossover

TESTS = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(TESTS / "dashboards"))
from served import find_chromium, serving  # noqa: E402

STEPS, EVERY_S, DRAGS, LIMIT_MS = 120, 0.016, 5, 150
IDLE = "window.Bokeh && Bokeh.documents.length && Bokeh.documents.every(d => d.is_idle)"

# Notes every value that the slider's thumb takes, with its pointer event's time, and every painted frame.
STAMPS = """() => {
  const S = window.stamps = {inputs: [], paints: []};
  let event = 0, painted = [];
  addEventListener('pointermove', e => { event = e.timeStamp; }, true);
  addEventListener('mousemove', e => { event = e.timeStamp; }, true);
  const deep = root => [...root.querySelectorAll('*')].flatMap(
    one => [one, ...(one.shadowRoot ? deep(one.shadowRoot) : [])]);
  const thumb = deep(document).find(one => one.matches('input[type=range]') && one.offsetParent !== null
    && Number(one.min) === -10);
  new MutationObserver(() => S.inputs.push([Number(thumb.getAttribute('aria-valuenow')), event]))
    .observe(thumb, {attributes: true, attributeFilter: ['aria-valuenow']});
  const after = new MessageChannel();
  after.port1.onmessage = () => {
    for (const [id, gap] of painted.splice(0)) S.paints.push([id, gap, performance.now()]);
  };
  const views = [];
  const walk = view => { views.push(view); for (const child of view.children?.() ?? []) walk(child); };
  for (const root of Bokeh.index) walk(root);
  let type = Object.getPrototypeOf(views.find(view => view._actual_paint));
  while (!Object.hasOwn(type, '_actual_paint')) type = Object.getPrototypeOf(type);
  const paint = type._actual_paint;
  type._actual_paint = function () {
    paint.call(this);
    for (const one of this.model.renderers) {
      const gap = one.data_source?.data.get?.('gap0') ?? one.data_source?.data.gap0;
      if (gap?.length) { painted.push([this.model.id, gap[0]]); after.port2.postMessage(0); break; }
    }
  };
}"""


def drag(page) -> dict:
    """Drags the offset slider across its range; the stamps of that."""
    thumb = page.locator(".MuiSlider-thumb:visible").first.bounding_box()
    track = page.locator(".MuiSlider-root:visible").first.bounding_box()
    y = thumb["y"] + thumb["height"] / 2
    page.mouse.move(thumb["x"] + thumb["width"] / 2, y)
    page.mouse.down()
    begin = time.time()
    for k in range(STEPS):
        page.mouse.move(track["x"] + track["width"] * (0.05 + 0.9 * k / STEPS), y)
        time.sleep(max(begin + (k + 1) * EVERY_S - time.time(), 0))
    page.mouse.up()
    page.wait_for_timeout(2000)
    return page.evaluate("window.stamps")


def latencies_ms(stamps: dict) -> np.ndarray:
    """Milliseconds from each position of the slider to its picture, or a newer one, in every view.

    The gap at the first point is a straight line of the offset: its first and last values say which one.
    """
    values, times = np.array(stamps["inputs"]).T
    views = sorted({view for view, _, _ in stamps["paints"]})
    seen = np.full((len(views), len(values)), np.inf)
    gaps = np.array([gap for _, gap, _ in stamps["paints"]])
    ends = gaps[-1], values[-1]
    slope = (gaps[-1] - gaps[0]) / (values[-1] - values[0])
    for view, gap, when in stamps["paints"]:
        offset = ends[1] + (gap - ends[0]) / slope
        shown = int(np.argmin(np.abs(values - offset)))
        row = seen[views.index(view)]
        row[: shown + 1] = np.minimum(row[: shown + 1], np.where(times[: shown + 1] <= when, when, np.inf))
    return np.max(seen, axis=0) - times


def open_set(page, path: Path) -> None:
    """Shows the Timing tab and opens a crossover file in it."""
    page.get_by_role("tab", name="Timing", exact=True).click()
    page.get_by_text("One offset").first.wait_for(timeout=120_000)  # every set of the demo is fitted by then
    page.keyboard.press("Control+o")
    page.locator("input[type=file]").first.set_input_files(path)
    page.get_by_text(f"{POINTS} point counts").first.wait_for(timeout=60_000)


def measure(browser, url: str, path: Path | None) -> list[np.ndarray]:
    """Latencies of each drag on a served page, in the Timing tab if a path of a set is given."""
    found = []
    for _ in range(DRAGS):
        page = browser.new_page(viewport={"width": 1366, "height": 768})
        page.goto(url)
        page.wait_for_function(IDLE, timeout=60_000)
        if path is not None:
            open_set(page, path)
        page.wait_for_timeout(4000)
        page.evaluate(STAMPS)
        found.append(latencies_ms(drag(page)))
        page.close()
    return found


def write_set(path: Path) -> Path:
    """Writes the simulated set as a crossover file."""
    session = Session()
    session.open_range_demo()
    write_crossover(path, set_of_200(session.survey, session.profile))
    return path


def main() -> None:
    """Prints 50th and 95th percentiles of both, over all drags and of each, and their ratio."""
    peer_app = str(TESTS / "benchmarks" / "peer_dynamicmap.py")
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder) / "ours") as ours,
        serving(
            Path(folder) / "peer", "--address", "127.0.0.1",
            command=("-m", "panel", "serve", peer_app), page="peer_dynamicmap",
        ) as peer,
        sync_playwright() as playwright,
    ):  # fmt: skip
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=["--no-sandbox"])
        results = {
            "Timing tab": measure(browser, ours.url, write_set(Path(folder) / "simulated.txt")),
            "HoloViews DynamicMap": measure(browser, peer.url, None),
        }
    p95 = {}
    for name, drags in results.items():
        p50, p95[name] = np.percentile(np.concatenate(drags), [50, 95])
        each = ", ".join(f"{np.percentile(one, 95):.0f}" for one in drags)
        print(
            f"{name:22} slider to picture p50 {p50:.0f} ms, p95 {p95[name]:.0f} ms; p95 of each drag {each}"
        )
    ratio = p95["HoloViews DynamicMap"] / p95["Timing tab"]
    print(
        f"{POINTS} points, {STEPS} positions; peer / ours at p95: {ratio:.1f}; wanted at most {LIMIT_MS} ms"
    )


if __name__ == "__main__":
    main()
