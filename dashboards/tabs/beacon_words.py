"""What the Beacon fix tab says of a fix: a sentence, numbers, positions to copy."""

from __future__ import annotations

import html
import json
from dataclasses import asdict

import numpy as np

from trackerlib.beacon.choice import verdict
from trackerlib.beacon.convergence import Step
from trackerlib.beacon.error_budget import ErrorBudget
from trackerlib.beacon.result import BeaconFix
from trackerlib.commands.fix_document import document, motion_document, steadiest_words
from trackerlib.frames import degrees_minutes, utm
from trackerlib.positions import degrees_minutes_seconds
from trackerlib.rounding import rounded, value_with_sigma

CELL = " style='padding:1px 10px 1px 0;vertical-align:top'"


def sentence(fix: BeaconFix) -> str:
    """The answer as a person would read it aloud, with what must be noted beside it, as HTML."""
    return _answer(fix) + "".join(f" <b>Note:</b> {html.escape(note)}." for note in fix.notes)


def _answer(fix: BeaconFix) -> str:
    if fix.converged:
        now = fix.present
        shape = now.ellipse
        words = (
            f"<b>The beacon {'lies' if fix.velocity is None else 'is now'} at "
            f"{html.escape(degrees_minutes(now.lat_deg, 'NS'))}, "
            f"{html.escape(degrees_minutes(now.lon_deg, 'EW'))}</b>, depth "
            f"{value_with_sigma(now.depth_m, now.sigma[2], 'm')}. With 95 % probability it is within an ellipse "
            f"of {rounded(shape.semi_major_m)} by {rounded(shape.semi_minor_m)} m whose long axis bears "
            f"{shape.bearing_deg:.0f}°."
        )
        return words if fix.velocity is None else words + " " + movement(fix)
    words = f"<b>No fix yet:</b> {html.escape(fix.reason or '')}."
    if fix.along_track_m is not None:
        along = value_with_sigma(fix.along_track_m, fix.sigma_along_track_m, "m")
        closest = value_with_sigma(fix.closest_slant_range_m, fix.sigma_closest_slant_range_m, "m")
        words += (
            f" Along the track it is {along} from the first ping, {closest} of slant range from the line."
        )
    return words


def movement(fix: BeaconFix) -> str:
    """How a moving beacon moves, and when and where a rising one comes up."""
    east, north, up = (float(value) for value in fix.velocity)
    parts = []
    if east or north:
        sigma = float(np.sqrt(np.trace(fix.uncertainty.covariance[3:5, 3:5]) / 2))
        bearing = np.degrees(np.arctan2(east, north)) % 360
        parts.append(f"drifts {value_with_sigma(np.hypot(east, north), sigma, 'm/s')} towards {bearing:.0f}°")
    if up:
        way = "rises" if up > 0 else "sinks"
        parts.append(f"{way} at {value_with_sigma(abs(up), float(fix.uncertainty.sigma[5]), 'm/s')}")
    return f"It {' and '.join(parts)}.{_surfacing(fix)}"


def _surfacing(fix: BeaconFix) -> str:
    up = motion_document(fix).get("surfaces")
    if up is None:
        return ""
    wait_s = up["epoch_s"] - fix.present.elapsed_s
    return (
        f" It comes to the surface in {value_with_sigma(wait_s / 60, up['sigma_epoch_s'] / 60, 'min')} at "
        f"{html.escape(degrees_minutes(up['lat_deg'], 'NS'))}, {html.escape(degrees_minutes(up['lon_deg'], 'EW'))} "
        f"(± {rounded(up['sigma_east_m'])} m east, ± {rounded(up['sigma_north_m'])} m north)."
    )


def table(fix: BeaconFix, budget: ErrorBudget | None = None) -> str:
    """The numbers below the sentence, as HTML."""
    rows = []
    if fix.position is not None:
        now = fix.present
        sigma = now.sigma if now.sigma is not None else (None, None, None)
        rows = [
            ("east of first ping", value_with_sigma(float(now.position[0]), sigma[0], "m")),
            ("north of first ping", value_with_sigma(float(now.position[1]), sigma[1], "m")),
            ("depth", value_with_sigma(now.depth_m, sigma[2], "m")),
        ]
        rows += [(name, text) for name, text in position_texts(fix).items() if name != "everything"]
    if (then := motion_document(fix).get("steadiest")) is not None:
        rows.append(("known best", steadiest_words(then)))
    if fix.uncertainty is not None:
        rows += [
            ("rms residual", f"{1e3 * fix.uncertainty.rms_s:.3g} ms"),
            ("residuals that count as one", f"{fix.uncertainty.correlation.length:.1f}"),
        ]
    if budget is not None:
        parts = [
            f"{rounded(values[2])} m {name.replace('_', ' ')}" for name, values in asdict(budget).items()
        ]
        rows.append(("depth's sigma is made of", ", ".join(parts)))
    if fix.sound_speed_mps is not None:
        rows.append(
            ("mean sound speed", value_with_sigma(fix.sound_speed_mps, fix.sigma_sound_speed_mps, "m/s"))
        )
    rows.append(("pings used", f"{int(fix.used.sum())} of {len(fix.used)}"))
    left_out = ", ".join(map(str, fix.rejected[:20])) + (" …" if len(fix.rejected) > 20 else "")
    rows.append(("left out", left_out or "none"))
    cells = "".join(
        f'<tr><td style="opacity:.75;padding:1px 8px 1px 0;vertical-align:top">{html.escape(name)}</td>'
        f"<td>{html.escape(text)}</td></tr>"
        for name, text in rows
    )
    return f"<table>{cells}</table>"


