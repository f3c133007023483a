"""Arrivals opened beside the ship's positions: limits and the antenna's offset turned in the Beacon fix tab."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dashboards.session import Session
from dashboards.tabs.beacon import BeaconTab
from trackerlib.beacon.navigation import PositionLimits
from trackerlib.frames import LocalFrame
from trackerlib.textfiles import InputError

FRAME = LocalFrame(41.0, -66.0)
BEACON = np.array([250.0, 400.0, -900.0])
OFFSET_M = (-20.0, 6.0)  # from antenna to hydrophone: forward, starboard
INTERVAL_S = 2.0
CORNERS = np.array([[0.0, 0.0], [0.0, 900.0], [900.0, 900.0], [900.0, 100.0]])
SPEED_MPS = 3.0


def sailed(seconds):
    """Places (N, 2) of the antenna, and headings (N,) [rad], along three legs."""
    legs = np.diff(CORNERS, axis=0)
    length = np.linalg.norm(legs, axis=1)
    along = np.minimum(SPEED_MPS * np.asarray(seconds), length.sum() - 1e-6)
    leg = np.searchsorted(np.cumsum(length), along, side="right")
    begun = np.concatenate([[0.0], np.cumsum(length)])[leg]
    way = legs[leg] / length[leg, None]
    return CORNERS[leg] + (along - begun)[:, None] * way, np.arctan2(way[:, 0], way[:, 1])


def hydrophone(seconds):
    place, heading = sailed(seconds)
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=1)
    abeam = np.stack([np.cos(heading), -np.sin(heading)], axis=1)
    return np.column_stack([place + OFFSET_M[0] * ahead + OFFSET_M[1] * abeam, np.zeros(len(place))])


@pytest.fixture(scope="module")
def files():
    """The two CSVs: an HDOP of 12 over half a minute, and a gap of ten seconds."""
    rng = np.random.default_rng(1)
    emitted = 3.7 + INTERVAL_S * np.arange(420)
    arrival = emitted.copy()
    for _ in range(6):
        arrival = emitted + np.linalg.norm(BEACON - hydrophone(arrival), axis=1) / 1500.0
    arrival += rng.normal(0, 3e-4, len(arrival))
    seconds = np.setdiff1d(np.arange(0.0, 860.0), np.arange(401.0, 410.0))
    place, heading = sailed(seconds)
    noisy = np.column_stack([place + rng.normal(0, 0.5, place.shape), np.zeros(len(place))])
    lat, lon, _ = FRAME.to_geodetic(noisy)
    hdop = np.where((seconds > 200) & (seconds <= 230), 12.0, 1.0)
    rows = zip(seconds, lat, lon, hdop, np.degrees(heading), strict=True)
    navigation = ["# SIMULATED", "time_s,lat_deg,lon_deg,hdop,heading_deg"]
    navigation += [f"{t:.0f},{a:.9f},{b:.9f},{h:g},{w:.3f}" for t, a, b, h, w in rows]
    return (
        "\n".join(["# SIMULATED", "arrival_s", *(f"{one:.6f}" for one in arrival)]).encode(),
        "\n".join(navigation).encode(),
    )


@pytest.fixture
def session():
    session = Session()
    yield session
    session.close()


@pytest.fixture
def tab(session, files):
    session.open_file("arrivals.csv", files[0])
    assert "now open the ship's positions" in session.message
    session.open_file("gps.csv", files[1])
    tab = BeaconTab(session=session)
    tab.activate()
    tab.settings.interval.value = "2"
    tab.settings.ship_errors.value = "white"
    tab.settings.gps.value = "0.6"
    return tab


def test_every_refusal_is_counted_and_the_interval_asked_for(session, files):
    session.open_file("gps.csv", files[1])  # in the other order
    session.open_file("arrivals.csv", files[0])
    assert "420 arrivals" in session.message
    assert "30 positions refused: HDOP of 10 or more" in session.message
    assert "tell the interval of the pinger" in session.message
    assert session.simulated
    counts = dict(session.placed.refused)
    assert len(session.pings) == 420 - sum(counts.values())
    assert set(counts) == {"HDOP of 10 or more", "gap of more than 4 s between positions"}


def test_real_arrivals_do_not_inherit_the_demos_water(session, files):
    session.open_beacon_demo()
    for name, content in zip(("arrivals.csv", "gps.csv"), files, strict=True):
        session.open_file(name, content.replace(b"# SIMULATED\n", b""))
    assert not session.simulated
    assert session.fix_settings.profile is None
    assert session.truth is None


def test_a_limit_turned_makes_the_pings_afresh_and_undo_takes_it_back(tab):
    session = tab.session
    before, numbers = len(session.pings), set(session.pings.number)
    assert "30 positions refused" in tab.positions.words.object
    assert f"{before} of 420 arrivals have a position" in tab.positions.words.object
    tab.positions.hdop.value = 20.0
    assert session.position_limits == PositionLimits(greatest_hdop=20.0)
    assert len(session.pings) > before
    assert numbers < set(session.pings.number)
    assert len(session.fix.number) == len(session.pings)
    assert "positions refused" not in tab.positions.words.object
    assert "positions refused" not in session.message
    tab.positions.gap.value = "12"
    tab.positions.age.value = 10.0
    assert len(session.pings) == 420
    for _ in range(3):
        session.undo()
    assert len(session.pings) == before
    assert (tab.positions.hdop.value, tab.positions.gap.value) == (10.0, "")
    session.redo()
    assert tab.positions.hdop.value == 20.0
    assert len(session.pings) > before


def test_the_antennas_offset_moves_the_hydrophone(tab):
    session, fix = tab.session, tab.session.fix

    def miss():
        fix = session.fix
        assert fix.converged, fix.reason
        return fix.position - fix.frame.to_local(*(float(one) for one in FRAME.to_geodetic(BEACON)))

    unmoved = np.linalg.norm(miss()[:2])
    tab.positions.offset[0].value = OFFSET_M[0]
    tab.positions.offset[1].value = OFFSET_M[1]
    assert session.antenna_offset_m == (*OFFSET_M, 0.0)
    assert np.all(np.abs(miss()) < 4 * session.fix.sigma)
    assert np.linalg.norm(miss()[:2]) < 0.3 * unmoved
    assert "antenna offset turned by heading" in tab.positions.words.object
    assert session.fix.uncertainty.rms_s < 0.5 * fix.uncertainty.rms_s
    session.undo()
    session.undo()
    assert session.antenna_offset_m == (0.0, 0.0, 0.0)
    assert session.fix.uncertainty.rms_s == pytest.approx(fix.uncertainty.rms_s)


def test_a_ping_left_out_by_hand_stays_so(tab):
    session = tab.session
    number = int(session.pings.number[3])
    tab._compute_history()
    assert len(tab.history.source.data["number"]) > 3
    assert tab.history.figure.title.text == ""
    tab.map.pings.selected.indices = [3]
    tab.edits.leave_out()
    tab.positions.hdop.value = 20.0
    assert session.fix_settings.left_out == {number}
    assert number in session.fix.rejected
    assert len(tab.history.source.data["number"]) == 0  # it was of the pings before
    assert "No fix believed yet" in tab.history.figure.title.text


def test_the_live_estimator_hears_the_pings_made_afresh(tab):
    session = tab.session
    session.edit(fix_settings=type(session.fix_settings)(gps_rms_m=0.6), live=True)
    first = session._live_survey
    tab.positions.hdop.value = 20.0
    assert session._live_survey is not first
    assert len(session.fix.number) == len(session.pings)


def test_a_session_file_carries_them(tab, files):
    tab.positions.hdop.value = 20.0
    tab.positions.gap.value = "12"
    tab.positions.offset[1].value = 6.0
    text, count = tab.session.to_json(), len(tab.session.pings)
    other = Session()
    for name, content in zip(("arrivals.csv", "gps.csv"), files, strict=True):
        other.open_file(name, content)
    other.open_file("mine.json", text.encode())
    assert other.position_limits == tab.session.position_limits
    assert other.antenna_offset_m == (0.0, 6.0, 0.0)
    assert len(other.pings) == count
    broken = json.loads(text) | {"antenna_offset_m": [1, 2]}
    with pytest.raises(InputError, match="not a session file"):
        other.open_file("broken.json", json.dumps(broken).encode())
    other.close()


def test_what_makes_no_sense_is_told_and_changes_nothing(tab):
    before = tab.session.pings
    tab.positions.gap.value = "-1"
    assert tab.session.failed
    assert "greatest_gap_s is -1; wanted" in tab.session.message
    assert tab.session.pings is before
    assert tab.positions.gap.value == ""
    tab.positions.hdop.value = 0.5  # every position has more
    assert len(tab.session.pings) == 0
    assert not tab.session.fix.converged
    assert "0 usable pings" in tab.sentence.object
    tab.settings.restore_defaults()
    assert len(tab.session.pings) == len(before)


def test_a_survey_with_positions_of_its_own_says_so(session):
    session.open_beacon_demo()
    tab = BeaconTab(session=session)
    tab.activate()
    assert "positions of its own" in tab.positions.words.object
    pings = session.pings
    tab.positions.hdop.value = 5.0
    assert session.pings is pings
    assert "refused" not in json.loads(tab.export()[1])


def test_the_export_counts_what_was_refused(tab):
    refused = json.loads(tab.export()[1])["refused"]
    assert refused["positions"] == {"HDOP of 10 or more": 30}
    assert sum(refused["arrivals"].values()) == 420 - len(tab.session.pings)


def test_the_report_tells_limits_offset_and_what_was_refused(tab):
    tab.positions.age.value = 1.5
    tab.positions.offset[0].value = -12.0
    tab.files.layout.value = "html"
    text = tab.files.file().read().decode()
    for words in (
        "<td>greatest age</td><td>1.5 s</td>",
        "<td>greatest gap</td><td>3 s</td>",
        "-12 m forward, 0 m starboard, 0 m down",
        f"{len(tab.session.pings)} of 420",
        "30 positions refused: HDOP of 10 or more",
        "arrivals refused: ",
    ):
        assert words in text, words
