"""The report's receiver, streaming, against the plain way with scipy.signal.hilbert on the same samples.

.venv/bin/python tests/benchmarks/bench_receiver.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from scipy.signal import butter, hilbert, sosfilt

from trackerlib.compiled import warm
from trackerlib.receiver.arrivals import joined
from trackerlib.receiver.report_receiver import ReceiverSettings, ReportReceiver

sys.path.append(str(Path(__file__).parents[1] / "receiver"))
from sounds import pulses_at, sound_of

RATE, SECONDS, BLOCK = 48_000, 40, 4_800
REPEATS = 15
WANTED = 1000  # times real time, on one core
SETTINGS = ReceiverSettings(maxima=1)


def streaming(sound):
    """Arrival times by our chain, 100 ms at a time."""
    receiver = ReportReceiver(SETTINGS, RATE)
    parts = [receiver.feed(sound[k : k + BLOCK]).arrivals for k in range(0, len(sound), BLOCK)]
    return joined([*parts, receiver.finish().arrivals]).arrival_s


def plain(sound):
    """Arrival times, late by the filters: band-pass, Hilbert, 1-ms mean, decibels, sum of 11, maximum."""
    half = SETTINGS.tuned_bandwidth_hz / 2
    band = butter(
        2, [SETTINGS.carrier_hz - half, SETTINGS.carrier_hz + half], "bandpass", fs=RATE, output="sos"
    )
    envelope = np.abs(hilbert(sosfilt(band, sound)))
    level = 180 + 20 * np.log10(envelope.reshape(-1, 48).mean(axis=1) + 1e-9)
    total = np.convolve(level, np.ones(11))[: len(level)]
    return 1e-3 * (np.argmax(total.reshape(-1, 2000), axis=1) + 2000 * np.arange(len(total) // 2000))


def seconds_of(work, sound) -> float:
    """Processor seconds of the best of several runs; the machine may be busy with other things."""
    best = np.inf
    for _ in range(REPEATS if work is streaming else 3):
        start = time.thread_time()
        work(sound)
        best = min(best, time.thread_time() - start)
    return best


def main() -> int:
    warm()
    true = 0.4 + 2.00003 * np.arange(SECONDS // 2)
    sound = sound_of(pulses_at(true, 20), SECONDS, RATE)
    ours, theirs = seconds_of(streaming, sound), seconds_of(plain, sound)
    for name, taken, found in (("report's chain", ours, streaming(sound)), ("Hilbert", theirs, plain(sound))):
        error = found - true
        spread = 1e3 * np.std(error)
        print(f"{name:16s}{SECONDS / taken:10,.0f} x real time   scatter of arrivals {spread:.2f} ms")
    print(f"ratio {theirs / ours:.0f}")
    kept = SECONDS / ours >= WANTED
    print(f"wanted {WANTED:,} x real time: {'kept' if kept else 'BROKEN'}")
    return 0 if kept else 1


if __name__ == "__main__":
    raise SystemExit(main())
