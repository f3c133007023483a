"""The survey that `fix` and `plan` read, and how it is to be fixed: their options, and what these tell."""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from trackerlib.beacon.motion import MOTIONS
from trackerlib.beacon.navigation import Receptions
from trackerlib.beacon.pairs import LEAST_EXPERIMENTS
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.settings import METHODS, FixSettings
from trackerlib.commands.position_limits import add_limits, limits_of
from trackerlib.commands.range_inputs import tell
from trackerlib.exports.record import Placing
from trackerlib.surveyfiles.profile_csv import read_profile_csv
from trackerlib.surveyfiles.stream_csv import read_arrivals, read_navigation
from trackerlib.surveyfiles.survey import LAYOUTS, read_survey
from trackerlib.textfiles import InputError, read_lines


def add_survey_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the file, the estimator, water and clock, and the ship, each under its head."""
    _about_the_file(parser)
    _about_the_estimator(parser.add_argument_group("the estimator"))
    _about_the_water_and_the_clock(parser.add_argument_group("water and clock"))
    _about_the_ship(parser.add_argument_group("the ship"))


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


def _about_the_estimator(group) -> None:
    add, defaults = group.add_argument, FixSettings()
    add(
        "--method",
        choices=METHODS,
        default=METHODS[0],
        help="every ping (the default), the thesis's experiments, or usual least squares",
    )
    add("--experiments", type=int, metavar="N", help="pairs: how many (default: as many as there are)")
    add("--spacing", type=int, metavar="K", help="pairs: receptions from first to second (default: thesis's)")
    add("--step", type=int, metavar="J", help="pairs: receptions from one pair to the next (default: K)")
    motion = group.add_mutually_exclusive_group()
    motion.add_argument(
        "--motion", choices=MOTIONS, default=MOTIONS[0], help="how the beacon may move (default: still)"
    )
    motion.add_argument("--moving", dest="motion", action="store_const", const="free", help="--motion free")
    regions = {
        "--max-speed-mps": (defaults.max_speed_mps, "V", "greatest speed of a beacon that moves"),
        "--max-range-m": (defaults.max_range_m, "R", "greatest distance from the ship's mean position"),
        "--max-depth-m": (defaults.max_depth_m, "D", "greatest depth"),
    }
    for name, (default, letter, words) in regions.items():
        add(name, type=float, default=default, metavar=letter, help=f"{words} searched (default {default:g})")
    add("--start", type=_place, metavar="LAT,LON,DEPTH_M", help="a further place to start from")
    add(
        "--reject",
        choices=("auto", "none"),
        default="auto",
        help="leave out false returns (the default; of experiments: those that every ping tells), or nothing",
    )


def _about_the_water_and_the_clock(group) -> None:
    add, speed_mps = group.add_argument, FixSettings().sound_speed_mps
    water = group.add_mutually_exclusive_group()
    water.add_argument(
        "--sound-speed-mps",
        type=float,
        default=speed_mps,
        metavar="C",
        help=f"of all the water (default {speed_mps:g})",
    )
    water.add_argument("--profile", type=Path, metavar="FILE", help="csv depth_m, speed_mps, instead")
    add(
        "--sound-speed-sigma-mps",
        type=float,
        metavar="S",
        help="of the mean speed on the way (default 2, or 0.5 with a profile)",
    )
    add(
        "--estimate-sound-speed",
        action="store_true",
        help="with the place; the one told and its sigma are the prior",
    )
    add("--interval-s", type=float, metavar="T", help="of the pinger: times are known up to multiples of it")
    add("--estimate-interval", action="store_true", help="with the place; the one told is nearly right")
    add("--estimate-interval-drift", action="store_true", help="and how it changes")
    add("--emission-known", action="store_true", help="times are true travel times")
    add(
        "--turnaround-ms",
        type=float,
        metavar="T",
        help="delay inside two-way times (default: the file's, else 13)",
    )


def _about_the_ship(group) -> None:
    add = group.add_argument
    add(
        "--gps-rms-m",
        type=_one_or_two,
        metavar="G[,N]",
        help="ship position error, each of east and north, or both apart (default: not known)",
    )
    add("--gps-correlation-s", type=float, metavar="S", help="in which that error's correlation falls by e")
    add(
        "--hydrophone-depth-m",
        type=float,
        default=0.0,
        metavar="H",
        help="where the file does not say (default 0)",
    )
    add(
        "--antenna-offset-m",
        type=_offset,
        default=(0.0, 0.0, 0.0),
        metavar="F,S,D",
        help="from antenna to hydrophone: forward, starboard, down, with --navigation (default 0,0,0)",
    )
    add(
        "--antenna-sigma-m",
        type=_one_or_two,
        default=0.0,
        metavar="H[,V]",
        help="sigma of that offset: each of forward and starboard, and down (default 0)",
    )
    add_limits(group)


def read_survey_and_settings(args: argparse.Namespace) -> tuple[Pings, FixSettings]:
    """The survey and the settings that these options tell; raises InputError."""
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
    tell(args.pings.name, reading.bad_records, reading.notes)
    return reading.pings, _settings(args), {"lines": _by_reason(reading.bad_records)}, None


def _by_reason(records) -> dict[str, int]:
    return dict(Counter(record.why for record in records))


def _from_stream(args: argparse.Namespace) -> tuple[Pings, dict[str, dict[str, int]], Placing]:
    """Pings of arrivals and a navigation stream; what was refused is counted, on standard error too."""
    if args.interval_s is None:
        raise InputError("--navigation needs --interval-s, the interval of the pinger")
    arrivals = read_arrivals(read_lines(args.pings), args.pings.name)
    fixes, bad = read_navigation(read_lines(args.navigation), args.navigation.name)
    tell(args.pings.name, arrivals.bad_records, ())
    tell(args.navigation.name, bad, ())
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
