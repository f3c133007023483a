"""False alarms and misses of the report's chain against a threshold on its levels, by simulation through the chain."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackerlib.acoustics.ambient_noise import ambient_noise_db, equivalent_noise_v
from trackerlib.receiver.arrivals import Arrivals, joined
from trackerlib.receiver.detection_curve import unit_pulse
from trackerlib.receiver.front_end import FULL_CODE, Attenuator
from trackerlib.receiver.report_receiver import ReceiverSettings, ReportReceiver

LEVELS = np.arange(FULL_CODE + 1)


@dataclass(frozen=True, eq=False)
class LevelCurve:
    """Shares that were simulated at each level 0 to 255, and S signal-to-noise ratios."""

    level: np.ndarray  # (256,) an arrival of that level or more counts
    snr_db: np.ndarray  # (S,) pulse energy over noise density
    false_alarm: np.ndarray  # (256,) periods of noise alone whose strongest arrival counts
    miss: np.ndarray  # (S, 256) pulses of which the period's strongest arrival is none, or does not count
    periods: int  # simulated, of noise and at each ratio


def level_curve(
    settings: ReceiverSettings,
    rate_hz: int,
    snr_db: np.ndarray,
    *,
    sea_state: float = 3.0,
    periods: int = 200,
    seed: int = 0,
) -> LevelCurve:
    """False alarms a period and misses, one pulse a period, in the noise of a sea state, at the attenuation set.

    settings : its attenuator stays at its start, only the strongest arrival of a period is taken
    """
    steady = replace(settings, maxima=1, attenuator=Attenuator(False, settings.attenuator.start_db))
    snr_db = np.atleast_1d(snr_db).astype(float)
    rng = np.random.default_rng(seed)
    _, strongest = _strongest(steady, rate_hz, None, sea_state, periods, rng)
    alarm = np.mean(strongest[:, None] >= LEVELS, axis=0)
    miss = []
    for ratio in snr_db:
        error_s, strongest = _strongest(steady, rate_hz, float(ratio), sea_state, periods, rng)
        heard = np.where(np.abs(error_s) < settings.pulse_s, strongest, -1.0)
        miss.append(np.mean(heard[:, None] < LEVELS, axis=0))
    return LevelCurve(LEVELS, snr_db, alarm, np.array(miss), periods)


def _strongest(
    settings: ReceiverSettings,
    rate_hz: int,
    snr_db: float | None,
    sea_state: float,
    periods: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """How late (P,) [s] each period's strongest arrival is behind its pulse, and its level (P,), -1 where none is.

    snr_db : of the pulses; None for noise alone
    """
    receiver, length = ReportReceiver(settings, rate_hz), round(settings.interval_s * rate_hz)
    noise = equivalent_noise_v(ambient_noise_db(sea_state)) * np.sqrt(rate_hz / 2) / settings.full_scale_v
    begin_s = settings.interval_s * rng.uniform(0.3, 0.7, periods)
    parts: list[Arrivals] = []
    for begin in begin_s:
        sound = rng.standard_normal(length)
        if snr_db is not None:
            phase = rng.uniform(0, 2 * np.pi)
            pulse = unit_pulse(rate_hz, settings.carrier_hz, settings.pulse_s, begin, phase, length)
            sound = sound + 10 ** (snr_db / 20) * pulse
        parts.append(receiver.feed(noise * sound).arrivals)
    arrivals = joined([*parts, receiver.finish().arrivals])
    within = arrivals.period < periods
    period = arrivals.period[within]
    late_s, level = np.full(periods, np.inf), np.full(periods, -1.0)
    level[period] = arrivals.level[within]
    late_s[period] = arrivals.arrival_s[within] - period * length / rate_hz - begin_s[period]
    return late_s, level
