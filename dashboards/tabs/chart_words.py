"""What the Wet-paper chart says: of the source, of a hyperbola, of a receiver on its line."""

from __future__ import annotations

import html

import numpy as np

from dashboards.pictures.bearing_layer import distance_text
from trackerlib.beacon.bearing_lines import BearingFix
from trackerlib.beacon.navigation import PositionLimits, ship_at_receptions
from trackerlib.frames import degrees_minutes
from trackerlib.live.deck_pings import RangePlacer
from trackerlib.live.navigation_feed import FeedStatus
from trackerlib.live.navigation_file import NavigationFile, outside_words
from trackerlib.live.receiver_session import SessionStatus
from trackerlib.receiver.chart import ChartSettings
from trackerlib.receiver.hyperbola import Pass
from trackerlib.receiver.rolls import PingRoll, Roll
from trackerlib.rounding import rounded, value_with_sigma

BADGE = ' <b style="background:#B35900;color:white;border-radius:4px;padding:1px 6px">SIMULATED</b>'
LOG_HOLDS_TIMES = (
    "A survey log holds times, not sound: every mark is drawn alike, 10 ms long, and the grain is the paper's. Pings "
    "are a line each. A ping's time is that of its log line plus its travel time plus an unknown constant, so only how "
    "the trace bends counts."
)


def paper_words(roll: Roll, settings: ChartSettings, shown: int, missed: int, threshold: float) -> str:
    """What lies on the paper, as HTML."""
    name = html.escape(roll.source)
    kind = BADGE if roll.simulated else ""
    what = f"{settings.interval_s:.4f} s across, the newest line at the bottom."
    if isinstance(roll, PingRoll):
        return f"<b>{shown} of {len(roll.pings)} pings</b> of {name}{kind}, a line each, {what}"
    text = f"<b>{shown} lines</b> of {name}{kind}, {what}"
    loud = int(np.sum(roll.arrivals.level >= threshold))
    return f"{text} {loud} arrivals above the threshold; {missed} of the lines kept have none."


def position_notes(
    navigation: NavigationFile, name: str, roll: Roll | None, threshold: float, limits: PositionLimits
) -> list[str]:
    """What the positions beside a recording are worth: how many, at how many arrivals, and what was refused."""
    fixes = navigation.fixes
    simulated = "SIMULATED " if navigation.simulated else ""
    notes = [f"{name}: {len(fixes.time_s)} {simulated}positions ({navigation.layout})"]
    if navigation.bad_records:
        first = navigation.bad_records[0]
        notes.append(
            f"{len(navigation.bad_records)} lines gave none, the first is line {first.line}: {first.why}"
        )
    if roll is None:
        return notes
    outside = outside_words(fixes, roll.until_s)
    if outside:
        return [*notes, outside]
    loud = roll.arrivals.arrival_s[roll.arrivals.level >= threshold]
    ship = ship_at_receptions(fixes, loud, limits)
    notes.append(f"{int(ship.accepted.sum())} of {len(loud)} arrivals above the threshold have a position")
    notes += [f"{count} arrivals refused: {why}" for why, count in ship.refused]
    return notes + [f"{count} positions refused: {why}" for why, count in ship.fixes_refused]


def receiver_words(
    status: SessionStatus | None, pings: int, unplaced: int, kept: str, sample_interval_s: tuple[float, float]
) -> str:
    """How the receiver on its line does, as HTML.

    sample_interval_s : by the host's clock, and its standard error; NaN if not known
    """
    if status is None:
        return (
            "<b>No receiver is connected.</b> Name its serial device or <code>tcp:HOST:PORT</code> and press Connect; "
            "or start the emulator, which is a simulated receiver with a GPS."
        )
    attenuation = "not known" if not np.isfinite(status.attenuation_db) else f"{status.attenuation_db:.0f} dB"
    state = {"listening": "Listening", "waiting": "Waiting for the line", "stopped": "Stopped"}[status.state]
    words = [
        f"<b>{state}</b>: {status.periods} periods, {status.missed} missed, {status.uncertain} of unknown number; "
        f"{status.positions} positions; attenuation {attenuation}; {status.baud} baud.",
        f"{pings} pings followed and given to the beacon fix.",
    ]
    if np.isfinite(sample_interval_s).all():
        told = value_with_sigma(1e3 * sample_interval_s[0], 1e3 * sample_interval_s[1], "ms")
        words.append(f"Sample interval by this machine's clock {told}.")
    if unplaced:
        words.append(f"{unplaced} more had no ship's position.")
    if status.no_position:
        words.append(f"GPS: {html.escape(status.no_position)}.")
    if status.words:
        words.append(f"<span style='color:#C62828'>{html.escape(status.words)}.</span>")
    if status.lost:
        words.append(f"<span style='color:#C62828'>{status.lost} bytes or rows could not be kept.</span>")
    if kept:
        words.append(f"Kept in {html.escape(kept)}.")
    return " ".join(words)


