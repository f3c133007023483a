"""A beacon fix under the keys that others rely on."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from trackerlib.beacon.convergence import Step
from trackerlib.beacon.intervals import Interval
from trackerlib.beacon.result import BeaconFix
from trackerlib.beacon.uncertainty import ellipse95
from trackerlib.rounding import rounded

SIGMAS = ("sigma_east_m", "sigma_north_m", "sigma_depth_m")


def document(fix: BeaconFix) -> dict:
    """A fix under the keys that others rely on."""
    known = fix.position is not None
    answer = {
        "converged": fix.converged,
        "reason": fix.reason,
        "lat_deg": fix.lat_deg,
        "lon_deg": fix.lon_deg,
        "depth_m": fix.depth_m,
        "east_m": float(fix.position[0]) if known else None,
        "north_m": float(fix.position[1]) if known else None,
        "origin": {"lat_deg": fix.frame.lat_deg, "lon_deg": fix.frame.lon_deg},
        "velocity_mps": None if fix.velocity is None else fix.velocity.tolist(),
        "emission_offset_s": fix.emission_offset_s,
        **_emission(fix),
        "sound_speed_mps": fix.sound_speed_mps,
        "sigma_sound_speed_mps": fix.sigma_sound_speed_mps,
        "pings": len(fix.number),
        "used": int(fix.used.sum()),
        "rejected": [int(number) for number in fix.rejected],
        "unobservable": [{"direction_enu": list(u.direction_enu), "why": u.why} for u in fix.unobservable],
        "alternatives": [
            {
                "lat_deg": other.lat_deg,
                "lon_deg": other.lon_deg,
                "depth_m": other.depth_m,
                "east_m": other.east_m,
                "north_m": other.north_m,
                "chi_square_above_best": other.misfit,
            }
            for other in fix.alternatives
        ],
        "notes": list(fix.notes),
        "method": fix.method,
        "simulated": fix.simulated,
        **_uncertainty(fix),
        **motion_document(fix),
    }
    if fix.unobservable:
        answer["along_track_m"] = fix.along_track_m
        answer["sigma_along_track_m"] = fix.sigma_along_track_m
        answer["closest_slant_range_m"] = fix.closest_slant_range_m
        answer["sigma_closest_slant_range_m"] = fix.sigma_closest_slant_range_m
    return answer


def step_document(step: Step) -> dict:
    """One step of a convergence log."""
    east, north, up = (float(value) for value in step.position)
    return {
        "stage": step.stage,
        "iteration": step.iteration,
        "east_m": east,
        "north_m": north,
        "up_m": up,
        "rms_ms": step.rms_ms,
        "step_m": step.step_m,
        "damping": step.damping,
        "pings": step.pings,
        "words": str(step),
    }


def interval_document(intervals: dict[str, Interval]) -> dict[str, list[float]]:
    """Lowest and highest of each coordinate [m], infinite where an interval is open."""
    return {name: [interval.low_m, interval.high_m] for name, interval in intervals.items()}


def _emission(fix: BeaconFix) -> dict:
    """The pinger's interval and its drift, where they were estimated."""
    emission = fix.emission
    if emission is None or emission.interval_s is None:
        return {}
    answer = {"interval_s": emission.interval_s, "sigma_interval_s": emission.sigma_interval_s}
    if emission.drift_ppm_per_hour is not None:
        answer["interval_drift_ppm_per_hour"] = emission.drift_ppm_per_hour
        answer["sigma_interval_drift_ppm_per_hour"] = emission.sigma_drift_ppm_per_hour
    return answer


