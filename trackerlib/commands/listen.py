"""`listen RECORDING`: arrivals of a pinger in a recording, period by period."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from trackerlib.beacon.navigation import ShipPositions, ship_at_receptions
from trackerlib.beacon.pings import Pings
from trackerlib.commands.position_limits import add_limits, limits_of
from trackerlib.live.navigation_file import BeginUnknown, NavigationFile, outside_words, read_navigation_file
from trackerlib.live.recorded_pings import followed_trace, receptions_of, utc_at
from trackerlib.receiver.arrivals import Arrivals, joined
from trackerlib.receiver.detectors import DETECTORS, hear
from trackerlib.receiver.front_end import ATTENUATIONS_DB, Attenuator
from trackerlib.receiver.recording import BLOCK_S, Recording
from trackerlib.receiver.recording_start import instant_in
from trackerlib.receiver.report_receiver import ReceiverSettings
from trackerlib.receiver.trains import SortedArrivals, sort_arrivals
from trackerlib.rounding import value_with_sigma
from trackerlib.textfiles import InputError, read_lines, write_text

SUMMARY = "find a pinger's arrivals in a recording of sound"
GAINS = ("auto", *map(str, ATTENUATIONS_DB))
BAD_LINES = 5  # of a navigation file that are told one by one


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `listen`."""
    defaults = ReceiverSettings()
    add = parser.add_argument
    add("recording", type=Path, metavar="RECORDING", help="WAV, RF64 or FLAC")
    add("--carrier-hz", type=float, required=True, metavar="F")
    add("--pulse-ms", type=float, required=True, metavar="P", help="length of a pulse")
    add(
        "--interval-s",
        type=float,
        required=True,
        metavar="T",
        help="from ping to ping; times are folded at it",
    )
    add("--maxima", type=int, default=defaults.maxima, metavar="N", help="most arrivals a period (default 2)")
    add("--window-ms", type=float, metavar="W", help="closer arrivals are one (default: two pulses)")
    add(
        "--sample-ms",
        type=float,
        default=1.0,
        metavar="S",
        help="of the converter (default 1; its own clock 1.0005)",
    )
    add("--gain", choices=GAINS, default="auto", help="attenuation in dB; auto sets it once a period")
    add("--detector", choices=DETECTORS, default=DETECTORS[0], help="the report's chain, or a matched filter")
    add("--channel", type=int, metavar="C", help="of a recording of several, from 1 (default 1)")
    add("--out", type=Path, required=True, metavar="ARRIVALS.csv")
    add(
        "--navigation",
        type=Path,
        metavar="FILE",
        help="NMEA 0183 log, or csv utc, lat_deg, lon_deg (or time_s from the recording's start), hdop, heading_deg",
    )
    add_limits(parser)
    add("--began", metavar="UTC", help="when the recording began, if neither its head nor its name tells")
    add(
        "--pings",
        type=Path,
        metavar="PINGS.csv",
        help="with --navigation: the pinger's pings with positions, for `fix` (default: beside ARRIVALS.csv)",
    )


def run(args: argparse.Namespace) -> dict:
    """Writes the arrivals and returns the answer of `listen` as a document for JSON."""
    try:
        settings = _settings(args)
    except ValueError as error:
        raise InputError(error) from None
    if args.pings is not None and args.navigation is None:
        raise InputError("--pings needs --navigation, the file of the ship's positions")
    limits = limits_of(args)
    with Recording(args.recording, args.channel) as recording:
        heard = hear(args.detector, settings, recording.rate_hz, recording.blocks(), BLOCK_S)
        navigation, began_s = _navigation(args, recording)
        try:
            parts = [each.arrivals for each in heard]
        except ValueError as error:
            raise InputError(f"{args.recording}: {error}") from None
        recording.check()
        notes = recording.notes()
    arrivals = joined(parts)
    for note in notes[1:]:
        print(f"{args.recording.name}: {note}", file=sys.stderr)
    ship = None if navigation is None else ship_at_receptions(navigation.fixes, arrivals.arrival_s, limits)
    simulated = recording.simulated or (navigation is not None and navigation.simulated)
    found = sort_arrivals(arrivals, settings.interval_s)
    write_text(args.out, csv_text(arrivals, settings.interval_s, simulated, ship, found))
    answer = document(args, settings, recording, arrivals, found, notes)
    if navigation is None:
        return answer
    return answer | _placed(args, settings, recording, arrivals, navigation, ship, began_s, simulated)


