"""Are timing offsets unbiased, and do their 95 % intervals hold 95 %? Simulated sets by geometry, against the truth.

A line a geometry and strength of the noise's correlation: mean error and root-mean-square error of the offset (ms),
the mean sigma that is stated, and the share of runs whose interval holds the truth, for offset and drift. The last
columns are those of the report's own formula (17)-(19), which takes the noise of neighbouring counts as independent.

.venv/bin/python tests/benchmarks/study_timing_coverage.py [RUNS]
"""

from __future__ import annotations

import sys

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.simulation.crossover_runs import ClockTruth, simulate_crossover
from trackerlib.timing.correction import fit_timing, stretches

RUNS = 10_000
CORRELATIONS = (0.0, 0.2)  # of the noise from one count to the next
TRUTH = ClockTruth(2.5e-3, 1e-6, 30.0)
NOISE_FT, WOBBLE_FT = 1.5, 0.4
COUNT = np.arange(1, 61)
PLACE = np.array([[20_000.0, 0.0, -1300.0], [27_000.0, -200.0, -1310.0]])
SURVEY = ArraySurvey(np.array([1, 2]), PLACE, np.full(2, "NaT", "datetime64[D]"), np.zeros(2, bool))
PROFILE = SoundSpeedProfile.from_layer_middles(
    np.arange(0.0, 1350.0, 25.0), 4880.0 - 30 * (1 - np.exp(-np.arange(54) / 4)) + 0.45 * np.arange(54)
)
# Tracks between the two arrays: along their line, across it, bending, and a short one that passes beside the first.
TRACKS = {
    "along": np.column_stack([22_000 + 50.0 * COUNT, 900 + 2.0 * COUNT, np.full(60, -400.0)]),
    "across": np.column_stack([23_600 + 3.0 * COUNT, -1800 + 60.0 * COUNT, -300 - 2.0 * COUNT]),
    "bending": np.column_stack([22_300 + 40.0 * COUNT, 600 + 0.6 * (COUNT - 30.0) ** 2, np.full(60, -60.0)]),
    "beside, 45 points": np.column_stack([20_900 + 25.0 * COUNT, -1500 + 35.0 * COUNT, -600 + 5.0 * COUNT])[
        :45
    ],
}


def study(track: np.ndarray, runs: int, correlation: float, seed: int) -> np.ndarray:
    """Errors, stated sigmas and the report's sigmas (runs, 3, 2) of offset [s] and drift [s/count]."""
    found = np.empty((runs, 3, 2))
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        crossover = simulate_crossover(
            track, COUNT[: len(track)], tuple(PLACE), PROFILE, TRUTH, rng, NOISE_FT, WOBBLE_FT, correlation
        )
        fit = fit_timing(crossover, SURVEY, PROFILE)
        found[run, 0] = fit.offset_s - TRUTH.at(fit.t0), fit.drift_s_per_count - TRUTH.drift_s_per_count
        found[run, 1] = fit.sigma_offset_s, fit.sigma_drift_s_per_count
        found[run, 2] = report_sigmas(crossover, fit)
    return found


def report_sigmas(crossover: CrossoverSet, fit) -> np.ndarray:
    """Sigmas of offset and drift (2,) by (17)-(19) alone, with the M of the fit."""
    first, second = stretches(crossover, SURVEY, PROFILE)
    keep = ~fit.excluded
    c, t = (first.velocity - second.velocity)[keep], crossover.point_count[keep] - fit.t0
    square, noise = np.sum(c * c, axis=1), np.einsum("ti,ij,tj->t", c, fit.noise, c)
    return np.sqrt([noise.sum() / square.sum() ** 2, np.sum(t**2 * noise) / np.sum(t**2 * square) ** 2])


def main() -> None:
    """Prints the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    sure = np.sqrt(0.95 * 0.05 / runs)
    print(
        f"{runs} simulated runs a line; wanted: bias below 0.002 ms, share 94 to 96 %; "
        f"runs alone scatter a share by {sure:.1%}"
    )
    print("track              corr.   bias (ms)     rms   stated   share   drift's   report: stated   share")
    for correlation in CORRELATIONS:
        for seed, (name, track) in enumerate(TRACKS.items()):
            error, stated, plain = study(track, runs, correlation, seed).transpose(1, 0, 2)
            share, plain_share = (np.mean(np.abs(error) < 1.96 * one, axis=0) for one in (stated, plain))
            print(
                f"{name:18} {correlation:5.1f}   {1e3 * error[:, 0].mean():9.5f} {1e3 * error[:, 0].std():7.4f}  "
                f"{1e3 * stated[:, 0].mean():7.4f} {share[0]:7.1%}  {share[1]:8.1%}   {1e3 * plain[:, 0].mean():14.4f} "
                f"{plain_share[0]:7.1%}"
            )


if __name__ == "__main__":
    main()
