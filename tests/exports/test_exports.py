"""Every export says the fix, where the beacon is now, and SIMULATED; other programs can read it."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree

import gpxpy
import netCDF4
import numpy as np
import pytest
from compliance_checker.runner import CheckSuite, ComplianceChecker

from trackerlib.beacon.fix import fix_beacon
from trackerlib.beacon.paths import StraightPaths
from trackerlib.beacon.settings import FixSettings
from trackerlib.exports.export import LAYOUTS, export_fix
from trackerlib.exports.record import FixRecord
from trackerlib.frames import LocalFrame
from trackerlib.simulation.beacon_survey import Errors, sail, simulate_survey
from trackerlib.surveyfiles.survey import read_survey
from trackerlib.textfiles import InputError

KML = "{http://www.opengis.net/kml/2.2}"
SETTINGS = FixSettings(gps_rms_m=3.0)


def made_at(lat_deg, lon_deg):
    """A survey round a beacon at a place: pings and their fix."""
    track = sail(np.array([[30.0, 1500.0], [150.0, 1500.0], [270.0, 1500.0]]), np.zeros(2), 2.5, 10.0)
    pings = simulate_survey(
        track,
        np.array([700.0, 500.0, -1500.0]),
        StraightPaths(1500.0),
        LocalFrame(lat_deg, lon_deg),
        np.random.default_rng(5),
        Errors(gps_rms_m=3.0, time_rms_s=0.0005),
        emission_offset_s=0.3,
    )
    return pings, fix_beacon(pings, SETTINGS)


@pytest.fixture(scope="module", params=[(41.0, -66.0), (-33.0, 179.995)], ids=["Georges Bank", "date line"])
def made(request):
    return made_at(*request.param)


def exported(made, tmp_path, name, layout=None):
    pings, fix = made
    path = tmp_path / name
    export_fix(fix, path, layout, pings=pings, settings=SETTINGS)
    return path


@pytest.mark.parametrize(("layout", "suffix"), [(name, suffix) for name, (suffix, _) in LAYOUTS.items()])
def test_every_layout_says_simulated_and_which_program(made, tmp_path, layout, suffix):
    content = exported(made, tmp_path, f"fix{suffix}", layout).read_bytes()
    assert b"SIMULATED" in content
    assert b"trackerlib" in content
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize("version", ["1.0", "1.1"])
def test_a_plotter_reads_the_beacon_and_the_track(made, tmp_path, version):
    pings, fix = made
    gpx = gpxpy.parse(exported(made, tmp_path, "fix.gpx", f"gpx-{version}").read_text())
    assert gpx.version == version
    mark = gpx.waypoints[0]
    assert (mark.latitude, mark.elevation) == pytest.approx((fix.lat_deg, -fix.depth_m), abs=1e-3)
    assert (mark.longitude - fix.lon_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-8)
    points = gpx.tracks[0].segments[0].points
    assert len(points) == len(pings)
    assert points[3].time.replace(tzinfo=None) == pings.utc[3].astype(object)


def test_a_globe_gets_a_closed_ellipse_round_the_beacon(made, tmp_path):
    root = ElementTree.parse(exported(made, tmp_path, "fix.kml")).getroot()
    ring = root.find(f".//{KML}LinearRing/{KML}coordinates").text.split()
    assert ring[0] == ring[-1]
    lon, lat = np.array([[float(part) for part in pair.split(",")] for pair in ring]).T
    _, fix = made
    assert lat.min() < fix.lat_deg < lat.max()
    assert (np.unwrap(lon, period=360).max() - np.unwrap(lon, period=360).min()) < 0.01


def test_geojson_winds_its_rings_to_the_left_and_never_crosses_the_date_line(made, tmp_path):
    document = json.loads(exported(made, tmp_path, "fix.geojson").read_text())
    kinds = {feature["properties"]["kind"]: feature for feature in document["features"]}
    _, fix = made
    assert kinds["beacon"]["geometry"]["coordinates"][1] == pytest.approx(fix.lat_deg, abs=1e-9)
    assert len(kinds["beacon"]["properties"]["covariance_enu_m2"]) == 3
    geometry = kinds["ellipse"]["geometry"]
    rings = (
        geometry["coordinates"] if geometry["type"] == "Polygon" else [p[0] for p in geometry["coordinates"]]
    )
    for ring in rings:
        x, y = np.array(ring).T
        assert np.abs(np.diff(x)).max() < 1
        assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0  # counter-clockwise
    ship = kinds["ship"]["geometry"]
    lines = [ship["coordinates"]] if ship["type"] == "LineString" else ship["coordinates"]
    assert all(np.abs(np.diff(np.array(line)[:, 0])).max() < 1 for line in lines)


def test_the_table_is_read_back_as_the_same_survey(made, tmp_path):
    pings, fix = made
    path = exported(made, tmp_path, "fix.csv")
    again = read_survey(path).pings
    assert again.simulated
    assert again.travel_time_s == pytest.approx(pings.travel_time_s, abs=1e-9)
    assert again.lat_deg == pytest.approx(pings.lat_deg, abs=1e-8)
    assert fix_beacon(again, SETTINGS).position == pytest.approx(fix.position, abs=1e-2)
    rows = list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))
    assert float(rows[7]["residual_ms"]) == pytest.approx(1e3 * fix.residual_s[7], abs=1e-6)


def test_the_netcdf_file_passes_the_cf_checker(made, tmp_path):
    path = exported(made, tmp_path, "fix.nc")
    CheckSuite.load_all_available_checkers()
    passed, errors = ComplianceChecker.run_checker(
        str(path), ["cf:1.11"], 0, "strict", output_filename=str(tmp_path / "cf.txt")
    )
    assert passed, (tmp_path / "cf.txt").read_text()
    assert not errors
    with netCDF4.Dataset(path) as dataset:
        assert dataset.featureType == "trajectory"
        assert dataset.beacon_depth_m == pytest.approx(made[1].depth_m)


def test_the_report_needs_nothing_from_elsewhere(made, tmp_path):
    text = exported(made, tmp_path, "fix.html").read_text()
    assert "<script" not in text
    assert all(word not in text for word in ('src="http', 'href="http', "url(http"))
    assert text.count("<svg") == 2
    assert "gps_rms_m" in text


@pytest.mark.parametrize("suffix", [".gpx", ".kml", ".geojson", ".csv", ".nc", ".html"])
def test_a_refused_fix_is_exported_with_its_reason(made, tmp_path, suffix):
    pings, _ = made
    few = pings.only(slice(0, 5))
    fix = fix_beacon(few, SETTINGS)
    path = tmp_path / f"refused{suffix}"
    export_fix(fix, path, pings=few)
    assert b"5 usable pings" in path.read_bytes()


def test_an_unknown_suffix_and_a_missing_folder_are_named(made, tmp_path):
    with pytest.raises(InputError, match=r"wanted \.gpx"):
        exported(made, tmp_path, "fix.doc")
    with pytest.raises(InputError, match="cannot be written"):
        export_fix(made[1], tmp_path / "nowhere" / "fix.gpx")


def test_pings_of_another_survey_are_refused(made):
    with pytest.raises(ValueError, match="numbers differ"):
        FixRecord(made[1], made[0].only(slice(0, 20)))
