"""GPX for chart plotters: a fix as waypoints and the ship's track (1.0 and 1.1), a planned route (1.1)."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element

import numpy as np

from trackerlib.exports.record import FixRecord, Place, utc_text, wrapped
from trackerlib.exports.xml_tree import child, document_text


def fix_gpx(record: FixRecord, version: str = "1.1") -> str:
    """GPX of a fix: beacon and alternatives as waypoints, elevation minus depth [m], the ship's track.

    Raises ValueError for a version other than "1.0" and "1.1".
    """
    root = _root(version)
    header = child(root, "metadata") if version == "1.1" else root
    child(header, "name", record.title)
    child(header, "desc", "\n".join(record.summary))
    for place in [record.beacon, *record.alternatives]:
        if place is not None:
            _waypoint(root, place)
    _track(root, record)
    return document_text(root)


def route_gpx(points: Iterable[tuple[float, float, str]], name: str) -> str:
    """GPX 1.1 of a planned route through points (latitude, longitude [degrees], name)."""
    root = _root("1.1")
    route = child(root, "rte")
    child(route, "name", name)
    for lat_deg, lon_deg, point_name in points:
        child(child(route, "rtept", **_place(lat_deg, lon_deg)), "name", point_name)
    return document_text(root)


def _root(version: str) -> Element:
    if version not in ("1.0", "1.1"):
        raise ValueError(f"GPX version is {version!r}; wanted 1.0 or 1.1")
    space = f"http://www.topografix.com/GPX/{version.replace('.', '/')}"
    return Element("gpx", {"version": version, "creator": "trackerlib", "xmlns": space})


def _place(lat_deg: float, lon_deg: float) -> dict[str, str]:
    return {"lat": f"{lat_deg:z.9f}", "lon": f"{float(wrapped(np.array(lon_deg))):z.9f}"}


def _waypoint(root: Element, place: Place) -> None:
    waypoint = child(root, "wpt", **_place(place.lat_deg, place.lon_deg))
    child(waypoint, "ele", f"{-place.depth_m:z.3f}")
    child(waypoint, "name", place.name)
    child(waypoint, "desc", place.description)


def _track(root: Element, record: FixRecord) -> None:
    if not record.placed.any():
        return
    track = child(root, "trk")
    child(track, "name", record.named("Ship at the pings"))
    segment = child(track, "trkseg")
    lat, lon, _ = record.ship
    for k in np.flatnonzero(record.placed):
        point = child(segment, "trkpt", **_place(lat[k], lon[k]))
        if time := utc_text(record.utc[k]):
            child(point, "time", time)
