"""The served app in a real browser: only what only a browser shows."""

from __future__ import annotations

import json
from itertools import product

import pytest
from conftest import IDLE
from playwright.sync_api import expect
from served import serving

from dashboards.frame import TABS

pytestmark = pytest.mark.ui

TITLES = ["Wet-paper chart", "Crossover", "Timing", "Beacon fix", "Monte Carlo"]
# What must stand in each tab once its data are drawn.
SENTENCES = {
    "Wet-paper chart": "1000 of 1000 pings",
    "Crossover": "both saw the torpedo",
    "Timing": "Transit times were too short by",
    "Beacon fix": "The beacon lies at 41°15.",
    "Monte Carlo": "times the bound in z",
}


def show(page, title):
    page.get_by_role("tab", name=title, exact=True).click()
    expect(page.get_by_text(SENTENCES[title]).first).to_be_visible(timeout=30_000)
    page.wait_for_function(IDLE, timeout=60_000)


@pytest.mark.parametrize(("width", "height"), [(1366, 768), (2560, 1440)])
def test_every_tab_is_drawn_without_a_foreign_request_or_an_error(server, open_page, width, height):
    page, record = open_page(server.url, width, height)
    assert [tab.inner_text() for tab in page.get_by_role("tab").all()] == TITLES
    for title in TITLES:
        show(page, title)
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), title
    page.wait_for_timeout(500)
    assert record.foreign == []
    assert record.errors == []
    bar = page.locator(".MuiAppBar-root").first.bounding_box()
    assert bar["height"] <= 44


def test_dark_and_light(server, open_page):
    page, record = open_page(server.url)
    ground = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(ground)
    page.locator(".MuiAppBar-root button").last.click()
    page.wait_for_timeout(500)
    assert page.evaluate(ground) != light
    for title in TITLES:
        show(page, title)
    assert record.errors == []


def test_two_browsers_never_see_each_others_state(server, open_page):
    (one, _), (other, _) = open_page(server.url), open_page(server.url)
    show(one, "Beacon fix")
    show(other, "Beacon fix")
    used = "table td:has-text('pings used') + td"
    whole = one.locator(used).first.inner_text()
    assert other.locator(used).first.inner_text() == whole
    one.get_by_role("button", name="Play").first.click()
    expect(one.locator(used).first).not_to_have_text(whole, timeout=20_000)
    expect(one.get_by_role("button", name="Pause").first).to_be_visible()
    expect(other.get_by_role("button", name="Play").first).to_be_visible()
    assert other.locator(used).first.inner_text() == whole


def test_a_click_in_the_legend_hides_a_track_and_shows_it_again(server, open_page):
    page, record = open_page(server.url)
    show(page, "Timing")
    hidden = """() => ['plan', 'side'].map(name => Bokeh.documents[0].get_model_by_name(name).renderers.filter(
        one => one.data_source.name == 'points' && !one.visible).map(one => one.glyph.marker.field))"""
    for wanted in ([["marky"], ["marky"]], [[], []]):
        page.get_by_text("array 12", exact=True).first.click()
        page.wait_for_function(
            f"JSON.stringify(({hidden})()) == '{json.dumps(wanted, separators=(',', ':'))}'"
        )
    assert record.errors == []


def test_numbers_are_typed_into_a_slider_one_after_the_other(server, open_page):
    page, record = open_page(server.url)
    show(page, "Timing")
    slider, box = (
        page.get_by_role("slider", name="Offset (ms)"),
        page.locator("input[type=text]:visible").first,
    )
    page.context.new_cdp_session(page).send("Emulation.setCPUThrottlingRate", {"rate": 4})  # a slow machine
    box.click()
    for wait_ms, (keys, at) in product(
        (0, 100, 700),
        (
            (["3.5"], "3.5"),
            (["2.25"], "2.25"),
            (["Delete", "Enter", "-1"], "-1"),  # a box left empty keeps its number
            (["Backspace", "Enter"], "-1"),
            (["ArrowRight", "5"], "-15"),  # the cursor was placed: what is typed is added
            (["Tab", "Shift+Tab", "4"], "4"),
        ),
    ):
        page.wait_for_timeout(wait_ms)
        for key in keys:
            page.keyboard.press(key) if key[:1].isupper() else page.keyboard.type(key)
        page.keyboard.press("Enter")
        expect(slider).to_have_attribute("aria-valuenow", at, timeout=5_000)
    page.keyboard.press("Tab")  # right behind Enter: the focus goes on and stays there
    page.wait_for_timeout(700)
    expect(box).not_to_be_focused()
    assert record.errors == []


