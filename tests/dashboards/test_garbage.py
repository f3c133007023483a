"""Python looks for garbage when nobody uses a page, and in the end even if somebody does."""

import asyncio
import time

import panel as pn
import pytest
from bokeh.document import Document

from dashboards import garbage


@pytest.fixture
def looks(monkeypatch):
    found = []
    monkeypatch.setattr(garbage.gc, "collect", lambda: found.append(time.monotonic()))
    monkeypatch.setattr(garbage, "QUIET_S", 0.1)
    monkeypatch.setattr(garbage, "LONGEST_S", 0.5)
    monkeypatch.setattr(garbage, "_last_change", 0.0)
    return found


def used_page():
    """A slider in a watched document."""
    document, slider = Document(), pn.widgets.FloatSlider()
    slider.server_doc(document)
    garbage.watch(document)
    return slider


async def use(slider, for_s: float) -> float:
    """Turns the slider every 20 ms; when it was last turned."""
    begin = time.monotonic()
    while time.monotonic() - begin < for_s:
        slider.value = time.monotonic() % 1
        await asyncio.sleep(0.02)
    return time.monotonic()


def test_it_looks_at_once_where_nobody_is(looks):
    garbage._collect_when_quiet()
    assert len(looks) == 1


def test_it_waits_until_a_page_in_use_is_left_alone(looks):
    async def story():
        slider = used_page()
        slider.value = 0.5
        garbage._collect_when_quiet()
        last = await use(slider, 0.25)
        assert not looks
        await asyncio.sleep(0.3)
        return last

    last = asyncio.run(story())
    assert len(looks) == 1
    assert looks[0] > last


def test_it_does_not_wait_for_ever(looks):
    async def story():
        slider = used_page()
        slider.value = 0.5
        garbage._collect_when_quiet()
        return await use(slider, 0.9)

    last = asyncio.run(story())
    assert len(looks) == 1
    assert looks[0] < last