def csv_text(
    arrivals: Arrivals,
    interval_s: float,
    simulated: bool,
    ship: ShipPositions | None = None,
    found: SortedArrivals | None = None,
) -> str:
    """Arrivals as CSV, a row each; what a detector does not tell is left empty.

    ship : where she was at each; it adds latitude, longitude and why there is none
    found : which are direct and of which train; worked out here if it is not told
    """
    found = found or sort_arrivals(arrivals, interval_s)
    fold = np.maximum(arrivals.arrival_s - arrivals.period * interval_s, 0.0)
    table: dict[str, Iterable] = {
        "period": arrivals.period,
        "rank": arrivals.rank,
        "arrival_s": (f"{value:.7f}" for value in arrivals.arrival_s),
        "fold_s": (f"{value:.7f}" for value in fold),
        "level": (f"{value:.2f}" for value in arrivals.level),
        "attenuation_db": (f"{value:g}" for value in arrivals.attenuation_db),
        "snr_db": _told(arrivals.snr_db, 2),
        "sigma_s": _told(arrivals.sigma_s, 8),
        "direct": found.direct.astype(int),
        "train": ("" if number == 0 else number for number in found.train),
        "emission": ("" if number < 0 else number for number in found.emission),
    }
    if ship is not None:
        table |= {
            "lat_deg": _told(ship.lat_deg, 7),
            "lon_deg": _told(ship.lon_deg, 7),
            "no_position": ("" if why == 0 else ship.reasons[why] for why in ship.reason),
        }
    return _csv(table, simulated)


def _told(values: np.ndarray, decimals: int) -> Iterator[str]:
    return ("" if np.isnan(value) else f"{value:.{decimals}f}" for value in values)


def _csv(table: dict[str, Iterable], simulated: bool) -> str:
    lines = ["# SIMULATED sound"] if simulated else []
    rows = (",".join(map(str, row)) for row in zip(*table.values(), strict=True))
    return "\n".join([*lines, ",".join(table), *rows]) + "\n"


def pings_text(pings: Pings) -> str:
    """Pings as the CSV that `fix` reads."""
    table: dict[str, Iterable] = {
        "ping": pings.number,
        "utc": ("" if np.isnat(utc) else f"{utc}Z" for utc in pings.utc),
        "time_s": (f"{value:.6f}" for value in pings.clock_s),
        "lat_deg": _told(pings.lat_deg, 7),
        "lon_deg": _told(pings.lon_deg, 7),
        "oneway_s": _told(pings.travel_time_s, 7),
    }
    return _csv(table, pings.simulated)


def _navigation(args: argparse.Namespace, recording: Recording) -> tuple[NavigationFile | None, float | None]:
    """Positions by the recording's clock, if there is a file of them; and when the recording began, if that is known.

    Bad lines and what tells the beginning go to standard error.
    """
    if args.navigation is None:
        return None, None
    if args.began is not None:
        began_s = instant_in(args.began)
        if began_s is None:
            raise InputError(f"--began is {args.began!r}; wanted UTC such as 2018-04-26T05:10:33.25Z")
    else:
        began_s, where = recording.began or (None, "")
        if began_s is not None:
            print(
                f"{args.recording.name}: began {utc_at(began_s, 0)}Z, as its {where} tells", file=sys.stderr
            )
    try:
        navigation = read_navigation_file(read_lines(args.navigation), args.navigation.name, began_s)
    except BeginUnknown as error:
        raise InputError(f"{error}; tell it with --began UTC") from None
    for record in navigation.bad_records[:BAD_LINES]:
        print(f"{args.navigation.name}, line {record.line}: {record.why}", file=sys.stderr)
    more = len(navigation.bad_records) - BAD_LINES
    if more > 0:
        print(f"{args.navigation.name}: {more} more lines gave no position", file=sys.stderr)
    return navigation, began_s


