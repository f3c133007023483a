"""The Wet-paper chart with sound: recordings, a simulated hunt with known truth, marks, bearing lines, exports."""

from __future__ import annotations

import io

import numpy as np
import pytest
import soundfile

from dashboards.opening import binary_kind
from dashboards.session import Session
from dashboards.tabs.chart import ChartTab
from dashboards.tabs.chart_controls import ChartControls, sea_states
from dashboards.tabs.chart_export import folded_signal
from dashboards.tabs.chart_marks import TraceMarks
from dashboards.tabs.chart_sources import SimulatedHuntSound
from trackerlib.acoustics.ambient_noise import LIMIT, ambient_noise_db, equivalent_noise_v
from trackerlib.frames import LocalFrame
from trackerlib.receiver.arrivals import Arrivals
from trackerlib.receiver.chart import ChartSettings
from trackerlib.receiver.rolls import MarkRoll
from trackerlib.simulation.hunt_files import write_hunt
from trackerlib.simulation.hunt_sound import BEACON_M, simulate_hunt_sound

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


@pytest.mark.parametrize("name", sea_states())
def test_every_sea_state_of_the_menu_can_be_simulated(name):
    controls = ChartControls(Session())
    assert "Table 5-1" in controls.sea_state.label
    controls.sea_state.value = controls.sea_state.options[name]
    sound = SimulatedHuntSound(1, controls.sea_state.value)
    assert sound.name.endswith(f"sea state {name}")
    wanted = equivalent_noise_v(ambient_noise_db(LIMIT if name == LIMIT else float(name)))
    assert wanted < sound.hunt.density_v < 1.5 * wanted + 100e-9


def test_a_sea_state_outside_the_table_is_told_in_words():
    tab = ChartTab(session=Session())
    tab.controls_.sea_state.options = {"0": 0.0}
    tab.controls_.sea_state.value = 0.0
    tab.controls_.simulate.clicks += 1
    assert tab.session.failed
    assert "cannot be simulated: sea_state is 0.0; wanted 1 to 8" in tab.session.message


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
    tab.play_or_pause()
    tab.session.speed = 100
    tab.tick(0.2)
    assert tab.paper.count == 10
    tab.play_or_pause()
    tab.tick(0.2)
    assert tab.paper.count == 10
    tab.controls_.at_once.clicks += 1
    assert tab.paper.count == 500


def test_a_hidden_tab_is_sent_nothing(tab):
    tab.play_or_pause()
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
        (lambda path: soundfile.write(path, np.zeros((48_000, 2)), 48_000), "found silence"),
        (lambda path: soundfile.write(path, np.ones(480), 8_000), "which carry sounds below 4000 Hz"),
    ],
)
def test_a_file_that_is_no_use_is_told_in_a_sentence(tmp_path, write, words):
    session = Session()
    tab = ChartTab(session=session)
    tab.activate()
    write(tmp_path / "bad.wav")
    session.open_file("bad.wav", (tmp_path / "bad.wav").read_bytes())
    assert session.failed
    assert words in session.message
    session.close()


@pytest.fixture(scope="module")
def half_a_minute():
    """Sound of a simulated hunt, 30 s at 24 kHz."""
    return simulate_hunt_sound(2, rate_hz=24_000, missing=0).open().read(720_000)


@pytest.mark.parametrize(
    ("suffix", "subtype", "change", "kept", "lines", "words"),
    [
        ("wav", "PCM_16", None, 1 / 2, 7, "truncated: its head tells of 30.000 s, 15.0"),
        ("flac", "PCM_16", None, 1 / 2, 7, "truncated"),
        ("wav", "PCM_24", None, 1, 15, None),
        ("flac", "PCM_24", None, 1, 15, None),
        ("wav", "PCM_16", lambda sound: np.clip(2000 * sound, -1, 1), 1, 15, "the recording is clipped"),
        (
            "flac",
            "PCM_16",
            lambda sound: np.column_stack([sound, 0 * sound]),
            1,
            15,
            "2 channels; heard channel 1",
        ),
    ],
)
def test_an_odd_recording_is_heard_and_says_so(
    tmp_path, half_a_minute, suffix, subtype, change, kept, lines, words
):
    sound = half_a_minute if change is None else change(half_a_minute)
    soundfile.write(tmp_path / f"hunt.{suffix}", sound, 24_000, subtype=subtype)
    whole = (tmp_path / f"hunt.{suffix}").read_bytes()
    session = Session()
    tab = ChartTab(session=session)
    tab.activate()
    session.open_file(f"hunt.{suffix}", whole[: round(kept * len(whole))])
    assert not session.failed, session.message
    assert tab.kind == "recording"
    assert tab.paper.count == pytest.approx(lines, abs=0 if kept == 1 or suffix == "wav" else 1)
    assert np.sum(tab.roll.arrivals.level > 120) >= lines - 1
    if words is None:
        assert "truncated" not in session.message
    else:
        assert words in session.message
        assert words.lower() in tab.words.object.lower()
    session.close()