def _uncertainty(fix: BeaconFix) -> dict:
    keys = (*SIGMAS, "covariance_enu_m2", "ellipse95", "rms_ms")
    if fix.uncertainty is None:
        return dict.fromkeys(keys)
    shape = fix.ellipse
    return {
        **dict(zip(keys[:3], map(float, fix.sigma), strict=True)),
        "covariance_enu_m2": fix.uncertainty.covariance[:3, :3].tolist(),
        "ellipse95": {
            "semi_major_m": shape.semi_major_m,
            "semi_minor_m": shape.semi_minor_m,
            "bearing_deg": shape.bearing_deg,
        },
        "rms_ms": 1e3 * fix.uncertainty.rms_s,
        "sigma_depth_from_sound_speed_m": abs(
            float(fix.uncertainty.speed_sigma_mps * fix.uncertainty.by_sound_speed[2])
        ),
        "residual_correlation_length": fix.uncertainty.correlation.length,
    }


def motion_document(fix: BeaconFix) -> dict:
    """Keys of a moving beacon, none of another: where it is when its place is known best, now, and where it comes up.

    The position of a fix is that at the first ping.
    """
    if fix.velocity is None or fix.uncertainty is None:
        return {}
    last = float(np.max(fix.elapsed_s))
    instants = {"steadiest": float(np.clip(fix.steadiest_s, 0.0, last)), "present": last}
    answer = {
        "epoch_s": 0.0,
        "sigma_velocity_mps": fix.uncertainty.sigma[3:].tolist(),
        "covariance_velocity_m2ps2": fix.uncertainty.covariance[3:, 3:].tolist(),
        "covariance_position_velocity_m2ps": fix.uncertainty.covariance[:3, 3:].tolist(),
    }
    for name, instant in instants.items():
        position, covariance = fix.at(instant)
        lat, lon, up = fix.frame.to_geodetic(position)
        sigma, shape = np.sqrt(np.diag(covariance)), ellipse95(covariance)
        answer[name] = {
            "epoch_s": instant,
            "lat_deg": float(lat),
            "lon_deg": float(lon),
            "depth_m": -float(up),
            "east_m": float(position[0]),
            "north_m": float(position[1]),
            **dict(zip(SIGMAS, map(float, sigma), strict=True)),
            "ellipse95": asdict(shape),
        }
    rising = fix.velocity[2]
    if rising > 2 * fix.uncertainty.sigma[5] > 0:
        answer["surfaces"] = _surfacing(fix)
    return answer


def steadiest_words(then: dict) -> str:
    """Where a moving beacon was when position and velocity trade off least, of `motion_document`'s steadiest."""
    return (
        f"{then['epoch_s']:.0f} s after the first ping: {then['lat_deg']:.7f}, {then['lon_deg']:.7f}, depth "
        f"{then['depth_m']:.1f} m; sigma {sigma_words(then)}"
    )


def sigma_words(place: dict) -> str:
    """The standard errors of a place under the keys of a document, that of depth where it has one."""
    return ", ".join(
        f"{rounded(place[f'sigma_{axis}_m'])} m {axis}"
        for axis in ("east", "north", "depth")
        if f"sigma_{axis}_m" in place
    )


def _surfacing(fix: BeaconFix) -> dict:
    """When and where a rising beacon comes to the surface, with standard errors to first order."""
    rising = fix.velocity[2]
    seconds = -fix.position[2] / rising
    gradient = np.zeros(6)
    gradient[2], gradient[5] = -1 / rising, fix.position[2] / rising**2
    sigma_s = float(np.sqrt(gradient @ fix.uncertainty.covariance @ gradient))
    step = np.hstack([np.eye(3), seconds * np.eye(3)]) + np.outer([*fix.velocity[:2], 0.0], gradient)
    place = fix.position + seconds * fix.velocity
    covariance = step @ fix.uncertainty.covariance @ step.T
    lat, lon, _ = fix.frame.to_geodetic(place)
    east, north = np.sqrt(np.maximum(np.diag(covariance)[:2], 0.0))
    return {
        "epoch_s": float(seconds),
        "sigma_epoch_s": sigma_s,
        "lat_deg": float(lat),
        "lon_deg": float(lon),
        "sigma_east_m": float(east),
        "sigma_north_m": float(north),
    }
