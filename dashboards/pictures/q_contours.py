"""Contours of Q over offset and drift, with the estimate, its ellipse and where the sliders stand."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.plotting import figure
from bokeh.plotting.contour import contour_data
from scipy.stats import chi2

from dashboards.palette import BEFORE, ESTIMATE
from dashboards.pictures.legend import legend_entry, style_legend
from trackerlib.timing.correction import TimingCorrection

SIGMAS = 8.0  # either side of the estimate that is drawn
CELLS = 65
LEVELS = 8
AROUND = np.linspace(0, 2 * np.pi, 73)


class QContours:
    """Root mean square gap, sqrt Q of (8) and (11), against offset and drift."""

    def __init__(self):
        self.figure = fig = figure(
            name="q",
            sizing_mode="stretch_both",
            tools="pan,wheel_zoom,reset,save",
            active_scroll="wheel_zoom",
            x_axis_label="offset (ms)",
            y_axis_label="drift (ms per count)",
        )
        blank, levels = np.array([[0.0, 1.0], [0.0, 1.0]]), np.linspace(0.05, 0.95, LEVELS).tolist()
        self.drawn = fig.contour([0, 1], [0, 1], blank, levels, line_color=BEFORE)
        self.words = ColumnDataSource({"x": [], "y": [], "words": []})
        fig.text(
            "x", "y", "words", source=self.words, text_font_size="10px", text_color=BEFORE, text_align="right",
            x_offset=-3,
        )  # fmt: skip
        self.ring = ColumnDataSource({"x": [], "y": []}, name="ellipse")
        self.best = ColumnDataSource({"x": [], "y": []}, name="estimate")
        self.now = ColumnDataSource({"x": [], "y": []}, name="sliders")
        ring = fig.line("x", "y", source=self.ring, line_color=ESTIMATE, line_width=2)
        best = fig.scatter("x", "y", source=self.best, size=9, color=ESTIMATE)
        now = fig.scatter("x", "y", source=self.now, size=13, marker="cross", line_color=BEFORE, line_width=2)
        legend_entry(fig, "contours of the root mean square gap", [], line=True, line_color=BEFORE)
        legend_entry(fig, "estimate", [best], size=8, color=ESTIMATE)
        legend_entry(fig, "its 95 % ellipse", [ring], line=True, line_color=ESTIMATE, line_width=2)
        legend_entry(fig, "sliders", [now], size=10, marker="cross", line_color=BEFORE, line_width=2)
        style_legend(fig)

    def show(self, correction: TimingCorrection | None) -> None:
        """The surface about an estimate; None clears it."""
        for source in (self.ring, self.best, self.now, self.words):
            source.data = {name: [] for name in source.data}
        if correction is None or not correction.points:
            return
        offset, drift = _grids(correction)
        rms = np.sqrt(correction.q_surface(offset, drift)).T
        middle = CELLS // 2
        at = middle + np.arange(1, LEVELS + 1) * middle // LEVELS  # a contour at every sigma of the offset
        levels = rms[middle, at].tolist()
        ms = 1e3 * offset, 1e3 * drift
        if np.ptp(rms) > 1e-9 * max(rms.max(), 1e-9):
            self.drawn.set_data(contour_data(*ms, rms, levels, want_fill=False))
            every_other = slice(1, None, 2)
            self.words.data = {
                "x": ms[0][at][every_other],
                "y": np.full(len(levels[every_other]), ms[1][middle]),
                "words": [f"{level:.2f} ft" for level in levels[every_other]],
            }
        self.best.data = {"x": [1e3 * correction.offset_s], "y": [1e3 * correction.drift_s_per_count]}
        outline = ellipse(correction)
        if outline is not None:
            self.ring.data = {"x": 1e3 * outline[0], "y": 1e3 * outline[1]}

    def move(self, offset_ms: float, drift_ms: float) -> None:
        """Where the sliders stand."""
        self.now.data = {"x": [offset_ms], "y": [drift_ms]}


def ellipse(correction: TimingCorrection) -> np.ndarray | None:
    """Outline (2, N) [s, s/count] of the 95 % ellipse of offset and drift, None without sigmas."""
    if correction.sigma_offset_s is None or not correction.sigma_drift_s_per_count:
        return None
    rho = np.clip(correction.correlation, -0.999999, 0.999999)
    sigma = np.array([correction.sigma_offset_s, correction.sigma_drift_s_per_count])
    half = np.linalg.cholesky(np.array([[1.0, rho], [rho, 1.0]])) * np.sqrt(chi2.ppf(0.95, 2))
    centre = np.array([correction.offset_s, correction.drift_s_per_count])
    return centre[:, None] + sigma[:, None] * (half @ np.stack([np.cos(AROUND), np.sin(AROUND)]))


def _grids(correction: TimingCorrection) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and drifts (CELLS,) about the estimate."""
    offset = correction.sigma_offset_s or correction.isotropic_sigma_offset_s or 1e-4
    drift = correction.sigma_drift_s_per_count or correction.isotropic_sigma_drift_s_per_count or 1e-6
    steps = np.linspace(-SIGMAS, SIGMAS, CELLS)
    return correction.offset_s + offset * steps, correction.drift_s_per_count + drift * steps
