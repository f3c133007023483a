"""`listen`: recordings to arrivals, and calls that are no use."""

import csv
import errno
import json
import os

import numpy as np
import pytest
import soundfile
from sounds import DENSITY_V, pulses_at

from trackerlib.acoustics.ambient_noise import ambient_noise_db, equivalent_noise_v, table_5_1
from trackerlib.commands import main
from trackerlib.receiver.detectors import DETECTORS
from trackerlib.receiver.report_receiver import FULL_SCALE_V
from trackerlib.simulation.hunt_files import write_hunt
from trackerlib.simulation.hunt_sound import simulate_hunt_sound
from trackerlib.simulation.sound import SimulatedSound, joined_pulses, write_sound
from trackerlib.surveyfiles.survey import read_survey

BEGAN_S = 1_714_521_600.25  # 2024-05-01 00:00:00.25 UTC
TRUE_S = 0.3137 + 2.00004 * np.arange(10)


@pytest.fixture
def recording(tmp_path):
    """Twenty seconds of a simulated beacon, loud enough that the attenuator has to act."""
    path = tmp_path / "beacon.flac"
    write_sound(path, SimulatedSound(pulses_at(TRUE_S, 75), DENSITY_V, 48_000, FULL_SCALE_V, 1), 20.0)
    return path


@pytest.fixture
def call(tmp_path, capsys):
    """Runs listen; returns exit code, rows of the CSV (None if there is none), standard output and error."""

    def run(path, *more, carrier=10_000):
        out = tmp_path / "arrivals.csv"
        argv = [
            "listen",
            path,
            "--carrier-hz",
            carrier,
            "--pulse-ms",
            10,
            "--interval-s",
            2,
            "--out",
            out,
            *more,
        ]
        code = main([str(word) for word in argv])
        rows = None
        if out.exists():
            text = [line for line in out.read_text().splitlines() if not line.startswith("#")]
            rows = list(csv.DictReader(text))
        return code, rows, *capsys.readouterr()

    return run


def test_arrivals_are_those_that_were_sent(call, recording):
    code, rows, out, _ = call(recording, "--maxima", 1, "--json")
    answer = json.loads(out)
    assert code == 0
    assert [int(row["period"]) for row in rows] == list(range(10))
    assert [float(row["arrival_s"]) for row in rows] == pytest.approx(TRUE_S, abs=1.5e-4)
    assert [float(row["fold_s"]) for row in rows] == pytest.approx(TRUE_S % 2, abs=1.5e-4)
    # The gain was set before the first period, which would be saturated otherwise.
    assert float(rows[0]["attenuation_db"]) > 0
    assert float(rows[0]["level"]) < 232
    assert answer["simulated"]
    assert (answer["arrivals"], answer["periods"], answer["periods_heard"]) == (10, 10, 10)


def test_gain_set_by_hand_stays(call, recording):
    _, rows, _, _ = call(recording, "--gain", 12)
    assert {row["attenuation_db"] for row in rows} == {"12"}
    assert {int(row["rank"]) for row in rows} == {1, 2}


def test_what_is_odd_is_said_and_heard_all_the_same(call, tmp_path):
    path = tmp_path / "stereo.wav"
    sound = SimulatedSound(pulses_at(TRUE_S, 30), DENSITY_V, 48_000, FULL_SCALE_V, 1).read(48_000 * 8)
    soundfile.write(path, np.stack([300 * sound, 0 * sound], axis=1), 48_000, subtype="PCM_24")
    path.write_bytes(path.read_bytes()[:-600_000])
    code, rows, _, err = call(path, "--maxima", 1)
    assert code == 0
    assert "2 channels; heard channel 1" in err
    assert "truncated: its head tells of 8.000 s" in err
    assert float(rows[0]["arrival_s"]) == pytest.approx(TRUE_S[0], abs=3e-4)


