"""The receiver behind the chart: response of its front end, misses and false alarms, residuals of a hyperbola."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool, Range1d, Span
from bokeh.palettes import Viridis256
from bokeh.plotting import figure

from dashboards.palette import ESTIMATE, FIRST_ARRAY, SECOND_ARRAY, SHIP
from dashboards.pictures.legend import style_legend
from trackerlib.receiver.detection_curve import DetectionCurve
from trackerlib.receiver.front_end import ATTENUATIONS_DB
from trackerlib.receiver.front_end_design import (
    HYDROPHONE_F,
    FrontEnd,
    attenuation_db,
    decibels,
    parallel,
    source_impedance,
    switched_shunts,
)
from trackerlib.receiver.level_curve import LevelCurve

SPAN = 0.12  # of the carrier, to each side
POINTS = 401
TOLERANCE = 0.25  # of the hydrophone's capacitance
NO_MARKS = "Mark a trace, then Hyperbola: what the curve leaves of each mark is drawn here"
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


class FrontEndView:
    """Tuned response from hydrophone to detector, the gains of its stages, what the attenuator's shunts leave; |Z|."""

    def __init__(self):
        self.figure = fig = _strip("front end", "frequency (kHz)", "gain (dB)")
        columns = ("khz", "whole", *(f"stage{k}" for k in range(3)))
        self.source = ColumnDataSource({name: [] for name in columns}, name="front end")
        self.steps = ColumnDataSource({"khz": [], "gain": [], "step": [], "taken": []})
        fig.line("khz", "whole", source=self.source, color=FIRST_ARRAY, line_width=2, legend_label="whole")
        dashes = ("dashed", "dotted", "dotdash")
        for k, (label, dash) in enumerate(zip(STAGES, dashes, strict=True)):
            fig.line("khz", f"stage{k}", source=self.source, color=SHIP, line_dash=dash, legend_label=label)
        dots = fig.scatter(
            "khz", "gain", source=self.steps, color=SECOND_ARRAY, size=6, legend_label="attenuator"
        )
        fig.add_tools(
            HoverTool(
                renderers=[dots],
                tooltips=[
                    ("step of Table 5-2", "@step dB"),
                    ("its shunts take off", "@taken{0.0} dB"),
                    ("gain left", "@gain{0.0} dB"),
                ],
            )
        )
        style_legend(fig, "top_right")
        self._make_impedance()

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
        shunts = [switched_shunts(design.third.series_ohm, step) for step in steps]
        gain = [float(design.gain_db(design.carrier_hz, parallel(*each))) for each in shunts]
        taken = [attenuation_db(design.third.series_ohm, each) for each in shunts]
        khz = design.carrier_hz / 1e3
        self.steps.data = {"khz": [khz] * len(steps), "gain": gain, "step": steps, "taken": taken}
        self._show_impedance(design.carrier_hz)

    def _make_impedance(self) -> None:
        self.impedance = fig = _strip(
            "source impedance",
            "frequency (kHz)",
            "source |Z| (Ω)",
            x_axis_type="log",
            y_axis_type="log",
        )
        self.ohms = ColumnDataSource({"khz": [], "ohm": [], "least": [], "most": []}, name="source impedance")
        self.at_carrier = ColumnDataSource({"khz": [], "ohm": []})
        fig.varea(
            "khz", "least", "most", source=self.ohms, fill_color=SHIP, fill_alpha=0.2, legend_label="± 25 %"
        )
        fig.line(
            "khz", "ohm", source=self.ohms, color=FIRST_ARRAY, line_width=2, legend_label="hydrophone, cable"
        )
        dot = fig.scatter(
            "khz", "ohm", source=self.at_carrier, color=SECOND_ARRAY, size=6, legend_label="carrier"
        )
        fig.add_tools(HoverTool(renderers=[dot], tooltips=[("at", "@khz kHz"), ("|Z|", "@ohm{0} Ω")]))
        style_legend(fig, "top_right")

    def _show_impedance(self, carrier_hz: float) -> None:
        """(5-13), Figure 5-6, with the tolerance of the hydrophone's capacitance."""
        hz = np.geomspace(0.1, 10, POINTS) * carrier_hz
        self.ohms.data = {
            "khz": hz / 1e3,
            "ohm": np.abs(source_impedance(hz)),
            "least": np.abs(source_impedance(hz, hydrophone_f=(1 + TOLERANCE) * HYDROPHONE_F)),
            "most": np.abs(source_impedance(hz, hydrophone_f=(1 - TOLERANCE) * HYDROPHONE_F)),
        }
        self.at_carrier.data = {"khz": [carrier_hz / 1e3], "ohm": [float(abs(source_impedance(carrier_hz)))]}


