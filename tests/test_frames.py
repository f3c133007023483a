"""Frames of reference, against another geodesy library and worked values."""

from __future__ import annotations

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from trackerlib.frames import LocalFrame, bearing_deg, degrees_minutes, utm

PLACES = [(0.0, 0.0), (-5.7, -134.1), (71.3, 179.99), (34.96, 139.26), (-89.5, 20.0)]


@pytest.mark.parametrize(("lat", "lon"), PLACES)
def test_there_and_back(lat, lon):
    frame = LocalFrame(lat, lon)
    place = np.array([[1200.0, -3400.0, -2500.0], [0.0, 0.0, 0.0], [-9000.0, 12_000.0, -10.0]])
    again = frame.to_local(*frame.to_geodetic(place))
    assert np.abs(again - place).max() < 1e-6


@pytest.mark.parametrize(("lat", "lon"), PLACES)
def test_short_distances_are_those_of_the_geodesic(lat, lon):
    # Within a kilometre the chord is shorter than the geodesic by less than 2 micrometres.
    line = Geodesic.WGS84.Direct(lat, lon, 37.0, 800.0)
    east, north, up = LocalFrame(lat, lon).to_local(line["lat2"], line["lon2"], 0.0)
    assert np.sqrt(east**2 + north**2 + up**2) == pytest.approx(800.0, abs=1e-4)
    assert bearing_deg(east, north) == pytest.approx(37.0, abs=1e-3)


def test_the_sea_surface_falls_away_from_the_plane():
    # 10 km over twice the radius of curvature: 1e8 / 12.74e6 = 7.85 m
    line = Geodesic.WGS84.Direct(40.0, 5.0, 90.0, 10_000.0)
    assert LocalFrame(40.0, 5.0).to_local(line["lat2"], line["lon2"], 0.0)[2] == pytest.approx(
        -7.83, abs=0.03
    )


def test_across_the_date_line():
    east, north, _ = LocalFrame(10.0, 179.999).to_local(10.0, -179.999, 0.0)
    assert east == pytest.approx(219.3, abs=0.2)
    assert abs(north) < 0.01


@pytest.mark.parametrize(
    ("value", "letters", "text"),
    [
        (-5.7077, "NS", "5°42.4620' S"),
        (134.0, "EW", "134°00.0000' E"),
        (-0.99999999, "NS", "1°00.0000' S"),
        (7.5, "EW", "7°30.0000' E"),
    ],
)
def test_degrees_and_minutes(value, letters, text):
    assert degrees_minutes(value, letters) == text


def test_utm_of_a_known_place():
    # Equator on a central meridian: easting is the false easting, northing zero.
    assert utm(0.0, 3.0) == ("31N", pytest.approx(500_000, abs=1e-3), pytest.approx(0, abs=1e-3))
    zone, easting, northing = utm(-0.0001, -177.0)
    assert zone == "1S"
    assert easting == pytest.approx(500_000, abs=1e-3)
    assert northing == pytest.approx(10_000_000 - 11.06, abs=0.02)


def test_utm_says_where_it_ends():
    with pytest.raises(ValueError, match="not defined at latitude 85"):
        utm(85.0, 0.0)
