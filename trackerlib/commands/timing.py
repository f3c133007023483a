"""`timing CROSSOVER...`: offset and drift of one clock from every set, with their sigmas."""

from __future__ import annotations

import argparse
import csv
import io
import sys
from pathlib import Path

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.commands.campaign_runs import chosen_runs, each_run, failures_report
from trackerlib.commands.range_inputs import read_profile, read_survey, tell
from trackerlib.crossover.doubts import profile_doubts, set_doubts
from trackerlib.crossover.gating import gate_reports
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.campaign import CampaignRun
from trackerlib.rangefiles.covariance_files import read_covariances
from trackerlib.rangefiles.crossover_file import crossover_file_name, read_crossover
from trackerlib.rangefiles.m_matrix_file import read_m_matrix
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.rounding import value_with_sigma
from trackerlib.textfiles import InputError, write_text
from trackerlib.timing.causes import CauseFit, Ranking, compare_causes
from trackerlib.timing.correction import METHODS, OUTLIERS, TimingCorrection, fit_timing
from trackerlib.timing.one_run import offsets_agree

SUMMARY = "estimate timing offset and drift from crossover sets"
SERVES = 0.025  # chance below which sets are not said to share one offset
MOST_CAUSES = 12  # that an answer lists
COLUMNS = (
    "day", "run", "pair", "offset_ms", "sigma_offset_ms", "drift_ms_per_count", "sigma_drift_ms_per_count",
    "correlation", "t0", "points", "file",
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
    add("--profile-speeds", choices=("middle", "boundary"), default="middle", help="where its speeds belong")
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
    survey = read_survey(args.arrays)
    profile = read_profile(args.profile, args.profile_speeds)
    answers, sets, failed = fit_sets(args, survey, profile)
    if args.out:
        write_text(args.out, offsets_csv(answers, args.day, args.run))
    answer = {
        "sets": answers,
        "failed_sets": failed,
        "one_offset": one_offset(answers),
        "simulated": _is_simulated(args, sets),
    }
    if args.causes:
        try:
            answer |= causes_document(compare_causes(sets, survey, profile))
        except ValueError as error:
            print(f"timing: {error}", file=sys.stderr)
    return answer


def fit_sets(args: argparse.Namespace, survey: ArraySurvey, profile: SoundSpeedProfile):
    """Answers and sets of all files, and those of no use with the reason. Raises InputError where none is of use."""
    noise = None if args.covariance is None else _told_noise(args.covariance)
    named = [(path, None) for path in args.crossover] + [_told(*one) for one in args.set]
    answers, sets, failed = [], [], []
    for path, pair in named:
        try:
            reading = read_crossover(path, survey, pair)
            doubts = set_doubts(reading.set, survey)
            tell(path.name, reading.bad_records, [*reading.notes, *doubts])
            fit = fit_timing(reading.set, survey, profile, noise, method=args.method, outliers=args.outliers)
        except InputError as error:
            failed.append({"file": str(path), "why": str(error)})
            continue
        answers.append({**document(path, reading.set, fit), "remarks": doubts})
        sets.append(reading.set)
    if not answers:
        raise InputError(f"no crossover set is of use; {failed[0]['file']}: {failed[0]['why']}")
    tell(profile.name, (), profile_doubts(profile, survey, {n for one in sets for n in one.pair}))
    for one in failed:
        print(f"timing: {one['file']} is no use: {one['why']}; the other sets go on", file=sys.stderr)
    return answers, sets, failed


def one_offset(answers: list[dict]) -> dict | None:
    """Whether the sets share one offset, and one offset with a drift, each judged by its own sigma."""
    sure = [one for one in answers if one["sigma_offset_ms"]]
    if len(sure) < 3:
        return None
    offset, sigma, t0 = (
        np.array([one[key] for one in sure]) for key in ("offset_ms", "sigma_offset_ms", "t0")
    )
    tests = {
        "constant": offsets_agree(1e-3 * offset, 1e-3 * sigma, t0),
        "drifting": offsets_agree(1e-3 * offset, 1e-3 * sigma, t0, drift=True),
    }
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
        "causes": [one(fit) for fit in ranking.fits[:MOST_CAUSES]],
        "causes_skipped_sets": list(ranking.skipped),
    }


def run_campaign(args: argparse.Namespace) -> dict:
    """The answer for every set of every run of a campaign; its T-files are gated on the way."""
    if args.crossover or args.set or args.arrays or args.profile:
        raise InputError("--campaign names its files itself; wanted either it or crossover sets")
    done, failed = each_run(
        "timing", chosen_runs(args.campaign, args.day, args.run), lambda one: fit_run(args, one)
    )
    answers = [
        {"day": one.day, "run": one.run, "vehicle": one.vehicle, **fit}
        for one, (fits, _) in done
        for fit in fits
    ]
    if args.out:
        write_text(args.out, offsets_csv(answers))
    simulated = any(simulated for _, (_, simulated) in done)
    return {"sets": answers, "failed_runs": failed, "simulated": simulated}


