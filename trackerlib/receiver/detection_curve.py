"""False alarms and misses of the matched filter against its threshold, by theory and by simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from trackerlib.receiver import demodulation as kernels
from trackerlib.receiver.cells import CellStream, MatchedFilter
from trackerlib.receiver.matched import NOISE_CELLS, NOISE_SHARE, threshold

GRID = 9  # points of an average over a pulse's place in its cell


@dataclass(frozen=True, eq=False)
class DetectionCurve:
    """False alarms and misses, simulated and as theory has them, at T thresholds and S signal-to-noise ratios."""

    false_alarm: np.ndarray  # (T,) stated probability a cell
    threshold: np.ndarray  # (T,) power over noise
    snr_db: np.ndarray  # (S,) pulse energy over noise density
    false_alarm_found: np.ndarray  # (T,) share of simulated cells of noise
    miss: np.ndarray  # (S, T) probability that theory gives
    miss_found: np.ndarray  # (S, T) share of simulated pulses
    cells: int  # of noise simulated
    pulses: int  # simulated at each ratio


def detection_curve(
    matched: MatchedFilter, false_alarm: np.ndarray, snr_db: np.ndarray, *, pulses: int = 500, seed: int = 0
) -> DetectionCurve:
    """The detector's false alarms and misses in white noise, one pulse a frame of its noise estimate.

    false_alarm : (T,) stated probabilities; snr_db : (S,) ratios; pulses : simulated at each ratio
    The same frames without a pulse give the false alarms.
    """
    false_alarm, snr_db = np.atleast_1d(false_alarm).astype(float), np.atleast_1d(snr_db).astype(float)
    kept = int(NOISE_SHARE * NOISE_CELLS)
    least = np.array([threshold(each, kept) for each in false_alarm])
    rng = np.random.default_rng(seed)
    alarms, cells = np.zeros(len(least)), 0
    missed = np.zeros((len(snr_db), len(least)))
    for _ in range(pulses):
        noise = rng.standard_normal(matched.start_of((NOISE_CELLS + 1) * matched.cells) + 1)
        quiet = _power_over_noise(matched, noise, kept)
        alarms += np.sum(quiet[:, None] > least, axis=0)
        cells += len(quiet)
        begin_s = matched.pulse_s * (NOISE_CELLS / 2 + rng.uniform(0, 1))
        phase = rng.uniform(0, 2 * np.pi)
        pulse = unit_pulse(matched.rate_hz, matched.carrier_hz, matched.pulse_s, begin_s, phase, len(noise))
        near = int(
            begin_s * matched.cells_per_s
        )  # the pulse begins in this cell, and so does the best window
        for row, ratio in enumerate(snr_db):
            power = _power_over_noise(matched, noise + 10 ** (ratio / 20) * pulse, kept)
            missed[row] += power[near - 1 : near + 3].max() <= least
    return DetectionCurve(
        false_alarm,
        least,
        snr_db,
        alarms / cells,
        np.array([_miss(matched, ratio, least, kept) for ratio in snr_db]),
        missed / pulses,
        cells,
        pulses,
    )


def _power_over_noise(matched: MatchedFilter, samples: np.ndarray, kept: int) -> np.ndarray:
    """Power of the windows that begin with each cell of a frame, over the detector's estimate of the noise."""
    stream = CellStream(matched, matched.cells, (NOISE_CELLS + 2) * matched.cells, (0.0, 1.0))
    stream.take(samples)
    first = matched.cells - 1 - stream.base
    power = stream.power[first : first + NOISE_CELLS * matched.cells]
    return power / kernels.censored_mean(power[:: matched.cells], kept)


def unit_pulse(
    rate_hz: float, carrier_hz: float, pulse_s: float, begin_s: float, phase: float, length: int
) -> np.ndarray:
    """Samples (length,) of a pulse whose energy is that of the density of noise of variance 1 a sample."""
    n = np.arange(length)
    gate = (n >= begin_s * rate_hz) & (n < (begin_s + pulse_s) * rate_hz)
    amplitude = 2 / np.sqrt(pulse_s * rate_hz)
    return gate * amplitude * np.cos(2 * np.pi * carrier_hz / rate_hz * n + phase)


def _miss(matched: MatchedFilter, snr_db: float, least: np.ndarray, kept: int) -> np.ndarray:
    """Probability (T,) that the nearer of two windows stays below the threshold (non-central chi-square).

    Averaged over where in its cell the pulse begins, which costs up to half a cell of it, and over the error of the
    noise estimate. The other windows' luck is left out, so the truth is a little lower.
    """
    off = (np.arange(GRID) + 0.5) / GRID / 2 / matched.cells
    noise = stats.gamma.ppf((np.arange(GRID) + 0.5) / GRID, kept) / kept
    energy = 10 ** (snr_db / 10) * (1 - off) ** 2
    below = stats.ncx2.cdf(2 * least[:, None, None] * noise[:, None], 2, 2 * energy)
    return below.mean(axis=(1, 2))
