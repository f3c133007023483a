"""Six hours of sound read, heard by both detectors, drawn on the app's paper: peak memory against the 500 MB allowed.

And against soundfile.read, which takes the whole.

.venv/bin/python tests/benchmarks/bench_long_recording.py      (needs 3.2 GB in the temporary folder)
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import soundfile

from dashboards.pictures.wet_paper import WetPaper
from dashboards.tabs.chart_controls import COLUMNS
from dashboards.tabs.chart_sources import LATE_ARRIVALS_S, MODERN_FULL_SCALE
from trackerlib.compiled import warm
from trackerlib.receiver.chart import ChartSettings
from trackerlib.receiver.detectors import DETECTORS, hear
from trackerlib.receiver.recording import BLOCK_S, Recording
from trackerlib.receiver.report_receiver import ReceiverSettings
from trackerlib.receiver.rolls import SoundRoll

sys.path.append(str(Path(__file__).parents[1] / "receiver"))
from sounds import pulses_at, sound_of

RATE, HOURS, MINUTE = 48_000, 6, 60
ALLOWED_MB = 500
HISTORY = 2000  # lines of paper kept, the most there are
LINES_EVERY = 100  # blocks


def write(path: Path) -> np.ndarray:
    """A simulated recording in RF64, 24 bit: one minute over and over; returns the true arrivals."""
    once = 0.4137 + 2.0 * np.arange(MINUTE // 2)
    minute = sound_of(pulses_at(once, 25), MINUTE, RATE)
    with soundfile.SoundFile(path, "w", RATE, 1, "PCM_24", format="RF64") as file:
        for _ in range(HOURS * 60):
            file.write(minute)
    return (once + MINUTE * np.arange(HOURS * 60)[:, None]).ravel()


def listen(name: str, path: Path) -> tuple[np.ndarray, int, float, float]:
    """Arrival times of a whole recording, lines drawn on the app's paper as they come, seconds taken, peak MB."""
    warm()
    start = time.perf_counter()
    settings, chart = ReceiverSettings(maxima=1), ChartSettings(columns=COLUMNS)
    roll = SoundRoll(path.name, True, settings.sample_interval_s, settings.interval_s + LATE_ARRIVALS_S)
    paper = WetPaper(COLUMNS, HISTORY)
    with Recording(path) as recording:
        heard = hear(name, settings, RATE, recording.blocks(), BLOCK_S, MODERN_FULL_SCALE)
        for number, each in enumerate(heard, 1):
            roll.feed(each)
            if number % LINES_EVERY == 0:
                draw(paper, roll, chart)
    roll.finish()
    draw(paper, roll, chart)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return roll.arrivals.arrival_s, paper.count, time.perf_counter() - start, peak


def draw(paper: WetPaper, roll: SoundRoll, chart: ChartSettings) -> None:
    """Lays the lines on paper that have become known."""
    known = roll.whole_lines(chart)
    if known > paper.count:
        paper.add(roll.lines(chart, paper.count, known))
        paper.flush(whole=True)


def main() -> int:
    warm()  # compiles what is not compiled yet, which takes memory of its own; each detector then has its own process
    kept = True
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.rf64"
        true = write(path)
        whole = HOURS * 3600 * RATE * 4 / 1e6
        print(f"{HOURS} h, {path.stat().st_size / 1e6:,.0f} MB on disk; soundfile.read takes {whole:,.0f} MB")
        for name in DETECTORS:
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                arrival_s, lines, taken, peak = pool.submit(listen, name, path).result()
            error_ms = 1e3 * (arrival_s - true) if len(arrival_s) == len(true) else np.full(1, np.nan)
            print(
                f"{name:8}{len(arrival_s)} arrivals of {len(true)}, {lines} lines; rms error "
                f"{np.sqrt(np.mean(error_ms**2)):.3f} ms; {HOURS * 3600 / taken:,.0f} x real time, all included; "
                f"peak memory {peak:.0f} MB, ratio {whole / peak:.0f}"
            )
            kept = kept and peak < ALLOWED_MB
    print(f"allowed {ALLOWED_MB} MB: {'kept' if kept else 'BROKEN'}")
    return 0 if kept else 1


if __name__ == "__main__":
    raise SystemExit(main())
