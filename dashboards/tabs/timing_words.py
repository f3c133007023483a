"""What the Timing tab says: of one set, of a run, of causes, of constancy."""

from __future__ import annotations

import html

import numpy as np

from trackerlib.rounding import value_with_sigma
from trackerlib.timing.causes import CauseFit, Ranking
from trackerlib.timing.correction import APART, TimingCorrection
from trackerlib.timing.one_run import Agreement, RunVerdict

# What no survey, clock or ocean is wrong by; linear patterns hold no further either.
BELIEVABLE = {
    "scale": 0.05,
    "downrange": 200.0,
    "crossrange": 200.0,
    "up": 200.0,
    "elevation (rad)": 0.1,
    "azimuth (rad)": 0.1,
    "about downrange (rad)": 0.1,
    "about crossrange (rad)": 0.1,
    "about vertical (rad)": 0.1,
}
# Parameters of causes as a person reads them: factor and unit.
SHOWN = {
    "offset (s)": ("offset", 1e3, "ms"),
    "drift (s/count)": ("drift", 1e3, "ms/count"),
    "scale": ("scale", 100.0, "%"),
    "gradient (1/s)": ("gradient", 1.0, "1/s"),
    "scale per count": ("scale", 1e5, "% per 1000 counts"),
    "scale per length": ("scale", 1e5, "% per 1000 ft"),
    "downrange": ("downrange", 1.0, "ft"),
    "crossrange": ("crossrange", 1.0, "ft"),
    "up": ("up", 1.0, "ft"),
    "about downrange (rad)": ("about downrange", np.degrees(1), "°"),
    "about crossrange (rad)": ("about crossrange", np.degrees(1), "°"),
    "about vertical (rad)": ("about vertical", np.degrees(1), "°"),
    "elevation (rad)": ("elevation", np.degrees(1), "°"),
    "azimuth (rad)": ("azimuth", np.degrees(1), "°"),
}


def set_name(crossover) -> str:
    """A set as lists name it."""
    first, second = crossover.pair
    return f"{first}-{second}, pass {crossover.pass_number} ({crossover.points} points)"


def sentence(crossover, correction: TimingCorrection) -> str:
    """The correction as a person would read it aloud, as HTML."""
    first, second = crossover.pair
    if not correction.points:
        return f"<b>No offset can be told:</b> {html.escape(correction.reason)}."
    sigma = None if correction.sigma_offset_s is None else 1e3 * correction.sigma_offset_s
    way = "too short" if correction.offset_s > 0 else "too long"
    words = (
        f"<b>Transit times were {way} by {value_with_sigma(abs(1e3 * correction.offset_s), sigma, 'ms')}</b> "
        f"at point count {correction.t0:.0f}, as arrays {first} and {second} saw it: correcting it takes the gap from "
        f"{correction.rms_before:.1f} to {correction.rms_after:.1f} ft."
    )
    if correction.reason:
        words += f" {_sentence_case(correction.reason)}."
    if correction.isotropic_sigma_offset_s is not None:
        even = value_with_sigma(1e3 * correction.offset_s, 1e3 * correction.isotropic_sigma_offset_s, "ms")
        words += f" With noise equal on every axis the offset is {even}."
    if correction.separated:
        words += (
            f" <b>The versions stay apart {_listed(correction.separated)}</b> after correction, by more than "
            f"{APART:.0f} sigmas: a timing error is not all that parts them."
        )
    if not correction.settled:
        words += " The joint fit did not come to rest."
    return words


def numbers(correction: TimingCorrection) -> str:
    """The numbers of a correction, as an HTML table; nothing where no point is left to tell them."""
    if not correction.points:
        return ""
    drift_sigma = (
        None if correction.sigma_drift_s_per_count is None else 1e3 * correction.sigma_drift_s_per_count
    )
    offset_sigma = None if correction.sigma_offset_s is None else 1e3 * correction.sigma_offset_s

    def feet(vector):
        return ", ".join(f"{value:.1f}" for value in vector) + " ft"

    rows = [
        ("offset", value_with_sigma(1e3 * correction.offset_s, offset_sigma, "ms")),
        ("drift", value_with_sigma(1e3 * correction.drift_s_per_count, drift_sigma, "ms/count")),
        ("at point count (t0)", f"{correction.t0:.1f}"),
        ("points used", f"{correction.points} of {len(correction.excluded)}"),
        ("mean gap before", feet(correction.mean_before)),
        ("mean gap after", feet(correction.mean_after)),
        ("points that M rests on", str(correction.noise_points)),
        ("track", f"bends (degree {correction.degree})" if correction.curved else "straight"),
    ]
    if correction.correlation is not None:
        rows.insert(3, ("correlation of the two", f"{correction.correlation:.2f}"))
    cells = "".join(
        f'<tr><td style="opacity:.75;padding:1px 8px 1px 0">{html.escape(name)}</td><td>{html.escape(text)}</td></tr>'
        for name, text in rows
    )
    return f"<table>{cells}</table><div style='opacity:.75'>gaps: downrange, crossrange, vertical</div>"