def fit_run(args: argparse.Namespace, one: CampaignRun) -> tuple[list[dict], bool]:
    """The answers for every set of one run of a campaign, and whether the run is simulated."""
    survey = read_survey(one.arrays)
    profile = read_profile(one.profile, args.profile_speeds)
    tfile = read_tfile(one.tfile, one.header_records, one.mode)
    gated = gate_reports(tfile.reports, survey, one.mode, run_date=tfile.run_date)
    doubts = profile_doubts(profile, survey, {n for crossover in gated.sets for n in crossover.pair})
    tell(f"timing: {one}", gated.bad_records, (*tfile.doubts, *gated.warnings, *doubts))
    folder, answers = Path(f"day_{one.day}_run_{one.run}_mode_{one.mode}"), []
    for crossover in gated.sets:
        fit = fit_timing(crossover, survey, profile, method=args.method, outliers=args.outliers)
        answers.append(document(folder / crossover_file_name(crossover), crossover, fit))
    return answers, tfile.simulated


def document(path: Path | str, crossover: CrossoverSet, fit: TimingCorrection) -> dict:
    """One set's correction under the keys that others rely on."""

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


def offsets_csv(answers: list[dict], day: str = "", run_name: str = "") -> str:
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
        named = {"day": day, "run": run_name, **answer, "pair": pair, "file": Path(answer["file"]).name}
        table.writerow(named)
    return out.getvalue()


def report(answer: dict) -> str:
    """The answer of `timing` for a person, a line a set."""
    lines = ["pair       T   about count   offset (ms)        drift (ms/count)      rms gap (ft)"]
    lines += [_set_line(one) for one in answer["sets"]]
    for name, one in (answer.get("one_offset") or {}).items():
        kind = "one offset for all sets" if name == "constant" else "one offset and one drift"
        verdict = "serves" if one["p_value"] > SERVES else "does not serve"
        lines.append(
            f"{kind} {verdict}: {one['mean_offset_ms']:.3f} ± {one['sigma_mean_offset_ms']:.3f} ms, distance "
            f"{one['distance']:.1f} with {one['dof']} degrees of freedom, p {one['p_value']:.2g}"
        )
    if "causes" in answer:
        lines += _cause_lines(answer)
    lines += [f"{one['file']} is no use: {one['why']}" for one in answer.get("failed_sets", ())]
    lines += failures_report(answer.get("failed_runs", []))
    if answer["simulated"]:
        lines.append("SIMULATED data")
    return "\n".join(lines)


def _set_line(one: dict) -> str:
    """One set's correction; passes of one pair are told apart by the count that the offset holds at."""
    pair = "{}-{}".format(*one["pair"])
    shadow = f"   {one['in_shadow']} points in shadow" if one["in_shadow"] else ""
    if not one["points"]:
        return f"{pair:8} {0:3d}   no offset: {one['reason']}{shadow}"
    start = f"{pair:8} {one['points']:3d}   {one['t0']:11.1f}   {one['offset_ms']:7.3f}"
    if one["sigma_offset_ms"] is None:
        even = one["isotropic_sigma_offset_ms"]
        also = "" if even is None else f"; with equal noise on every axis ± {even:.2g}"
        return f"{start}, no sigma: {one['reason']}{also}{shadow}"
    apart = f"   still apart: {', '.join(one['separated'])}" if one["separated"] else ""
    outliers = len(one["excluded_counts"]) - one["in_shadow"]
    left_out = f"   {outliers} outlier{'s' * (outliers > 1)} left out" if outliers else ""
    return (
        f"{start} ± {one['sigma_offset_ms']:.3f}   "
        f"{one['drift_ms_per_count']:9.4f} ± {one['sigma_drift_ms_per_count']:.4f}   "
        f"{one['rms_before_ft']:.1f} -> {one['rms_after_ft']:.1f}{left_out}{shadow}{apart}"
    )


def _cause_lines(answer: dict) -> list[str]:
    """The comparison of causes, and of the best what it amounts to and what it cannot be told from."""
    best = next(one for one in answer["causes"] if one["cause"] == answer["best_cause"])
    several = len(answer["sets"]) > 1
    lines = ["", f"what fits {'all sets together' if several else 'the set'}: {best['cause']}"]
    for name, one in best["parameters"].items():
        lines.append(f"    {name}: {value_with_sigma(one['estimate'], one['sigma'], '').strip()}")
    lines += [f"    these sets cannot tell it from {other}" for other in best["alike"]]
    lines += [f"    the geometry hardly separates {one} and {two}" for one, two in best["hardly_separated"]]
    lines.append(f"{'cause':60}  AICc above best   chi-square   held out")
    for one in answer["causes"]:
        held_out = one["held_out_per_number"]
        lines.append(
            f"{one['cause']:60}  {one['aicc_above_best']:15.1f}   {one['chi_square_per_number']:10.3f}   "
            f"{'' if held_out is None else format(held_out, '8.3f')}"
        )
    return lines + [f"took no part: {why}" for why in answer["causes_skipped_sets"]]


def _told(file: str, left: str, right: str) -> tuple[Path, tuple[int, int]]:
    try:
        return Path(file), (int(left), int(right))
    except ValueError:
        raise InputError(f"--set {file} {left} {right}: wanted two array numbers after the file") from None


def _told_noise(path: Path) -> np.ndarray:
    """M (3, 3) of a file, or from both files of covariances in a folder."""
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
