"""Makes the files beside it: SIMULATED, nothing here was measured.

    .venv/bin/python data/beacon-demo/make.py

A pinger on the sea floor at 2475 m, 2 s between pings. The ship sails one long straight leg first,
so that a live fix is refused until it turns; then two legs across and past the beacon.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from trackerlib.acoustics.profile import SoundSpeedProfile
from trackerlib.beacon.paths import RayPaths
from trackerlib.frames import LocalFrame
from trackerlib.simulation.beacon_survey import Errors, sail, simulate_survey

HERE = Path(__file__).parent
FRAME = LocalFrame(41.25, -66.5)
BEACON = np.array([420.0, 310.0, -2475.0])
EMISSION_OFFSET_S = 0.8127
HYDROPHONE_DEPTH_M = 4.0
ERRORS = Errors(gps_rms_m=2.0, time_rms_s=4e-4, time_step_s=5e-4, false_returns=9)
LEGS = np.array([(70.0, 1900.0), (190.0, 1700.0), (310.0, 1400.0)])
# A made-up winter profile: mixed layer, a minimum at 400 m, pressure below.
DEPTH_M = np.array([0, 60, 120, 200, 400, 700, 1000, 1500, 2000, 3000.0])
SPEED_MPS = np.array([1479.2, 1479.9, 1476.0, 1472.1, 1471.4, 1474.6, 1478.8, 1486.7, 1494.9, 1512.3])

HEADER = """\
# SIMULATED DATA: made by make.py beside this file, nothing here was measured
# one-way travel time plus an unknown constant; positions WGS 84; heights of the hydrophone above the sea surface
ping,utc,lat_deg,lon_deg,oneway_s,up_m
"""


def main() -> None:
    profile = SoundSpeedProfile(DEPTH_M, SPEED_MPS, unit="m", name="made-up winter profile")
    track = sail(LEGS, np.array([-700.0, -500.0]), speed_mps=2.5, interval_s=2.0)
    pings = simulate_survey(
        track,
        BEACON,
        RayPaths(profile),
        FRAME,
        np.random.default_rng(1993),
        ERRORS,
        emission_offset_s=EMISSION_OFFSET_S,
        hydrophone_depth_m=HYDROPHONE_DEPTH_M,
        interval_s=2.0,
    )
    with (HERE / "survey.csv").open("w", newline="\n") as file:
        file.write(HEADER)
        for k in range(len(pings)):
            file.write(
                f"{pings.number[k]},{pings.utc[k]}Z,{pings.lat_deg[k]:.8f},{pings.lon_deg[k]:.8f},"
                f"{pings.travel_time_s[k]:.4f},{pings.up_m[k]:.2f}\n"
            )
    with (HERE / "soundspeed.csv").open("w", newline="\n") as file:
        file.write("# SIMULATED DATA: a made-up winter profile\ndepth_m,speed_mps\n")
        file.writelines(f"{d:.1f},{c:.2f}\n" for d, c in zip(DEPTH_M, SPEED_MPS, strict=True))
    lat, lon, up = (float(value) for value in FRAME.to_geodetic(BEACON))
    truth = {
        "simulated": True,
        "lat_deg": lat,
        "lon_deg": lon,
        "depth_m": -up,
        "emission_offset_s": EMISSION_OFFSET_S,
        "interval_s": 2.0,
        "gps_rms_m": ERRORS.gps_rms_m,
        "time_rms_s": ERRORS.time_rms_s,
        "false_returns": ERRORS.false_returns,
    }
    (HERE / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    main()
