"""Kernels are loaded beside the app, so that its first fit waits for no compiler."""

from __future__ import annotations

import os
import subprocess
import sys
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


@pytest.mark.parametrize("first", ["import numba", "import trackerlib.beacon.neighbours"])
def test_kernels_are_kept_by_what_all_sources_say_whatever_is_imported_first(first):
    """numba itself renews a kept kernel when its own file changes, not when a file changes whose kernels it calls."""
    code = f"""{first}
from trackerlib.beacon import neighbours, squared_range
print(*(one._cache.cache_path for one in (neighbours.smooth_track, squared_range._fix_alone)))"""
    untold = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=untold
    )
    assert all(f"{os.sep}kernels{os.sep}" in path for path in said.stdout.split())
