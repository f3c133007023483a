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
    """Prints microseconds a ping after the fix that stays and at the end, their ratio and the memory."""
    warm()
    rng = np.random.default_rng(1)
    seconds = np.arange(PINGS) / RATE_HZ
    angle = SHIP_MPS * seconds / 1000.0
    ship = np.column_stack([1000 * np.cos(angle), 1000 * np.sin(1.1 * angle), np.zeros(PINGS)])
    truth = np.array(SCENARIOS[2].position)
    times = np.linalg.norm(ship - truth, axis=1) / SOUND_SPEED_MPS + rng.normal(0, TIME_RMS_S, PINGS) + 0.4
    ship[:, :2] += rng.normal(0, 3, (PINGS, 2))
    live = LiveFix(LocalFrame(0.0, 0.0), FixSettings(gps_rms_m=3.0, sample_interval_ms=1.0))
    taken, first = np.empty(PINGS), 0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for k in range(PINGS):
        begin = time.perf_counter()
        live.add(k + 1, ship[k], seconds[k], times[k])
        taken[k] = time.perf_counter() - begin
        if live.reason is not None:
            first = k + 1
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    settled = 1e6 * np.median(taken[first + 1 : first + 1001])  # before it, pings are only kept
    last = 1e6 * np.median(taken[-1000:])
    error = live.fix().position - truth
    print(
        f"{PINGS} pings one at a time: {taken.sum():.2f} s in all, longest {1e3 * taken.max():.0f} ms; from the fix "
        f"that stays, at ping {first + 1}, a ping takes {settled:.1f} us and at the end {last:.1f} us, ratio "
        f"{last / settled:.2f}; memory grew by {grown:.0f} MB; error {np.linalg.norm(error):.2f} m"
    )


if __name__ == "__main__":
    main()
