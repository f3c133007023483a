"""The modern detector in blocks of 100 ms against a plain scipy.signal.hilbert envelope of the same samples.

Both run on one core; processor time is compared, so that a busy machine counts less.

.venv/bin/python tests/benchmarks/bench_matched.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from scipy import signal

from trackerlib.compiled import warm
from trackerlib.receiver.arrivals import joined
from trackerlib.receiver.matched import ModernDetector

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "receiver"))
from recordings import CARRIER_HZ, PULSE_S, RATE_HZ, recording

SECONDS, BLOCK, REPEATS = 60, RATE_HZ // 10, 9
INTERVAL_S = 2.0
WANTED = 5000  # times real time, on one core


def ours(samples):
    """Arrivals of the strongest of each period."""
    detector = ModernDetector(RATE_HZ, CARRIER_HZ, PULSE_S, INTERVAL_S, maxima=1)
    heard = [detector.feed(samples[k : k + BLOCK]) for k in range(0, len(samples), BLOCK)]
    heard.append(detector.finish())
    return joined([each.arrivals for each in heard]).arrival_s


def peer(samples):
    """Band-pass of one over the pulse, envelope by Hilbert transform, greatest of each period."""
    edges = CARRIER_HZ + np.array([-1, 1]) / PULSE_S
    taps = signal.firwin(481, edges, pass_zero=False, fs=RATE_HZ)
    envelope = np.abs(signal.hilbert(signal.oaconvolve(samples, taps, mode="same")))
    best = envelope.reshape(-1, round(INTERVAL_S * RATE_HZ)).argmax(axis=1)
    return np.arange(len(best)) * INTERVAL_S + best / RATE_HZ - PULSE_S / 2


def timed(function, samples):
    start = time.process_time()
    answer = function(samples)
    return time.process_time() - start, answer


def main() -> int:
    warm()
    rng = np.random.default_rng(1)
    begin_s = np.arange(0.7, SECONDS, INTERVAL_S) + rng.uniform(0, 0.01, round(SECONDS / INTERVAL_S))
    samples = recording(rng, begin_s, 20, SECONDS)
    runs = [(timed(ours, samples), timed(peer, samples)) for _ in range(REPEATS)]
    our_time, our_s = min((mine for mine, _ in runs), key=lambda run: run[0])
    their_time, their_s = min((theirs for _, theirs in runs), key=lambda run: run[0])
    pairs = [theirs[0] / mine[0] for mine, theirs in runs]
    for name, seconds, found_s in (
        ("ModernDetector", our_time, our_s),
        ("scipy hilbert", their_time, their_s),
    ):
        rms = np.sqrt(np.mean((found_s - begin_s) ** 2))
        print(f"{name:16}{SECONDS / seconds:10,.0f} x real time   rms error {rms * 1e3:.3f} ms at 20 dB")
    print(
        f"ratio {np.median(pairs):.0f} (median of {REPEATS} pairs; best against best {their_time / our_time:.0f})"
    )
    kept = SECONDS / our_time >= WANTED
    print(f"wanted {WANTED:,} x real time: {'kept' if kept else 'BROKEN'}")
    return 0 if kept else 1


if __name__ == "__main__":
    raise SystemExit(main())