def models_table(scores) -> str:
    """Which model the pings choose, and models side by side, the best first, as HTML."""
    cells = "".join(
        f"<tr><td{CELL}>{html.escape(score.name)}</td>"
        f"<td{CELL}>{'no place' if np.isinf(score.aicc) else f'{score.aicc:.1f}'}</td>"
        f"<td>{'' if np.isnan(score.held_out_s) else f'{1e3 * score.held_out_s:.3g} ms'}</td></tr>"
        for score in scores
    )
    return (
        f"<p style='margin:6px 0'>{html.escape(verdict(scores))}</p>"
        "<table><tr style='opacity:.75;text-align:left'><td>the beacon</td><td>AICc above best</td>"
        f"<td>held-out pings</td></tr>{cells}</table>"
    )


def estimators_table(fixes: dict[str, BeaconFix]) -> str:
    """Fixes of the same pings side by side, as an HTML table."""
    rows = []
    for fix in fixes.values():
        if fix.position is None:
            rows.append(f"<td colspan=5>no place: {html.escape(fix.reason or '')}</td>")
            continue
        now = fix.present
        east, north, _ = now.position
        sigma = now.sigma if now.sigma is not None else (None, None, None)
        values = [
            value_with_sigma(float(east), sigma[0], "m"),
            value_with_sigma(float(north), sigma[1], "m"),
            value_with_sigma(now.depth_m, sigma[2], "m"),
            ""
            if now.ellipse is None
            else f"{rounded(now.ellipse.semi_major_m)} × {rounded(now.ellipse.semi_minor_m)} m",
            "" if fix.converged else f"not believed: {fix.reason}",
        ]
        rows.append("".join(f"<td{CELL}>{html.escape(value)}</td>" for value in values))
    cells = "".join(
        f"<tr><td{CELL}>{html.escape(name)}</td>{row}</tr>" for name, row in zip(fixes, rows, strict=True)
    )
    titles = ("estimator", "east of first ping", "north", "depth", "95 % ellipse", "")
    head = "".join(f"<td{CELL}>{title}</td>" for title in titles)
    return f"<table><tr style='opacity:.75;text-align:left'>{head}</tr>{cells}</table>"


def log_table(log: tuple[Step, ...]) -> str:
    """The steps of a fix as an HTML table."""
    rows = "".join(
        f"<tr><td{CELL}>{html.escape(step.stage)}, {step.iteration}</td>"
        f"<td{CELL}>{'' if step.rms_ms is None else f'{step.rms_ms:.4g} ms'}</td>"
        f"<td{CELL}>{'' if step.step_m is None else f'{step.step_m:.2g} m'}</td><td>{step.pings}</td></tr>"
        for step in log
    )
    return (
        f"<table><tr style='opacity:.75;text-align:left'><td{CELL}>stage, iteration</td><td{CELL}>rms</td>"
        f"<td{CELL}>moved</td><td>pings</td></tr>{rows}</table>"
    )


def edits_table(reasons: dict[int, str]) -> str:
    """Pings left out by hand with their reasons, as HTML."""
    if not reasons:
        return "No ping is left out by hand."
    rows = "".join(
        f"<tr><td{CELL}>{number}</td><td>{html.escape(why) or 'no reason told'}</td></tr>"
        for number, why in reasons.items()
    )
    return f"<table><tr style='opacity:.75'><td{CELL}>ping</td><td>left out because</td></tr>{rows}</table>"


def position_texts(fix: BeaconFix) -> dict[str, str]:
    """The position as people copy it: decimal degrees, degrees and minutes, UTM where it is defined, and JSON."""
    if fix.position is None:
        return {}
    now = fix.present
    grid = {}
    if -80 <= now.lat_deg <= 84:
        zone, easting, northing = utm(now.lat_deg, now.lon_deg)
        grid = {"UTM": f"{zone} {easting:.2f} E {northing:.2f} N (WGS 84)"}
    return {
        "degrees": f"{now.lat_deg:.8f}, {now.lon_deg:.8f}",
        "minutes": f"{degrees_minutes(now.lat_deg, 'NS')}, {degrees_minutes(now.lon_deg, 'EW')}",
        "seconds": degrees_minutes_seconds(now.lat_deg, now.lon_deg),
        **grid,
        "everything": json.dumps(document(fix)),
    }