@pytest.mark.parametrize(
    ("more", "carrier", "wanted"),
    [
        ((), 30_000, "48000 samples per second, which carry sounds below 24000 Hz"),
        (("--maxima", 0), 10_000, "maxima is 0"),
        (("--channel", 2), 10_000, "found 1 channels, wanted number 2"),
        (("--sample-ms", 0), 10_000, "sample_interval_s is 0"),
    ],
)
def test_a_call_that_is_no_use_says_why_and_writes_nothing(call, recording, more, carrier, wanted):
    code, rows, out, err = call(recording, *more, carrier=carrier)
    assert (code, rows, out) == (2, None, "")
    assert wanted in err
    assert "Traceback" not in err


def test_silence_is_refused_and_an_older_file_is_kept(call, recording, tmp_path):
    _, before, _, _ = call(recording)
    silent = tmp_path / "silent.wav"
    soundfile.write(silent, np.zeros(48_000), 48_000)
    code, after, _, err = call(silent)
    assert code == 2
    assert "found silence" in err
    assert after == before


@pytest.fixture(scope="module")
def hunt(tmp_path_factory):
    """The first 80 s of a simulated hunt, and the log of her GPS."""
    path = tmp_path_factory.mktemp("hunt") / "hunt.flac"
    simulated = simulate_hunt_sound(1, rate_hz=24_000, missing=0)
    return path, write_hunt(path, simulated, 80.0, BEGAN_S), simulated


def test_positions_beside_a_recording_make_pings(call, hunt, tmp_path):
    path, log, simulated = hunt
    pings = tmp_path / "pings.csv"
    code, rows, out, err = call(path, "--navigation", log, "--pings", pings, "--json")
    answer = json.loads(out)
    assert code == 0
    assert "began 2024-05-01T00:00:00.250Z, as its head tells" in err
    assert answer["arrivals_placed"] == len(rows) == answer["arrivals"]
    read = read_survey(pings).pings
    assert read.simulated
    assert len(read) == answer["pings"] == answer["pings_followed"] >= 36
    first = float((read.utc[0] - np.datetime64("2024-05-01T00:00:00.250")) / np.timedelta64(1, "s"))
    lat = np.interp(first, simulated.fixes.time_s, simulated.fixes.lat_deg)
    assert read.lat_deg[0] == pytest.approx(lat, abs=1e-5)
    few = json.loads(call(path, "--navigation", log, "--greatest-age-s", 0.3, "--json")[2])
    assert few["arrivals_refused"]["gap of more than 0.6 s between positions"] > 0
    assert few["pings"] < answer["pings"]
    slope = np.polyfit(read.instant_s, read.travel_time_s, 1)[0]
    assert slope * 1500 == pytest.approx(-4.2, abs=0.5)  # 5 m/s, not quite towards the beacon


def test_positions_of_another_day_place_nothing_and_say_so(call, hunt):
    path, log, _ = hunt
    code, rows, out, err = call(path, "--navigation", log, "--began", "2024-05-02T00:00:00Z")
    assert code == 0
    assert "the nearest is 23:43:20 before its beginning" in err
    assert f"{len(rows)} arrivals refused: older than 2 s" in err
    assert {row["no_position"] for row in rows} == {"older than 2 s"}
    assert "0 of " in out


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--began", "noon"], "--began is 'noon'; wanted UTC such as"),
        (["--pings", "p.csv"], "--pings needs --navigation"),
    ],
)
def test_a_beginning_or_navigation_that_is_missing(call, hunt, more, words):
    path, log, _ = hunt
    more = more if "--pings" in more else ["--navigation", log, *more]
    code, rows, _, err = call(path, *more)
    assert (code, rows) == (2, None)
    assert words in err


def test_a_recording_that_does_not_say_when_it_began_needs_to_be_told(call, recording, hunt):
    code, rows, _, err = call(recording, "--navigation", hunt[1])
    assert (code, rows) == (2, None)
    assert "hunt.nmea: needs the time at which the recording began" in err
    assert "--began" in err


