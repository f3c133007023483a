"""`correct TFILE`: a corrected copy of a T-file, through curved rays; the original is never touched."""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path

import numpy as np

from trackerlib import __version__
from trackerlib.commands.range_inputs import (
    add_profile_speeds,
    check_outputs,
    read_profile,
    read_survey,
    tell,
)
from trackerlib.crossover.doubts import profile_doubts, report_doubts
from trackerlib.crossover.gating import MAX_SLANT_RANGE_FT, gate_mode_and_flag
from trackerlib.rangefiles.calibration_file import read_calibration
from trackerlib.rangefiles.corrected_tfile import CorrectedCopy, corrected_copy
from trackerlib.rangefiles.run_track_file import hand_overs_csv, run_track_csv
from trackerlib.rangefiles.tfile import CORRECTED, HEADER_RECORDS, TFileReading, parse_tfile
from trackerlib.textfiles import InputError, read_bytes, write_bytes, write_text
from trackerlib.timing.run_track import RunTrack, correct_run
from trackerlib.timing.track_correction import CorrectedReports, correct_reports

SUMMARY = "write a copy of a T-file with its positions corrected"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `correct`."""
    add = parser.add_argument
    add("tfile", type=Path, metavar="TFILE", help="fixed-column position reports of a run")
    add("--arrays", type=Path, required=True, metavar="FILE", help="array table")
    add("--profile", type=Path, required=True, metavar="VELOCITY.DAT", help="sound-speed table, ft and ft/s")
    add_profile_speeds(parser)
    add("--offset-ms", type=float, default=0.0, metavar="D", help="timing offset, positive stretches")
    add("--drift-ms-per-count", type=float, default=0.0, metavar="M", help="its change with the point count")
    add("--t0", type=float, metavar="T", help="point count at which the offset holds; needed with a drift")
    add("--calibration", type=Path, metavar="CALIBRATE.json", help="rotation and intercept of each array")
    add("--mode", type=int, metavar="M", help="only this vehicle (default: all)")
    add("--header-records", type=int, default=HEADER_RECORDS, metavar="N", help="to skip (default 31)")
    add("--track", type=Path, metavar="CSV", help="also the whole merged track of the vehicle of --mode")
    add("--hand-overs", type=Path, metavar="CSV", help="also the jumps of that track where arrays take over")
    add(
        "--max-slant-range-ft",
        type=float,
        default=MAX_SLANT_RANGE_FT,
        metavar="R",
        help="how far from an array its reports are taken into that track (default 4700)",
    )
    add("--out", type=Path, required=True, metavar="FILE", help="the copy")


def run(args: argparse.Namespace) -> dict:
    """Writes the copy and returns the answer of `correct` as a document for JSON."""
    _check(args)
    survey = read_survey(args.arrays)
    profile = read_profile(args.profile, args.profile_speeds)
    movements = read_calibration(args.calibration) if args.calibration else {}
    content = read_bytes(args.tfile)
    tfile = parse_tfile(content, args.tfile.name, args.header_records)
    corrected = correct_reports(tfile.reports, survey, profile, *_clock(args), args.mode, movements)
    done = provenance(args, content)
    copy = corrected_copy(content, tfile, corrected.which, corrected.position, done)
    warnings = [*tfile.doubts, *_warnings(args, tfile, survey, profile, corrected, copy)]
    tell("correct", (), warnings)
    answer = document(args, tfile, corrected, copy, warnings)
    if args.track or args.hand_overs:
        track = _whole_track(args, tfile, survey, profile, movements)
        for path, text in ((args.track, run_track_csv), (args.hand_overs, hand_overs_csv)):
            if path:
                write_text(path, text(track, done, tfile.simulated))
        answer |= _track_document(args, track)
    write_bytes(args.out, copy.content)
    return answer


def _clock(args: argparse.Namespace) -> tuple[float, float, float]:
    """Offset (s), drift (s a count) and the count at which the offset holds."""
    return 1e-3 * args.offset_ms, 1e-3 * args.drift_ms_per_count, args.t0 or 0.0


def _whole_track(args, tfile: TFileReading, survey, profile, movements) -> RunTrack:
    if args.mode is None:
        option = "--track" if args.track else "--hand-overs"
        raise InputError(f"{option} needs --mode, the vehicle")
    vehicle = gate_mode_and_flag(tfile.reports, args.mode)
    try:
        return correct_run(
            vehicle, survey, profile, args.max_slant_range_ft, *_clock(args), movements=movements
        )
    except ValueError as error:
        raise InputError(f"{args.tfile.name}: {error}") from None


def _track_document(args: argparse.Namespace, track: RunTrack) -> dict:
    """The whole track in numbers, and the files that hold it."""
    before, after = track.mean_jump
    return {
        "track": None if args.track is None else str(args.track),
        "hand_overs_file": None if args.hand_overs is None else str(args.hand_overs),
        "track_points": len(track.track),
        "hand_overs": len(track.hand_overs),
        "mean_jump_before_ft": before,
        "mean_jump_after_ft": after,
    }


def provenance(args: argparse.Namespace, content: bytes) -> str:
    """What was done to the T-file of this content, in one line for the header of the copy."""
    parts = [f"{CORRECTED} OF {args.tfile.name}: OFFSET {args.offset_ms:.9g} MS"]
    if args.drift_ms_per_count:
        parts.append(f"DRIFT {args.drift_ms_per_count:.9g} MS A COUNT ABOUT COUNT {args.t0:.9g}")
    parts.append("ALL VEHICLES" if args.mode is None else f"MODE {args.mode}")
    layout = {"middle": "", "boundary": " (SPEEDS AT THE DEPTHS)", "metres": " (IN METRES)"}[
        args.profile_speeds
    ]
    parts.append(f"PROFILE {args.profile.name}{layout}, ARRAYS {args.arrays.name}")
    if args.calibration:
        parts.append(f"CALIBRATION {args.calibration.name}")
    parts.append(f"SHA-256 OF THE ORIGINAL {hashlib.sha256(content).hexdigest()}")
    return ", ".join(parts) + f", TRACKERLIB {__version__}"


def document(
    args: argparse.Namespace,
    tfile: TFileReading,
    corrected: CorrectedReports,
    copy: CorrectedCopy,
    warnings: list[str],
) -> dict:
    """The answer under the keys that others rely on."""
    before = tfile.reports.position[corrected.which]
    change = np.linalg.norm(corrected.position - before, axis=1)[copy.written]
    total = len(tfile.reports) + len(tfile.reports.bad_records)
    return {
        "file": str(args.out),
        "corrected": int(copy.written.sum()),
        "untouched": total - int(copy.written.sum()),
        "largest_change_ft": float(change.max(initial=0.0)),
        "in_shadow": corrected.in_shadow,
        "unplaced_arrays": corrected.unplaced,
        "bad_records": [
            {"line": record.line, "why": record.why}
            for record in (*tfile.reports.bad_records, *copy.too_wide)
        ],
        "warnings": warnings,
        "simulated": tfile.simulated,
    }


def report(answer: dict) -> str:
    """The answer of `correct` for a person."""
    lines = ["SIMULATED DATA"] if answer["simulated"] else []
    lines += [
        f"{answer['corrected']} positions corrected, the farthest moved {answer['largest_change_ft']:.1f} ft",
        f"{answer['untouched']} records left as they were",
        f"written to {answer['file']}",
    ]
    bad = answer["bad_records"]
    lines += [f"line {record['line']}: {record['why']}" for record in bad[:10]]
    lines += [f"... and {len(bad) - 10} more such lines"] if len(bad) > 10 else []
    if "track" in answer:
        files = " and ".join(name for name in (answer["track"], answer["hand_overs_file"]) if name)
        lines.append(
            f"whole track of {answer['track_points']} counts: its {answer['hand_overs']} hand-overs jump "
            f"{answer['mean_jump_after_ft']:.1f} ft, before {answer['mean_jump_before_ft']:.1f} ft (rms); written to "
            f"{files}"
        )
    return "\n".join(lines)


def _check(args: argparse.Namespace) -> None:
    for name in ("offset_ms", "drift_ms_per_count", "t0"):
        value = getattr(args, name)
        if value is not None and not np.isfinite(value):
            raise InputError(f"--{name.replace('_', '-')} is {value}, wanted a number")
    if args.drift_ms_per_count and args.t0 is None:
        raise InputError("--drift-ms-per-count needs --t0, the point count at which the offset holds")
    check_outputs(
        {"--out": args.out, "--track": args.track, "--hand-overs": args.hand_overs},
        {"T-file": args.tfile, "array table": args.arrays, "profile": args.profile,
         "calibration": args.calibration},
    )  # fmt: skip


def _warnings(args, tfile, survey, profile, corrected, copy) -> list[str]:
    reports = tfile.reports
    wanted = ~reports.flagged if args.mode is None else (reports.mode == args.mode) & ~reports.flagged
    warnings = report_doubts(reports.position[wanted], reports.array[wanted], survey, args.max_slant_range_ft)
    warnings += profile_doubts(profile, survey, reports.array[wanted])
    warnings += [
        f"array {array} has no surveyed position: {count} reports are left as they were"
        for array, count in corrected.unplaced.items()
    ]
    if corrected.in_shadow:
        warnings.append(
            f"no direct ray joins {corrected.in_shadow} reports to their array; left as they were"
        )
    modes = np.unique(reports.mode[wanted]).tolist()
    if (args.offset_ms or args.drift_ms_per_count) and len(modes) > 1:
        warnings.append(
            f"one clock correction for the vehicles of modes {', '.join(map(str, modes))}, each of which has a clock "
            "of its own; --mode chooses one"
        )
    if not (args.offset_ms or args.drift_ms_per_count or args.calibration):
        warnings.append("no offset, drift or calibration is told: the copy holds the positions as they were")
    if args.mode is not None and not np.any(tfile.reports.mode == args.mode):
        warnings.append(f"no report has mode {args.mode}; nothing was corrected")
    if copy.too_wide:
        first, more = copy.too_wide[0], len(copy.too_wide) - 1
        warnings.append(f"line {first.line}: {first.why}" + (f"; so are {more} more" if more else ""))
    return warnings
