"""`fix PINGS`: a beacon's position from a survey, with its uncertainty or the reason why there is none."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path

from trackerlib.beacon.choice import compare_models, usual_models, verdict
from trackerlib.beacon.error_budget import error_budget
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.intervals import Interval, bootstrap_intervals, interval_words, profile_intervals
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix, chi_square_words
from trackerlib.beacon.settings import FixSettings
from trackerlib.commands.fix_document import (
    document,
    interval_document,
    sigma_words,
    steadiest_words,
    step_document,
)
from trackerlib.commands.survey_inputs import add_survey_arguments, read_and_count
from trackerlib.exports.export import SUFFIXES, export_fix
from trackerlib.rounding import rounded, value_with_sigma

MOST_NAMED = 40  # pings that a report lists by number
SUMMARY = "fix a beacon from a survey file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `fix`."""
    add_survey_arguments(parser)
    _about_the_answer(parser.add_argument_group("the answer"))


def _about_the_answer(group) -> None:
    add = group.add_argument
    add(
        "--export",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help=f"also write one of {', '.join(SUFFIXES)}; again for further files",
    )
    add(
        "--intervals",
        choices=("profile", "bootstrap"),
        help="also 95 %% intervals that need no ellipse, by profile likelihood or by resampled residuals",
    )
    add("--compare", action="store_true", help="also score the motions and speeds of sound to choose from")
    add("--log", action="store_true", help="also tell how the minimisation went, step by step")
    add("--gpx-version", choices=("1.1", "1.0"), default="1.1", help="of an exported .gpx (default 1.1)")


def run(args: argparse.Namespace) -> dict:
    """The answer of `fix` as a document for JSON."""
    pings, settings, refused, placing = read_and_count(args)
    fix = fix_beacon(pings, settings)
    intervals, warnings = _intervals(pings, fix, settings, args.intervals)
    for path in args.export:
        layout = f"gpx-{args.gpx_version}" if path.suffix.lower() == ".gpx" else None
        export_fix(fix, path, layout, pings=pings, settings=settings, intervals=intervals, placing=placing)
    answer = document(fix) | {"refused": refused, "warnings": warnings}
    if args.intervals is not None:
        answer["interval95_m"] = intervals and interval_document(intervals)
    if args.log:
        answer["log"] = [step_document(step) for step in fix.log]
    if args.compare:
        answer |= _comparison(pings, settings)
    if fix.uncertainty is not None and fix.position is not None:
        budget = error_budget(pings, fix, settings)
        answer["error_budget_m"] = {name: list(values) for name, values in asdict(budget).items()}
    return answer


def _comparison(pings: Pings, settings: FixSettings) -> dict:
    """The usual models scored, and which of them the pings choose."""
    scores = compare_models(pings, usual_models(settings))
    models = [
        {
            "name": score.name,
            "motion": score.settings.motion,
            "parameters": score.parameters,
            "converged": score.fix.converged,
            "aicc_above_best": score.aicc,
            "held_out_ms": 1e3 * score.held_out_s,
        }
        for score in scores
    ]
    return {"models": models, "verdict": verdict(scores)}


def _intervals(
    pings: Pings, fix: BeaconFix, settings: FixSettings, how: str | None
) -> tuple[dict[str, Interval] | None, list[str]]:
    """The 95 % intervals asked for, and a warning where the ellipse is not enough."""
    if not fix.converged or settings.method != "all-pings":
        return None, []
    profile = profile_intervals(pings, fix, settings)
    sentence = interval_words(fix, profile)
    warnings = [] if sentence is None else [sentence]
    if how is None:
        return None, warnings
    return profile if how == "profile" else bootstrap_intervals(pings, fix, settings), warnings


def report(answer: dict) -> str:
    """The answer of `fix` for a person."""
    lines = ["SIMULATED DATA"] if answer["simulated"] else []
    lines += [] if answer["converged"] else [f"No fix: {answer['reason']}"]
    lines += _place_lines(answer) + _clock_lines(answer)
    if "present" in answer:
        lines += _motion_lines(answer)
    lines += _further_lines(answer)
    named, more = answer["rejected"][:MOST_NAMED], len(answer["rejected"]) - MOST_NAMED
    rejected = (", ".join(map(str, named)) or "none") + (f" and {more} more" if more > 0 else "")
    rms = "" if answer["rms_ms"] is None else f", rms residual {answer['rms_ms']:.2g} ms"
    lines.append(f"pings     {answer['used']} of {answer['pings']} used{rms}; left out: {rejected}")
    lines += [f"step      {step['words']}" for step in answer.get("log", [])]
    return "\n".join(lines)


