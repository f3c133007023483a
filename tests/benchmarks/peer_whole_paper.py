"""The usual way to scroll a chart in Bokeh: the whole image replaced for every flush. Peer of bench_paper.py."""

from __future__ import annotations

import numpy as np
import panel as pn
from bokeh.models import ColumnDataSource, LinearColorMapper
from bokeh.plotting import figure

COLUMNS, LINES, RATE_HZ, FLUSH_MS = 1000, 1000, 20, 200

pn.extension()
rng = np.random.default_rng(0)
paper = np.zeros((LINES, COLUMNS), np.uint8)
source = ColumnDataSource({"image": [paper]})
fig = figure(width=900, height=500, x_range=(0, 2), y_range=(0, LINES))
mapper = LinearColorMapper([f"#{255 - k:02x}{255 - k:02x}{255 - k:02x}" for k in range(256)], low=0, high=255)
fig.image("image", x=0, y=0, dw=2, dh=LINES, source=source, color_mapper=mapper)
count = 0


def flush() -> None:
    """Adds the lines of one flush."""
    global paper, count
    new = rng.integers(0, 120, (RATE_HZ * FLUSH_MS // 1000, COLUMNS), np.uint8)
    count += len(new)
    paper = np.concatenate([paper[len(new) :], new])
    source.data = {"image": [paper], "lines": [count]}


pn.pane.Bokeh(fig).servable()
pn.state.curdoc.add_periodic_callback(flush, FLUSH_MS)
