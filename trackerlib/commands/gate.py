"""`gate TFILE`: the crossover sets of one vehicle's run, a file each."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from trackerlib.commands.campaign_runs import chosen_runs, each_run, failures_report, run_words
from trackerlib.commands.range_inputs import read_survey, tell
from trackerlib.crossover.gating import GAP_COUNTS, MAX_SLANT_RANGE_FT, GatingResult, gate_reports
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.segments import TrackSegment, straight_segments
from trackerlib.rangefiles.arrays import parse_date
from trackerlib.rangefiles.campaign import CampaignRun
from trackerlib.rangefiles.crossover_file import crossover_file_name, write_crossover
from trackerlib.rangefiles.report_files import write_report_files
from trackerlib.rangefiles.segment_file import segment_file_name, write_segment
from trackerlib.rangefiles.tfile import HEADER_RECORDS, read_tfile
from trackerlib.textfiles import InputError

MOST_LINES = 10  # of a kind that a report lists
SUMMARY = "match the tracks of every two arrays of a T-file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `gate`."""
    add = parser.add_argument
    add("tfile", type=Path, nargs="?", metavar="TFILE", help="fixed-column position reports of a run")
    add("--arrays", type=Path, metavar="FILE", help="array table")
    add("--mode", type=int, metavar="M", help="the vehicle: 2 ship, 7 torpedo; of a campaign only its runs")
    add("--campaign", type=Path, metavar="FILE", help="all runs of a campaign, in place of the three above")
    add("--day", metavar="D", help="of a campaign take only that day's runs")
    add("--run", metavar="R", help="of a campaign take only runs of that name")
    add(
        "--header-records",
        type=int,
        metavar="N",
        help="records to skip (default 31; a campaign says its own)",
    )
    add(
        "--max-slant-range-ft",
        type=float,
        default=MAX_SLANT_RANGE_FT,
        metavar="R",
        help="how far from an array its reports are kept (default 4700)",
    )
    add(
        "--gap-counts",
        type=int,
        default=GAP_COUNTS,
        metavar="G",
        help="a longer gap ends a pass (default 30)",
    )
    add(
        "--segments",
        action="store_true",
        help="write segment_AA_P.txt too: straight pieces of one array's track",
    )
    add(
        "--keep-line",
        type=int,
        action="append",
        default=[],
        metavar="N",
        help="of an array's repeated reports at one count keep the one in this line of the T-file",
    )
    add(
        "--report-files",
        action="store_true",
        help="write TRPDOTRX.DAT, OUTPUT1.COV, OUTPUT2.COV and MMATRIX.M of every set too, in a folder each",
    )
    add("--run-date", metavar="DAY", help="day of the run (default: the one date in the header)")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for crossover_AA_BB_P.txt")


def run(args: argparse.Namespace) -> dict:
    """Writes the sets and returns the answer of `gate` as a document for JSON."""
    _check(args)
    if args.campaign:
        return run_campaign(args)
    return run_one(args)


def run_campaign(args: argparse.Namespace) -> dict:
    """The answers of all runs of a campaign, each with its sets in a folder of its own."""

    def work(one: CampaignRun) -> dict:
        own = {name: getattr(one, name) for name in ("tfile", "arrays", "mode", "header_records")}
        return run_one(argparse.Namespace(**{**vars(args), **own, "out": args.out / one.folder}))

    chosen = chosen_runs(args.campaign, args.day, args.run, args.mode)
    if len(chosen.runs) > 1 and (args.keep_line or args.run_date):
        raise InputError(
            f"--keep-line and --run-date are of one run, found {len(chosen.runs)}; choose it with --day, --run, --mode"
        )
    done, failed = each_run("gate", chosen, work)
    answers = [
        {"day": one.day, "run": one.run, "mode": one.mode, "vehicle": one.vehicle, **answer}
        for one, answer in done
    ]
    simulated = any(answer["simulated"] for answer in answers)
    return {"runs": answers, "failed_runs": failed, "simulated": simulated}


def run_one(args: argparse.Namespace) -> dict:
    """The answer for one T-file."""
    survey = read_survey(args.arrays)
    header_records = HEADER_RECORDS if args.header_records is None else args.header_records
    tfile = read_tfile(args.tfile, header_records, args.mode)
    try:
        run_date = parse_date(args.run_date) if args.run_date else tfile.run_date
    except ValueError as error:
        raise InputError(f"--run-date: {error}") from None
    gates = (survey, args.mode, args.max_slant_range_ft, args.gap_counts)
    result = gate_reports(tfile.reports, *gates, run_date, args.keep_line)
    segments = straight_segments(tfile.reports, *gates) if args.segments else ()
    warnings = [*tfile.doubts, *result.warnings, *_not_kept(args.keep_line, result)]
    tell("gate", (), warnings)
    files = write_sets(args.out, result.sets)
    answer = document(result, files, warnings, tfile.simulated)
    if args.report_files:
        folders = [path.with_suffix("") for path in files]
        for folder, crossover in zip(folders, result.sets, strict=True):
            write_report_files(folder, crossover, survey)
        answer["report_files"] = [str(folder) for folder in folders]
    if args.segments:
        answer["segments"] = [_segment(segment, args.out) for segment in segments]
    return answer


