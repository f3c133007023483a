"""A fix as GeoJSON for maps, and its pings as CSV for spreadsheets."""

from __future__ import annotations

import csv
import io
import json
import math

import numpy as np

from trackerlib.exports.antimeridian import cut_line, cut_ring
from trackerlib.exports.record import FixRecord, Place, utc_text, wrapped

COLUMNS = (
    "ping",
    "utc",
    "time_s",
    "lat_deg",
    "lon_deg",
    "up_m",
    "oneway_s",
    "residual_ms",
    "used",
    "left_out_because",
)


def fix_geojson(record: FixRecord) -> str:
    """GeoJSON of a fix (RFC 7946: WGS 84; longitude, latitude, height in metres).

    A fix refused without a position keeps its properties, with a null geometry.
    """
    features = [_beacon(record), *_ellipse(record)]
    features += [
        _feature("alternative", p.name, _point(p), {"depth_m": p.depth_m}) for p in record.alternatives
    ]
    features += _track(record)
    collection = {"type": "FeatureCollection", "features": features}
    return json.dumps(collection, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def pings_csv(record: FixRecord) -> str:
    """CSV of the pings with their residuals [ms], under a comment block with the fix; unknowns are empty."""
    table = io.StringIO()
    for line in (record.title, *record.summary):
        table.write(f"# {line}\n")
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(COLUMNS)
    lat, lon, depth = record.ship
    clock = record.clock_s
    because = record.left_out_because
    for k, number in enumerate(record.fix.number):
        rows.writerow(
            (
                int(number),
                utc_text(record.utc[k]),
                _cell(clock[k], 6),
                _cell(lat[k], 9),
                _cell(lon[k], 9),
                _cell(-depth[k], 4),
                _cell(record.travel_time_s[k], 9),
                _cell(record.residual_ms[k], 6),
                int(record.fix.used[k]),
                because.get(int(number), ""),
            )
        )
    return table.getvalue()


def accuracy_csv(
    record: FixRecord, east_m: np.ndarray, north_m: np.ndarray, error_m: np.ndarray, speed_mps: float
) -> str:
    """CSV of the error [m] (N, M) expected after a leg to each place of a grid, under a comment block with the fix.

    east_m, north_m : (M,), (N,) in the frame of the fix; speed_mps : at which the legs are sailed
    """
    table = io.StringIO()
    for line in (record.title, *record.summary):
        table.write(f"# {line}\n")
    table.write(
        f"# Expected error (root-mean-square, in space) after a straight leg at {speed_mps:g} m/s from the last ping "
        "to each place; of several places that fit, for the one that the leg tells least of\n"
    )
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(("lat_deg", "lon_deg", "east_m", "north_m", "expected_error_m"))
    east, north = np.meshgrid(east_m, north_m)
    lat, lon, _ = record.fix.frame.to_geodetic(np.stack([east, north, np.zeros_like(east)], axis=-1))
    columns = (
        _cells(lat, 8), _cells(wrapped(lon), 8), _cells(east, 2), _cells(north, 2), _cells(error_m, 4)
    )  # fmt: skip
    rows.writerows(zip(*columns, strict=True))
    return table.getvalue()


def _cells(values: np.ndarray, decimals: int) -> list[str]:
    return [_cell(float(value), decimals) for value in values.ravel()]


def _cell(value: float, decimals: int) -> str:
    return f"{value:z.{decimals}f}" if math.isfinite(value) else ""


def _feature(kind: str, name: str, geometry: dict | None, properties: dict) -> dict:
    return {
        "type": "Feature",
        "geometry": geometry,
        "properties": {"kind": kind, "name": name, **properties},
    }


def _point(place: Place) -> dict:
    return {"type": "Point", "coordinates": [place.lon_deg, place.lat_deg, -place.depth_m]}


def _beacon(record: FixRecord) -> dict:
    place = record.beacon
    times = dict(zip(("first_utc", "last_utc"), record.survey_times, strict=False))
    properties = {**record.properties, **times, "summary": list(record.summary)}
    if place is None:
        return _feature("beacon", record.named("Beacon, no position"), None, properties)
    return _feature("beacon", place.name, _point(place), properties)


def _ellipse(record: FixRecord) -> list[dict]:
    ring = record.ellipse_ring()
    if ring is None:
        return []
    parts = cut_ring(ring[1], ring[0])
    geometry = (
        {"type": "Polygon", "coordinates": [parts[0]]}
        if len(parts) == 1
        else {"type": "MultiPolygon", "coordinates": [[part] for part in parts]}
    )
    properties = {"level_percent": 95, **record.properties["ellipse95"], "converged": record.fix.converged}
    return [_feature("ellipse", record.named("95 % ellipse"), geometry, properties)]


def _track(record: FixRecord) -> list[dict]:
    lat, lon, _ = record.ship
    known = record.placed
    if known.sum() < 2:
        return []
    parts = cut_line(lon[known], lat[known])
    geometry = (
        {"type": "LineString", "coordinates": parts[0]}
        if len(parts) == 1
        else {"type": "MultiLineString", "coordinates": parts}
    )
    numbers = record.fix.number[known].tolist()
    utc = [utc_text(time) or None for time in record.utc[known]] if not np.isnat(record.utc).all() else None
    return [_feature("ship", record.named("Ship at the pings"), geometry, {"numbers": numbers, "utc": utc})]
