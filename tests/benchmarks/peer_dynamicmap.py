"""The peer of bench_slider.py: the Timing tab's three views as a HoloViews DynamicMap. Served by that benchmark."""

from __future__ import annotations

import holoviews as hv
import numpy as np
import panel as pn
import panel_material_ui as pmui
from set_of_200 import set_of_200

from dashboards.session import Session
from trackerlib.timing.correction import corrected_tracks, stretches

pn.extension()
hv.extension("bokeh")

session = Session()
session.open_range_demo()
crossover = set_of_200(session.survey, session.profile)
stretch = stretches(crossover, session.survey, session.profile)
t0 = float(np.mean(crossover.point_count))
slider = pmui.FloatSlider(label="Offset (ms)", start=-10, end=10, step=0.001, value=0.0)
slider._debounce = 10


def view(horizontal, vertical):
    """One view of both tracks for the slider's offset."""

    def draw(value):
        x, y = corrected_tracks(crossover, *stretch, 1e-3 * value, 0.0, t0)
        gap = x - y
        along = np.linalg.norm(x[:, :2] - x[0, :2], axis=1)
        columns = {"count": crossover.point_count, "gap0": gap[:, 0], "gap1": gap[:, 1], "gap2": gap[:, 2]}
        layers = []
        for track in (x, y):
            table = columns | {"0": track[:, 0], "1": track[:, 1], "2": track[:, 2], "s": along}
            layers.append(hv.Scatter(table, horizontal, [vertical, *(c for c in columns if c != vertical)]))
        return hv.Overlay(layers)

    return hv.DynamicMap(draw, streams=[hv.streams.Params(slider, ["value"])]).opts(
        hv.opts.Scatter(responsive=True, min_height=250, size=5)
    )


pn.Column(
    slider, view("0", "1"), pn.Row(view("s", "2"), view("count", "gap0")), sizing_mode="stretch_both"
).servable()
