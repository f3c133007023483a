"""Simulated sound for tests and benchmarks of detectors: white noise and gated carriers at known times."""

from __future__ import annotations

import numpy as np

RATE_HZ, CARRIER_HZ, PULSE_S = 48_000, 10_000.0, 0.010


def recording(
    rng, begin_s, snr_db, seconds, rate_hz=RATE_HZ, carrier_hz=CARRIER_HZ, pulse_s=PULSE_S, rms=0.01
):
    """Samples (N,) float32; snr_db (one, or one a pulse) is a pulse's energy over the noise's one-sided density."""
    samples = rng.standard_normal(round(seconds * rate_hz), dtype=np.float32)
    amplitude = 2 * np.sqrt(10 ** (np.broadcast_to(snr_db, np.shape(begin_s)) / 10) / (pulse_s * rate_hz))
    for begin, size in zip(begin_s, amplitude, strict=True):
        n = np.arange(np.ceil(begin * rate_hz), np.ceil((begin + pulse_s) * rate_hz)).astype(int)
        samples[n] += size * np.cos(2 * np.pi * carrier_hz / rate_hz * n + rng.uniform(0, 2 * np.pi))
    return np.float32(rms) * samples


def brute_force(samples, first_s, last_s, rate_hz=RATE_HZ, carrier_hz=CARRIER_HZ, pulse_s=PULSE_S):
    """Begin (K,) of the pulse of greatest likelihood between each pair of times.

    Tries every sample, with the amplitude and phase that fit best; a gate that opens anywhere between two samples
    gives the same samples, so the middle between them stands for all finer steps.
    """
    length = round(pulse_s * rate_hz)
    mixed = samples * np.exp(-2j * np.pi * carrier_hz / rate_hz * np.arange(len(samples)))
    total = np.concatenate([[0], np.cumsum(mixed)])
    likelihood = np.abs(total[length:] - total[:-length]) ** 2
    first, last = (np.asarray(time_s) * rate_hz for time_s in (first_s, last_s))
    best = [
        int(a) + np.argmax(likelihood[int(a) : int(b)])
        for a, b in zip(first, np.broadcast_to(last, first.shape), strict=True)
    ]
    return (np.array(best) - 0.5) / rate_hz
