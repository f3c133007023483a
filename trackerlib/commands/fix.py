"""`fix PINGS`: a beacon's position from a survey, with its uncertainty or the reason why there is none."""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np

from trackerlib.beacon.choice import compare_models, usual_models, verdict
from trackerlib.beacon.error_budget import error_budget
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.intervals import Interval, bootstrap_intervals, interval_words, profile_intervals
from trackerlib.beacon.motion import MOTIONS
from trackerlib.beacon.navigation import Receptions
from trackerlib.beacon.pairs import LEAST_EXPERIMENTS
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.result import BeaconFix, chi_square_words
from trackerlib.beacon.settings import METHODS, FixSettings
from trackerlib.commands.fix_document import document, interval_document, steadiest_words, step_document
from trackerlib.commands.position_limits import add_limits, limits_of
from trackerlib.exports.export import SUFFIXES, export_fix
from trackerlib.exports.record import Placing
from trackerlib.rounding import value_with_sigma
from trackerlib.surveyfiles.profile_csv import read_profile_csv
from trackerlib.surveyfiles.stream_csv import read_arrivals, read_navigation
from trackerlib.surveyfiles.survey import LAYOUTS, read_survey
from trackerlib.textfiles import InputError, read_lines

MOST_NAMED = 40  # pings that a report lists by number
SUMMARY = "fix a beacon from a survey file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `fix`."""
    _about_the_file(parser)
    _about_the_estimator(parser)
    _about_the_water_and_the_clock(parser)
    _about_the_ship(parser)
    _about_the_answer(parser)


