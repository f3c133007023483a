"""`timing CROSSOVER...`: offset and drift of one clock from every set, with their sigmas."""

from __future__ import annotations

import argparse
import csv
import io
import sys
from pathlib import Path

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.commands.campaign_runs import RUN_KEYS, chosen_runs, each_run
from trackerlib.commands.range_inputs import (
    add_profile_speeds,
    check_outputs,
    read_edits,
    read_profile,
    read_survey,
    tell,
)
from trackerlib.commands.timing_report import report
from trackerlib.crossover.doubts import profile_doubts, set_doubts
from trackerlib.crossover.edits import PointEdits
from trackerlib.crossover.gating import gate_reports
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.campaign import Campaign, CampaignRun
from trackerlib.rangefiles.covariance_files import read_covariances
from trackerlib.rangefiles.crossover_file import crossover_file_name, read_crossover
from trackerlib.rangefiles.m_matrix_file import read_m_matrix
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.textfiles import InputError, write_text
from trackerlib.timing.causes import CauseFit, Ranking, compare_causes
from trackerlib.timing.correction import METHODS, OUTLIERS, TimingCorrection, fit_timing
from trackerlib.timing.one_run import judge_run

__all__ = ["SUMMARY", "add_arguments", "document", "offsets_csv", "report", "run"]