class ThresholdView:
    """Misses at several signal-to-noise ratios and false alarms of a detector against its threshold.

    Lines are theory where there is one; dots, or lines where there is none, are simulated.
    """

    def __init__(self, name: str, across: str, alarms: str, made: str):
        self.figure = fig = _strip(name, across, "share", y_axis_type="log", y_range=Range1d(5e-4, 1.3))
        fig.title.update(text=made, text_font_style="normal")
        columns = ("xs", "ys", "ink", "what")
        self.lines = ColumnDataSource({each: [] for each in columns}, name=f"{name} lines")
        self.dots = ColumnDataSource({each: [] for each in ("x", "y", "ink", "what")}, name=name)
        self._alarms = alarms
        fig.multi_line("xs", "ys", source=self.lines, color="ink", line_width=1.5, legend_field="what")
        dots = fig.scatter("x", "y", source=self.dots, color="ink", size=5)
        tips = [("", "@what"), ("threshold", "@x{0.0}"), ("share", "@y{0.0000}")]
        fig.add_tools(HoverTool(renderers=[dots], tooltips=tips))
        style_legend(fig, "bottom_left")

    def _draw(self, threshold, snr_db, alarms, misses, alarms_found, misses_found) -> None:
        """Shares at thresholds (T,): alarms (T,), misses (S, T), and the same as simulated where that differs."""
        steps = max(len(snr_db) - 1, 1)
        inks = [SECOND_ARRAY, *(Viridis256[round(200 * k / steps)] for k in range(len(snr_db)))]
        names = [self._alarms, *(f"misses, {ratio:.0f} dB" for ratio in snr_db)]
        ys = [_above_none(each) for each in (alarms, *misses)]
        self.lines.data = {"xs": [threshold] * len(names), "ys": ys, "ink": inks, "what": names}
        found = np.concatenate([_above_none(each) for each in (alarms_found, *misses_found)])
        self.dots.data = {
            "x": np.tile(threshold, len(names)),
            "y": found,
            "ink": np.repeat(inks, len(threshold)),
            "what": np.repeat(names, len(threshold)),
        }


def _above_none(share) -> np.ndarray:
    """Shares for a logarithmic axis, which has no place for none at all."""
    return np.where(np.asarray(share) > 0, share, np.nan)


class DetectionView(ThresholdView):
    """The modern detector's: lines by theory, dots simulated."""

    def __init__(self):
        super().__init__(
            "detection", "threshold of the matched filter: power over noise (dB)", "false alarms, a cell",
            "lines by theory, dots SIMULATED",
        )  # fmt: skip

    def show(self, curve: DetectionCurve) -> None:
        """These curves."""
        self._draw(
            10 * np.log10(curve.threshold), curve.snr_db, curve.false_alarm, curve.miss,
            curve.false_alarm_found, curve.miss_found,
        )  # fmt: skip


class LevelView(ThresholdView):
    """Those of the report's chain, all simulated."""

    def __init__(self):
        super().__init__(
            "level", "threshold of the report's chain: level, 0 to 255", "false alarms, a period", "SIMULATED"
        )
        self.figure.x_range = Range1d(0, 255)

    def show(self, curve: LevelCurve) -> None:
        """These curves."""
        told = slice(None, None, 8)  # dots among the lines
        self._draw(curve.level, curve.snr_db, curve.false_alarm, curve.miss, curve.false_alarm, curve.miss)
        self.dots.data = {name: np.asarray(column)[told] for name, column in self.dots.data.items()}


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
        fig.title.update(text=NO_MARKS, text_font_style="normal")

    def show(self, line, residual_s) -> None:
        """Residuals (M,) at lines (M,)."""
        self.figure.title.text = "" if len(line) else NO_MARKS
        self.source.data = {"line": np.asarray(line), "residual_ms": 1e3 * np.asarray(residual_s)}
