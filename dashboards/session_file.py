"""A session saved as a file of its settings and choices, and put back over the data that are open."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, replace
from typing import TYPE_CHECKING

import param

from trackerlib import __version__
from trackerlib.crossover.edits import edits_csv, parse_edits
from trackerlib.textfiles import InputError, decode_lines

if TYPE_CHECKING:
    from dashboards.session import Session

SAVED = ("mode", "max_slant_range_ft", "gap_counts", "speed", "live")


def session_json(session: Session) -> str:
    """Settings, choices and the names of the inputs."""
    settings = {
        field.name: getattr(session.fix_settings, field.name)
        for field in fields(session.fix_settings)
        if field.name not in ("profile", "left_out")
    }
    run, chosen = session.campaign_run, session.crossover
    document = {
        "workbench_session": 1,
        "version": __version__,
        "simulated": session.simulated,
        "inputs": {
            "pings": session.pings.source if session.pings is not None else None,
            "tfile": session.tfile.reports.source if session.tfile is not None else None,
            "run": None if run is None else f"{session.campaign.name}: {run}",
        },
        **{name: getattr(session, name) for name in SAVED},
        "fix_settings": settings,
        "position_limits": asdict(session.position_limits),
        "antenna_offset_m": session.antenna_offset_m,
        "left_out": {str(n): session.reasons.get(n, "") for n in sorted(session.fix_settings.left_out)},
        "chosen_set": None if chosen is None else [*chosen.pair, chosen.pass_number],
        "point_edits": edits_csv(session.edits),
        "timing_options": session.timing_options,
    }
    return json.dumps(document, indent=1)


def restore_session(session: Session, content: bytes, name: str) -> None:
    """Puts the settings of a session file over the data that are open. Raises InputError where it is none."""
    try:
        document = json.loads("\n".join(decode_lines(content, name)))
        kept = {key: document[key] for key in SAVED if key in document}
        told = document.get("fix_settings", {})
        told = {key: tuple(value) if isinstance(value, list) else value for key, value in told.items()}
        reasons = {int(number): str(why) for number, why in document.get("left_out", {}).items()}
        settings = replace(session.fix_settings, **told, left_out=frozenset(reasons))
        limits = replace(session.position_limits, **document.get("position_limits", {}))
        forward, starboard, down = map(float, document.get("antenna_offset_m", session.antenna_offset_m))
        with param.parameterized.discard_events(session):
            session.param.update(**kept)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"{name}: not a session file of this program ({error})") from None
    session.param.update(
        fix_settings=settings, reasons=reasons, position_limits=limits, antenna_offset_m=(forward, starboard, down)
    )  # fmt: skip
    session.gate()
    if "point_edits" in document:
        session.edits = parse_edits(document["point_edits"].splitlines(), name)[0]
    session.timing_options = session.timing_options | document.get("timing_options", {})
    chosen = document.get("chosen_set")
    if chosen and session.gating is not None:
        for one in session.gating.sets:
            if [*one.pair, one.pass_number] == chosen:
                session.crossover = one
    session.say(f"{name}: settings restored; the data files themselves are opened on their own")
