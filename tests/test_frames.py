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


@pytest.mark.parametrize(
    ("lat", "lon", "zone"),
    [
        (60.39, 5.32, "32N"),  # Bergen, 32V
        (78.22, 15.65, "33N"),  # Longyearbyen, 33X
        (78.93, 11.93, "33N"),  # Ny-Alesund
        (80.06, 31.5, "35N"),  # Kvitoya
        (70.92, -8.72, "29N"),  # Jan Mayen: no exception
        (64.0, 5.0, "31N"),  # north of the widened 32V
        (55.99, 5.0, "31N"),
        (58.97, 5.73, "32N"),  # Stavanger
        (58.0, 2.99, "31N"),
        (71.99, 8.0, "32N"),
        (72.0, 8.99, "31N"),
        (72.0, 9.0, "33N"),
        (84.0, 33.0, "37N"),
        (84.0, 42.0, "38N"),
        (-60.0, 5.0, "31S"),
        (60.39, 365.32, "32N"),
        (10.0, 180.0, "1N"),
    ],
)
def test_utm_zones_of_norway_and_svalbard(lat, lon, zone):
    assert utm(lat, lon)[0] == zone


def test_utm_of_bergen_by_the_series_of_krueger():
    # Transverse Mercator about 9 E, to the third order in the flattening, written out here.
    f = 1 / 298.257223563
    n = f / (2 - f)
    radius = 6_378_137 / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    alpha = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16, 13 * n**2 / 48 - 3 * n**3 / 5, 61 * n**3 / 240)
    lat, lon = np.radians(60.39), np.radians(5.32 - 9)
    k = 2 * np.sqrt(n) / (1 + n)
    t = np.sinh(np.arctanh(np.sin(lat)) - k * np.arctanh(k * np.sin(lat)))
    xi, eta = np.arctan2(t, np.cos(lon)), np.arctanh(np.sin(lon) / np.hypot(1, t))
    zeta = xi + 1j * eta
    north_east = zeta + sum(a * np.sin(2 * (j + 1) * zeta) for j, a in enumerate(alpha))
    _, easting, northing = utm(60.39, 5.32)
    assert easting == pytest.approx(500_000 + 0.9996 * radius * north_east.imag, abs=0.001)
    assert northing == pytest.approx(0.9996 * radius * north_east.real, abs=0.001)


def test_utm_says_where_it_ends():
    with pytest.raises(ValueError, match="not defined at latitude 85"):
        utm(85.0, 0.0)
