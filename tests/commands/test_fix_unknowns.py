"""`fix` with further unknowns, errors and intervals: options reach the fix and the answer says what it found."""

from __future__ import annotations

import json

import numpy as np
import pytest
from streams import INTERVAL_S, stream
from surveys import BOX, survey

from trackerlib.commands import main
from trackerlib.simulation.beacon_survey import Errors


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return written(
        tmp_path_factory.mktemp("box") / "box.csv", survey(BOX, (100.0, 50.0, -2400.0), Errors(2.0, 5e-4))
    )


def written(path, pings):
    rows = zip(pings.lat_deg, pings.lon_deg, pings.travel_time_s, pings.instant_s, strict=True)
    lines = [f"{lat:.9f},{lon:.9f},{time:.6f},{instant:.6f}" for lat, lon, time, instant in rows]
    path.write_text("lat_deg,lon_deg,oneway_s,time_s\n" + "\n".join(lines))
    return str(path)


def answer_of(argv, capsys):
    assert main(["fix", *argv, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_errors_of_the_ship_widen_the_answer(box, capsys):
    plain = answer_of([box, "--gps-rms-m", "2"], capsys)
    apart = answer_of([box, "--gps-rms-m", "2,2"], capsys)
    assert apart["sigma_east_m"] == pytest.approx(plain["sigma_east_m"], rel=1e-6)
    slow = answer_of([box, "--gps-rms-m", "2", "--gps-correlation-s", "120"], capsys)
    assert slow["sigma_east_m"] > 1.2 * plain["sigma_east_m"]
    antenna = answer_of([box, "--gps-rms-m", "2", "--antenna-sigma-m", "3,1"], capsys)
    assert antenna["sigma_north_m"] > 1.5 * plain["sigma_north_m"]


def test_a_fitted_speed_is_reported_with_its_sigma(box, capsys):
    argv = [box, "--gps-rms-m", "2", "--estimate-sound-speed", "--sound-speed-sigma-mps", "4"]
    answer = answer_of(argv, capsys)
    assert answer["sound_speed_mps"] != 1500.0
    assert 0 < answer["sigma_sound_speed_mps"] < 4.01
    assert "interval_s" not in answer


@pytest.mark.parametrize("how", ["profile", "bootstrap"])
def test_intervals_stand_beside_the_ellipse(box, how, capsys):
    answer = answer_of([box, "--gps-rms-m", "2", "--intervals", how], capsys)
    for name in ("east", "north", "depth"):
        low, high = answer["interval95_m"][name]
        assert low < answer[f"{name}_m"] < high
        assert high - low == pytest.approx(2 * 1.96 * answer[f"sigma_{name}_m"], rel=0.25)
    assert answer["warnings"] == []
    assert main(["fix", box, "--gps-rms-m", "2", "--intervals", how]) == 0
    assert "interval  95 %" in capsys.readouterr().out


def test_the_interval_of_the_pinger_is_reported(tmp_path, capsys):
    pings = stream((200.0, -150.0, -1500.0), 2, ppm=20.0, ppm_per_hour=3.0, emissions=1500)
    argv = [written(tmp_path / "stream.csv", pings), "--interval-s", "2", "--estimate-interval"]
    argv += ["--estimate-interval-drift", "--gps-rms-m", "1", "--sample-interval-ms", "1"]
    answer = answer_of(argv, capsys)
    assert answer["converged"], answer["reason"]
    error = answer["interval_s"] / INTERVAL_S - 1 - 20e-6
    assert abs(error) < 4 * answer["sigma_interval_s"] / INTERVAL_S
    assert abs(answer["interval_drift_ppm_per_hour"] - 3.0) < 4 * answer["sigma_interval_drift_ppm_per_hour"]
    assert main(["fix", *argv]) == 0
    out = capsys.readouterr().out
    assert "pinger    every 2.0000" in out
    assert "an hour" in out


def test_what_the_navigation_refuses_is_counted_by_reason(tmp_path, capsys):
    heard, navigation = tmp_path / "heard.csv", tmp_path / "navigation.csv"
    heard.write_text("arrival_s\n" + "\n".join(f"{2 * n + 0.5}" for n in range(30)))
    seconds = [n for n in range(62) if not 20 < n < 26]
    lines = [f"{n},{41 + 4e-5 * n},-66,{12 if n == 40 else 1}" for n in seconds]
    navigation.write_text("time_s,lat_deg,lon_deg,hdop\n" + "\n".join([*lines, "70,far,0,1"]))
    argv = [str(heard), "--navigation", str(navigation), "--interval-s", "2"]
    refused = answer_of(argv, capsys)["refused"]
    assert refused["positions"] == {"HDOP of 10 or more": 1}
    assert refused["arrivals"] == {"gap of more than 4 s between positions": 3}
    assert list(refused["lines"].values()) == [1]
    wide = answer_of([*argv, "--greatest-gap-s", "10", "--greatest-age-s", "6"], capsys)["refused"]
    assert wide["arrivals"] == {}
    narrow = answer_of([*argv, "--greatest-hdop", "20"], capsys)["refused"]
    assert narrow["positions"] == {}
    assert main(["fix", *argv, "--greatest-gap-s", "-1"]) == 2
    assert capsys.readouterr().err.endswith("fix: greatest_gap_s is -1; wanted more than 0, at most 7200\n")


@pytest.mark.parametrize(
    ("argv", "named"),
    [
        (["--estimate-interval"], "interval_s"),
        (["--gps-correlation-s", "30"], "gps_rms_m"),
        (["--gps-rms-m", "-1"], "gps_rms_m"),
        (["--antenna-sigma-m", "-1"], "antenna_sigma_m"),
        (["--estimate-sound-speed", "--method", "pairs"], "estimate_sound_speed"),
    ],
)
def test_options_that_contradict_each_other_are_named(box, argv, named, capsys):
    assert main(["fix", box, *argv]) == 2
    assert named in capsys.readouterr().err


@pytest.mark.parametrize("text", ["1,2,3", "a", ""])
def test_a_gps_error_that_is_no_number_is_named(box, text, capsys):
    with pytest.raises(SystemExit):
        main(["fix", box, "--gps-rms-m", text])
    assert "one number of metres" in capsys.readouterr().err


def bad(name):
    rng = np.random.default_rng(1)
    legs = ((20, 1800), (100, 1000), (320, 600))  # no closed figure: reversed, it is another one
    pings = survey(legs, (100.0, 50.0, -1500.0), Errors(2.0, 5e-4))
    lat, lon, time = pings.lat_deg.copy(), pings.lon_deg.copy(), pings.travel_time_s.copy()
    angle = np.linspace(0, 2 * np.pi, len(lat))
    if name == "one place":
        lat[:], lon[:] = lat[0], lon[0]
    elif name == "one ping":
        lat, lon, time = lat[:1], lon[:1], time[:1]
    elif name == "a straight line":
        lat, lon = lat[0] + 1e-4 * np.arange(len(lat)), np.full(len(lat), lon[0])
    elif name == "a circle round the beacon":
        lat, lon, time[:] = 41 + 0.01 * np.sin(angle), -66 + 0.01325 * np.cos(angle), 1.3
        time += rng.normal(0, 5e-4, len(time))
    elif name == "milliseconds":
        time *= 1e3
    elif name == "nothing but NaN":
        time[:] = np.nan
    elif name == "reversed":
        time = time[::-1]
    return [f"{a:.9f},{o:.9f},{t:.6f}" for a, o, t in zip(lat, lon, time, strict=True)]


BAD = ("one place", "one ping", "a straight line", "a circle round the beacon", "milliseconds")


@pytest.mark.parametrize("name", [*BAD, "nothing but NaN", "reversed"])
def test_a_survey_that_cannot_give_a_fix_is_refused_in_words(name, tmp_path, capsys):
    file = tmp_path / "pings.csv"
    file.write_text("lat_deg,lon_deg,oneway_s\n" + "\n".join(bad(name)))
    code = main(["fix", str(file), "--json"])
    out, err = capsys.readouterr()
    if code == 2:
        assert "pings.csv" in err
        return
    answer = json.loads(out)
    assert not answer["converged"]
    assert len(answer["reason"]) > 20


@pytest.mark.parametrize("speed", ["0", "340", "nan"])
def test_a_speed_that_is_not_of_water_is_named(box, speed, capsys):
    assert main(["fix", box, "--sound-speed-mps", speed]) == 2
    assert "sound_speed_mps" in capsys.readouterr().err