def test_a_late_echo_is_no_second_pinger(call, tmp_path):
    """Loud pings every 2 s, and their echo 0.13 s behind; the fold gives both a train."""
    path, true_s = tmp_path / "echo.flac", 0.3137 + 2.0 * np.arange(40)
    every = joined_pulses(pulses_at(true_s, 45), pulses_at(true_s + 0.13, 42))
    write_sound(path, SimulatedSound(every, DENSITY_V, 24_000, FULL_SCALE_V, 1), 80.0)
    code, _, out, _ = call(path, "--json")
    assert code == 0
    trains = json.loads(out)["trains"]
    assert [train["pings"] for train in trains] == [40, 40]
    (echo,) = [train for train in trains if train["echo_of"] is not None]
    assert echo["lag_ms"] == pytest.approx(130, abs=1)
    assert trains[echo["echo_of"] - 1]["interval_s"] == pytest.approx(2.0, abs=1e-5)
    assert "ms behind" in call(path)[2]


@pytest.mark.parametrize("detector", DETECTORS)
def test_the_direct_arrival_is_told_where_the_echo_is_louder(call, tmp_path, detector):
    """An echo 1.4 times as loud 30 ms behind is rank 1; the direct arrival is rank 2, and in the train."""
    path, true_s = tmp_path / "echo.flac", 0.3137 + 2.0 * np.arange(30)
    every = joined_pulses(pulses_at(true_s, 40), pulses_at(true_s + 0.030, 40, relative=1.4))
    write_sound(path, SimulatedSound(every, DENSITY_V, 24_000, FULL_SCALE_V, 1), 60.0)
    code, rows, out, _ = call(path, "--detector", detector, "--json")
    answer = json.loads(out)
    assert code == 0
    straight = [row for row in rows if row["direct"] == "1"]
    assert {row["rank"] for row in straight} == {"2"}
    assert len(straight) == answer["direct"] == 30
    assert [float(row["arrival_s"]) for row in straight] == pytest.approx(true_s, abs=2e-3)
    assert [(row["train"], int(row["emission"])) for row in straight] == [("1", k) for k in range(30)]
    assert all(row["train"] == row["emission"] == "" for row in rows if row["direct"] == "0")
    assert [(train["pings"], train["missed"], train["extra"]) for train in answer["trains"]] == [(30, 0, 0)]
    words = call(path, "--detector", detector)[2]
    assert "30 of them direct" in words
    assert "0 extra" in words
    assert "ppm" in words


@pytest.mark.parametrize("state", [row[0] for row in table_5_1() if row[0] != "limit"])
def test_arrivals_are_right_to_0_4_ms_in_every_sea_state(call, tmp_path, state):
    """20 dB in the tuned band, 30 pings at any phase of the sample interval, by the report's chain."""
    density_v = equivalent_noise_v(ambient_noise_db(float(state)))
    path, true_s = tmp_path / "sea.flac", 0.3137 + 2.00003 * np.arange(30)
    pulses = pulses_at(true_s, 20, density_v=density_v)
    write_sound(path, SimulatedSound(pulses, density_v, 24_000, FULL_SCALE_V, 1), 60.0)
    _, rows, _, _ = call(path, "--maxima", 1)
    error_s = np.array([float(row["arrival_s"]) for row in rows]) - true_s
    assert np.sqrt(np.mean(error_s**2)) < 0.4e-3


def test_a_disk_that_fills_leaves_no_half_file(call, recording, tmp_path, monkeypatch):
    def half(path, content):
        with path.open("wb") as file:
            file.write(content[: len(content) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr("pathlib.Path.write_bytes", half)
    code, rows, _, err = call(recording)
    assert (code, rows) == (2, None)
    assert "No space left on device" in err
    assert [path.name for path in tmp_path.iterdir()] == [recording.name]
