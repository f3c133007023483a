"""Kernels are loaded beside the app, so that its first fit waits for no compiler."""

from __future__ import annotations

import threading

import pytest

from dashboards.frame import serve_page
from trackerlib import compiled


@pytest.fixture(autouse=True)
def forgotten():
    compiled.warm_in_background.cache_clear()
    yield
    compiled.warm_in_background.cache_clear()


def test_serving_the_page_warms_the_kernels_in_one_thread_beside_it(monkeypatch):
    ended, runs = threading.Event(), []

    def slow():
        runs.append(threading.current_thread())
        ended.wait(30)

    monkeypatch.setattr(compiled, "warm", slow)
    try:
        serve_page([])
        serve_page([])  # another page of the same server: it did not wait for the first's thread to end
        thread = compiled.warm_in_background()
        assert thread.is_alive()
        assert thread.daemon  # it keeps no server from ending
    finally:
        ended.set()
    thread.join(30)
    assert runs == [thread]
