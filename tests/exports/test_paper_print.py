"""The paper as a print."""

from __future__ import annotations

import re
import zlib
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


def page_of(pdf):
    """Width and height of a PDF's page and what is drawn on it: text with its place, rectangles, pictures [points]."""
    (box,) = re.findall(rb"/MediaBox \[([^\]]*)\]", pdf)
    left, low, right, high = map(float, box.split())
    drawn = b""
    for stream in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL):
        try:
            piece = zlib.decompress(stream)
        except zlib.error:
            continue
        drawn += piece if b" cm" in piece else b""
    where = r"(?:1 0 -?0 1|0 1 -1 0) (\S+) (\S+) cm.*?(\[.*?\]\s*TJ)"
    texts = {
        "".join(re.findall(r"\(((?:\\.|[^()\\])*)\)", shown)): (float(x), float(y))
        for x, y, shown in re.findall(where, drawn.decode("latin-1"), re.DOTALL)
    }
    frames = [tuple(map(float, one)) for one in re.findall(rb"(\S+) (\S+) (\S+) (\S+) re", drawn)]
    pictures = [tuple(map(float, one)) for one in re.findall(rb"(\S+) 0 0 (\S+) (\S+) (\S+) cm /I", drawn)]
    return (right - left, high - low), texts, frames, pictures


@pytest.mark.parametrize(("count", "paper_in"), [(60, 4.0), (300, 5.0), (3000, 40.0)])
def test_the_page_is_as_wide_as_a4_and_its_printed_scale_is_true(count, paper_in):
    """What the ticks say of the distances between them, against the scale beside the axes."""
    lines = np.random.default_rng(0).integers(0, 255, (count, 100)).astype(np.uint8)
    size, texts, frames, pictures = page_of(print_paper(paper(lines), "pdf"))
    assert size == pytest.approx((210 / 25.4 * 72, (paper_in + 2.0) * 72), abs=0.5)
    across, down = (
        float(re.search(rf"1 cm is (\S+) {unit}$", "\n".join(texts), re.MULTILINE)[1])
        for unit in ("s", "lines")
    )
    assert texts["0.00"][1] == texts["1.00"][1]
    point_cm = 2.54 / 72
    assert across == pytest.approx(1.0 / ((texts["1.00"][0] - texts["0.00"][0]) * point_cm), rel=2e-3)
    numbers = sorted(int(text) for text in texts if text.isdigit())
    far = (texts[str(numbers[0])][1] - texts[str(numbers[-1])][1]) * point_cm
    assert down == pytest.approx((numbers[-1] - numbers[0]) / far, rel=2e-3)
    frame = max(frames, key=lambda one: one[2] * one[3])
    assert frame[2:] == pytest.approx((2.0 / across / point_cm, count / down / point_cm), rel=2e-3)
    (picture,) = pictures
    assert (*picture[2:], *picture[:2]) == pytest.approx(frame, abs=1.0)
    assert frame[0] >= 0.5 * 72
    assert frame[0] + frame[2] <= size[0] - 0.25 * 72


def test_bare_paper_is_refused():
    with pytest.raises(ValueError, match="no line on the paper"):
        print_paper(paper(np.zeros((0, 100), np.uint8)), "png")
