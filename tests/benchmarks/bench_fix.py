"""One fix from 1126 pings, from a cold start: ours against one SciPy least-squares call on the same data.

SciPy gets slant ranges with weights for the ship's position error, its usual way (finite differences) and a start
at the thesis's guess; its errors are those of the bias that noisy ship positions give. "The estimator" is
`fix_squared_range`: a place with its covariance from arrays in metres. "The whole fix" is `fix_beacon`: the same
survey from latitudes and times, with a search for other solutions, rejection of false returns, correlation of
residuals, and all the tests that may refuse it.

.venv/bin/python tests/benchmarks/bench_fix.py
"""

from __future__ import annotations

import time

import numpy as np
from scipy.optimize import least_squares

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.paths import StraightPaths
from trackerlib.beacon.pings import Pings
from trackerlib.beacon.settings import FixSettings
from trackerlib.beacon.squared_range import fix_squared_range
from trackerlib.compiled import warm
from trackerlib.frames import LocalFrame
from trackerlib.simulation.beacon_survey import Errors, simulate_survey
from trackerlib.simulation.hexagon import SCENARIOS, SOUND_SPEED_MPS, TIME_RMS_S, Receptions, sail_hexagon

RECEPTIONS, SURVEYS = 1126, 200
PEER_SURVEYS, WHOLE_SURVEYS = 100, 3
MANY = 1_000_000
RANGE_RMS_M = SOUND_SPEED_MPS * TIME_RMS_S


def timed(work, count: int) -> tuple[list, np.ndarray]:
    """What the calls of `work` for survey 0, 1, ... gave, and the median seconds by the clock and the processor."""
    results, seconds = [], []
    for k in range(count):
        begin = time.perf_counter(), time.process_time()
        results.append(work(k))
        seconds.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    return results, np.median(seconds, axis=0)


def peer(ship, ranges, epochs, gps_rms_m: float, moving: bool) -> np.ndarray:
    """Position, offset and velocity by SciPy."""

    def misfit(state):
        place = state[:3] + (epochs[:, None] * state[4:] if moving else 0.0)
        offset = place - ship
        distance = np.linalg.norm(offset, axis=1)
        level = np.sum(offset[:, :2] ** 2, axis=1) / distance**2
        return (ranges - state[3] - distance) / np.sqrt(RANGE_RMS_M**2 + gps_rms_m**2 * level)

    return least_squares(misfit, [0, 0, -2500, 0, *([0] * 3 if moving else [])], x_scale="jac").x


def logged(ship, ranges, epochs) -> Pings:
    """The same survey as a ship would log it."""
    lat, lon, _ = LocalFrame(43.0, -50.0).to_geodetic(ship)
    return Pings(
        number=np.arange(1, len(ship) + 1),
        lat_deg=lat,
        lon_deg=lon,
        up_m=np.zeros(len(ship)),
        travel_time_s=ranges / SOUND_SPEED_MPS,
        utc=np.datetime64("2026-06-01", "ms") + np.rint(1e3 * epochs).astype("timedelta64[ms]"),
        simulated=True,
    )


def compare(points: Receptions, gps_rms_m: float) -> str:
    """Time and error of all for one scenario, in words."""
    moving, epochs, truth = points.scenario.moving, points.emitted_s, points.truth
    rng = np.random.default_rng(1)
    ship = np.repeat(points.ship[None], SURVEYS, axis=0)
    ship[:, :, :2] += rng.normal(0, gps_rms_m, (SURVEYS, RECEPTIONS, 2))
    ranges = points.range_m + rng.normal(0, RANGE_RMS_M, (SURVEYS, RECEPTIONS)) + 300.0
    settings = FixSettings(
        sound_speed_mps=SOUND_SPEED_MPS,
        gps_rms_m=gps_rms_m,
        sample_interval_ms=1.0,
        motion="free" if moving else "still",
    )

    def one(k: int) -> np.ndarray:
        part = slice(k, k + 1)
        return fix_squared_range(
            ship[part], ranges[part], epochs, gps_rms_m, RANGE_RMS_M, moving=moving
        ).estimate[0]

    ours, our_time = timed(one, SURVEYS)
    theirs, their_time = timed(lambda k: peer(ship[k], ranges[k], epochs, gps_rms_m, moving), PEER_SURVEYS)
    pings = [logged(ship[k], ranges[k], epochs) for k in range(WHOLE_SURVEYS)]
    _, whole_time = timed(lambda k: fix_beacon(pings[k], settings), WHOLE_SURVEYS)

    def error(states) -> float:
        places = np.array([state[:3] for state in states])
        places[:, 2] = -np.abs(places[:, 2])  # the mirror above the surface is the same fit
        return float(np.sqrt(np.mean(np.sum((places - truth[:3]) ** 2, axis=1))))

    ratio, whole = their_time / our_time, their_time / whole_time
    return (
        f"the estimator {1e6 * our_time[0]:.0f} us, error {error(ours[:PEER_SURVEYS]):.2f} m; "
        f"least_squares {1e3 * their_time[0]:.1f} ms, {error(theirs):.2f} m: "
        f"{ratio[0]:.0f} times by the clock, {ratio[1]:.0f} in processor time; "
        f"the whole fix {1e3 * whole_time[0]:.0f} ms: {whole[0]:.2f} and {whole[1]:.2f} times"
    )


def many() -> str:
    """Time of the whole fix from a million pings on a winding track, in words."""
    angle = np.arange(MANY) / 1e5
    pings = simulate_survey(
        np.c_[2000 * np.sin(angle), 1500 * np.cos(0.7 * angle)],
        np.array([400.0, 300.0, -1500.0]),
        StraightPaths(SOUND_SPEED_MPS),
        LocalFrame(43.0, -50.0),
        np.random.default_rng(1),
        Errors(gps_rms_m=3.0, time_rms_s=TIME_RMS_S),
        emission_offset_s=0.2,
        interval_s=0.1,
    )
    settings = FixSettings(sound_speed_mps=SOUND_SPEED_MPS, gps_rms_m=3.0, sample_interval_ms=1.0)
    (fix,), time_s = timed(lambda k: fix_beacon(pings, settings), 1)
    outcome = "converged" if fix.converged else f"refused: {fix.reason}"
    return f"{time_s[0]:.1f} s by the clock, {time_s[1]:.1f} s in processor time, {outcome}"


if __name__ == "__main__":
    warm()
    print(f"the whole fix from {MANY} pings: {many()}")
    for number in (1, 4):
        for gps in (3.0, 25.0):
            print(
                f"scenario {number}, {gps:g} m: {compare(sail_hexagon(SCENARIOS[number], RECEPTIONS), gps)}"
            )
