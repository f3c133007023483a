"""The receiver behind the chart: response of its front end, detection curves, residuals of a hyperbola."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d, Span
from bokeh.palettes import Viridis256
from bokeh.plotting import figure

from dashboards.palette import ESTIMATE, FIRST_ARRAY, SECOND_ARRAY, SHIP
from dashboards.pictures.legend import LEGEND
from trackerlib.receiver.detection_curve import DetectionCurve
from trackerlib.receiver.front_end import ATTENUATIONS_DB
from trackerlib.receiver.front_end_design import FrontEnd, decibels, shunt_for

SPAN = 0.12  # of the carrier, to each side
POINTS = 401
STAGES = ("first stage", "second stage", "third stage")


def _strip(name: str, across: str, up: str, **options):
    return figure(
        name=name,
        sizing_mode="stretch_both",
        tools="pan,wheel_zoom,box_zoom,reset,save",
        x_axis_label=across,
        y_axis_label=up,
        **options,
    )


def _legend(fig, where: str = "top_right") -> None:
    for name, value in (LEGEND | {"location": where}).items():
        setattr(fig.legend, name, value)


class FrontEndView:
    """Tuned response from hydrophone to detector, the gains of its stages, and what the attenuator leaves."""

    def __init__(self):
        self.figure = fig = _strip("front end", "frequency (kHz)", "gain (dB)")
        columns = ("khz", "whole", *(f"stage{k}" for k in range(3)))
        self.source = ColumnDataSource({name: [] for name in columns}, name="front end")
        self.steps = ColumnDataSource({"khz": [], "gain": [], "step": []})
        fig.line("khz", "whole", source=self.source, color=FIRST_ARRAY, line_width=2, legend_label="whole")
        dashes = ("dashed", "dotted", "dotdash")
        for k, (label, dash) in enumerate(zip(STAGES, dashes, strict=True)):
            fig.line("khz", f"stage{k}", source=self.source, color=SHIP, line_dash=dash, legend_label=label)
        dots = fig.scatter(
            "khz", "gain", source=self.steps, color=SECOND_ARRAY, size=6, legend_label="attenuator"
        )
        fig.add_tools(
            HoverTool(renderers=[dots], tooltips=[("attenuator", "@step dB"), ("gain", "@gain{0.0} dB")])
        )
        _legend(fig)

    def show(self, design: FrontEnd) -> None:
        """Another design."""
        hz = np.linspace(1 - SPAN, 1 + SPAN, POINTS) * design.carrier_hz
        stages = design.stage_gains(hz)
        self.source.data = {
            "khz": hz / 1e3,
            "whole": design.gain_db(hz),
            **{f"stage{k}": decibels(stage) for k, stage in enumerate(stages)},
        }
        steps = [step for step in ATTENUATIONS_DB if step]
        gain = [
            float(design.gain_db(design.carrier_hz, shunt_for(design.third.series_ohm, step)))
            for step in steps
        ]
        khz = design.carrier_hz / 1e3
        self.steps.data = {"khz": [khz] * len(steps), "gain": gain, "step": steps}


class DetectionView:
    """Misses against false alarms of the modern detector: lines by theory, dots simulated."""

    def __init__(self):
        self.figure = fig = _strip(
            "detection", "false alarms, a cell", "misses", x_axis_type="log", y_range=Range1d(-0.02, 1.02)
        )
        self.theory = ColumnDataSource({"xs": [], "ys": [], "ink": [], "snr": []}, name="detection theory")
        self.found = ColumnDataSource(
            {name: [] for name in ("x", "y", "ink", "snr", "threshold")}, name="detection"
        )
        self.alarms = ColumnDataSource({"x": [], "y": []}, name="false alarms")
        fig.multi_line("xs", "ys", source=self.theory, color="ink", line_width=1.5)
        dots = fig.scatter("x", "y", source=self.found, color="ink", size=6, legend_field="snr")
        tips = [
            ("SNR", "@snr"),
            ("false alarms", "@x{0.0e}"),
            ("misses", "@y{0.000}"),
            ("power over noise", "@threshold{0.0}"),
        ]
        fig.add_tools(HoverTool(renderers=[dots], tooltips=tips))
        _legend(fig, "top_right")

    def show(self, curve: DetectionCurve) -> None:
        """These curves."""
        inks = [Viridis256[round(200 * k / max(len(curve.snr_db) - 1, 1))] for k in range(len(curve.snr_db))]
        names = [f"{ratio:.0f} dB" for ratio in curve.snr_db]
        count = len(curve.false_alarm)
        self.theory.data = {
            "xs": [curve.false_alarm] * len(names), "ys": list(curve.miss), "ink": inks, "snr": names,
        }  # fmt: skip
        self.found.data = {
            "x": np.tile(curve.false_alarm, len(names)),
            "y": curve.miss_found.ravel(),
            "ink": np.repeat(inks, count),
            "snr": np.repeat(names, count),
            "threshold": np.tile(curve.threshold, len(names)),
        }


class PassView:
    """What the hyperbola leaves of each mark."""

    def __init__(self):
        self.figure = fig = _strip("pass residuals", "line of paper", "mark less hyperbola (ms)")
        self.source = ColumnDataSource({"line": [], "residual_ms": []}, name="pass residuals")
        dots = fig.scatter("line", "residual_ms", source=self.source, size=5, color=ESTIMATE)
        fig.add_layout(Span(location=0, dimension="width", line_color=SHIP))
        fig.add_tools(
            HoverTool(renderers=[dots], tooltips=[("line", "@line"), ("residual", "@residual_ms{0.00} ms")])
        )

    def show(self, line, residual_s) -> None:
        """Residuals (M,) at lines (M,)."""
        self.source.data = {"line": np.asarray(line), "residual_ms": 1e3 * np.asarray(residual_s)}
