"""The paper as a print."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from trackerlib.exports.paper_print import PaperPrint, print_paper


def paper(lines, simulated=True):
    return PaperPrint(
        lines, 10, 2.0, "hunt $1.wav", simulated, ("threshold 120",), (np.array([1.0]), np.array([12.5])),
        (np.array([1.0, 1.1]), np.array([12.0, 13.0])),
    )  # fmt: skip


def test_a_print_says_what_it_is_of_and_how_made():
    lines = np.random.default_rng(0).integers(0, 255, (300, 100)).astype(np.uint8)
    now = datetime(2026, 6, 1, 12, tzinfo=UTC)
    pdf = print_paper(paper(lines), "pdf", now)
    assert pdf.startswith(b"%PDF")
    assert b"SIMULATED" in pdf
    assert b"SIMULATED" not in print_paper(paper(lines, simulated=False), "pdf", now)
    png = print_paper(paper(lines), "png", now)
    assert png.startswith(b"\x89PNG")
    assert b"hunt $1.wav" in png


def test_bare_paper_is_refused():
    with pytest.raises(ValueError, match="no line on the paper"):
        print_paper(paper(np.zeros((0, 100), np.uint8)), "png")
