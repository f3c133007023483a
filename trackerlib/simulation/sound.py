"""Simulated sound of pingers as a hydrophone under a moving ship hears it, block by block, with known truth.

Wojcik (1993), (5-1), (5-2): gated carrier pulses, each with its attenuation and phase, in noise. What is
heard over which path is worked out first (`pulses_heard`); `SimulatedSound` then makes the samples.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import soundfile

from trackerlib.acoustics.absorption import absorption_db_per_km
from trackerlib.acoustics.ambient_noise import (
    FLOW_NOISE_DB_AT_5_MPS,
    HYDROPHONE_DB,
    ambient_noise_db,
    equivalent_noise_v,
    flow_noise_db,
)
from trackerlib.receiver.recording import SIMULATED

PATHS = ("direct", "surface", "bottom")


@dataclass(frozen=True)
class Pinger:
    """A beacon that sends pulses of a carrier at a steady interval."""

    position_m: tuple[float, float, float] = (0.0, 0.0, -1000.0)  # east, north, up from the surface
    carrier_hz: float = 10_000.0
    pulse_s: float = 0.010
    interval_s: float = 2.0
    first_emission_s: float = 0.0  # To, which the listener does not know
    drift_ppm: float = 0.0  # by which the interval is longer than it says
    source_level_db: float = 185.5  # re 1 uPa at 1 m: 30 W in all directions
    missing: float = 0.0  # share of the pulses that are not sent


@dataclass(frozen=True)
class Listener:
    """A hydrophone that moves on a straight course."""

    start_m: tuple[float, float, float] = (0.0, 0.0, -10.0)  # east, north, up from the surface
    velocity_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Sea:
    """The water between them: speed of sound, bounds and noise."""

    sound_speed_mps: float = 1500.0
    depth_m: float = 2000.0
    surface_reflection: float = -0.8  # of pressure; a still surface has -1
    bottom_reflection: float = 0.4
    temperature_c: float = 10.0
    sea_state: float | str = 3.0  # of acoustics.ambient_noise.SCALE, or "limit"
    flow_noise_db_at_5_mps: float = FLOW_NOISE_DB_AT_5_MPS


@dataclass(frozen=True, eq=False)
class Pulses:
    """Pulses as they come in, in any order."""

    arrival_s: np.ndarray  # (N,) leading edge
    duration_s: np.ndarray  # (N,)
    carrier_hz: np.ndarray  # (N,) with the Doppler shift
    amplitude: np.ndarray  # (N,) uPa, peak of the carrier
    phase: np.ndarray  # (N,) at the leading edge
    emission: np.ndarray  # (N,) number of the emission, from 0
    path: np.ndarray  # (N,) places in PATHS

    def __len__(self) -> int:
        return len(self.arrival_s)


def joined_pulses(*parts: Pulses) -> Pulses:
    """Pulses of several pingers or paths together."""
    return Pulses(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Pulses)))


def pulses_heard(
    pinger: Pinger,
    listener: Listener,
    sea: Sea,
    duration_s: float,
    rng: np.random.Generator,
    paths: tuple[str, ...] = PATHS,
) -> Pulses:
    """What of a pinger arrives within `duration_s`, over each path, in water of constant sound speed.

    Reflections come from images of the pinger in surface and bottom. Pressure falls with the distance and
    with absorption (Ainslie and McColm 1998).
    """
    interval = pinger.interval_s * (1 + 1e-6 * pinger.drift_ppm)
    number = np.arange(max(int(np.ceil((duration_s - pinger.first_emission_s) / interval)), 0))
    number = number[rng.random(len(number)) >= pinger.missing]
    emitted = pinger.first_emission_s + number * interval
    parts = []
    for path in paths:
        image, reflection = _image(pinger, sea, path)
        arrival = _arrival(image, listener, sea.sound_speed_mps, emitted)
        end = _arrival(image, listener, sea.sound_speed_mps, emitted + pinger.pulse_s)
        distance = sea.sound_speed_mps * (arrival - emitted)
        loss_db = 20 * np.log10(distance) + distance / 1e3 * absorption_db_per_km(
            pinger.carrier_hz, sea.temperature_c, depth_m=-pinger.position_m[2] / 2
        )
        pulses = Pulses(
            arrival,
            end - arrival,
            pinger.carrier_hz * pinger.pulse_s / (end - arrival),
            np.sqrt(2) * abs(reflection) * 10 ** ((pinger.source_level_db - loss_db) / 20),
            rng.uniform(0, 2 * np.pi, len(number)) + (np.pi if reflection < 0 else 0.0),
            number,
            np.full(len(number), PATHS.index(path)),
        )
        within = (arrival >= 0) & (end < duration_s)
        parts.append(Pulses(*(getattr(pulses, f.name)[within] for f in fields(Pulses))))
    return joined_pulses(*parts)


def _image(pinger: Pinger, sea: Sea, path: str) -> tuple[np.ndarray, float]:
    """Where a path seems to come from, and the reflection it went through."""
    east, north, up = pinger.position_m
    if path == "surface":
        return np.array([east, north, -up]), sea.surface_reflection
    if path == "bottom":
        return np.array([east, north, -2 * sea.depth_m - up]), sea.bottom_reflection
    return np.array([east, north, up]), 1.0


def _arrival(source: np.ndarray, listener: Listener, speed: float, emitted: np.ndarray) -> np.ndarray:
    """When a moving listener hears what was sent at `emitted`: the positive root of (4-1), (4-2)."""
    velocity = np.asarray(listener.velocity_mps)
    gap = np.asarray(listener.start_m) + np.multiply.outer(emitted, velocity) - source
    alpha = velocity @ velocity - speed**2
    beta, gamma = 2 * gap @ velocity, np.sum(gap * gap, axis=1)
    return emitted + (-beta - np.sqrt(beta**2 - 4 * alpha * gamma)) / (2 * alpha)


def noise_density_v(sea: Sea, speed_mps: float = 0.0) -> float:
    """Noise of sea and flow at the hydrophone's terminals [V per root hertz]."""
    flow_db = flow_noise_db(speed_mps, sea.flow_noise_db_at_5_mps)
    return float(np.hypot(equivalent_noise_v(ambient_noise_db(sea.sea_state)), equivalent_noise_v(flow_db)))


