"""Which two arrays saw the vehicle together, how often, and how far apart they put it."""

from __future__ import annotations

import numpy as np
from bokeh.models import ColorBar, ColumnDataSource, FactorRange, HoverTool, LinearColorMapper, TapTool
from bokeh.palettes import Cividis256
from bokeh.plotting import figure

from dashboards.palette import ESTIMATE
from trackerlib.crossover.pairs import CrossoverSet

COLUMNS = ("a", "b", "first", "second", "points", "passes", "gap", "words", "text_ink", "edge")


class PairMatrix:
    """A cell for each pair of arrays, coloured by its median gap; a click chooses the pair."""

    def __init__(self):
        self.source = ColumnDataSource({name: [] for name in COLUMNS}, name="pairs")
        self.figure = fig = figure(
            name="matrix",
            sizing_mode="stretch_both",
            tools="reset,save",
            x_range=FactorRange(),
            y_range=FactorRange(),
            x_axis_label="second array",
            y_axis_label="first array",
        )
        self.colour = LinearColorMapper(palette=Cividis256, low=0, high=1)
        cells = fig.rect(
            "b", "a", width=0.94, height=0.94, source=self.source, line_color="edge", line_width=2,
            fill_color={"field": "gap", "transform": self.colour}, nonselection_fill_alpha=1.0,
        )  # fmt: skip
        fig.text(
            "b", "a", "words", source=self.source, text_align="center", text_baseline="middle",
            text_font_size="10px", text_color="text_ink", nonselection_text_alpha=1.0,
        )  # fmt: skip
        fig.add_layout(ColorBar(color_mapper=self.colour, width=9, title="median gap (ft)"), "right")
        fig.add_tools(
            TapTool(renderers=[cells]),
            HoverTool(
                renderers=[cells],
                tooltips=[
                    ("arrays", "@first and @second"),
                    ("points", "@points in @passes passes"),
                    ("median gap", "@gap{0.0} ft"),
                ],
            ),
        )
        fig.grid.visible = False

    def show(self, sets: tuple[CrossoverSet, ...], chosen: tuple[int, int] | None) -> None:
        """Every pair of some sets; the chosen one has a frame."""
        by_pair: dict[tuple[int, int], list[CrossoverSet]] = {}
        for one in sets:
            by_pair.setdefault(one.pair, []).append(one)
        gaps = {
            pair: float(np.linalg.norm(np.median(np.concatenate([one.gap for one in own]), axis=0)))
            for pair, own in by_pair.items()
        }
        high = max(gaps.values(), default=1.0)
        self.colour.high = high
        self.figure.y_range.factors = [str(n) for n in sorted({a for a, _ in by_pair}, reverse=True)]
        self.figure.x_range.factors = [str(n) for n in sorted({b for _, b in by_pair})]
        points = [sum(one.points for one in own) for own in by_pair.values()]
        self.source.data = {
            "a": [str(a) for a, _ in by_pair],
            "b": [str(b) for _, b in by_pair],
            "first": [a for a, _ in by_pair],
            "second": [b for _, b in by_pair],
            "points": points,
            "passes": [len(own) for own in by_pair.values()],
            "gap": list(gaps.values()),
            "words": [str(count) for count in points],
            "text_ink": ["black" if gap > 0.5 * high else "white" for gap in gaps.values()],
            "edge": [ESTIMATE if pair == chosen else "#00000000" for pair in by_pair],
        }

    def choose(self, chosen: tuple[int, int] | None) -> None:
        """Frames one pair."""
        pairs = zip(self.source.data["first"], self.source.data["second"], strict=True)
        self.source.data["edge"] = [ESTIMATE if pair == chosen else "#00000000" for pair in pairs]
