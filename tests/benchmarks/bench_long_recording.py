"""Six hours of sound read, detected and drawn: peak memory against the 500 MB allowed, and against soundfile.read.

.venv/bin/python tests/benchmarks/bench_long_recording.py      (needs 3.2 GB in the temporary folder)
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import soundfile

from trackerlib.compiled import warm
from trackerlib.receiver.arrivals import joined
from trackerlib.receiver.chart import ChartSettings, LevelPaper
from trackerlib.receiver.recording import Recording
from trackerlib.receiver.report_receiver import ReceiverSettings, ReportReceiver

sys.path.append(str(Path(__file__).parents[1] / "receiver"))
from sounds import pulses_at, sound_of

RATE, HOURS, MINUTE = 48_000, 6, 60
ALLOWED_MB = 500


def write(path: Path) -> np.ndarray:
    """A simulated recording in RF64, 24 bit: one minute over and over; returns the true arrivals."""
    once = 0.4137 + 2.0 * np.arange(MINUTE // 2)
    minute = sound_of(pulses_at(once, 25), MINUTE, RATE)
    with soundfile.SoundFile(path, "w", RATE, 1, "PCM_24", format="RF64") as file:
        for _ in range(HOURS * 60):
            file.write(minute)
    return (once + MINUTE * np.arange(HOURS * 60)[:, None]).ravel()


def listen(path: Path):
    """Arrivals and lines of paper of a whole recording."""
    receiver = ReportReceiver(ReceiverSettings(maxima=1), RATE)
    paper, lines, parts = LevelPaper(ChartSettings()), [], []
    with Recording(path) as recording:
        for block in recording.blocks():
            heard = receiver.feed(block)
            parts.append(heard.arrivals)
            lines.append(paper.feed(heard.levels))
    parts.append(receiver.finish().arrivals)
    return joined(parts), np.concatenate(lines)


def main():
    warm()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.rf64"
        true = write(path)
        start = time.perf_counter()
        arrivals, lines = listen(path)
        taken = time.perf_counter() - start
        size = path.stat().st_size / 1e6
    error_ms = 1e3 * (arrivals.arrival_s - true)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    whole = HOURS * 3600 * RATE * 4 / 1e6
    print(f"{HOURS} h, {size:,.0f} MB on disk; {len(arrivals)} arrivals of {len(true)}, {len(lines)} lines")
    print(
        f"rms error {np.sqrt(np.mean(error_ms**2)):.2f} ms; {HOURS * 3600 / taken:,.0f} x real time, file included"
    )
    print(
        f"peak memory {peak:.0f} MB; soundfile.read of it all would take {whole:,.0f} MB: ratio {whole / peak:.0f}"
    )
    print(f"allowed {ALLOWED_MB} MB: {'kept' if peak < ALLOWED_MB else 'BROKEN'}")


if __name__ == "__main__":
    main()
