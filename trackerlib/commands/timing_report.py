"""The answer of `timing` in words, a line a set."""

from __future__ import annotations

from trackerlib.commands.campaign_runs import RUN_KEYS, failures_report, run_words
from trackerlib.rounding import value_with_sigma

SERVES = 0.025  # chance below which sets are not said to share one offset


def report(answer: dict) -> str:
    """The answer of `timing` for a person, a line a set, and of a campaign run by run."""
    if "runs" in answer:
        lines = []
        for run in answer["runs"]:
            sets = [one for one in answer["sets"] if all(one[key] == run[key] for key in RUN_KEYS)]
            lines += [run_words(run), *_run_lines({**run, "sets": sets}), ""]
        lines += failures_report(answer["failed_runs"])
    else:
        lines = _run_lines(answer)
    if answer["simulated"]:
        lines.append("SIMULATED data")
    return "\n".join(lines)


def _run_lines(answer: dict) -> list[str]:
    """What the sets of one run say."""
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
    return lines + [f"{one['file']} is no use: {one['why']}" for one in answer.get("failed_sets", ())]


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
    by_hand = len(one["left_out_counts"])
    outliers = max(len(one["excluded_counts"]) - one["in_shadow"] - by_hand, 0)
    left_out = f"   {outliers} outlier{'s' * (outliers > 1)} left out" if outliers else ""
    left_out += f"   {by_hand} left out by hand" if by_hand else ""
    left_out += f"   M from {one['noise_points']} points" if one["noise_points"] != one["points"] else ""
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
