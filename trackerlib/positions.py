"""Positions on WGS 84 as people write them: decimal degrees, degrees and minutes, and seconds, UTM."""

from __future__ import annotations

from trackerlib import frames


def decimal_degrees(lat_deg: float, lon_deg: float, decimals: int = 7) -> str:
    """Latitude and longitude in degrees, south and west negative: `-5.7077000, 134.1000000`."""
    lat_deg, lon_deg = _checked(lat_deg, lon_deg)
    return f"{lat_deg:z.{decimals}f}, {lon_deg:z.{decimals}f}"


def degrees_minutes(lat_deg: float, lon_deg: float, decimals: int = 4) -> str:
    """Latitude and longitude in degrees and minutes: `5°42.4620' S, 134°06.0000' E`."""
    lat_deg, lon_deg = _checked(lat_deg, lon_deg)
    return f"{frames.degrees_minutes(lat_deg, 'NS', decimals)}, {frames.degrees_minutes(lon_deg, 'EW', decimals)}"


def degrees_minutes_seconds(lat_deg: float, lon_deg: float, decimals: int = 3) -> str:
    """Latitude and longitude in degrees, minutes and seconds: `5°42'27.720" S, 134°06'00.000" E`."""
    lat_deg, lon_deg = _checked(lat_deg, lon_deg)
    return f"{_seconds(lat_deg, 'NS', decimals)}, {_seconds(lon_deg, 'EW', decimals)}"


def utm(lat_deg: float, lon_deg: float, decimals: int = 1) -> str:
    """Zone with its datum, easting and northing in metres: `UTM 31N (WGS 84) 500000.0 m E 0.0 m N`.

    Raises ValueError beyond 84 degrees north and 80 degrees south, where UTM is not defined.
    """
    zone, easting, northing = frames.utm(*_checked(lat_deg, lon_deg))
    return f"UTM {zone} (WGS 84) {easting:z.{decimals}f} m E {northing:z.{decimals}f} m N"


def _checked(lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """The same place with its longitude from -180 to 180. Raises ValueError for what is no place."""
    if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 360):
        raise ValueError(f"{lat_deg}, {lon_deg} is no latitude and longitude in degrees")
    if abs(lon_deg) > 180:
        lon_deg -= 360 if lon_deg > 0 else -360
    return float(lat_deg), float(lon_deg)


def _seconds(value_deg: float, letters: str, decimals: int) -> str:
    minutes, seconds = divmod(round(abs(value_deg) * 3600, decimals), 60)
    degrees, minutes = divmod(int(minutes), 60)
    width = decimals + 3 if decimals else 2
    return f"{degrees}°{minutes:02d}'{seconds:0{width}.{decimals}f}\" {letters[value_deg < 0]}"
