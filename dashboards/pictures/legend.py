"""Legends inside a picture; a click on an entry hides what it names."""

from __future__ import annotations

import numpy as np
from bokeh.events import LegendItemClick
from bokeh.models import CustomJS, Legend, LegendItem

LEGEND = {
    "click_policy": "hide",
    "label_text_font_size": "11px",
    "label_height": 14,
    "spacing": 0,
    "padding": 4,
    "glyph_height": 14,
    "background_fill_alpha": 0.7,
}
# Bokeh tells of the click before it hides the mark.
FOLLOW = """
if (cb_obj.item.renderers[0] === mark) setTimeout(() => { for (const one of shown) one.visible = mark.visible })
"""
THEMED = ("label_text_font_size", "spacing", "glyph_height", "background_fill_alpha")


def style_legend(fig, location: str = "top_left", **other) -> None:
    """A small legend inside the picture; a click hides what it names. `other` are further properties of it."""
    style = LEGEND | {"location": location} | other
    for name, value in style.items():
        setattr(fig.legend, name, value)
    # The page's theme makes every legend large and its ground clear, live; this takes it back.
    small = {name: style[name] for name in THEMED}
    code = "if (legend.spacing !== small.spacing) legend.setv(small)"
    for legend in fig.legend:
        legend.js_on_change("spacing", CustomJS(args={"legend": legend, "small": small}, code=code))


def legend_entry(fig, label: str, shown: list, *, line: bool = False, visible: bool = True, **mark):
    """A legend entry with a mark of its own; a click on it hides or shows the renderers it stands for.

    line : the mark is a piece of line, not a dot
    The mark stands for itself because Bokeh draws the legend of a data-coloured renderer from its data, fails when
    these grow fewer or are none, and builds the legend again at every change of anything that its entries lead to.
    A link from the mark to what it stands for would be such a lead: so the legend's click is followed instead.
    """
    drawn = fig.line if line else fig.scatter
    mark = drawn([np.nan], [np.nan], **mark)
    if not fig.legend:
        fig.add_layout(Legend())
    entry = LegendItem(label=label, renderers=[mark], visible=visible)
    if shown:
        follow = CustomJS(args={"mark": mark, "shown": shown}, code=FOLLOW)
        fig.legend[0].js_on_event(LegendItemClick, follow)
    fig.legend[0].items.append(entry)
    return entry