class SimulatedSound:
    """A stream of SIMULATED samples; what it gives does not depend on how many are asked for at a time.

    pulses : heard; density_v : noise [V per root hertz], white; full_scale_v : volts of a sample of 1
    """

    def __init__(self, pulses: Pulses, density_v: float, rate_hz: float, full_scale_v: float, seed: int):
        order = np.argsort(pulses.arrival_s)
        self._pulses = Pulses(*(getattr(pulses, f.name)[order] for f in fields(Pulses)))
        self._longest = float(np.max(pulses.duration_s, initial=0.0))
        self._sigma = density_v * np.sqrt(rate_hz / 2) / full_scale_v
        self._volts = 10 ** (HYDROPHONE_DB / 20) / full_scale_v  # of 1 uPa, in samples
        self._rng = np.random.default_rng(seed)
        self.rate_hz, self.position = rate_hz, 0

    def read(self, count: int) -> np.ndarray:
        """The next samples (count,) float32, clipped at -1 and 1 as a converter clips."""
        block = self._rng.standard_normal(count, np.float32) * np.float32(self._sigma)
        start, pulses = self.position / self.rate_hz, self._pulses
        first = np.searchsorted(pulses.arrival_s, start - self._longest - 1 / self.rate_hz)
        last = np.searchsorted(pulses.arrival_s, start + (count + 1) / self.rate_hz)
        for k in range(first, last):
            self._add(block, k)
        self.position += count
        return np.clip(block, -1.0, 1.0)

    def _add(self, block: np.ndarray, k: int) -> None:
        """Adds one pulse; samples at its edges count by the share of them that it covers."""
        pulses, rate = self._pulses, self.rate_hz
        begin = pulses.arrival_s[k] * rate
        length = pulses.duration_s[k] * rate
        low = max(int(begin) - 1, self.position)
        high = min(int(begin + length) + 2, self.position + len(block))
        since = np.arange(low, high) - begin
        gate = np.clip(since + 0.5, 0, 1) * np.clip(length - since + 0.5, 0, 1)
        wave = np.cos(2 * np.pi * pulses.carrier_hz[k] * since / rate + pulses.phase[k])
        block[low - self.position : high - self.position] += self._volts * pulses.amplitude[k] * gate * wave


def write_sound(
    path: str | Path, sound: SimulatedSound, seconds: float, began_s: float | None = None, **layout
) -> None:
    """Writes a recording that says it is SIMULATED and when it began, if told [s since 1970].

    layout : format and subtype of soundfile, by the name if none
    """
    rate = round(sound.rate_hz)
    with soundfile.SoundFile(path, "w", rate, channels=1, **layout) as file:
        file.comment = SIMULATED
        if began_s is not None:
            file.date = f"{np.datetime64(round(1e3 * began_s), 'ms')}Z"
        left = round(seconds * rate)
        while left:
            count = min(left, 10 * rate)
            file.write(sound.read(count))
            left -= count
