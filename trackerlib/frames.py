"""Frames of reference: latitude and longitude, a local east-north-up frame, degrees as people write them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pyproj

pyproj.network.set_network_enabled(False)  # everything needed is in pyproj's own data


@cache
def _to_geocentric() -> pyproj.Transformer:
    """WGS 84 longitude, latitude, ellipsoidal height to geocentric x, y, z, metres."""
    return pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)


@dataclass(frozen=True)
class LocalFrame:
    """East, north, up in metres on the plane that touches the WGS 84 ellipsoid at an origin.

    Heights and depths are taken from the ellipsoid, which stands for the sea surface: the geoid's
    tens of metres shift ship and beacon alike. The plane leaves the sea surface by 8 cm at 1 km and
    8 m at 10 km, so depth is asked of `to_geodetic`, never read off `up`.
    """

    lat_deg: float
    lon_deg: float

    def _axes(self) -> np.ndarray:
        lat, lon = np.radians(self.lat_deg), np.radians(self.lon_deg)
        east = (-np.sin(lon), np.cos(lon), 0.0)
        north = (-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat))
        up = (np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat))
        return np.array((east, north, up))

    def _origin(self) -> np.ndarray:
        return np.array(_to_geocentric().transform(self.lon_deg, self.lat_deg, 0.0))

    def to_local(self, lat_deg, lon_deg, up_m) -> np.ndarray:
        """East, north, up (..., 3) [m] of positions at height `up_m` above the sea surface."""
        lon, lat, up = np.broadcast_arrays(np.asarray(lon_deg, float), lat_deg, up_m)
        geocentric = np.stack(_to_geocentric().transform(lon, lat, up), axis=-1)
        return (geocentric - self._origin()) @ self._axes().T

    def to_geodetic(self, east_north_up) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Latitude, longitude [degrees] and height above the sea surface [m] of local positions (..., 3)."""
        geocentric = np.asarray(east_north_up, float) @ self._axes() + self._origin()
        lon, lat, up = _to_geocentric().transform(
            geocentric[..., 0], geocentric[..., 1], geocentric[..., 2], direction="INVERSE"
        )
        return lat, lon, up


def degrees_minutes(value_deg: float, letters: str, decimals: int = 4) -> str:
    """An angle as ships write it: `degrees_minutes(-5.7077, "NS")` gives `5°42.4620' S`."""
    minutes = round(abs(value_deg) * 60, decimals)
    whole, rest = divmod(minutes, 60)
    width = decimals + 3 if decimals else 2
    return f"{int(whole)}°{rest:0{width}.{decimals}f}' {letters[value_deg < 0]}"


def utm(lat_deg: float, lon_deg: float) -> tuple[str, float, float]:
    """Zone (such as `9S`, hemisphere letter N or S), easting and northing [m] on WGS 84.

    Raises ValueError beyond 84 degrees north and 80 degrees south, where UTM is not defined.
    """
    if not -80 <= lat_deg <= 84:
        raise ValueError(f"UTM is not defined at latitude {lat_deg:.2f} degrees")
    zone = utm_zone(lat_deg, lon_deg)
    south = lat_deg < 0
    easting, northing = _to_utm(zone, south).transform(lon_deg, lat_deg)
    return f"{zone}{'S' if south else 'N'}", easting, northing


def utm_zone(lat_deg: float, lon_deg: float) -> int:
    """Number of the UTM zone, 6 degrees wide but for south-west Norway (32V) and Svalbard (31X, 33X, 35X, 37X)."""
    east = (lon_deg + 180) % 360 - 180
    if 56 <= lat_deg < 64 and 3 <= east < 12:
        return 32
    if lat_deg >= 72 and 0 <= east < 42:
        return (31, 33, 35, 37)[sum(east >= west for west in (9, 21, 33))]
    return int((east + 180) // 6) + 1


@cache
def _to_utm(zone: int, south: bool) -> pyproj.Transformer:
    return pyproj.Transformer.from_crs(
        "EPSG:4326", f"EPSG:{32700 + zone if south else 32600 + zone}", always_xy=True
    )


def bearing_deg(east: float, north: float) -> float:
    """Direction of a horizontal vector, degrees from true north, clockwise, 0 to 360."""
    return float(np.degrees(np.arctan2(east, north)) % 360)
