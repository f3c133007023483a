"""KML 2.2 for globes: beacon, 95 % ellipse, ship's track and alternatives."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from trackerlib.exports.record import FixRecord, Place, ellipse_text
from trackerlib.exports.xml_tree import child, document_text

ESTIMATE, SHIP, OTHER = "ff7733cc", "ff706a5a", "ff968f8a"  # alpha, blue, green, red


def fix_kml(record: FixRecord) -> str:
    """KML of a fix. The beacon's time is that of the last ping; places lie on the ground, depth in words."""
    root = Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2"})
    document = child(root, "Document")
    child(document, "name", record.title)
    child(document, "description", "\n".join(record.summary))
    _styles(document)
    last = record.survey_times[-1:]
    if record.beacon is not None:
        style = "beacon" if record.fix.converged else "guess"
        _point(document, record.beacon, style, *last)
    _ellipse(document, record, *last)
    for place in record.alternatives:
        _point(document, place, "guess", *last)
    _track(document, record)
    return document_text(root)


def _styles(document: Element) -> None:
    for name, colour in (("beacon", ESTIMATE), ("guess", OTHER)):
        child(child(child(document, "Style", id=name), "IconStyle"), "color", colour)
    for name, colour in (("ellipse", ESTIMATE), ("ship", SHIP)):
        style = child(document, "Style", id=name)
        line = child(style, "LineStyle")
        child(line, "color", colour)
        child(line, "width", "2")
        child(child(style, "PolyStyle"), "color", "26" + colour[2:])


def _placemark(parent: Element, name: str, description: str, style: str, *times: str) -> Element:
    """A placemark of one time, of a span of two, or of none."""
    placemark = child(parent, "Placemark")
    child(placemark, "name", name)
    child(placemark, "description", description)
    if len(times) == 1:
        child(child(placemark, "TimeStamp"), "when", times[0])
    elif times:
        span = child(placemark, "TimeSpan")
        child(span, "begin", times[0])
        child(span, "end", times[1])
    child(placemark, "styleUrl", f"#{style}")
    return placemark


def _point(document: Element, place: Place, style: str, *times: str) -> None:
    placemark = _placemark(document, place.name, place.description, style, *times)
    depth = child(child(placemark, "ExtendedData"), "Data", name="depth_m")
    child(depth, "value", f"{place.depth_m:.3f}")
    point = child(placemark, "Point")
    child(point, "altitudeMode", "clampToGround")
    child(point, "coordinates", _coordinates([place.lat_deg], [place.lon_deg]))


def _ellipse(document: Element, record: FixRecord, *times: str) -> None:
    ring = record.ellipse_ring()
    if ring is None:
        return
    name = record.named("95 % ellipse" if record.fix.converged else "95 % ellipse of the best guess")
    placemark = _placemark(document, name, ellipse_text(record.fix), "ellipse", *times)
    polygon = child(placemark, "Polygon")
    child(polygon, "tessellate", "1")
    child(polygon, "altitudeMode", "clampToGround")
    boundary = child(child(polygon, "outerBoundaryIs"), "LinearRing")
    child(boundary, "coordinates", _coordinates(*ring))


def _track(document: Element, record: FixRecord) -> None:
    lat, lon, _ = record.ship
    known = record.placed
    if known.sum() < 2:
        return
    name = record.named("Ship at the pings")
    placemark = _placemark(document, name, f"{known.sum()} pings", "ship", *record.survey_times)
    line = child(placemark, "LineString")
    child(line, "tessellate", "1")
    child(line, "altitudeMode", "clampToGround")
    child(line, "coordinates", _coordinates(lat[known], lon[known]))


def _coordinates(lat_deg, lon_deg) -> str:
    return " ".join(f"{lon:z.9f},{lat:z.9f}" for lat, lon in zip(lat_deg, lon_deg, strict=True))