def test_a_set_is_chosen_in_the_sorted_table_and_the_profile_is_filled(server, open_page):
    page, record = open_page(server.url)
    show(page, "Timing")
    page.get_by_role("button", name="Profile", exact=True).click()
    expect(page.locator(".tabulator-row:visible").first).to_be_visible(timeout=10_000)
    page.get_by_role("button", name="Sets", exact=True).click()
    header = page.locator(".tabulator-col:visible", has_text="after")
    header.click()
    expect(header).to_have_attribute("aria-sort", "ascending")
    row = page.locator(".tabulator-row:visible").nth(3)
    pair = row.locator(".tabulator-cell:visible").first.inner_text()
    row.click()
    first, second = pair.split("-")
    expect(page.get_by_text(f"as arrays {first} and {second} saw it").first).to_be_visible(timeout=10_000)
    assert record.errors == []


def test_the_line_pointed_at_shows_the_ship_on_the_map(server, open_page):
    page, record = open_page(server.url)
    show(page, "Wet-paper chart")
    paper = page.locator(".bk-Figure").first.bounding_box()
    find = "Bokeh.documents[0].get_model_by_name"
    places = []
    for share in (0.3, 0.6):
        page.mouse.move(paper["x"] + 0.5 * paper["width"], paper["y"] + share * paper["height"], steps=4)
        page.wait_for_function(f"{find}('ship pointed at').data.x.length === 1", timeout=5_000)
        line = page.evaluate(f"Math.floor({find}('line pointed at').data.y[0])")
        beside = page.evaluate(
            f"(() => {{ const d = {find}('line values').data; const k = d.line.indexOf({line});"
            " return [d.ship_x[k], d.ship_y[k]]; })()"
        )
        places.append(
            page.evaluate(
                f"(() => {{ const d = {find}('ship pointed at').data; return [d.x[0], d.y[0]]; }})()"
            )
        )
        assert places[-1] == beside
    assert places[0] != places[1]
    assert record.errors == []


def test_keys_play_save_undo(server, open_page):
    page, record = open_page(server.url)
    show(page, "Beacon fix")
    page.locator("canvas").first.click(force=True, position={"x": 40, "y": 40})
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Pause").first).to_be_visible(timeout=10_000)
    page.keyboard.press("Space")
    expect(page.get_by_role("button", name="Play").first).to_be_visible(timeout=10_000)
    with page.expect_download() as waiting:
        page.keyboard.press("Control+s")
    saved = json.loads(waiting.value.path().read_text())
    assert saved["workbench_session"] == 1
    assert saved["simulated"] is True
    page.keyboard.press("Control+z")
    expect(page.get_by_role("status").last).to_contain_text("Nothing to undo", timeout=10_000)
    assert record.errors == []


def test_tabs_and_menu_are_reachable_by_keyboard(server, open_page):
    page, _ = open_page(server.url)
    page.get_by_role("tab", name=TITLES[0]).focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    expect(page.get_by_text(SENTENCES["Crossover"]).first).to_be_visible(timeout=30_000)
    page.get_by_text("Help", exact=True).first.focus()
    page.keyboard.press("Enter")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")