def write_sets(folder: Path, sets: tuple[CrossoverSet, ...]) -> list[Path]:
    """Writes each set as crossover_AA_BB_P.txt; says on standard error which older ones it leaves."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / crossover_file_name(crossover) for crossover in sets]
    older = sorted(path.name for path in folder.glob("crossover_*.txt") if path not in files)
    if older:
        print(f"gate: left {len(older)} files of another call in {folder}: {older[0]} ...", file=sys.stderr)
    for path, crossover in zip(files, sets, strict=True):
        write_crossover(path, crossover)
    return files


def document(result: GatingResult, files: list[Path], warnings: list[str], simulated: bool) -> dict:
    """A gating under the keys that others rely on."""
    counts = result.counts
    return {
        "records_read": counts.records_read,
        "kept_mode": counts.kept_mode,
        "kept_paired": counts.kept_paired,
        "kept_range": counts.kept_range,
        "kept_repaired": counts.kept_repaired,
        "repeats_left_out": counts.repeats_left_out,
        "unplaced_arrays": result.unplaced_arrays,
        "bad_records": [{"line": record.line, "why": record.why} for record in result.bad_records],
        "sets": [_set(crossover, path) for crossover, path in zip(result.sets, files, strict=True)],
        "repeats": [vars(choice) for choice in result.choices],
        "warnings": warnings,
        "simulated": simulated,
    }


def report(answer: dict) -> str:
    """The answer of `gate` for a person."""
    if "runs" in answer:
        parts = [f"{run_words(one)}\n{report(one)}" for one in answer["runs"]]
        return "\n\n".join([*parts, *failures_report(answer["failed_runs"])])
    bad = answer["bad_records"]
    lines = ["SIMULATED DATA"] if answer["simulated"] else []
    lines += [
        f"{answer['records_read']:7d} records read, {len(bad)} of them not readable",
        f"{answer['kept_mode']:7d} of the mode and without an edit mark",
        f"{answer['kept_paired']:7d} at a point count with two or more arrays",
        f"{answer['kept_range']:7d} within slant range of a surveyed array",
        f"{answer['kept_repaired']:7d} paired again, {answer['repeats_left_out']} of them repeats left out",
    ]
    lines += [f"line {record['line']}: {record['why']}" for record in bad[:MOST_LINES]]
    lines += (
        [f"... and {len(bad) - MOST_LINES} more lines that cannot be read"] if len(bad) > MOST_LINES else []
    )
    repeats = answer["repeats"]
    lines += [_choice_line(choice) for choice in repeats[:MOST_LINES]]
    lines += (
        [f"... and {len(repeats) - MOST_LINES} more choices (--json)"] if len(repeats) > MOST_LINES else []
    )
    lines += [
        f"{s['file']}  {s['points']} points, counts {s['first']} to {s['last']}" for s in answer["sets"]
    ] or ["no crossover set: no two arrays saw the vehicle at one point count"]
    if "report_files" in answer:
        lines.append(f"{len(answer['report_files'])} folders of the report's files")
    if "segments" in answer:
        lines.append(f"{len(answer['segments'])} straight pieces of single arrays' tracks")
    return "\n".join(lines)


def _choice_line(choice: dict) -> str:
    """One choice among repeated reports, with the lines by which it is taken back."""
    dropped = ", ".join(map(str, choice["dropped_lines"]))
    return (
        f"array {choice['array']} at count {choice['point_count']}: line {choice['kept_line']} kept and not {dropped}: "
        f"{choice['reason']} (--keep-line turns it)"
    )


def _check(args: argparse.Namespace) -> None:
    own = [args.tfile, args.arrays, args.header_records]
    if args.campaign and any(value is not None for value in own):
        raise InputError(
            "--campaign names T-file, arrays and header records itself; wanted either it or those"
        )
    if not args.campaign and any(value is None for value in (args.tfile, args.arrays, args.mode)):
        raise InputError("wanted TFILE, --arrays FILE and --mode M, or --campaign FILE")
    if not args.campaign and (args.day is not None or args.run is not None):
        raise InputError(
            "--day and --run choose among the runs of a campaign; wanted --campaign FILE with them"
        )
    if not args.max_slant_range_ft > 0:
        raise InputError(f"--max-slant-range-ft is {args.max_slant_range_ft:g}, wanted feet above 0")
    if args.gap_counts < 1:
        raise InputError(f"--gap-counts is {args.gap_counts}, wanted 1 or more")


def _not_kept(lines: list[int], result: GatingResult) -> list[str]:
    """Which of the lines that were named to be kept chose nothing."""
    kept = {choice.kept_line for choice in result.choices} if lines else set()
    return [
        f"--keep-line {line} chose nothing: it holds no repeated report of this vehicle that passes the gates, or "
        "another line of the same repeat was named too"
        for line in lines
        if line not in kept
    ]


def _segment(segment: TrackSegment, folder: Path) -> dict:
    """Writes a straight piece and says which."""
    path = folder / segment_file_name(segment)
    write_segment(path, segment)
    return {
        "file": str(path),
        "array": segment.array,
        "piece": segment.piece,
        "points": len(segment.point_count),
        "first": int(segment.point_count[0]),
        "last": int(segment.point_count[-1]),
    }


def _set(crossover: CrossoverSet, path: Path) -> dict:
    return {
        "file": str(path),
        "pair": list(crossover.pair),
        "pass": crossover.pass_number,
        "points": crossover.points,
        "first": int(crossover.point_count[0]),
        "last": int(crossover.point_count[-1]),
    }
