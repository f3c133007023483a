"""Simulated sound for the receiver's tests: pulses at known instants, in noise of a known density."""

from __future__ import annotations

import numpy as np

from trackerlib.acoustics.ambient_noise import HYDROPHONE_DB
from trackerlib.receiver.arrivals import Arrivals, joined
from trackerlib.receiver.report_receiver import FULL_SCALE_V, ReceiverSettings, ReportReceiver
from trackerlib.simulation.sound import Pulses, SimulatedSound

DENSITY_V = 89e-9  # sea state 3


def pulses_at(
    arrival_s, snr_db=40.0, settings=None, relative=1.0, density_v=DENSITY_V, carrier_hz=None, seed=0
) -> Pulses:
    """Pulses of the settings' length whose power is `snr_db` over that of the noise in the tuned band."""
    settings = settings or ReceiverSettings()
    arrival_s = np.atleast_1d(np.asarray(arrival_s, float))
    count = len(arrival_s)
    noise = density_v * np.sqrt(settings.tuned_bandwidth_hz)
    amplitude = np.sqrt(2) * noise * 10 ** ((snr_db - HYDROPHONE_DB) / 20)
    return Pulses(
        arrival_s,
        np.full(count, settings.pulse_s),
        np.full(count, carrier_hz or settings.carrier_hz),
        amplitude * relative * np.ones(count),
        np.random.default_rng(seed).uniform(0, 2 * np.pi, count),
        np.arange(count),
        np.zeros(count, int),
    )


def sound_of(pulses: Pulses, seconds: float, rate_hz=48_000.0, density_v=DENSITY_V, seed=1) -> np.ndarray:
    """Samples of those pulses in noise."""
    stream = SimulatedSound(pulses, density_v, rate_hz, FULL_SCALE_V, seed)
    return stream.read(round(seconds * rate_hz))


def heard(receiver, sound, cuts=()) -> tuple[np.ndarray, Arrivals]:
    """Levels and arrivals of a whole stream that was cut at those samples."""
    parts = [receiver.feed(block) for block in np.split(sound, cuts)] + [receiver.finish()]
    return np.concatenate([part.levels for part in parts]), joined([part.arrivals for part in parts])


def listen(sound, settings, rate_hz=48_000.0) -> Arrivals:
    """Arrivals that the report's receiver finds in a whole stream."""
    return heard(ReportReceiver(settings, rate_hz), sound)[1]
