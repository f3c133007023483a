"""The Wet-paper chart with sound: recordings, a simulated hunt with known truth, marks, bearing lines, exports."""

from __future__ import annotations

import io

import numpy as np
import pytest
import soundfile

from dashboards.session import Session, binary_kind
from dashboards.tabs.chart import ChartTab
from dashboards.tabs.chart_controls import ChartControls
from dashboards.tabs.chart_export import folded_signal
from trackerlib.frames import LocalFrame
from trackerlib.simulation.hunt_sound import BEACON_M, simulate_hunt_sound
from trackerlib.simulation.sound import write_sound

TRACES = ((10, 240), (260, 490))  # lines of each leg


@pytest.fixture(scope="module")
def hunted():
    """A tab that has heard a simulated hunt; tests put its marks and lines back."""
    session = Session()
    session.open_beacon_demo()
    tab = ChartTab(session=session)
    tab.activate()
    tab.controls_.simulate.clicks += 1
    assert not session.failed, session.message
    return tab


@pytest.fixture
def tab(hunted):
    hunted.session.param.update(chart_marks=(), bearing_lines=(), fold_s=2.0)
    yield hunted
    hunted.session.param.update(chart_marks=(), bearing_lines=(), fold_s=2.0)


def drag(tab, first, last):
    """A box round the loudest trace of these lines."""
    data = tab.paper.arrivals.data
    loud = (data["line"] > first) & (data["line"] < last) & (np.asarray(data["level"]) > 190)
    tab.paper.arrivals.selected.indices = np.flatnonzero(loud).tolist()
    tab._try(tab._dragged)


def far_m(tab, lat, lon):
    truth = tab.sound.truth
    return float(np.hypot(*LocalFrame(truth["lat_deg"], truth["lon_deg"]).to_local(lat, lon, 0.0)[:2]))


def test_simulated_sound_lies_on_the_paper_and_says_what_it_is(tab):
    assert tab.kind == "simulated"
    assert tab.paper.count == 500
    assert tab.paper.shown().max() > 200
    assert "SIMULATED" in tab.words.object
    assert len(tab.strip.source.data["line"]) == 500
    assert np.nanmedian(tab.strip.source.data["snr_db"]) > 20
    assert tab.strip.missed < 50


def test_a_hyperbola_through_the_marks_is_that_of_the_beacon(tab):
    deep_m = -BEACON_M[2] - tab.sound.hunt.hydrophone_depth_m
    for (first, last), abeam_m in zip(TRACES, (500.0, 400.0), strict=True):
        tab.marks.clear()
        drag(tab, first, last)
        assert len(tab.marks.marks) > 100
        tab.controls_.fit.clicks += 1
        line = tab.marks.found.line
        assert abs(line.distance_m - np.hypot(abeam_m, deep_m)) < 4 * line.sigma_m + 2
        assert "Closest approach" in tab.pass_words.object
        tab.controls_.keep_line.clicks += 1
    fix = tab.map.bearings.fix
    assert fix.converged
    assert far_m(tab, fix.lat_deg, fix.lon_deg) < 15
    assert "2 bearing lines meet" in tab.bearing_words.object
    tab.session.undo()
    assert len(tab.session.bearing_lines) == 1


def test_marks_change_by_click_and_undo_brings_them_back(tab):
    data = tab.paper.arrivals.data
    k = int(np.argmax(data["level"]))
    place = float(data["x"][k]), float(data["y"][k])
    tab._tapped(place[0] + 0.003, place[1] + 0.4)
    assert tab.marks.marks == ((int(data["line"][k]), pytest.approx(place[0])),)
    assert tab.session.pointed is not None
    assert list(tab.paper.chosen.data["x"]) == [pytest.approx(place[0])]
    tab._tapped(*place)
    assert tab.marks.marks == ()
    tab.session.undo()
    assert len(tab.marks.marks) == 1


def test_an_accepted_trace_feeds_the_fix_and_the_rejected_are_struck_through(tab):
    tab.controls_.accept.clicks += 1
    session = tab.session
    assert session.pings.simulated
    assert len(session.pings) > 450
    fix = session.fix
    assert fix.converged, fix.reason
    assert far_m(tab, fix.lat_deg, fix.lon_deg) < 3
    assert abs(fix.depth_m - 800) < 10
    left_out = int(session.pings.number[100])
    settings = session.fix_settings
    session.edit(fix_settings=type(settings)(**{**vars(settings), "left_out": frozenset({left_out})}))
    assert left_out in tab.paper.marks.data["number"]
    session.undo()


