"""A day of pings at ten a second, one at a time: is the last thousand as quick as the first."""

from __future__ import annotations

import resource
import time

import numpy as np

from trackerlib.beacon.live import LiveFix
from trackerlib.beacon.settings import FixSettings
from trackerlib.compiled import warm
from trackerlib.frames import LocalFrame
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S

PINGS, RATE_HZ, SHIP_MPS = 86_400, 10.0, 3.0


def main() -> None:
    """Prints microseconds a ping by thousands, their ratio and the memory."""
    warm()
    rng = np.random.default_rng(1)
    seconds = np.arange(PINGS) / RATE_HZ
    angle = SHIP_MPS * seconds / 1000.0
    ship = np.column_stack([1000 * np.cos(angle), 1000 * np.sin(1.1 * angle), np.zeros(PINGS)])
    truth = np.array(SCENARIOS[2].position)
    times = np.linalg.norm(ship - truth, axis=1) / SOUND_SPEED_MPS + rng.normal(0, TIME_RMS_S, PINGS) + 0.4
    ship[:, :2] += rng.normal(0, 3, (PINGS, 2))
    live = LiveFix(LocalFrame(0.0, 0.0), FixSettings(gps_rms_m=3.0, sample_interval_ms=1.0))
    taken = np.empty(PINGS)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for k in range(PINGS):
        begin = time.perf_counter()
        live.add(k + 1, ship[k], seconds[k], times[k])
        taken[k] = time.perf_counter() - begin
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    thousands = 1e6 * np.median(taken.reshape(-1, 800), axis=1)
    settled = np.flatnonzero(np.arange(PINGS) > 2000)[0] // 800 + 1
    error = live.fix().position - truth
    print(
        f"{PINGS} pings one at a time: {taken.sum():.2f} s in all, longest {1e3 * taken.max():.0f} ms; a ping takes "
        f"{thousands[settled]:.1f} us early and {thousands[-1]:.1f} us at the end, ratio "
        f"{thousands[-1] / thousands[settled]:.2f}; memory grew by {grown:.0f} MB; error {np.linalg.norm(error):.2f} m"
    )


if __name__ == "__main__":
    main()