SUMMARY = "estimate timing offset and drift from crossover sets"
MOST_CAUSES = 12  # that an answer lists
COLUMNS = (
    "day", "run", "pair", "offset_ms", "sigma_offset_ms", "drift_ms_per_count", "sigma_drift_ms_per_count",
    "correlation", "t0", "points", "file", "mode", "simulated",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of `timing`."""
    add = parser.add_argument
    add("crossover", nargs="*", type=Path, metavar="CROSSOVER", help="crossover files whose arrays are known")
    add(
        "--set",
        nargs=3,
        action="append",
        default=[],
        metavar=("FILE", "LEFT", "RIGHT"),
        help="a crossover file and its two arrays",
    )
    add("--arrays", type=Path, metavar="FILE", help="array table")
    add("--profile", type=Path, metavar="VELOCITY.DAT", help="sound-speed table, ft and ft/s")
    add("--campaign", type=Path, metavar="FILE", help="all runs of a campaign, in place of all the above")
    add_profile_speeds(parser)
    add(
        "--covariance",
        type=Path,
        metavar="FILE",
        help="M in three rows, or a folder with OUTPUT1.COV and OUTPUT2.COV (default: from straight lines)",
    )
    add(
        "--causes",
        action="store_true",
        help="also compare what else could part the tracks, on all sets together",
    )
    add(
        "--method",
        choices=METHODS,
        default=METHODS[0],
        help="weigh directions alike, or by M until it settles",
    )
    add(
        "--outliers",
        choices=OUTLIERS,
        default=OUTLIERS[0],
        help="out of all, out of M alone, or in everything",
    )
    add(
        "--edits",
        type=Path,
        metavar="FILE",
        help="points to leave out by hand: an edit log, as the Crossover tab saves it",
    )
    add("--mode", type=int, metavar="M", help="vehicle of these sets; of a campaign take only its runs")
    add("--day", metavar="D", help="day of these sets, for --out; of a campaign take only that day's runs")
    add("--run", metavar="R", help="run of these sets, for --out; of a campaign take only runs of that name")
    add("--out", type=Path, metavar="OFFSETS.csv", help="table of the offsets, which `constancy` reads")


def run(args: argparse.Namespace) -> dict:
    """The answer of `timing` as a document for JSON; writes OFFSETS.csv where that is asked for."""
    if args.campaign:
        return run_campaign(args)
    if args.arrays is None or args.profile is None:
        raise InputError("wanted --arrays FILE and --profile VELOCITY.DAT, or --campaign FILE")
    if not args.crossover and not args.set:
        raise InputError("no crossover set given; wanted CROSSOVER files or --set FILE LEFT RIGHT")
    if args.out and (args.day is None or args.run is None):
        raise InputError("--out needs --day and --run, which the table names")
    _check_out(args)
    survey = read_survey(args.arrays)
    profile = read_profile(args.profile, args.profile_speeds)
    answers, sets, fits, failed = fit_sets(args, survey, profile)
    simulated = _is_simulated(args, sets)
    answer = {"sets": answers, "failed_sets": failed, **_together(args, sets, fits, survey, profile)}
    if args.out:
        write_text(args.out, offsets_csv(answers, args.day, args.run, simulated))
    return {**answer, "simulated": simulated}


def fit_sets(args: argparse.Namespace, survey: ArraySurvey, profile: SoundSpeedProfile):
    """Answers, sets and fits of all files, and those of no use with the reason. Raises InputError if none is of use.

    The sets are without the points left out by hand.
    """
    noise = _told_noise(args.covariance)
    edits, mode = _edits_of_sets(args)
    named = [(path, None) for path in args.crossover] + [_told(*one) for one in args.set]
    answers, sets, fits, failed, taken = [], [], [], [], set()
    for path, pair in named:
        try:
            if path.resolve() in taken:
                raise InputError("is named twice; it is taken once")
            taken.add(path.resolve())
            reading = read_crossover(path, survey, pair)
            crossover = reading.set.lower_first()
            doubts = set_doubts(crossover, survey)
            tell(path.name, reading.bad_records, [*reading.notes, *doubts])
            left_out = edits.excluded(crossover, mode)
            answer, fit = fit_set(args, path, crossover, survey, profile, noise, left_out)
        except InputError as error:
            failed.append({"file": str(path), "why": str(error)})
            continue
        answers.append({**answer, "mode": args.mode, "remarks": doubts})
        sets.append(crossover.only(~left_out))
        fits.append(fit)
    if not answers:
        raise InputError(f"no crossover set is of use; {failed[0]['file']}: {failed[0]['why']}")
    tell(profile.name, (), profile_doubts(profile, survey, {n for one in sets for n in one.pair}))
    _tell_edits(args, edits, answers)
    for one in failed:
        print(f"timing: {one['file']} is no use: {one['why']}; the other sets go on", file=sys.stderr)
    return answers, sets, fits, failed


def fit_set(args, path, crossover, survey, profile, noise, left_out) -> tuple[dict, TimingCorrection]:
    """The answer for one set without the points (T,) left out by hand, and the fit itself."""
    options = {"method": args.method, "outliers": args.outliers, "left_out": left_out}
    fit = fit_timing(crossover, survey, profile, noise, **options)
    return document(path, crossover, fit, left_out), fit


def _together(args, sets, fits, survey, profile) -> dict:
    """What the sets of one run say together."""
    answer = {"one_offset": one_offset(sets, fits)}
    if args.causes:
        try:
            answer |= causes_document(compare_causes(sets, survey, profile))
        except ValueError as error:
            print(f"timing: {error}", file=sys.stderr)
    return answer


def _edits_of_sets(args: argparse.Namespace) -> tuple[PointEdits, int]:
    """The edit log, and the vehicle under which it knows the points of crossover files."""
    edits = read_edits(args.edits)
    modes = sorted({edit.mode for edit in edits.log})
    if args.mode is None and len(modes) > 1:
        raise InputError(
            f"{args.edits.name}: found points of modes {', '.join(map(str, modes))}; choose the vehicle of these sets "
            "with --mode"
        )
    return edits, (modes or [0])[0] if args.mode is None else args.mode


def _tell_edits(args: argparse.Namespace, edits: PointEdits, answers: list[dict]) -> None:
    """Says how many points of an edit log are in none of the sets."""
    missed = len(edits.reasons) - sum(len(one["left_out_counts"]) for one in answers)
    if missed > 0:
        tell(
            args.edits.name,
            (),
            [f"{missed} of {len(edits.reasons)} points left out are in none of these sets"],
        )


def one_offset(sets: list[CrossoverSet], fits: list[TimingCorrection]) -> dict | None:
    """Whether the sets share one offset, and one offset with a drift, each judged by its own sigma."""
    try:
        verdict = judge_run(sets, fits)
    except ValueError:  # too few with a sigma
        return None
    tests = {"constant": verdict.whole, "drifting": verdict.drifting}
    return {
        name: {
            "mean_offset_ms": 1e3 * test.offset_s,
            "sigma_mean_offset_ms": 1e3 * test.sigma_offset_s,
            "distance": test.distance,
            "dof": test.dof,
            "p_value": test.p_value,
        }
        for name, test in tests.items()
    }


def causes_document(ranking: Ranking) -> dict:
    """The comparison of causes as keys of a document."""

    def one(fit: CauseFit) -> dict:
        return {
            "cause": fit.name,
            "aicc_above_best": fit.aicc,
            "chi_square_per_number": fit.chi_square / fit.count,
            "held_out_per_number": fit.held_out,
            "parameters": {
                name: {"estimate": float(value), "sigma": float(sigma)}
                for name, value, sigma in zip(fit.parameters, fit.estimate, fit.sigma, strict=True)
            },
            "hardly_separated": [list(pair) for pair in fit.hardly_separated],
            "alike": list(fit.alike),
        }

    return {
        "best_cause": ranking.best.name,
        "causes": [one(fit) for fit in ranking.leading(MOST_CAUSES)],
        "causes_skipped_sets": list(ranking.skipped),
    }


def run_campaign(args: argparse.Namespace) -> dict:
    """The answer for every set of every run of a campaign; its T-files are gated on the way."""
    if args.crossover or args.set or args.arrays or args.profile:
        raise InputError("--campaign names its files itself; wanted either it or crossover sets")
    campaign = chosen_runs(args.campaign, args.day, args.run, args.mode)
    _check_out(args, campaign)
    noise, edits = _told_noise(args.covariance), read_edits(args.edits)
    _refuse_namesakes(args, edits, campaign)
    done, failed = each_run(
        "timing", campaign, lambda one: fit_run(args, one, noise, edits.of_source(one.tfile.name))
    )
    answers = [answer for _, (fits, _) in done for answer in fits]
    simulated = any(run["simulated"] for _, (_, run) in done)
    _tell_edits(args, edits, answers)
    if args.out:
        rows = [{**answer, "run": _run_name(campaign, answer)} for answer in answers]
        write_text(args.out, offsets_csv(rows, simulated=simulated))
    runs = [run for _, (_, run) in done]
    return {"sets": answers, "runs": runs, "failed_runs": failed, "simulated": simulated}


def fit_run(args, one: CampaignRun, noise: np.ndarray | None, edits: PointEdits) -> tuple[list[dict], dict]:
    """The answers for every set of one run of a campaign, and what they say together."""
    survey = read_survey(one.arrays)
    profile = read_profile(one.profile, args.profile_speeds)
    tfile = read_tfile(one.tfile, one.header_records, one.mode)
    gated = gate_reports(tfile.reports, survey, one.mode, run_date=tfile.run_date)
    doubts = profile_doubts(profile, survey, {n for crossover in gated.sets for n in crossover.pair})
    tell(f"timing: {one}", gated.bad_records, (*tfile.doubts, *gated.warnings, *doubts))
    known = {**{key: getattr(one, key) for key in RUN_KEYS}, "vehicle": one.vehicle}
    answers, fits = [], []
    for crossover in gated.sets:
        path = Path(one.folder) / crossover_file_name(crossover)
        left_out = edits.excluded(crossover, one.mode)
        answer, fit = fit_set(args, path, crossover, survey, profile, noise, left_out)
        answers.append({**known, **answer})
        fits.append(fit)
    kept = [edits.kept(crossover, one.mode) for crossover in gated.sets]
    together = _together(args, kept, fits, survey, profile)
    return answers, {**known, **together, "simulated": tfile.simulated}


def _refuse_namesakes(args: argparse.Namespace, edits: PointEdits, campaign: Campaign) -> None:
    """Raises InputError where a log would leave points out of two T-files, as it knows them by name alone."""
    names = [file.name for file in {one.tfile for one in campaign.runs}]
    if twice := {name for name in names if names.count(name) > 1 and len(edits.of_source(name))}:
        raise InputError(
            f"{args.edits.name}: T-files stand there without their folder, and two of these runs have a {min(twice)}; "
            "choose one run with --day and --run"
        )


def _run_name(campaign: Campaign, answer: dict) -> str:
    """The run for the table of offsets; vehicles of one run, each with its own clock, are runs of their own there."""
    together = campaign.select({answer["day"]}, {answer["run"]}).runs
    return answer["run"] if len(together) == 1 else f"{answer['run']} mode {answer['mode']}"


def document(
    path: Path | str, crossover: CrossoverSet, fit: TimingCorrection, left_out: np.ndarray | None = None
) -> dict:
    """One set's correction under the keys that others rely on; `left_out` (T,) is true at points left out by hand."""

    def milli(value):
        return None if value is None else 1e3 * value

    return {
        "file": str(path),
        "pair": list(crossover.pair),
        "offset_ms": milli(fit.offset_s),
        "sigma_offset_ms": milli(fit.sigma_offset_s),
        "drift_ms_per_count": milli(fit.drift_s_per_count),
        "sigma_drift_ms_per_count": milli(fit.sigma_drift_s_per_count),
        "correlation": fit.correlation,
        "t0": fit.t0,
        "points": fit.points,
        "in_shadow": fit.in_shadow,
        "excluded_counts": crossover.point_count[fit.excluded].tolist(),
        "left_out_counts": [] if left_out is None else crossover.point_count[left_out].tolist(),
        "M_ft2": None if fit.noise is None else fit.noise.tolist(),
        "noise_points": fit.noise_points,
        "method": fit.method,
        "settled": fit.settled,
        "isotropic_sigma_offset_ms": milli(fit.isotropic_sigma_offset_s),
        "correlation_length": fit.correlation_length,
        "curved": fit.curved,
        "degree": fit.degree,
        "separated": list(fit.separated),
        "rms_before_ft": fit.rms_before,
        "rms_after_ft": fit.rms_after,
        "mean_before_ft": fit.mean_before.tolist(),
        "mean_after_ft": fit.mean_after.tolist(),
        "reason": fit.reason,
    }


def offsets_csv(answers: list[dict], day: str = "", run_name: str = "", simulated: bool = False) -> str:
    """The table of offsets: day, run, pair, offset_ms, and the other columns of Table 1 (Read 1990).

    day, run_name : of the answers that do not name theirs
    A set without a usable point has no offset and no row.
    """
    out = io.StringIO()
    table = csv.DictWriter(out, COLUMNS, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    for answer in answers:
        if not answer["points"]:
            continue
        pair = "-".join(map(str, answer["pair"]))
        label = {"simulated": "yes" if simulated else "", "file": Path(answer["file"]).name}
        named = {"day": day, "run": run_name, **answer, "pair": pair, **label}
        table.writerow(named)
    return out.getvalue()


def _check_out(args: argparse.Namespace, campaign: Campaign | None = None) -> None:
    """Raises InputError where the table of offsets would be written over a file that is read."""
    read = {
        "array table": args.arrays,
        "profile": args.profile,
        "campaign": args.campaign,
        "edit log": args.edits,
    }
    read |= {
        f"crossover file {path}": path for path in (*args.crossover, *(Path(one[0]) for one in args.set))
    }
    for one in campaign.runs if campaign else ():
        read |= {
            f"T-file of {one}": one.tfile,
            f"array table of {one}": one.arrays,
            f"profile of {one}": one.profile,
        }
    check_outputs({"--out": args.out}, read)


def _told(file: str, left: str, right: str) -> tuple[Path, tuple[int, int]]:
    try:
        return Path(file), (int(left), int(right))
    except ValueError:
        raise InputError(f"--set {file} {left} {right}: wanted two array numbers after the file") from None


def _told_noise(path: Path | None) -> np.ndarray | None:
    """M (3, 3) of a file, or from both files of covariances in a folder; None where none is told."""
    if path is None:
        return None
    if not path.is_dir():
        return read_m_matrix(path)
    of_x, of_y, cross = read_covariances(path)
    return of_x + of_y - cross - cross.T


def _is_simulated(args: argparse.Namespace, sets: list[CrossoverSet]) -> bool:
    """Whether a set says so itself, or a truth.json beside the array table says that the run is synthetic."""
    if any(one.range_name == "SIMULATED" for one in sets):
        return True
    truth = args.arrays.with_name("truth.json")
    return truth.exists() and '"synthetic": true' in truth.read_text(errors="replace")
