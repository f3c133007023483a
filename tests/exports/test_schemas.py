"""Exports held to the formats' own definitions: KML to OGC's schema, GPX to the order and types that it lays down.

The schema of KML is OGC's ogckml22.xsd, with OASIS's xAL and the part of Atom it names, as fastkml brings them: they
are read from its folder, nothing from the network. The schemas of GPX state no terms for passing them on, so their
rules for what we write are written out here.
"""

from __future__ import annotations

import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from test_exports import made_at

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.settings import FixSettings
from trackerlib.exports.export import export_fix
from trackerlib.exports.gpx import route_gpx

POINT = "magvar geoidheight name cmt desc src {links} sym type fix sat hdop vdop pdop ageofdgpsdata dgpsid"
OLD = POINT.format(links="url urlname")
NEW = POINT.format(links="link") + " extensions"
MANY = {"wpt", "rte", "trk", "rtept", "trkseg", "trkpt", "link"}
ORDER = {
    "1.0": {
        "gpx": "name desc author email url urlname time keywords bounds wpt rte trk",
        "wpt": f"ele time {OLD}",
        "trk": "name cmt desc src url urlname number trkseg",
        "trkseg": "trkpt",
        "trkpt": f"ele time course speed {OLD}",
    },
    "1.1": {
        "gpx": "metadata wpt rte trk extensions",
        "metadata": "name desc author copyright link time keywords bounds extensions",
        "wpt": f"ele time {NEW}",
        "rte": "name cmt desc src link number type extensions rtept",
        "rtept": f"ele time {NEW}",
        "trk": "name cmt desc src link number type extensions trkseg",
        "trkseg": "trkpt extensions",
        "trkpt": f"ele time {NEW}",
    },
}
DECIMAL = re.compile(r"-?\d+(\.\d+)?")  # as xsd:decimal, no power of ten
TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z")


def gpx_faults(text: str, version: str) -> list[str]:
    """What a document breaks of the rules of GPX."""
    root = etree.fromstring(text.encode())
    space = f"{{http://www.topografix.com/GPX/{version.replace('.', '/')}}}"
    faults = [] if root.tag == f"{space}gpx" and root.get("version") == version else ["root"]
    faults += [] if root.get("creator") else ["creator"]
    for element in root.iter():
        name = element.tag.removeprefix(space)
        told = [child.tag.removeprefix(space) for child in element]
        order = ORDER[version].get(name, "").split()
        ranks = [order.index(child) if child in order else -1 for child in told]
        if -1 in ranks or ranks != sorted(ranks):
            faults.append(f"{name}: {told}")
        faults += [f"{name}: two {one}" for one in set(told) - MANY if told.count(one) > 1]
        if name in ("wpt", "rtept", "trkpt"):
            lat, lon = element.get("lat"), element.get("lon")
            within = DECIMAL.fullmatch(lat) and DECIMAL.fullmatch(lon) and abs(float(lat)) <= 90
            faults += [] if within and -180 <= float(lon) < 180 else [f"{name}: {lat} {lon}"]
        pattern = {"ele": DECIMAL, "time": TIME}.get(name)
        if pattern and not pattern.fullmatch(element.text):
            faults.append(f"{name}: {element.text}")
    return faults


@pytest.fixture(scope="module")
def kml_schema():
    folder = Path(find_spec("fastkml").submodule_search_locations[0]) / "schema"
    return etree.XMLSchema(etree.parse(str(folder / "ogckml22.xsd"), etree.XMLParser(no_network=True)))


def surveys():
    pings, fix = made_at(-33.0, 179.995)
    few, line = pings.only(slice(0, 5)), pings.only(slice(0, 60))  # refused; refused with both mirror places
    dateless = replace(pings, utc=np.full(len(pings), np.datetime64("NaT", "ms")))
    how = FixSettings(gps_rms_m=3.0)
    return {
        "fixed": (pings, fix),
        "refused": (few, fix_beacon(few, how)),
        "mirror": (line, fix_beacon(line, how)),
        "dateless": (dateless, fix),
    }


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Texts by survey and layout."""
    folder, texts = tmp_path_factory.mktemp("exports"), {}
    for name, (pings, fix) in surveys().items():
        for layout in ("gpx-1.0", "gpx-1.1", "kml"):
            path = folder / f"{name}.{layout[:3]}"
            export_fix(fix, path, layout, pings=pings)
            texts[name, layout] = path.read_text(encoding="utf-8")
    assert "trkpt" in texts["fixed", "gpx-1.0"]
    assert texts["mirror", "gpx-1.1"].count("<wpt") >= 2
    return texts


NAMES = ["fixed", "refused", "mirror", "dateless"]


@pytest.mark.parametrize("name", NAMES)
def test_kml_is_valid_by_its_schema(exported, kml_schema, name):
    kml_schema.assertValid(etree.fromstring(exported[name, "kml"].encode()))


@pytest.mark.parametrize("version", ["1.0", "1.1"])
@pytest.mark.parametrize("name", NAMES)
def test_gpx_keeps_the_rules_of_its_version(exported, name, version):
    assert gpx_faults(exported[name, f"gpx-{version}"], version) == []


def test_a_route_keeps_them_too_and_the_date_line_is_west():
    text = route_gpx([(0.0, 179.99999999999, "start"), (-1e-12, -180.0, "end")], "over the line")
    assert gpx_faults(text, "1.1") == []
    assert text.count('lon="-180.000000000"') == 2


def test_what_breaks_the_rules_is_found(exported, kml_schema):
    text = exported["fixed", "gpx-1.1"]
    for good, bad in (
        ("<ele>", "<depth>"),
        ("<ele>-", "<ele>-1e"),
        ('lon="', 'lon="5'),
        (' creator="', ' maker="'),
    ):
        broken = text.replace(good, bad).replace("</ele>", "</depth>" if bad == "<depth>" else "</ele>")
        assert gpx_faults(broken, "1.1")
    assert gpx_faults(text, "1.0")
    kml = exported["fixed", "kml"].replace("<altitudeMode>clampToGround", "<altitudeMode>onTheGround")
    assert not kml_schema.validate(etree.fromstring(kml.encode()))
