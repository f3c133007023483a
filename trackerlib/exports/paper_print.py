"""The wet paper as a print: a page with axes, what it is of, how it was made and, where it is, SIMULATED."""

from __future__ import annotations

import io
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from trackerlib import __version__

WIDTH_IN, MARGIN_IN = 8.27, 0.75  # A4
PAPER_IN = WIDTH_IN - 1.6 * MARGIN_IN  # across the lines
CM_AN_INCH = 2.54
LINES_AN_INCH = 60.0
SHORTEST_IN, LONGEST_IN = 4.0, 40.0
DPI = 150
PAPER = ((0.969, 0.945, 0.890), (0.188, 0.133, 0.094))  # bare and inked


@dataclass(frozen=True, eq=False)
class PaperPrint:
    """What is printed."""

    lines: np.ndarray  # (N, columns) uint8, oldest first
    first_line: int
    interval_s: float
    source: str
    simulated: bool
    settings: tuple[str, ...] = ()  # sentences
    marks: tuple[np.ndarray, np.ndarray] | None = None  # fold times [s] and lines of the analyst's marks
    curve: tuple[np.ndarray, np.ndarray] | None = None  # of the hyperbola


def print_paper(paper: PaperPrint, layout: str, now: datetime | None = None) -> bytes:
    """The file, "pdf" or "png". Raises ValueError for paper without a line."""
    from matplotlib.colors import LinearSegmentedColormap  # half a second that only a print should pay
    from matplotlib.figure import Figure

    if not len(paper.lines):
        raise ValueError("there is no line on the paper yet")
    high = float(np.clip(len(paper.lines) / LINES_AN_INCH, SHORTEST_IN, LONGEST_IN))
    figure = Figure(figsize=(WIDTH_IN, high + 2 * MARGIN_IN + 0.5), dpi=DPI)
    whole = figure.get_figheight()
    axes = figure.add_axes((MARGIN_IN / WIDTH_IN, MARGIN_IN / whole, PAPER_IN / WIDTH_IN, high / whole))
    last = paper.first_line + len(paper.lines)
    axes.imshow(
        paper.lines,
        cmap=LinearSegmentedColormap.from_list("paper", PAPER),
        vmin=0,
        vmax=255,
        aspect="auto",
        interpolation="nearest",
        extent=(0.0, paper.interval_s, last, paper.first_line),
    )
    if paper.curve is not None:
        axes.plot(*paper.curve, color="#CC3377", linewidth=1)
    if paper.marks is not None:
        axes.plot(*paper.marks, linestyle="none", marker="s", markersize=3, fillstyle="none", color="#CC3377")
    across = f"1 cm is {paper.interval_s / PAPER_IN / CM_AN_INCH:.4g} s"
    down = f"1 cm is {len(paper.lines) / high / CM_AN_INCH:.4g} lines"
    axes.set(xlim=(0, paper.interval_s))
    axes.set(xlabel=f"arrival, folded (s): {across}", ylabel=f"line of paper: {down}")
    axes.set_ylim(last, paper.first_line)
    when = (now or datetime.now(UTC)).strftime("%Y-%m-%dT%H:%MZ")
    label = "SIMULATED · " if paper.simulated else ""
    title = (
        f"{label}{paper.source} · lines {paper.first_line} to {last - 1} folded at {paper.interval_s:.4f} s"
    )
    above = 1 - 0.35 / whole
    figure.text(MARGIN_IN / WIDTH_IN, above, title, fontsize=9, weight="bold", parse_math=False)
    words = " · ".join([*paper.settings, f"printed {when} by tracker workbench {__version__}"])
    figure.text(MARGIN_IN / WIDTH_IN, above - 0.22 / whole, words, fontsize=7, parse_math=False)
    file = io.BytesIO()
    facts = {"Title": title, "Creator": f"tracker workbench {__version__}"}
    if paper.simulated:
        facts["Keywords"] = "SIMULATED"
    figure.savefig(file, format=layout, metadata=facts if layout == "pdf" else {"Title": title})
    return file.getvalue()
