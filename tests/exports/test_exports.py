"""Every export says the fix, where the beacon is now, and SIMULATED; other programs can read it."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

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
from trackerlib.positions import decimal_degrees
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


@pytest.fixture(scope="module")
def drifting():
    """A survey of a beacon that drifts north, and its fix."""
    track = sail(np.array([[a, 1500.0] for a in (30.0, 150.0, 270.0, 30.0)]), np.zeros(2), 2.5, 10.0)
    rng, frame, start = np.random.default_rng(6), LocalFrame(41.0, -66.0), np.array([700.0, 500.0, -1500.0])
    still = simulate_survey(track, start, StraightPaths(1500.0), frame, rng, Errors(1.0, 0.0005))
    place = start + still.elapsed_s[:, None] * [0.0, 0.2, 0.0]
    ship = frame.to_local(still.lat_deg, still.lon_deg, still.up_m)
    times = np.linalg.norm(ship - place, axis=1) / 1500.0 + rng.normal(0.3, 0.0005, len(still))
    pings = replace(still, travel_time_s=times)
    fix = fix_beacon(pings, FixSettings(gps_rms_m=1.0, motion="free"))
    assert fix.converged, fix.reason
    return pings, fix


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


def passes_the_cf_checker(path):
    """Raises AssertionError with what the checker says."""
    CheckSuite.load_all_available_checkers()
    told = path.with_suffix(".txt")
    passed, errors = ComplianceChecker.run_checker(
        str(path), ["cf:1.11"], 0, "strict", output_filename=str(told)
    )
    assert passed, told.read_text()
    assert not errors


def test_the_netcdf_file_passes_the_cf_checker(made, tmp_path):
    path = exported(made, tmp_path, "fix.nc")
    passes_the_cf_checker(path)
    with netCDF4.Dataset(path) as dataset:
        assert dataset.featureType == "trajectory"
        assert dataset.beacon_depth_m == pytest.approx(made[1].depth_m)


def holed(pings):
    """A time lost here, a place there."""
    utc, lat = pings.utc.copy(), pings.lat_deg.copy()
    utc[3], lat[8] = np.datetime64("NaT"), np.nan
    return replace(pings, utc=utc, lat_deg=lat)


def by_clock(pings):
    """A log whose clock names no date."""
    return replace(pings, utc=np.full(len(pings), np.datetime64("NaT", "ms")), clock_s=7e4 + pings.elapsed_s)


@pytest.mark.parametrize(("change", "left_out"), [(holed, [4, 9]), (by_clock, [])])
def test_a_survey_with_holes_or_a_clock_alone_is_a_trajectory_too(made, tmp_path, change, left_out):
    pings = change(made[0])
    path = tmp_path / "odd.nc"
    export_fix(fix_beacon(pings, SETTINGS), path, pings=pings)
    passes_the_cf_checker(path)
    kept = ~np.isin(pings.number, left_out)
    with netCDF4.Dataset(path) as dataset:
        assert dataset.featureType == "trajectory"
        assert dataset["ping_number"][:].tolist() == pings.number[kept].tolist()
        assert ("pings 4, 9" in dataset.comment) == bool(left_out)
        time = dataset["time"][:]
        wanted = pings.clock_s if change is by_clock else pings.utc[kept].astype("datetime64[us]").astype(int)
        assert np.array_equal(time, wanted)


def test_the_instants_of_a_clock_alone_are_read_back_from_the_table(made, tmp_path):
    pings = by_clock(made[0])
    path = tmp_path / "clock.csv"
    export_fix(fix_beacon(pings, SETTINGS), path, pings=pings)
    again = read_survey(path).pings
    assert again.timed
    assert again.clock_s == pytest.approx(pings.clock_s, abs=1e-6)


@pytest.mark.parametrize("suffix", [".gpx", ".kml", ".geojson", ".nc", ".csv", ".html"])
def test_of_a_moving_beacon_its_present_place_is_exported(drifting, tmp_path, suffix):
    pings, fix = drifting
    path = tmp_path / f"moving{suffix}"
    export_fix(fix, path, pings=pings)
    now = fix.present
    assert now.lat_deg - fix.lat_deg > 5e-4
    if suffix == ".nc":
        passes_the_cf_checker(path)
        with netCDF4.Dataset(path) as dataset:
            assert dataset.beacon_lat_deg == pytest.approx(now.lat_deg, abs=1e-9)
            assert json.loads(dataset.beacon_velocity_mps) == pytest.approx(fix.velocity.tolist())
    elif suffix == ".gpx":
        assert gpxpy.parse(path.read_text()).waypoints[0].latitude == pytest.approx(now.lat_deg, abs=1e-8)
    elif suffix == ".geojson":
        beacon = json.loads(path.read_text())["features"][0]
        assert beacon["geometry"]["coordinates"][1] == pytest.approx(now.lat_deg, abs=1e-9)
        assert beacon["properties"]["elapsed_s"] == pytest.approx(pings.elapsed_s[-1], abs=5)
    elif suffix == ".html":
        assert decimal_degrees(now.lat_deg, now.lon_deg) in path.read_text()
    else:
        assert f"{now.lat_deg:.4f}" in path.read_text()


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
