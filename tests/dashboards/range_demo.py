"""The range demo as it was opened, for tests that share one tab: building a tab takes longer than most tests."""

from __future__ import annotations

from dashboards.session import Session
from trackerlib.crossover.edits import PointEdits

PLAIN = {"method": "report", "outliers": "out"}


def opened_tab(kind):
    """A tab on the range demo, and what its session held then."""
    session = Session()
    session.open_range_demo()
    tab = kind(session=session)
    tab.activate()
    assert not session.failed, session.message
    names = ("tfile", "survey", "profile", "gating", "crossover")
    return tab, {name: getattr(session, name) for name in names}


def as_opened(tab, state: dict):
    """The same tab with everything that a test changed put back."""
    session = tab.session
    session._past.clear()
    session._future.clear()
    tab.activate()
    tab.pages.choice.value = tab.pages.choice.options[0]
    changed = {name: value for name, value in state.items() if getattr(session, name) is not value}
    if session.timing_options != PLAIN:
        changed["timing_options"] = dict(PLAIN)
    if len(session.edits):
        changed["edits"] = PointEdits()
    if changed or session.correction is None:
        session.param.update(correction=None, **changed)
    for name, value in (("mode", 7), ("max_slant_range_ft", 4700.0), ("gap_counts", 30), ("keep_lines", ())):
        if getattr(session, name) != value:
            setattr(session, name, value)
    session.param.update(message="", failed=False, offsets=None)
    return tab