def test_the_interval_is_straightened_and_the_marks_go(tab):
    tab.controls_.straighten.clicks += 1
    assert abs(tab.settings.interval_s - 2.0) < 0.01
    assert tab.session.fold_s == tab.settings.interval_s
    assert "±" in tab.session.message
    tab.session.undo()
    assert tab.settings.interval_s == 2.0


def test_the_threshold_bares_the_paper(tab):
    before = (tab.paper.shown() > 40).mean()
    tab.controls_.threshold.value = 0
    assert (tab.paper.shown() > 40).mean() > 5 * before
    tab.controls_.threshold.value = 120


def test_a_replay_begins_with_bare_paper_and_ends_with_all(tab):
    tab.play()
    tab.session.speed = 100
    tab.tick(0.2)
    assert tab.paper.count == 10
    tab.play()
    tab.tick(0.2)
    assert tab.paper.count == 10
    tab.controls_.at_once.clicks += 1
    assert tab.paper.count == 500


def test_a_hidden_tab_is_sent_nothing(tab):
    tab.play()
    tab.deactivate()
    tab.tick(0.2)
    assert tab.paper.count == 500
    tab.activate()
    assert tab.paper.count == 10
    tab.controls_.at_once.clicks += 1


def test_exports_say_what_they_are_of(tab):
    files = tab.files
    assert files._paper("png").read(4) == b"\x89PNG"
    pdf = files._paper("pdf").read()
    assert pdf.startswith(b"%PDF")
    assert b"SIMULATED" in pdf
    text = files._arrivals().read().decode()
    assert text.startswith("# SIMULATED DATA\n# simulated hunt")
    files.from_s.value, files.for_s.value = 100.0, 3.0
    with soundfile.SoundFile(files._excerpt()) as wav:
        assert (wav.samplerate, wav.frames, wav.comment) == (48_000, 144_000, "SIMULATED")
        hunt = simulate_hunt_sound(1).open()
        hunt.read(100 * 48_000)
        assert np.abs(wav.read(dtype="float32") - hunt.read(144_000)).max() < 1e-6
    heard = folded_signal(tab._on_paper().paper)
    assert (len(heard), np.abs(heard).max() > 20_000) == (16_000, True)


def test_the_modern_detector_hears_the_same_beacon(tab):
    tab.controls_.detector.value = "modern"
    assert np.isfinite(tab.roll.arrivals.sigma_s).all()
    assert tab.strip.missed < 60
    tab.controls_.detector.value = "report"


def test_at_most_nine_rows_are_in_sight():
    assert len(ChartControls(Session()).in_sight()) <= 9


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda path: path.write_bytes(b"RIFF not a sound"), "found no recording"),
        (lambda path: soundfile.write(path, np.zeros(48_000), 48_000), "found silence"),
        (lambda path: soundfile.write(path, np.ones(480), 8_000), "rate"),
    ],
)
def test_a_file_that_is_no_use_is_told_in_a_sentence(tmp_path, write, words):
    session = Session()
    tab = ChartTab(session=session)
    tab.activate()
    write(tmp_path / "bad.wav")
    session.open_file("bad.wav", (tmp_path / "bad.wav").read_bytes())
    assert session.failed
    assert words in session.message or "carr" in session.message
    session.close()


def test_a_recording_that_is_cut_short_or_clipped_is_heard_and_says_so(tmp_path):
    session = Session()
    tab = ChartTab(session=session)
    tab.activate()
    write_sound(tmp_path / "hunt.wav", simulate_hunt_sound(2).open(), 30.0, subtype="PCM_16")
    whole = (tmp_path / "hunt.wav").read_bytes()
    session.open_file("hunt.wav", whole[: len(whole) // 2])
    assert tab.kind == "recording"
    assert tab.paper.count == 7
    assert "truncated" in session.message
    assert "truncated" in tab.words.object.lower()
    session.close()


def test_binary_uploads_are_told_by_their_first_bytes():
    assert binary_kind(b"RF64\xff\xff\xff\xffWAVE") == "recording"
    assert binary_kind(b"fLaC\x00") == "recording"
    assert binary_kind(b"SQLite format 3\x00") == "hunt_file"
    assert binary_kind(io.BytesIO(b"lat_deg,lon_deg").read()) is None
