"""A hunt in the browser: the emulated receiver over its line, to the paper, to pings, to a fix."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest
from playwright.sync_api import expect
from scipy.stats import chi2

pytestmark = pytest.mark.ui

RATE = 25  # times real time: faster, and a busy machine asks too seldom to hear every period
ENOUGH = 250  # pings: the ship has sailed two and a half legs of the hexagon
# of the truth: the emulated line answers late by tens of metres of the ship's way, at this rate
NEAR_M = 25.0
PATIENCE_MS = 55_000
FOLLOWED = re.compile(r"(\d+) pings followed")


def choose_source(page, name):
    page.locator(".MuiSelect-select:visible").first.click()  # the head has others, hidden
    page.locator("li, [role=option]").filter(has_text=name).first.click()


def source(page, name, column):
    """A column of a figure's data in the browser."""
    code = f"Array.from(Bokeh.documents[0].get_model_by_name('{name}').data['{column}'] ?? [])"
    return page.evaluate(code)


def test_from_the_emulated_receiver_to_the_chart_to_a_fix(server, open_page):
    page, record = open_page(server.url)
    choose_source(page, "Receiver on its line")
    page.get_by_role("button", name="Emulator", exact=True).click()
    rate = page.get_by_label("Receiver's time against ours")
    rate.fill(str(RATE))
    rate.press("Enter")
    page.get_by_role("button", name="Start emulator").click()
    expect(page.get_by_role("status").last).to_contain_text(f"{RATE} times as fast", timeout=10_000)
    page.get_by_role("button", name="Connect", exact=True).click()
    expect(page.get_by_text("Listening").first).to_be_visible(timeout=20_000)
    # Lines appear on the paper, marks on them.
    page.wait_for_function(
        "Bokeh.documents[0].get_model_by_name('line values').data.line.length > 20", timeout=PATIENCE_MS
    )
    strips = page.evaluate(
        "Math.max(...Bokeh.documents[0].get_model_by_name('paper strips').data.image.map(one => Math.max(...one)))"
    )
    assert strips > 120
    assert page.get_by_text("SIMULATED", exact=True).count() >= 1
    # Arrivals and positions become pings, and these a fix.
    page.wait_for_function(
        f"Bokeh.documents[0].get_model_by_name('line values').data.line.at(-1) > {ENOUGH}",
        timeout=PATIENCE_MS,
    )
    pings = page.get_by_text(FOLLOWED).first
    expect(pings).to_be_visible()
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while followed(pings) <= ENOUGH / 2 and time.monotonic() < deadline:
        page.wait_for_timeout(200)
    assert followed(pings) > ENOUGH / 2
    page.get_by_role("tab", name="Beacon fix", exact=True).click()
    expect(page.get_by_text("The beacon lies at").first).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="Stop listening").click()
    page.wait_for_timeout(1500)
    x, y = source(page, "fix", "x"), source(page, "fix", "y")
    truth_x, truth_y = source(page, "truth", "x"), source(page, "truth", "y")
    ring = np.array([source(page, "ellipse", "x"), source(page, "ellipse", "y")])
    assert (len(x), len(truth_x)) == (1, 1)
    half_axes = np.linalg.norm(ring - [[x[0]], [y[0]]], axis=0)
    assert 0.1 < half_axes.min() <= half_axes.max() < 300
    assert np.hypot(x[0] - truth_x[0], y[0] - truth_y[0]) < NEAR_M
    assert inside(ring, np.array([truth_x[0], truth_y[0]]), np.array([x[0], y[0]]), share=0.99)
    assert record.errors == []
    assert record.foreign == []


def followed(pings) -> int:
    """How many pings the status line says were followed."""
    return int(FOLLOWED.search(pings.inner_text())[1])


def inside(ring: np.ndarray, point: np.ndarray, centre: np.ndarray, share: float) -> bool:
    """Whether a point lies within the ellipse that holds `share`, of which `ring` (2, N) holds 95 %."""
    shape = ring - centre[:, None]
    covariance = shape @ shape.T / shape.shape[1] * 2 / chi2.ppf(0.95, 2)
    off = point - centre
    return float(off @ np.linalg.solve(covariance, off)) < chi2.ppf(share, 2)
