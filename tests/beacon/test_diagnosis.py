"""Contours agree with the ellipse, influence with fixes that really leave the ping out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trackerlib.beacon.diagnosis import influence, misfit_surface
from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.paths import StraightPaths
from trackerlib.beacon.settings import FixSettings
from trackerlib.frames import LocalFrame
from trackerlib.simulation.beacon_survey import Errors, sail, simulate_survey

SETTINGS = FixSettings(gps_rms_m=2.0, sound_speed_sigma_mps=0.0, reject="none")


@pytest.fixture(scope="module")
def made():
    track = sail(np.array([[10.0, 1500.0], [130.0, 1500.0], [250.0, 1500.0]]), np.zeros(2), 2.5, 10.0)
    pings = simulate_survey(
        track,
        np.array([900.0, 400.0, -1600.0]),
        StraightPaths(1500.0),
        LocalFrame(35.0, 20.0),
        np.random.default_rng(3),
        Errors(gps_rms_m=2.0, time_rms_s=0.0003),
    )
    return pings, fix_beacon(pings, SETTINGS)


@pytest.mark.parametrize("names", [("east", "north"), ("east", "depth"), ("north", "depth")])
def test_near_the_fix_the_surface_is_the_ellipse(made, names):
    pings, fix = made
    surface = misfit_surface(pings, fix, SETTINGS, names)
    axes = [("east", "north", "depth").index(name) for name in names]
    sign = np.array([-1.0 if name == "depth" else 1.0 for name in names])
    covariance = fix.uncertainty.noise_covariance[np.ix_(axes, axes)] * np.outer(sign, sign)
    centre = fix.position[axes] * sign
    across, up = np.meshgrid(surface.across, surface.up)
    d = np.stack([across - centre[0], up - centre[1]], axis=-1)
    expected = np.einsum("ijk,kl,ijl->ij", d, np.linalg.inv(covariance), d)
    near = (expected > 0.5) & (expected < 12)
    assert near.sum() > 20
    assert np.median(np.abs(surface.rise[near] / expected[near] - 1)) < 0.15


def test_influence_is_what_leaving_the_ping_out_does(made):
    pings, fix = made
    moved = influence(pings, fix, SETTINGS)
    weighted = fix_beacon(pings, SETTINGS)
    for row in (0, 40, int(np.nanargmax(moved))):
        without = fix_beacon(pings, replace(SETTINGS, left_out=frozenset({int(pings.number[row])})))
        true = np.linalg.norm(without.position - weighted.position)
        assert moved[row] == pytest.approx(true, rel=0.35, abs=0.02)


def test_a_refused_fix_has_no_surface(made):
    pings, _ = made
    few = pings.only(slice(0, 4))
    with pytest.raises(ValueError, match="no place"):
        misfit_surface(few, fix_beacon(few, SETTINGS), SETTINGS)
    with pytest.raises(ValueError, match="wanted two"):
        misfit_surface(*made, SETTINGS, ("east", "east"))


def test_velocities_have_contours_too():
    track = sail(
        np.array([[10.0, 1500.0], [130.0, 1500.0], [250.0, 1500.0], [30.0, 900.0]]), np.zeros(2), 2.5, 10.0
    )
    pings = simulate_survey(
        track,
        np.array([900.0, 400.0, -1600.0]),
        StraightPaths(1500.0),
        LocalFrame(35.0, 20.0),
        np.random.default_rng(3),
        Errors(gps_rms_m=2.0, time_rms_s=0.0003),
    )
    settings = replace(SETTINGS, motion="horizontal")
    fix = fix_beacon(pings, settings)
    surface = misfit_surface(pings, fix, settings, ("velocity east", "velocity north"))
    covariance = fix.uncertainty.noise_covariance[3:5, 3:5]
    across, up = np.meshgrid(surface.across - fix.velocity[0], surface.up - fix.velocity[1])
    d = np.stack([across, up], axis=-1)
    expected = np.einsum("ijk,kl,ijl->ij", d, np.linalg.inv(covariance), d)
    near = (expected > 0.5) & (expected < 12)
    assert near.sum() > 20
    assert np.median(np.abs(surface.rise[near] / expected[near] - 1)) < 0.2
    with pytest.raises(ValueError, match="leaves free"):
        misfit_surface(pings, fix, settings, ("east", "velocity up"))