def _about_the_file(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("pings", type=Path, metavar="PINGS", help="csv of pings, or a survey log of the SIO or WHOI kind")
    add("--format", choices=LAYOUTS, default="auto", help="layout of the file (default: look at it)")
    add("--transponder", metavar="NAME", help="which one, where a csv holds several")
    add(
        "--navigation",
        type=Path,
        metavar="FILE",
        help="csv time_s, lat_deg, lon_deg, hdop, heading_deg; PINGS then "
        "has arrival_s by the same clock, and --interval-s is needed",
    )
    add(
        "--sample-interval-ms",
        type=float,
        metavar="S",
        help="step of the one-way times (default: found in the file)",
    )


def _about_the_estimator(parser: argparse.ArgumentParser) -> None:
    add, defaults = parser.add_argument, FixSettings()
    add(
        "--method",
        choices=METHODS,
        default=METHODS[0],
        help="every ping, the thesis's experiments, or usual least squares",
    )
    add("--experiments", type=int, metavar="N", help="pairs: how many (default: as many as there are)")
    add("--spacing", type=int, metavar="K", help="pairs: receptions from first to second (default: thesis's)")
    add("--step", type=int, metavar="J", help="pairs: receptions from one pair to the next (default: K)")
    motion = parser.add_mutually_exclusive_group()
    motion.add_argument("--motion", choices=MOTIONS, default=MOTIONS[0], help="how the beacon may move")
    motion.add_argument("--moving", dest="motion", action="store_const", const="free", help="--motion free")
    add("--max-speed-mps", type=float, default=defaults.max_speed_mps, metavar="V", help="of the beacon")
    add("--start", type=_place, metavar="LAT,LON,DEPTH_M", help="a further place to start from")
    add("--max-range-m", type=float, default=defaults.max_range_m, metavar="R")
    add("--max-depth-m", type=float, default=defaults.max_depth_m, metavar="D")
    add(
        "--reject",
        choices=("auto", "none"),
        default="auto",
        help="leave out false returns (of experiments: those that every ping tells), or nothing",
    )


def _about_the_water_and_the_clock(parser: argparse.ArgumentParser) -> None:
    add, defaults = parser.add_argument, FixSettings()
    water = parser.add_mutually_exclusive_group()
    water.add_argument("--sound-speed-mps", type=float, default=defaults.sound_speed_mps, metavar="C")
    water.add_argument("--profile", type=Path, metavar="FILE", help="csv depth_m, speed_mps")
    add("--sound-speed-sigma-mps", type=float, metavar="S", help="default 2, or 0.5 with a profile")
    add("--estimate-sound-speed", action="store_true", help="too; the one told and its sigma are the prior")
    add("--estimate-interval", action="store_true", help="too; the one told is nearly right")
    add("--estimate-interval-drift", action="store_true", help="and how it changes")
    add("--interval-s", type=float, metavar="T", help="of the pinger: times are known up to multiples of it")
    add("--emission-known", action="store_true", help="times are true travel times")
    add(
        "--turnaround-ms",
        type=float,
        metavar="T",
        help="delay inside two-way times (default: the file's, else 13)",
    )


def _about_the_ship(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--gps-rms-m",
        type=_one_or_two,
        metavar="G[,N]",
        help="ship position error, each of east and north, or both apart",
    )
    add("--gps-correlation-s", type=float, metavar="S", help="in which that error's correlation falls by e")
    add(
        "--antenna-sigma-m",
        type=_one_or_two,
        default=0.0,
        metavar="H[,V]",
        help="sigma of the offset from antenna to hydrophone: each of forward and starboard, and down",
    )
    add("--hydrophone-depth-m", type=float, default=0.0, metavar="H", help="where the file does not say")
    add_limits(parser)
    add(
        "--antenna-offset-m",
        type=_offset,
        default=(0.0, 0.0, 0.0),
        metavar="F,S,D",
        help="from antenna to hydrophone: forward, starboard, down",
    )


def _about_the_answer(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--export",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help=f"also write {', '.join(SUFFIXES)}",
    )
    add(
        "--intervals",
        choices=("profile", "bootstrap"),
        help="also 95 %% intervals that need no ellipse, by profile likelihood or by resampled residuals",
    )
    add("--compare", action="store_true", help="also score the motions and speeds of sound to choose from")
    add("--log", action="store_true", help="also tell how the minimisation went, step by step")
    add("--gpx-version", choices=("1.1", "1.0"), default="1.1", help="of an exported .gpx")


def read(args: argparse.Namespace) -> tuple[Pings, FixSettings]:
    """The survey and the settings that the options of `fix` tell; raises InputError."""
    return read_and_count(args)[:2]


def read_and_count(
    args: argparse.Namespace,
) -> tuple[Pings, FixSettings, dict[str, dict[str, int]], Placing | None]:
    """The same, of what was refused (lines, positions, arrivals) how many for which reason, and how it was placed."""
    if args.navigation is not None:
        pings, refused, placing = _from_stream(args)
        return pings, _settings(args), refused, placing
    reading = read_survey(
        args.pings,
        layout=args.format,
        turnaround_s=None if args.turnaround_ms is None else args.turnaround_ms * 1e-3,
        transponder=args.transponder,
        hydrophone_depth_m=args.hydrophone_depth_m,
    )
    for record in reading.bad_records:
        print(f"{args.pings.name}, line {record.line}: {record.why}", file=sys.stderr)
    for note in reading.notes:
        print(f"{args.pings.name}: {note}", file=sys.stderr)
    return reading.pings, _settings(args), {"lines": _by_reason(reading.bad_records)}, None


def _by_reason(records) -> dict[str, int]:
    return dict(Counter(record.why for record in records))


def _from_stream(args: argparse.Namespace) -> tuple[Pings, dict[str, dict[str, int]], Placing]:
    """Pings of arrivals and a navigation stream; what was refused is counted, on standard error too."""
    if args.interval_s is None:
        raise InputError("--navigation needs --interval-s, the interval of the pinger")
    arrivals = read_arrivals(read_lines(args.pings), args.pings.name)
    fixes, bad = read_navigation(read_lines(args.navigation), args.navigation.name)
    for path, records in ((args.pings, arrivals.bad_records), (args.navigation, bad)):
        for record in records:
            print(f"{path.name}, line {record.line}: {record.why}", file=sys.stderr)
    receptions = Receptions(
        arrivals.number, arrivals.arrival_s, fixes, source=args.pings.name, simulated=arrivals.simulated
    )
    pings, ship = receptions.pings(limits_of(args), args.antenna_offset_m, args.hydrophone_depth_m)
    refused = {"positions": dict(ship.fixes_refused), "arrivals": dict(ship.refused)}
    for sentence in ship.words:
        print(sentence, file=sys.stderr)
    lines = {"lines": _by_reason([*arrivals.bad_records, *bad])}
    return pings, lines | refused, Placing(ship, limits_of(args), args.antenna_offset_m)


def _settings(args: argparse.Namespace) -> FixSettings:
    antenna = np.atleast_1d(args.antenna_sigma_m).tolist()
    try:
        settings = FixSettings(
            sound_speed_mps=args.sound_speed_mps,
            profile=None if args.profile is None else read_profile_csv(args.profile),
            sound_speed_sigma_mps=args.sound_speed_sigma_mps,
            estimate_sound_speed=args.estimate_sound_speed,
            gps_rms_m=args.gps_rms_m,
            gps_correlation_s=args.gps_correlation_s,
            antenna_sigma_m=(antenna[0], antenna[-1] if len(antenna) > 1 else 0.0),
            sample_interval_ms=args.sample_interval_ms,
            emission_known=args.emission_known,
            start=args.start,
            max_range_m=args.max_range_m,
            max_depth_m=args.max_depth_m,
            hydrophone_depth_m=args.hydrophone_depth_m,
            reject=args.reject,
            method=args.method,
            experiments=args.experiments,
            spacing=args.spacing,
            step=args.step,
            motion=args.motion,
            max_speed_mps=args.max_speed_mps,
            interval_s=args.interval_s,
            estimate_interval=args.estimate_interval,
            estimate_interval_drift=args.estimate_interval_drift,
        )
    except InputError:
        raise
    except ValueError as error:
        raise InputError(error) from None
    if settings.method == "pairs":
        count, spacing = LEAST_EXPERIMENTS[settings.motion != "still"]
        if (settings.experiments or count) < count or (settings.spacing or spacing) < spacing:
            print(
                f"fewer than the {count} experiments at spacing {spacing} that the thesis asks for",
                file=sys.stderr,
            )
    return settings


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
    lines = [] if answer["converged"] else [f"No fix: {answer['reason']}"]
    lines += _place_lines(answer) + _clock_lines(answer)
    if "present" in answer:
        lines += _motion_lines(answer)
    lines += _further_lines(answer)
    named, more = answer["rejected"][:MOST_NAMED], len(answer["rejected"]) - MOST_NAMED
    rejected = (", ".join(map(str, named)) or "none") + (f" and {more} more" if more > 0 else "")
    lines.append(f"pings     {answer['used']} of {answer['pings']} used; left out: {rejected}")
    lines += [f"step      {step['words']}" for step in answer.get("log", [])]
    return "\n".join(lines)


def _place_lines(answer: dict) -> list[str]:
    """Where it lies, and how surely."""
    lines = []
    if answer["lat_deg"] is not None:
        lines.append(
            f"{'position' if answer['converged'] else 'best guess'}  {answer['lat_deg']:.7f}, {answer['lon_deg']:.7f}"
        )
        lines.append(f"depth     {answer['depth_m']:.1f} m")
    if answer["sigma_east_m"] is not None:
        lines.append(
            f"sigma     {answer['sigma_east_m']:.2g} m east, {answer['sigma_north_m']:.2g} m north, "
            f"{answer['sigma_depth_m']:.2g} m depth"
        )
        shape = answer["ellipse95"]
        lines.append(
            f"ellipse   95 %: {shape['semi_major_m']:.2g} by {shape['semi_minor_m']:.2g} m, "
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
        f"now       {now['lat_deg']:.7f}, {now['lon_deg']:.7f}, depth {now['depth_m']:.1f} m; sigma "
        f"{now['sigma_east_m']:.2g} m east, {now['sigma_north_m']:.2g} m north, {now['sigma_depth_m']:.2g} m depth"
    )
    lines.append(f"steadiest {steadiest_words(answer['steadiest'])}")
    if "surfaces" in answer:
        up = answer["surfaces"]
        lines.append(
            f"surfaces  {value_with_sigma(up['epoch_s'], up['sigma_epoch_s'], 's')} after the first ping, at "
            f"{up['lat_deg']:.6f}, {up['lon_deg']:.6f} (sigma {up['sigma_east_m']:.2g} m east, "
            f"{up['sigma_north_m']:.2g} m north)"
        )
    return lines


def _further_lines(answer: dict) -> list[str]:
    """What the errors are made of, what fits as well, and what is to be noted."""
    lines = []
    if "error_budget_m" in answer:
        causes = [
            f"{values[2]:.2g} m {name.replace('_', ' ')}" for name, values in answer["error_budget_m"].items()
        ]
        lines.append(f"of depth  sigma from {', '.join(causes)}")
    if answer.get("along_track_m") is not None:
        lines.append(f"along track {answer['along_track_m']:.0f} m from the first ping")
        lines.append(f"closest slant range {answer['closest_slant_range_m']:.0f} m")
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


def _one_or_two(text: str) -> float | tuple[float, float]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in (1, 2):
        raise argparse.ArgumentTypeError(f"found {text!r}; wanted one number of metres, or two with a comma")
    return values[0] if len(values) == 1 else (values[0], values[1])


def _offset(text: str) -> tuple[float, float, float]:
    try:
        forward, starboard, down = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"found {text!r}; wanted FORWARD,STARBOARD,DOWN in metres") from None
    return forward, starboard, down


def _place(text: str) -> tuple[float, float, float]:
    try:
        lat, lon, depth = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"found {text!r}; wanted LAT,LON,DEPTH_M") from None
    if not (abs(lat) <= 90 and abs(lon) <= 360 and 0 <= depth <= 12_000 and math.isfinite(lon)):
        raise argparse.ArgumentTypeError(f"found {text!r}; wanted degrees, degrees, metres below the surface")
    return lat, lon, depth