def run_sentence(verdict: RunVerdict) -> str:
    """Whether one offset serves the run, and which array stands in the way, as HTML."""
    whole, serves = verdict.whole, verdict.simplest
    if serves is whole:
        return (
            f"<b>One offset serves the run:</b> {_offset(whole)} for all {whole.offsets} sets with a sigma "
            f"({_test(whole)})."
        )
    words = (
        f"<b>One offset does not serve this run:</b> the {whole.offsets} offsets scatter {whole.scatter:.1f} times as "
        f"far as their sigmas allow ({_test(whole)}). "
    )
    if serves is None:
        best = verdict.without[0]
        return words + (
            f"No array alone explains it; without array {best.left_out} they come nearest ({_test(best)}). "
            "<b>Causes</b> tries what else could part the tracks."
        )
    drift = ""
    if serves.drift_s_per_count:
        sigma = 1e3 * serves.sigma_drift_s_per_count
        drift = f" with a drift of {value_with_sigma(1e3 * serves.drift_s_per_count, sigma, 'ms/count')}"
    if serves.left_out is None:
        return words + f"An offset of {_offset(serves)}{drift} serves it ({_test(serves)})."
    return words + (
        f"<b>Without array {serves.left_out} the other {serves.offsets} agree:</b> {_offset(serves)}{drift} "
        f"({_test(serves)}). Something is wrong with array {serves.left_out}; <b>Causes</b> tells what."
    )


def _offset(one: Agreement) -> str:
    return value_with_sigma(1e3 * one.offset_s, 1e3 * one.sigma_offset_s, "ms")


def _test(one: Agreement) -> str:
    return f"chi-square {one.distance:.1f} for {one.dof}, {p_words(one.p_value)}"


def p_words(p_value: float) -> str:
    """A p-value without digits that mean nothing."""
    return "p below 1e-12" if p_value < 1e-12 else f"p {p_value:.2g}"


def parameters_words(fit: CauseFit) -> str:
    """Estimates with sigmas in the units of the screen."""
    return "; ".join(
        _parameter(name, value, sigma)
        for name, value, sigma in zip(fit.parameters, fit.estimate, fit.sigma, strict=True)
    )


def _parameter(name: str, value: float, sigma: float) -> str:
    words, factor, unit = SHOWN[name]
    return f"{words} {value_with_sigma(factor * value, factor * sigma, unit)}"


def ranking_sentence(ranking: Ranking, scope: str) -> str:
    """Which cause the gaps support, how well, and what the geometry cannot separate, as HTML."""
    best = ranking.best
    if not best.parameters:
        words = f"<b>Noise alone explains the gaps of {scope}</b>; no cause fits better than the best of so many would "
        words += f"by luck. Chi-square per number is {best.chi_square / best.count:.2f}; 1 is what noise alone leaves."
        return words + _skipped(ranking)
    words = (
        f"<b>What fits {scope} best is {html.escape(best.name)}:</b> {html.escape(parameters_words(best))}. "
        f"It brings chi-square per number from {ranking.chi_square_before / best.count:.1f} to "
        f"{best.chi_square / best.count:.2f}; 1 is what noise alone leaves."
    )
    words += _believed(ranking)
    arrays = [cause.array for cause in best.causes if cause.array is not None]
    moved = [k for k, name in enumerate(best.parameters) if name in ("downrange", "crossrange", "up")]
    if len(moved) == 3:
        words += (
            f" <b>Array {arrays[0]} seems to lie {np.linalg.norm(best.estimate[moved]):.1f} ft from where the table "
            "puts it</b>; its position should be moved by these three."
        )
    rival = next((fit for fit in ranking.fits if fit.aicc > best.aicc), None)
    if rival is not None:
        words += f" The next best, {html.escape(rival.name)}, is {rival.aicc - best.aicc:.0f} worse in AICc."
    if best.aicc > 0:
        words += f" {_sentence_case(ranking.fits[0].name)} is {best.aicc:.0f} better in AICc, no more than by luck."
    if best.held_out is not None:
        words += f" On sets that the fit had not seen chi-square per number is {best.held_out:.2f}."
    if best.alike:
        words += f" These sets cannot tell it from {html.escape(_listed(best.alike))}."
    if best.hardly_separated:
        pairs = [f"{SHOWN[a][0]} and {SHOWN[b][0]}" for a, b in best.hardly_separated]
        words += f" The geometry hardly separates {_listed(pairs)}."
    return words + _skipped(ranking)


def _skipped(ranking: Ranking) -> str:
    if not ranking.skipped:
        return ""
    listed = "<br>".join(html.escape(one) for one in ranking.skipped)
    return (
        f"<details><summary>Sets that could not take part: {len(ranking.skipped)}</summary>{listed}</details>"
    )


def _believed(ranking: Ranking) -> str:
    """A warning where the best pair of causes is larger than can be, and the best cause alone beside any pair."""
    best = ranking.best
    words = ""
    wild = [
        SHOWN[name][0]
        for name, value in zip(best.parameters, best.estimate, strict=True)
        if abs(value) > BELIEVABLE.get(name, np.inf)
    ]
    if wild:
        words += (
            f" <b>That {_listed(wild)} is more than can be believed:</b> these sets are too few, or too much alike, "
            "to tell the causes apart."
        )
    if len(best.causes) > 1:
        alone = next(fit for fit in ranking.fits if len(fit.causes) == 1 and fit.parameters)
        words += (
            f" Of the causes alone the best is {html.escape(alone.name)}: {html.escape(parameters_words(alone))}, "
            f"with chi-square per number {alone.chi_square / alone.count:.2f}."
        )
    return words


def _listed(names) -> str:
    names = list(names)
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + f" and {names[-1]}"


def _sentence_case(text: str) -> str:
    return html.escape(text[:1].upper() + text[1:])