def test_files_are_opened_and_what_is_none_is_told_in_words(server, open_page, tmp_path):
    page, record = open_page(server.url)
    show(page, "Beacon fix")
    survey = tmp_path / "mine.csv"
    survey.write_text(
        "lat_deg,lon_deg,oneway_s\n" + "".join(f"{10 + k / 1000},20,2.{k}\n" for k in range(1, 7))
    )
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00\x00")
    for path, words in ((survey, "mine.csv: 6 pings"), (picture, "picture.png, line 1: found binary data")):
        page.keyboard.press("Control+o")
        page.locator("input[type=file]").first.set_input_files(path)
        expect(page.get_by_role("status").last).to_contain_text(words, timeout=20_000)
    expect(page.get_by_role("dialog")).to_contain_text("picture.png, line 1: found binary data")
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_have_count(0)
    expect(page.get_by_text("6 usable pings").first).to_be_visible(timeout=20_000)
    assert record.errors == []
    assert server.get()[0] == 200


@pytest.mark.parametrize("address", TABS)
def test_a_tab_served_alone(address, open_page, tmp_path):
    module, _ = address.split(":")
    name = module.rsplit(".", 1)[1]
    command = ("-m", "panel", "serve", f"dashboards/tabs/{name}.py", "--setup", "dashboards/guard.py")
    with serving(tmp_path / "log", "--address", "127.0.0.1", command=command, page=name) as alone:
        page, record = open_page(alone.url)
        titles = [tab.inner_text() for tab in page.get_by_role("tab").all()]
        assert len(titles) == 1
        expect(page.get_by_text(SENTENCES[titles[0]]).first).to_be_visible(timeout=30_000)
        assert (record.foreign, record.errors) == ([], [])


BROKEN = """
from dashboards.frame import serve_page
from dashboards.tabs.tab import Tab

class Broken(Tab):
    title = "Broken"
    def __init__(self, *args, **options):
        raise RuntimeError("the tide table is missing")

serve_page(TABS)
"""


@pytest.mark.parametrize(
    ("tabs", "says", "why"),
    [
        ('["tide_tables:TideTab"]', "could not start", "No module named 'tide_tables'"),
        ("[Broken]", "Broken cannot be drawn", "the tide table is missing"),
    ],
)
def test_a_failing_start_says_why_in_words(open_page, tmp_path, tabs, says, why):
    (tmp_path / "broken.py").write_text(BROKEN.replace("TABS", tabs))
    command = ("-m", "panel", "serve", str(tmp_path / "broken.py"), "--setup", "dashboards/guard.py")
    with serving(tmp_path / "log", "--address", "127.0.0.1", command=command, page="broken") as broken:
        page, _ = open_page(broken.url)
        expect(page.get_by_text(says).first).to_be_visible(timeout=20_000)
        expect(page.get_by_text(why).first).to_be_visible()
        assert why in broken.log.read_text()


FAILING = """
import panel_material_ui as pmui
from dashboards.frame import serve_page
from dashboards.tabs.tab import Tab

class Failing(Tab):
    title = "Failing"
    def controls(self):
        button = pmui.Button(label="Break it")
        button.on_click(lambda event: 1 / 0)
        return [button]

serve_page([Failing])
"""


def test_an_error_in_a_callback_is_shown_and_the_app_stays_up(open_page, tmp_path):
    (tmp_path / "failing.py").write_text(FAILING)
    command = ("-m", "panel", "serve", str(tmp_path / "failing.py"), "--setup", "dashboards/guard.py")
    with serving(tmp_path / "log", "--address", "127.0.0.1", command=command, page="failing") as failing:
        page, _ = open_page(failing.url)
        for _ in range(2):
            page.get_by_role("button", name="Break it").click()
            expect(page.get_by_role("status").last).to_contain_text("division by zero", timeout=20_000)
        assert "ZeroDivisionError" in failing.log.read_text()


def test_first_paint_is_told(server, open_page, record_property):
    page, _ = open_page(server.url)
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    record_property("first_paint_ms", paint)
    print(f"first contentful paint {paint:.0f} ms")
    assert paint > 0
