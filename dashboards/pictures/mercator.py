"""A Bokeh map without tiles: mercator axes, equal metres a pixel, degrees and minutes on the grid."""

from __future__ import annotations

import numpy as np
from bokeh.models import CustomJS, CustomJSTickFormatter, Range1d, WMTSTileSource
from bokeh.plotting import figure

EARTH_RADIUS_M = 6_378_137.0  # of the web mercator sphere


def mercator(lat_deg, lon_deg) -> tuple[np.ndarray, np.ndarray]:
    """Web mercator x, y [m] of latitudes and longitudes [degrees]."""
    lat, lon = np.radians(np.asarray(lat_deg, float)), np.radians(np.asarray(lon_deg, float))
    return EARTH_RADIUS_M * lon, EARTH_RADIUS_M * np.arctanh(np.sin(lat))


def from_mercator(x, y) -> tuple[np.ndarray, np.ndarray]:
    """Latitudes and longitudes [degrees] of web mercator x, y [m]."""
    lat = np.arcsin(np.tanh(np.asarray(y, float) / EARTH_RADIUS_M))
    return np.degrees(lat), np.degrees(np.asarray(x, float) / EARTH_RADIUS_M)


# Untouched, the home box fills the frame; once zoomed, a resize keeps scale and centre.
_EQUAL_SCALE = """
let W, H;
try { W = fig.inner_width; H = fig.inner_height; } catch { return; }  // not laid out yet
if (!(W > 0 && H > 0)) return;
const stretched = JSON.stringify(home_box.tags);
if (home_box.tags[4]) {  // both axes fill the frame, until the home box is another
  if (fig.__lock?.stretched === stretched) return;
  const [x0, x1, y0, y1] = home_box.tags;
  fig.x_range.setv({start: x0, end: x1}); fig.y_range.setv({start: y0, end: y1});
  fig.__lock = {stretched};
  return;
}
if (fig.__lock?.stretched) fig.__lock = null;
const x = fig.x_range, y = fig.y_range, X = x.end - x.start, Y = y.end - y.start, m = fig.__lock;
const eq = (a, b) => Math.abs(a - b) < 1e-6 * (Math.abs(X) + Math.abs(Y));
const home = home_box.tags;
const same_home = m && m.home.every((v, k) => v === home[k]);
const untouched = !m || (!m.user && eq(x.start, m.x0) && eq(x.end, m.x1) && eq(y.start, m.y0) && eq(y.end, m.y1));
let s, cx = (x.start + x.end) / 2, cy = (y.start + y.end) / 2;
if (untouched || !same_home) {
  cx = (home[0] + home[1]) / 2; cy = (home[2] + home[3]) / 2;
  s = Math.max((home[1] - home[0]) / W, (home[3] - home[2]) / H);
} else s = (eq(X, m.X) && eq(Y, m.Y)) ? m.s : Math.max(X / m.W, Y / m.H);
x.setv({start: cx - s * W / 2, end: cx + s * W / 2});
y.setv({start: cy - s * H / 2, end: cy + s * H / 2});
fig.__lock = {s, W, H, home: [...home], user: same_home && !untouched, X: x.end - x.start, Y: y.end - y.start,
              x0: x.start, x1: x.end, y0: y.start, y1: y.end};
"""

_LONGITUDE = """
const d = tick / 6378137 * 180 / Math.PI, a = Math.abs(d);
const step = Math.abs((ticks[1] - ticks[0]) / 6378137 * 180 / Math.PI * 60);
const p = Math.max(0, Math.min(3, Math.ceil(-Math.log10(step + 1e-12))));
let D = Math.floor(a + 1e-9), M = Math.max(0, (a - D) * 60);
if (M > 60 - 0.5 * 10 ** -p) { D += 1; M = 0; }
return D + '\\u00b0' + M.toFixed(p).padStart(p ? 3 + p : 2, '0') + "'" + (d < 0 ? 'W' : 'E');
"""

_LATITUDE = """
const deg = (t) => (2 * Math.atan(Math.exp(t / 6378137)) - Math.PI / 2) * 180 / Math.PI;
const d = deg(tick), a = Math.abs(d);
const step = Math.abs((deg(ticks[1]) - deg(ticks[0])) * 60);
const p = Math.max(0, Math.min(3, Math.ceil(-Math.log10(step + 1e-12))));
let D = Math.floor(a + 1e-9), M = Math.max(0, (a - D) * 60);
if (M > 60 - 0.5 * 10 ** -p) { D += 1; M = 0; }
return D + '\\u00b0' + M.toFixed(p).padStart(p ? 3 + p : 2, '0') + "'" + (d < 0 ? 'S' : 'N');
"""


def map_figure(name: str, tile_address: str = "", **options):
    """A map figure and the object that holds its home box.

    tile_address : a WMTS address such as http://chart-plotter/tiles/{Z}/{X}/{Y}.png; without one no
        request is made
    Change the home box with `show_box`.
    """
    fig = figure(
        name=name,
        x_axis_type="mercator",
        y_axis_type="mercator",
        x_range=Range1d(0, 1000),
        y_range=Range1d(0, 1000),
        sizing_mode="stretch_both",
        tools="pan,wheel_zoom,box_zoom,box_select,tap,reset,save",
        active_scroll="wheel_zoom",
        **options,
    )
    home = equal_scale(fig)
    fig.xaxis.formatter = CustomJSTickFormatter(code=_LONGITUDE)
    fig.yaxis.formatter = CustomJSTickFormatter(code=_LATITUDE)
    if tile_address:
        fig.add_tile(WMTSTileSource(url=tile_address))
    return fig, home


def equal_scale(fig) -> Range1d:
    """Keeps one length a pixel on both axes of a figure, through resizes; returns the holder of its home box.

    The figure's ranges are Range1d; the home box is the holder's tags: left, right, bottom, top; and maybe a fifth,
    not zero where both axes are to be stretched to the frame.
    """
    home = Range1d(tags=[0.0, 1000.0, 0.0, 1000.0])
    lock = CustomJS(args={"fig": fig, "home_box": home}, code=_EQUAL_SCALE)
    again = CustomJS(args={"fig": fig, "home_box": home}, code="fig.__lock = null;" + _EQUAL_SCALE)
    fig.js_on_change("inner_width", lock)
    fig.js_on_change("inner_height", lock)
    home.js_on_change("tags", lock)
    fig.js_on_event("reset", again)
    return home


def show_box(home: Range1d, x: np.ndarray, y: np.ndarray, margin: float = 0.15) -> None:
    """Makes the box round mercator points the home of a map; an analyst's own zoom goes."""
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if not len(x):
        return
    half = max(np.ptp(x), np.ptp(y), 50.0) * (0.5 + margin)
    cx, cy = (x.min() + x.max()) / 2, (y.min() + y.max()) / 2
    home.tags = [float(v) for v in (cx - half, cx + half, cy - half, cy + half)]
