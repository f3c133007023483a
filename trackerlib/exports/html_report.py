"""A fix as one HTML page that needs nothing else: the answer in words, map, residuals, numbers, pings left out."""

from __future__ import annotations

import html
import io
import re
from dataclasses import fields

import numpy as np

from trackerlib.beacon.settings import FixSettings
from trackerlib.exports.record import SIMULATED, FixRecord, Placing
from trackerlib.positions import decimal_degrees, degrees_minutes, degrees_minutes_seconds, utm

INK = {"estimate": "#cc3377", "ship": "#5a6470", "rejected": "#8a8f96"}
STYLE = """
body { font: 15px/1.45 sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em; color: #1c2126; }
table { border-collapse: collapse; margin: .6em 0 1.4em; } td { padding: .15em 1.2em .15em 0; vertical-align: top; }
td:first-child { color: #5a6470; } .simulated { background: #b85c00; color: white; padding: .4em .8em; }
svg { max-width: 100%; height: auto; } h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 1.6em; }
"""


def fix_html(record: FixRecord) -> str:
    """A self-contained HTML page of a fix, refused or not."""
    parts = [f"<h1>{html.escape(record.title)}</h1>"]
    if record.fix.simulated:
        parts.append(f'<p class="simulated">{html.escape(SIMULATED)}</p>')
    parts += [f"<p>{html.escape(line)}</p>" for line in record.summary if line != SIMULATED]
    if record.beacon is not None:
        parts += ["<h2>Position</h2>", _table(_positions(record))]
    parts += ["<h2>Map</h2>", _map(record)]
    if record.fix.residual_s is not None:
        parts += ["<h2>Residuals</h2>", _residuals(record)]
    if record.settings is not None:
        parts += ["<h2>Settings</h2>", _table(_settings(record.settings))]
    if record.placing is not None:
        parts += ["<h2>Ship's positions</h2>", _table(_placing(record.placing))]
    parts += [
        "<h2>Pings left out</h2>",
        _table(_left_out(record)) if len(record.fix.rejected) else "<p>none</p>",
    ]
    parts.append(f"<p>{html.escape(record.provenance)}</p>")
    title = html.escape(record.title)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
        f"</head><body>\n{chr(10).join(parts)}\n</body></html>\n"
    )


def _positions(record: FixRecord) -> list[tuple[str, str]]:
    place = record.beacon.lat_deg, record.beacon.lon_deg
    rows = [
        ("decimal degrees", decimal_degrees(*place)),
        ("degrees, minutes", degrees_minutes(*place)),
        ("degrees, minutes, seconds", degrees_minutes_seconds(*place)),
    ]
    if -80 <= place[0] <= 84:
        rows.append(("UTM", utm(*place)))
    return rows


def _left_out(record: FixRecord) -> list[tuple[str, str]]:
    """Reasons, each with the numbers of its pings."""
    numbers: dict[str, list[str]] = {}
    for number, why in record.left_out_because.items():
        numbers.setdefault(why, []).append(str(number))
    return [(why, ", ".join(listed)) for why, listed in numbers.items()]


def _settings(settings: FixSettings) -> list[tuple[str, str]]:
    rows = []
    for field in fields(settings):
        value = getattr(settings, field.name)
        if field.name == "profile" and value is not None:
            value = f"{len(value.depth)} depths down to {value.depth[-1]:g} m"
        if field.name == "left_out":
            value = ", ".join(map(str, sorted(value))) or "none"
        rows.append((field.name, "not told" if value is None else str(value)))
    return rows


def _placing(placing: Placing) -> list[tuple[str, str]]:
    limits, ship = placing.limits, placing.ship
    forward, starboard, down = placing.antenna_offset_m
    rows = [
        ("refused from HDOP", f"{limits.greatest_hdop:g}"),
        ("greatest age", f"{limits.greatest_age_s:g} s"),
        ("greatest gap", f"{limits.gap_s:g} s"),
        ("antenna to hydrophone", f"{forward:g} m forward, {starboard:g} m starboard, {down:g} m down"),
        ("arrivals with a position", f"{int(ship.accepted.sum())} of {len(ship.time_s)}"),
    ]
    return rows + [("", sentence) for sentence in ship.words]


def _table(rows: list[tuple[str, str]]) -> str:
    cells = "".join(f"<tr><td>{html.escape(a)}</td><td>{html.escape(b)}</td></tr>" for a, b in rows)
    return f"<table>{cells}</table>"


def _map(record: FixRecord) -> str:
    figure, axes = _axes(6.4, 5.2)
    ship, used = record.fix.ship, record.fix.used
    axes.plot(ship[:, 0], ship[:, 1], color=INK["ship"], lw=0.8, label="ship")
    axes.plot(*ship[~used, :2].T, "x", color=INK["rejected"], ms=5, label="left out")
    axes.plot(*ship[used, :2].T, ".", color=INK["ship"], ms=3, label="ping")
    if record.fix.position is not None:
        place = record.fix.present.position
        filled = INK["estimate"] if record.fix.converged else "none"
        axes.plot(
            *place[:2],
            "o",
            ms=8,
            markerfacecolor=filled,
            markeredgecolor=INK["estimate"],
            label="beacon, 95 %",
        )
        ring = record.ellipse_local()
        if ring is not None:
            axes.plot(*ring.T, color=INK["estimate"], ls="-" if record.fix.converged else "--")
    for other in record.fix.alternatives:
        axes.plot(
            other.east_m, other.north_m, "o", ms=8, markerfacecolor="none", markeredgecolor=INK["estimate"]
        )
    axes.set_aspect("equal", "datalim")
    axes.set_xlabel("east of the first ping (m)")
    axes.set_ylabel("north of the first ping (m)")
    axes.legend(fontsize=8, loc="best")
    return _svg(figure)


def _residuals(record: FixRecord) -> str:
    figure, axes = _axes(7.2, 2.6)
    number, residual, used = record.fix.number, record.residual_ms, record.fix.used
    limit = 6 * max(float(np.nanstd(residual[used])) if used.any() else 1.0, 0.1)
    axes.plot(number[used], residual[used], ".", color=INK["ship"], ms=3)
    axes.plot(number[~used], np.clip(residual[~used], -limit, limit), "x", color=INK["rejected"], ms=5)
    axes.axhline(0, color=INK["ship"], lw=0.6)
    axes.set_xlabel("ping")
    axes.set_ylabel("residual (ms)")
    return _svg(figure)


def _axes(width: float, height: float):
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def _svg(figure) -> str:
    """The drawing alone, without the file's head, which would name a place on the net."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    return re.sub(
        r"<metadata>.*?</metadata>", "", text.getvalue()[text.getvalue().index("<svg") :], flags=re.DOTALL
    )
