"""Jobs in line and in threads: newest wins, cancel, progress, errors."""

from __future__ import annotations

import threading

import pytest

from dashboards.jobs import Cancelled, Jobs, Progress


class Document:
    """What Jobs use of a served document: callbacks that run later, under its lock."""

    session_context = object()

    def __init__(self):
        self.callbacks = []
        self.came = threading.Condition()

    def add_next_tick_callback(self, callback):
        with self.came:
            self.callbacks.append(callback)
            self.came.notify()

    def add_timeout_callback(self, callback, milliseconds):
        assert milliseconds > 0
        self.add_next_tick_callback(callback)

    def run_one(self):
        with self.came:
            assert self.came.wait_for(lambda: self.callbacks, timeout=10), "nothing came within 10 s"
            callback = self.callbacks.pop(0)
        callback()


class Page:
    """Jobs with a record of what they told."""

    def __init__(self, served: bool):
        self.states, self.errors = [], []
        self.jobs = Jobs(lambda *state: self.states.append(state), self.errors.append)
        if served:
            self.jobs.document = Document()

    def until_idle(self):
        while self.jobs.busy:
            self.jobs.document.run_one()


def test_without_a_page_work_is_done_at_once():
    page, results = Page(served=False), []
    page.jobs.start("sum", lambda progress: (progress(0.5, "half"), 3)[1], results.append)
    assert results == [3]
    assert page.states == [("sum", 0.5, "half"), ("", 0.0, "")]


def test_an_error_is_reported_and_leaves_nothing_at_work():
    for served in (False, True):
        page, results = Page(served), []
        page.jobs.start("sum", lambda progress: 1 / 0, results.append)
        if served:
            page.until_idle()
        assert results == []
        assert isinstance(page.errors[0], ZeroDivisionError)
        assert not page.jobs.busy


def test_of_many_requests_the_first_and_the_newest_are_worked():
    page, results, go = Page(served=True), [], threading.Event()
    page.jobs.start("fix", lambda progress: (go.wait(10), 0)[1], results.append)
    for k in range(1, 6):
        page.jobs.start("fix", lambda progress, k=k: k, results.append)
    go.set()
    page.until_idle()
    assert results == [0, 5]


def test_two_purposes_do_not_wait_for_each_other():
    page, results, go = Page(served=True), [], threading.Event()
    page.jobs.start("slow", lambda progress: (go.wait(10), "slow")[1], results.append)
    page.jobs.start("quick", lambda progress: "quick", results.append)
    page.jobs.document.run_one()
    assert results == ["quick"]
    go.set()
    page.until_idle()
    assert results == ["quick", "slow"]


def test_of_many_steps_the_page_is_told_the_newest_and_no_more_once_the_job_is_done():
    page, stepped, go = Page(served=True), threading.Event(), threading.Event()

    def work(progress):
        for k in range(50):
            progress(k / 50, f"step {k}")
        stepped.set()
        go.wait(10)
        progress(1.0, "late")

    page.jobs.start("steps", work, lambda result: None)
    assert stepped.wait(10)
    page.jobs.document.run_one()  # asks for the timeout
    page.jobs.document.run_one()
    assert page.states == [("steps", 49 / 50, "step 49")]
    go.set()
    page.until_idle()
    while page.jobs.document.callbacks:
        page.jobs.document.run_one()
    assert page.states[-1] == ("", 0.0, "")


def test_cancel_stops_at_the_next_progress_and_forgets_what_waits():
    page, results, running = Page(served=True), [], threading.Event()

    def work(progress):
        while True:
            running.set()
            progress(0.1)

    page.jobs.start("endless", work, results.append)
    page.jobs.start("endless", work, results.append)
    assert running.wait(10)
    page.jobs.cancel()
    page.until_idle()
    assert results == []
    assert page.errors == []
    assert page.states[-1] == ("", 0.0, "endless: cancelled")


def test_a_cancelled_progress_raises():
    progress = Progress(lambda share, text: None, lambda show: show())
    progress(0.1)
    progress.cancel()
    with pytest.raises(Cancelled):
        progress(0.2)