def _place_lines(answer: dict) -> list[str]:
    """Where it lies, and how surely."""
    lines = []
    if answer["lat_deg"] is not None:
        lines.append(
            f"{'position' if answer['converged'] else 'best guess'}  {answer['lat_deg']:.7f}, {answer['lon_deg']:.7f}"
        )
        lines.append(f"depth     {value_with_sigma(answer['depth_m'], answer['sigma_depth_m'], 'm')}")
    if answer["sigma_east_m"] is not None:
        lines.append(f"sigma     {sigma_words(answer)}")
        shape = answer["ellipse95"]
        lines.append(
            f"ellipse   95 %: {rounded(shape['semi_major_m'])} by {rounded(shape['semi_minor_m'])} m, "
            f"long axis {shape['bearing_deg']:.0f} degrees from true north"
        )
    if answer.get("interval95_m"):
        lines.append(
            "interval  95 %: "
            + "; ".join(
                f"{name} {_bound(low)} to {_bound(high)}"
                for name, (low, high) in answer["interval95_m"].items()
            )
        )
    return lines


def _clock_lines(answer: dict) -> list[str]:
    """The pinger's interval, where it was estimated."""
    lines = []
    if "interval_s" in answer:
        lines.append(
            f"pinger    every {value_with_sigma(answer['interval_s'], answer['sigma_interval_s'], 's')}"
        )
    if "interval_drift_ppm_per_hour" in answer:
        drift, sigma = answer["interval_drift_ppm_per_hour"], answer["sigma_interval_drift_ppm_per_hour"]
        lines.append(f"drift     {value_with_sigma(drift, sigma, 'ppm')} an hour")
    return lines


def _motion_lines(answer: dict) -> list[str]:
    """How it moves, where it is by now, and where it comes up."""
    lines = []
    now, velocity, sigma = answer["present"], answer["velocity_mps"], answer["sigma_velocity_mps"]
    lines.append("that was at the first ping; it moves")
    lines.append(
        "velocity  "
        + ", ".join(
            f"{value_with_sigma(value, error, 'm/s')} {way}"
            for value, error, way in zip(velocity, sigma, ("east", "north", "up"), strict=True)
            if error > 0
        )
    )
    lines.append(
        f"now       {now['lat_deg']:.7f}, {now['lon_deg']:.7f}, depth {now['depth_m']:.1f} m; "
        f"sigma {sigma_words(now)}"
    )
    lines.append(f"steadiest {steadiest_words(answer['steadiest'])}")
    if "surfaces" in answer:
        up = answer["surfaces"]
        lines.append(
            f"surfaces  {value_with_sigma(up['epoch_s'], up['sigma_epoch_s'], 's')} after the first ping, at "
            f"{up['lat_deg']:.6f}, {up['lon_deg']:.6f} (sigma {sigma_words(up)})"
        )
    return lines


def _further_lines(answer: dict) -> list[str]:
    """What the errors are made of, what fits as well, and what is to be noted."""
    lines = []
    if answer["sound_speed_mps"] is not None:
        speed = value_with_sigma(answer["sound_speed_mps"], answer["sigma_sound_speed_mps"], "m/s")
        lines.append(f"sound     {speed}, mean of the way")
    if "error_budget_m" in answer:
        causes = [
            f"{rounded(values[2])} m {name.replace('_', ' ')}"
            for name, values in answer["error_budget_m"].items()
        ]
        lines.append(f"of depth  sigma from {', '.join(causes)}")
    if answer.get("along_track_m") is not None:
        along = value_with_sigma(answer["along_track_m"], answer["sigma_along_track_m"], "m")
        closest = value_with_sigma(
            answer["closest_slant_range_m"], answer["sigma_closest_slant_range_m"], "m"
        )
        lines.append(f"along track {along} from the first ping")
        lines.append(f"closest slant range {closest}")
    lines += [
        f"model     {m['name']}: AICc {m['aicc_above_best']:.1f} above the best, "
        f"held-out pings {m['held_out_ms']:.3g} ms"
        for m in answer.get("models", [])
    ]
    if "verdict" in answer:
        lines.append(f"choice    {answer['verdict']}")
    lines += [
        f"also fits {a['lat_deg']:.6f}, {a['lon_deg']:.6f}, depth {a['depth_m']:.0f} m, "
        f"{chi_square_words(a['chi_square_above_best'])}"
        for a in answer["alternatives"]
    ]
    lines += [f"note      {sentence}" for sentence in [*answer["notes"], *answer["warnings"]]]
    return lines


def _bound(value: float) -> str:
    return f"{value:.1f} m" if math.isfinite(value) else "open"
