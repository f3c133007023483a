"""Figures 4-3 to 4-146 of Wojcik (1993) from a study's table: a page a scenario and sweep.

Where the thesis drew one estimate a point, the root-mean-square error of many is drawn, with what the fixes
said of themselves and the Cramer-Rao bound beside.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from trackerlib.simulation.hexagon import SCENARIOS

FIRST_FIGURE = {1: (3, 11), 2: (19, 27), 3: (35, 43), 4: (51, 67), 5: (83, 99), 6: (115, 131)}
COLOURS = {"all-pings": "#0072b2", "thesis": "#d55e00", "usual": "#009e73"}
MARKS = {3.0: "x", 25.0: "o"}  # the thesis's own
Panel = tuple[
    str, tuple[tuple[str, str], ...], float | None
]  # title, columns with their labels, GPS if only one


def panels(moving: bool) -> list[Panel]:
    """What each figure of a sweep shows, in the thesis's order: 8 still, 16 moving."""
    listed: list[Panel] = []

    def pair(name: str, error: str, sigma: str, bound: str) -> None:
        listed.append((f"{name}: error [m]", ((error, ""), (bound, "bound")), None))
        listed.append((f"std of {name} [m]", ((sigma, ""), (bound, "bound")), None))

    for axis in "xyz":
        name = f"{axis.upper()}{'o' if moving else 'T'}"
        pair(name, f"rmse.{axis}", f"mean_sigma.{axis}", f"crlb.{axis}")
    if moving:
        speeds = tuple((f"rmse.v{axis}", f"v{axis}") for axis in "xyz")
        speeds += tuple((f"crlb.v{axis}", "bound") for axis in "xyz")
        listed += [(f"velocities, {gps:g} m GPS: error [m/s]", speeds, gps) for gps in MARKS]
    listed.append(("position error, three axes [m]", (("rmse_3d_m", ""), ("crlb_3d_m", "bound")), None))
    listed.append(("position error, horizontal [m]", (("rmse_2d_m", ""), ("crlb_2d_m", "bound")), None))
    if moving:
        for axis in "xyz":
            pair(f"present {axis.upper()}T", f"rmse_now.{axis}", f"mean_sigma_now.{axis}", f"crlb_now.{axis}")
    return listed


def draw_page(rows: pd.DataFrame, folder: Path) -> Path:
    """The file written: one page (SVG) of the rows of one scenario, sweep and ship's speed in a study's table."""
    from matplotlib import rc_context  # half a second that only a study should pay
    from matplotlib.figure import Figure

    scenario, sweep = int(rows.scenario.iloc[0]), str(rows.sweep.iloc[0])
    listed = panels(SCENARIOS[scenario].moving)
    # Fixed margins: to fit them to the words costs three times what all the drawing does.
    height = 3.1 * len(listed) / 4
    figure = Figure(figsize=(13, height))
    grid = figure.subplots(len(listed) // 4, 4).ravel()
    figure.subplots_adjust(
        left=0.04, right=0.99, bottom=0.45 / height, top=1 - 0.6 / height, wspace=0.18, hspace=0.36
    )
    number = FIRST_FIGURE[scenario][int(sweep == "spacing")]
    for k, (panel, axes) in enumerate(zip(listed, grid, strict=True)):
        _draw_panel(axes, panel, rows, sweep)
        axes.set_title(f"4-{number + k}  {panel[0]}", fontsize=8, y=1.01)
    grid[0].legend(fontsize=6, loc="upper right")
    figure.suptitle(
        f"SIMULATED  scenario {scenario}, {int(rows.trials.max())} trials a point, "
        f"ship at {rows.speed_mps.iloc[0]:g} m/s",
        fontsize=10,
        y=1 - 0.15 / height,
    )
    path = folder / f"scenario{scenario}_{sweep}_{rows.speed_mps.iloc[0]:g}mps.svg"
    with rc_context({"svg.fonttype": "none"}):  # words stay words
        figure.savefig(path, metadata={"Date": None})
    return path


def _draw_panel(axes, panel: Panel, rows: pd.DataFrame, sweep: str) -> None:
    _, columns, only = panel
    for (method, gps), curve in rows.groupby(["method", "gps_rms_m"]):
        if only is not None and gps != only:
            continue
        curve = curve.sort_values(sweep)
        for column, label in columns:
            bound = label == "bound"
            if bound and method != rows.method.iloc[0]:
                continue
            axes.plot(
                curve[sweep],
                curve[column].where(
                    np.isfinite(curve[column]) & (bound | (curve.converged > curve.trials / 2))
                ),
                color="#777777" if bound else COLOURS[str(method)],
                linestyle="-" if bound or not label else {"vx": "-", "vy": "--", "vz": ":"}[label],
                marker=None if bound else MARKS.get(float(gps), "."),
                markersize=2.5,
                linewidth=0.8,
                label=f"{'bound' if bound else method} {gps:g} m GPS {'' if bound else label}".strip(),
            )
    axes.set_yscale("log")
    axes.minorticks_off()
    axes.set_xlabel("experiments" if sweep == "experiments" else "spacing, pulse intervals", fontsize=7)
    axes.tick_params(labelsize=6)
    axes.grid(alpha=0.3)
