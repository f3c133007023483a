"""`plan PINGS`: which leg to sail next, and how well the beacon would be known after it."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path

import numpy as np

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.planning import (
    FASTEST_MPS,
    Forecast,
    Plan,
    accuracy_map,
    map_reach,
    plan_next_leg,
    surveys_so_far,
    time_to_reach,
)
from trackerlib.beacon.result import BeaconFix
from trackerlib.commands.survey_inputs import add_survey_arguments, read_survey_and_settings
from trackerlib.exports.gpx import route_gpx
from trackerlib.exports.record import FixRecord
from trackerlib.exports.tables import accuracy_csv
from trackerlib.rounding import rounded
from trackerlib.textfiles import InputError, write_text

SUMMARY = "plan the next leg of a beacon hunt"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `plan`: what `fix` has of the survey, and its own."""
    add_survey_arguments(parser)
    add = parser.add_argument_group("the next leg").add_argument
    add("--budget-s", type=float, default=1800.0, metavar="T", help="time for the leg (default 1800)")
    add(
        "--ship-speed-mps",
        type=float,
        default=FASTEST_MPS,
        metavar="V",
        help="at most (default 5: faster, and flow noise hides the pings)",
    )
    add("--wanted-m", type=float, metavar="E", help="also the time until the expected error is this")
    add("--route", type=Path, metavar="FILE.gpx", help="also write the leg as a GPX route")
    add(
        "--map",
        type=Path,
        metavar="FILE.csv",
        help="also write the expected error after a leg to each place of a grid, the worst of all that fit",
    )


def run(args: argparse.Namespace) -> dict:
    """The answer of `plan` as a document for JSON."""
    pings, settings = read_survey_and_settings(args)
    fix = fix_beacon(pings, settings)
    try:
        plan = plan_next_leg(pings, fix, settings, args.budget_s, args.ship_speed_mps)
        surveys = surveys_so_far(pings, fix, settings)
        seconds = None
        if args.wanted_m is not None:
            seconds = time_to_reach(surveys, args.wanted_m, args.ship_speed_mps)
    except ValueError as error:
        raise InputError(error) from None
    if args.route is not None:
        write_text(args.route, route_text(plan, fix))
    if args.map is not None:
        reach = map_reach(plan, args.budget_s, args.ship_speed_mps)
        east, north, expected = accuracy_map(surveys, reach, args.ship_speed_mps)
        record = FixRecord(fix, pings, settings)
        write_text(args.map, accuracy_csv(record, east, north, expected, args.ship_speed_mps))
    return {
        "converged": fix.converged,
        "reason": fix.reason,
        "now_rms_m": float(np.sqrt(np.trace(plan.now))),
        "best": leg_document(plan.best, fix),
        "over_beacon": None if plan.over_beacon is None else leg_document(plan.over_beacon, fix),
        "candidates": [leg_document(forecast, fix) for forecast in plan.forecasts],
        "wanted_m": args.wanted_m,
        "seconds_to_wanted": seconds,
        "worse_after_s": plan.worse_after_s,
        "words": plan.words,
        "simulated": fix.simulated,
    }


def leg_document(forecast: Forecast, fix: BeaconFix) -> dict:
    """A leg and what it would come to, for JSON."""
    leg, sigma = forecast.leg, forecast.sigma
    lat, lon, _ = fix.frame.to_geodetic(np.array([*leg.end, 0.0]))
    return {
        "bearing_deg": leg.bearing_deg,
        "length_m": leg.length_m,
        "duration_s": leg.duration_s,
        "speed_mps": leg.speed_mps,
        "over_beacon": leg.over_beacon,
        "end_lat_deg": float(lat),
        "end_lon_deg": float(lon),
        "expected_pings": forecast.expected_pings,
        "sigma_east_m": float(sigma[0]),
        "sigma_north_m": float(sigma[1]),
        "sigma_depth_m": float(sigma[2]),
        "sigma_sound_speed_mps": forecast.speed_sigma_mps,
        "rms_m": forecast.rms_m,
        "ellipse95": asdict(forecast.ellipse),
    }


def route_text(plan: Plan, fix: BeaconFix) -> str:
    """The best leg as a GPX 1.1 route."""
    leg = plan.best.leg
    lat, lon, _ = fix.frame.to_geodetic(np.column_stack([[leg.start, leg.end], np.zeros(2)]))
    label = "SIMULATED " if fix.simulated else ""
    return route_gpx(zip(lat, lon, ("start", "end"), strict=True), f"{label}{plan.words}")


def report(answer: dict) -> str:
    """The answer of `plan` for a person."""
    lines = ["SIMULATED DATA"] if answer["simulated"] else []
    lines += [] if answer["converged"] else [f"No fix: {answer['reason']}"]
    lines.append(answer["words"])
    over = answer["over_beacon"]
    if over is None:
        lines.append("The time does not reach a leg over the beacon.")
    elif not answer["best"]["over_beacon"]:
        way = f"{over['length_m']:.0f} m on {over['bearing_deg']:.0f}°"
        lines.append(f"Straight over the beacon, {way}: {rounded(over['rms_m'])} m.")
    if answer["seconds_to_wanted"] is not None:
        lines.append(f"The wanted accuracy needs {answer['seconds_to_wanted'] / 60:.0f} min.")
    elif answer["wanted_m"] is not None:
        lines.append(f"No straight leg reaches an error of {answer['wanted_m']:g} m within a day.")
    return "\n".join(lines)