def feed_words(feed: FeedStatus, what: str = "Positions from") -> str:
    """How a line of positions does, as HTML."""
    reader = feed.reader
    state = {"connected": "listening", "waiting": "waiting for it", "ended": "ended", "stopped": "stopped"}
    words = [f"<b>{what} {html.escape(feed.name)}</b>, {state[reader.state]}: {feed.positions} positions."]
    if reader.state == "connected" and not reader.bytes:
        words.append("Nothing has come yet.")
    if feed.refused:
        counts = ", ".join(f"{count} of {html.escape(why)}" for why, count in feed.refused)
        words.append(f"Refused: {counts}; the latest: {html.escape(feed.last_refused)}.")
    if reader.words:
        words.append(f"<span style='color:#C62828'>{html.escape(reader.words)}.</span>")
    if reader.dropped or reader.raw_lost:
        lost = f"{reader.dropped} lines and {reader.raw_lost} bytes could not be kept"
        words.append(f"<span style='color:#C62828'>{lost}.</span>")
    return " ".join(words)


def ranges_words(placer: RangePlacer, placed: int) -> str:
    """What became of a deck unit's ranges, as HTML."""
    words = [
        f"<b>{placer.ranges} ranges of the deck unit</b>, {placer.no_reply} without a reply; {placed} pings given to "
        "the beacon fix, of half the time each, turnaround off."
    ]
    if placer.too_short:
        words.append(f"{placer.too_short} were shorter than the turnaround.")
    if placer.unplaced:
        words.append(f"{placer.unplaced} had no ship's position.")
    return " ".join(words)


def deck_words(feeds: tuple[FeedStatus, ...], placer: RangePlacer | None, placed: int, kept: str) -> str:
    """How a deck unit on its line does, as HTML."""
    if not feeds or placer is None:
        return (
            "<b>No deck unit is connected.</b> Name its serial device, <code>tcp:HOST:PORT</code> or "
            "<code>udp:PORT</code>, and where the ship's positions come from if not on the same line, and press "
            "Connect. Lines such as <code>RNG: TX = 11.0 RX = 12.0 time = 08.807 Sec.</code> are wanted."
        )
    words = [ranges_words(placer, placed)]
    if kept:
        words.append(f"Kept in {html.escape(kept)}.")
    return " ".join(words) + "".join(f"<br>{feed_words(feed, 'Line')}" for feed in feeds)


def pass_words(found: Pass | None, marks: int, when: str) -> str:
    """Closest approach of the marked trace, in a sentence, as HTML.

    when : the time of closest approach as a person would say it
    """
    if found is None:
        if not marks:
            return (
                "Drag a box or lasso round a trace, or click on it, to mark it; a click on a mark takes it away. "
                "<b>Hyperbola</b> then tells the closest approach."
            )
        return f"{marks} marks. <b>Hyperbola</b> fits their closest approach."
    if found.line is None:
        return f"<b>No closest approach:</b> {html.escape(found.reason or '')}."
    line = found.line
    words = (
        f"<b>Closest approach {when}, line {found.closest_emission:.1f} ± {found.sigma_emission:.1f}: "
        f"{html.escape(distance_text(line))}</b> of slant distance. The beacon bears "
        f"{line.bearing_deg:.0f}° or {(line.bearing_deg + 180) % 360:.0f}° from "
        f"{html.escape(degrees_minutes(line.lat_deg, 'NS'))}, {html.escape(degrees_minutes(line.lon_deg, 'EW'))}; the "
        f"line is sure to {rounded(line.sigma_along_m)} m along the track."
    )
    if found.reason:
        words += f" {html.escape(found.reason[0].upper() + found.reason[1:])}."
    return words


def bearing_words(fix: BearingFix | None, count: int) -> str:
    """What the bearing lines say together, as HTML."""
    if fix is None:
        return ""
    lines = f"{count} bearing line{'s' if count > 1 else ''}"
    if not fix.converged:
        return f"<b>{lines}, no fix:</b> {html.escape(fix.reason or '')}."
    shape = fix.ellipse
    depth = ""
    if fix.depth_m is not None:
        depth = f", {value_with_sigma(fix.depth_m, fix.sigma_depth_m, 'm')} below the hydrophone"
    return (
        f"<b>{lines} meet at {html.escape(degrees_minutes(fix.lat_deg, 'NS'))}, "
        f"{html.escape(degrees_minutes(fix.lon_deg, 'EW'))}</b>{depth}; 95 % ellipse {rounded(shape.semi_major_m)} by "
        f"{rounded(shape.semi_minor_m)} m, long axis {shape.bearing_deg:.0f}°."
    )