def test_the_channel_of_a_stereo_recording_is_chosen(tmp_path, half_a_minute):
    soundfile.write(tmp_path / "two.flac", np.column_stack([0 * half_a_minute, half_a_minute]), 24_000)
    tab = ChartTab(session=Session())
    tab.activate()
    tab.controls_.path.value = str(tmp_path / "two.flac")
    tab.controls_.open_path.clicks += 1
    assert "channel 2 has sound" in tab.session.message
    tab.controls_.channel.value = 2
    assert not tab.session.failed, tab.session.message
    assert "2 channels; heard channel 2" in tab.session.message
    assert tab.paper.count == 15
    tab.controls_.channel.value = 3
    assert "found 2 channels, wanted number 3" in tab.session.message
    assert tab.sound.channel == 2


@pytest.fixture(scope="module")
def brought_home(tmp_path_factory):
    """Half a simulated hunt as a recording, and the log of her GPS."""
    path = tmp_path_factory.mktemp("home") / "hunt.flac"
    hunt = simulate_hunt_sound(3, rate_hz=24_000)
    return path, write_hunt(path, hunt, 500.0, 1_714_521_600.25), hunt


def test_positions_beside_a_recording_make_hyperbola_line_and_fix(brought_home):
    path, log, hunt = brought_home
    session = Session()
    tab = ChartTab(session=session)
    tab.activate()
    session.open_file("gps.nmea", log.read_bytes())
    assert "wait for the recording" in session.message
    session.open_file("hunt.flac", path.read_bytes())
    assert not session.failed, session.message
    assert "1001 SIMULATED positions (NMEA 0183)" in session.message
    assert "arrivals above the threshold have a position" in tab.words.object
    drag(tab, 10, 240)
    tab.controls_.fit.clicks += 1
    line = tab.marks.found.line
    assert abs(line.distance_m - np.hypot(500, 770)) < 4 * line.sigma_m + 3
    assert "at 2024-05-01T00:0" in tab.pass_words.object
    tab.controls_.keep_line.clicks += 1
    assert len(session.bearing_lines) == 1
    tab.marks.clear()
    tab.controls_.accept.clicks += 1
    assert not session.failed, session.message
    assert session.pings.simulated
    assert str(session.pings.utc[0]).startswith("2024-05-01T00:00:0")
    frame = LocalFrame(hunt.truth["lat_deg"], hunt.truth["lon_deg"])
    place = frame.to_local(session.pings.lat_deg, session.pings.lon_deg, np.zeros(len(session.pings)))
    assert np.hypot(place[:, 0], place[:, 1]).min() == pytest.approx(500, abs=15)
    session.close()


def test_refused_positions_are_counted_and_a_bad_log_is_told_with_its_line(brought_home, tmp_path):
    path, log, _ = brought_home
    lines = log.read_text().splitlines()
    tab = ChartTab(session=Session())
    session, c = tab.session, tab.controls_
    tab.activate()
    c.path.value = str(path)
    c.open_path.clicks += 1
    (tmp_path / "gap.nmea").write_text("\n".join([*lines[:401], "$GPGGA,junk*00", *lines[601:]]))
    c.navigation.value = str(tmp_path / "gap.nmea")
    c.open_navigation.clicks += 1
    assert "1 lines gave none, the first is line 402: $GPGGA,junk has checksum 00" in session.message
    assert "refused: gap of more than 4 s" in tab.words.object
    c.accept.clicks += 1
    assert "refused: gap of more than 4 s" in session.message
    c.began.value = "2024-05-01T01:00:00"
    assert "the nearest is 0:43:20 before its beginning" in session.message
    c.accept.clicks += 1
    assert session.failed
    assert "where the ship was is not known" in session.message
    c.began.value = "noon"
    assert "Recording began is 'noon'" in session.message
    c.began.value = ""
    (tmp_path / "bad.csv").write_text("utc,lat_deg,lon_deg\nnever,1,2\n")
    c.navigation.value = str(tmp_path / "bad.csv")
    c.open_navigation.clicks += 1
    assert "bad.csv: found no usable fix, wanted at least two; line 2: utc is 'never'" in session.message
    session.close()


def test_binary_uploads_are_told_by_their_first_bytes():
    assert binary_kind(b"RF64\xff\xff\xff\xffWAVE") == "recording"
    assert binary_kind(b"fLaC\x00") == "recording"
    assert binary_kind(b"SQLite format 3\x00") == "hunt_file"
    assert binary_kind(io.BytesIO(b"lat_deg,lon_deg").read()) is None


def test_straighten_names_a_late_echo():
    time_s = np.sort(np.concatenate([0.3 + 2.0002 * np.arange(60), 0.43 + 2.0002 * np.arange(60)]))
    number, unknown = (time_s // 2).astype(int), np.full(120, np.nan)
    roll = MarkRoll("line")
    roll.add(
        Arrivals(number, np.ones(120, int), time_s, np.full(120, 200.0), unknown, unknown, unknown), 121.0
    )
    interval_s, _, words = TraceMarks(Session()).straight(roll, ChartSettings(2.0, 1000), 120)
    assert interval_s == pytest.approx(2.0002)
    assert words == "the trace 130 ms behind is its echo, no second pinger"
