"""`listen RECORDING`: arrivals of a pinger in a recording, period by period."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from trackerlib.receiver.arrivals import Arrivals, joined
from trackerlib.receiver.detectors import DETECTORS, hear
from trackerlib.receiver.front_end import ATTENUATIONS_DB, Attenuator
from trackerlib.receiver.recording import BLOCK_S, Recording
from trackerlib.receiver.report_receiver import ReceiverSettings
from trackerlib.textfiles import InputError, write_text

SUMMARY = "find a pinger's arrivals in a recording of sound"
GAINS = ("auto", *map(str, ATTENUATIONS_DB))
COLUMNS = ("period", "rank", "arrival_s", "fold_s", "level", "attenuation_db", "snr_db", "sigma_s")


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


def run(args: argparse.Namespace) -> dict:
    """Writes the arrivals and returns the answer of `listen` as a document for JSON."""
    try:
        settings = _settings(args)
    except ValueError as error:
        raise InputError(error) from None
    with Recording(args.recording, args.channel) as recording:
        heard = hear(args.detector, settings, recording.rate_hz, recording.blocks(), BLOCK_S)
        try:
            parts = [each.arrivals for each in heard]
        except ValueError as error:
            raise InputError(f"{args.recording}: {error}") from None
        recording.check()
        notes = recording.notes()
    arrivals = joined(parts)
    for note in notes[1:]:
        print(f"{args.recording.name}: {note}", file=sys.stderr)
    write_text(args.out, csv_text(arrivals, settings.interval_s, recording.simulated))
    return document(args, settings, recording, arrivals, notes)


def csv_text(arrivals: Arrivals, interval_s: float, simulated: bool) -> str:
    """Arrivals as CSV, a row each; what a detector does not tell is left empty."""
    fold = np.maximum(arrivals.arrival_s - arrivals.period * interval_s, 0.0)
    rows = zip(
        arrivals.period,
        arrivals.rank,
        (f"{value:.7f}" for value in arrivals.arrival_s),
        (f"{value:.7f}" for value in fold),
        (f"{value:.2f}" for value in arrivals.level),
        (f"{value:g}" for value in arrivals.attenuation_db),
        ("" if np.isnan(value) else f"{value:.2f}" for value in arrivals.snr_db),
        ("" if np.isnan(value) else f"{value:.8f}" for value in arrivals.sigma_s),
        strict=True,
    )
    lines = ["# SIMULATED sound"] if simulated else []
    return "\n".join([*lines, ",".join(COLUMNS), *(",".join(map(str, row)) for row in rows)]) + "\n"


def document(
    args, settings: ReceiverSettings, recording: Recording, arrivals: Arrivals, notes: list[str]
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
        "attenuations_db": {
            f"{db:g}": count for db, count in sorted(Counter(arrivals.attenuation_db).items())
        },
        "notes": notes,
        "simulated": recording.simulated,
        "out": str(args.out),
    }


def report(answer: dict) -> str:
    """The answer of `listen` for a person."""
    lines = ["SIMULATED DATA"] if answer["simulated"] else []
    lines += [
        answer["notes"][0],
        f"{answer['arrivals']} arrivals in {answer['periods_heard']} of {answer['periods']} periods",
        f"written to {answer['out']}",
    ]
    return "\n".join(lines)


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