def _placed(args, settings, recording, arrivals, navigation, ship, began_s, simulated) -> dict:
    """Writes the pings that have a position; what `listen` answers of them."""
    path = args.pings or args.out.with_name(f"{args.out.stem}_pings.csv")
    trace = followed_trace(arrivals, settings.interval_s)
    receptions = receptions_of(
        trace,
        settings.interval_s,
        navigation.fixes,
        began_s=began_s,
        source=args.recording.name,
        simulated=simulated,
    )
    pings, at_pings = receptions.pings(limits_of(args))
    outside = outside_words(navigation.fixes, recording.seconds)
    for words in [outside] if outside else []:
        print(f"{args.navigation.name}: {words}", file=sys.stderr)
    for sentence in ship.words:
        print(sentence, file=sys.stderr)
    write_text(path, pings_text(pings))
    return {
        "simulated": simulated,
        "navigation": str(args.navigation),
        "began": None if began_s is None else f"{utc_at(began_s, 0)}Z",
        "positions": len(navigation.fixes.time_s),
        "positions_refused": dict(ship.fixes_refused),
        "lines_without_position": len(navigation.bad_records),
        "arrivals_placed": int(ship.accepted.sum()),
        "arrivals_refused": dict(ship.refused),
        "pings_followed": len(trace.emission),
        "pings": len(pings),
        "pings_refused": dict(at_pings.refused),
        "pings_out": str(path),
    }


def document(
    args,
    settings: ReceiverSettings,
    recording: Recording,
    arrivals: Arrivals,
    found: SortedArrivals,
    notes: list[str],
) -> dict:
    """A hearing as a document for JSON."""
    periods = int(np.ceil(recording.seconds / settings.interval_s - 1e-9))
    return {
        "recording": str(args.recording),
        "detector": args.detector,
        "rate_hz": recording.rate_hz,
        "channel": recording.channel,
        "channels": recording.channels,
        "seconds": recording.seconds,
        "periods": periods,
        "periods_heard": len(np.unique(arrivals.period)),
        "arrivals": len(arrivals),
        "strongest": int(np.sum(arrivals.rank == 1)),
        "direct": int(found.direct.sum()),
        "trains": _trains(found),
        "attenuations_db": {
            f"{db:g}": count for db, count in sorted(Counter(arrivals.attenuation_db).items())
        },
        "notes": notes,
        "simulated": recording.simulated,
        "out": str(args.out),
    }


def _trains(found: SortedArrivals) -> list[dict]:
    """Each pinger's interval and drift, the longest train first, and which trains are late echoes of another."""
    return [
        {
            "interval_s": train.interval_s,
            "sigma_interval_s": train.sigma_interval_s,
            "drift_ppm": train.drift_ppm,
            "sigma_drift_ppm": train.sigma_drift_ppm,
            "pings": len(train.rows),
            "missed": train.missed,
            "extra": train.extra,
            "echo_of": None if echo is None else echo.of + 1,
            "lag_ms": None if echo is None else 1e3 * echo.lag_s,
        }
        for train, echo in zip(found.trains, found.echoes, strict=True)
    ]


def report(answer: dict) -> str:
    """The answer of `listen` for a person."""
    lines = ["SIMULATED DATA"] if answer["simulated"] else []
    lines += [
        answer["notes"][0],
        f"{answer['arrivals']} arrivals in {answer['periods_heard']} of {answer['periods']} periods, "
        f"{answer['direct']} of them direct",
        *(_train_words(number, train) for number, train in enumerate(answer["trains"], 1)),
        f"written to {answer['out']}",
    ]
    if "pings_out" in answer:
        lines.append(
            f"{answer['pings']} of {answer['pings_followed']} pings of the pinger have a position, "
            f"written to {answer['pings_out']}"
        )
    return "\n".join(lines)


def _train_words(number: int, train: dict) -> str:
    interval = value_with_sigma(1e3 * train["interval_s"], 1e3 * train["sigma_interval_s"], "ms")
    drift = value_with_sigma(train["drift_ppm"], train["sigma_drift_ppm"], "ppm")
    words = (
        f"train {number}: {train['pings']} pings, {train['missed']} missed, {train['extra']} extra, "
        f"every {interval} as heard, drift {drift}"
    )
    if train["echo_of"] is None:
        return words
    return f"{words}; echo of train {train['echo_of']}, {train['lag_ms']:.0f} ms behind"


def _settings(args: argparse.Namespace) -> ReceiverSettings:
    window_ms = 2 * args.pulse_ms if args.window_ms is None else args.window_ms
    return ReceiverSettings(
        carrier_hz=args.carrier_hz,
        pulse_s=args.pulse_ms * 1e-3,
        interval_s=args.interval_s,
        maxima=args.maxima,
        window_s=window_ms * 1e-3,
        sample_interval_s=args.sample_ms * 1e-3,
        attenuator=Attenuator(args.gain == "auto", 0 if args.gain == "auto" else int(args.gain)),
    )
