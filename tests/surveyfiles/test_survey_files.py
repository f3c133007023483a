"""Survey logs and CSVs as people really have them."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.surveyfiles.reading import degrees_from_minutes, time_step, utc_from_day_of_year
from trackerlib.surveyfiles.survey import parse_survey, read_survey
from trackerlib.textfiles import InputError

SIO = """\
Ranging data taken on:  2018-04-25 22:09:11.325000
Drop Point (Latitude):  -5.70784
Comment:
==================================================

 5985 msec. Lat: 5 42.3510 S  Lon: 134 05.6283 W  Alt: 17.54 Time(UTC): 2018:116:05:10:33
 5979 msec. Lat: 5 42.3510 S  Lon: 134 05.6283 W  Alt: 17.54 Time(UTC): 2018:116:05:10:33
Event skipped - Timeout or Badly formatted data was received
*5975 msec. Lat: 5 42.3764 S  Lon: 134 05.6103 W  Alt: 18.41 Time(UTC): 2018:116:05:11:33
 596x msec. Lat: 5 42.4063 N  Lon: 134 05.5871 E  Alt: 16.70 Time(UTC): 2018:116:05:12:34
 5967 msec. Lat: 5 62.4533 N  Lon: 134 05.5699 E  Alt: 17.52 Time(UTC): 2018:116:05:13:34
 5970 msec. Lat: 5 42.5125 N  Lon: 134 05.5717 E  Alt: 18.56 Time(UTC): 2018:366:05:14:34
 5976 msec. Lat: 5 42.5808 N  Lon: 134 05.6055 E  Alt: 17.98 Time(UTC): 2018:116:05:15:35
"""

WHOI = """\
# EdgeNmea_Universal_0.9.py VERSION 0.0.9
# TAT:                  20 ms
# Sys date time utc, rng m,rng ms,    latitude  ,    longitude  , GPS time, heading
2023-04-06 05:10:05,  2329,  3106, 01 35.6648 N, 091 48.5082 W, 05:10:03.00, 84.1
2023-04-06 05:10:20,  2328,  3104, 01 35.6630 S, 091 48.5069 E, 05:10:18.00, 142.8
2023-04-06 05:10:35,  2330,  abcd, 01 35.6606 N, 091 48.5058 W, 05:10:33.00, 141.4
2023-04-06 05:10:50,  2330,  31
"""


def test_sio_log_line_by_line():
    reading = parse_survey(SIO.splitlines(), "log.txt")
    pings = reading.pings
    assert reading.layout == "sio"
    assert len(pings) == 3
    assert pings.travel_time_s[0] == pytest.approx((5.985 - 0.013) / 2)
    assert pings.lat_deg[0] == pytest.approx(-(5 + 42.3510 / 60))
    assert pings.lon_deg[0] == pytest.approx(-(134 + 5.6283 / 60))
    assert pings.lat_deg[2] > 0
    assert pings.lon_deg[2] > 0
    assert pings.utc[0] == np.datetime64("2018-04-26T05:10:33")
    assert pings.number.tolist() == [1, 2, 3]
    assert [record.line for record in reading.bad_records] == [10, 11, 12]
    assert "'596x'" in reading.bad_records[0].why
    assert "62.4533" in reading.bad_records[1].why
    assert "2018:366" in reading.bad_records[2].why
    assert any("1 lines 'Event skipped'" in note for note in reading.notes)
    assert any("1 lines marked with *" in note for note in reading.notes)


def test_whoi_log_line_by_line():
    reading = parse_survey(WHOI.splitlines(), "log.txt")
    assert reading.layout == "whoi"
    assert reading.pings.travel_time_s.tolist() == pytest.approx([(3.106 - 0.020) / 2, (3.104 - 0.020) / 2])
    assert np.sign(reading.pings.lat_deg).tolist() == [1, -1]
    assert np.sign(reading.pings.lon_deg).tolist() == [-1, 1]
    assert reading.pings.utc[0] == np.datetime64("2023-04-06T05:10:05")
    assert [record.line for record in reading.bad_records] == [6, 7]


def test_the_turn_around_can_be_told():
    pings = parse_survey(WHOI.splitlines(), "log.txt", turnaround_s=0.1).pings
    assert pings.travel_time_s[0] == pytest.approx((3.106 - 0.1) / 2)


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_line_ends_and_encodings_change_nothing(tmp_path, line_end, encoding):
    text = SIO.replace("Comment:", "Comment: Überfahrt").replace("\n", line_end)
    path = tmp_path / "log.txt"
    path.write_bytes(text.encode(encoding) + (b"" if encoding == "utf-16" else b"\x1a"))
    assert len(read_survey(path).pings) == 3


def test_a_log_cut_in_the_middle_keeps_what_is_whole(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text(SIO[:-30])
    reading = read_survey(path)
    assert len(reading.pings) == 2
    assert reading.bad_records[-1].line == 13


CSV = "ping,utc,lat_deg,lon_deg,oneway_s,up_m\n7,2024-02-29T23:59:59.250Z,-5.5,190,2.5,-9.1\n8,,5.5,-170,2.75,\n"


def test_csv():
    pings = parse_survey(CSV.splitlines(), "p.csv", hydrophone_depth_m=4.0).pings
    assert pings.number.tolist() == [7, 8]
    assert pings.lon_deg.tolist() == [-170, -170]
    assert pings.up_m.tolist() == [-9.1, -4.0]
    assert pings.utc[0] == np.datetime64("2024-02-29T23:59:59.250")
    assert np.isnat(pings.utc[1])


def test_csv_with_decimal_commas():
    text = "lat_deg;lon_deg;oneway_s\n-5,5;10,25;2,5\n"
    pings = parse_survey(text.splitlines(), "p.csv").pings
    assert (pings.lat_deg[0], pings.lon_deg[0], pings.travel_time_s[0]) == (-5.5, 10.25, 2.5)


def test_csv_says_it_is_simulated():
    text = "# SIMULATED DATA\nlat_deg,lon_deg,oneway_s\n1,2,3\n"
    assert parse_survey(text.splitlines(), "p.csv").pings.simulated
    assert not parse_survey(CSV.splitlines(), "p.csv").pings.simulated


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("1,2,three", "oneway_s is 'three'"),
        ("1,2,nan", "oneway_s is 'nan'"),
        ("91,2,3", "lat_deg is '91'"),
        ("1,2", "found 2 columns; wanted 3"),
        ("1,2,3,4", "found 4 columns; wanted 3"),
    ],
)
def test_a_bad_row_is_reported_and_the_rest_kept(row, words):
    reading = parse_survey(f"lat_deg,lon_deg,oneway_s\n1,2,3\n{row}\n4,5,6\n".splitlines(), "p.csv")
    assert len(reading.pings) == 2
    assert reading.bad_records[0].line == 3
    assert words in reading.bad_records[0].why


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("lat_deg,lon_deg,oneway_s\n1,2,three\n", "p.csv: found no usable ping.*line 2: oneway_s is 'three'"),
        ("lat_deg,lon_deg\n1,2\n", "p.csv, line 1: found columns .*oneway_s missing"),
        ("hello\nworld\n", "line 1: found columns 'hello'"),
        ("# only a comment\n", "no header and no pings"),
    ],
)
def test_a_file_of_no_use_says_why(text, words):
    with pytest.raises(InputError, match=words):
        parse_survey(text.splitlines(), "p.csv")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "binary data"),
        (None, "no such file"),
    ],
)
def test_what_is_no_text_file(tmp_path, content, words):
    path = tmp_path / "survey.txt"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=words):
        read_survey(path)


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(InputError, match="found a folder"):
        read_survey(tmp_path)


TRANSPONDERS = "transponder,lat_deg,lon_deg,oneway_s\nM11,1,2,3\nM12,1,2,4\nM11,1,2,5\n"


def test_one_of_several_transponders():
    assert parse_survey(
        TRANSPONDERS.splitlines(), "p.csv", transponder="M11"
    ).pings.travel_time_s.tolist() == [3, 5]
    with pytest.raises(InputError, match=r"found transponders M11, M12; choose one"):
        parse_survey(TRANSPONDERS.splitlines(), "p.csv")
    with pytest.raises(InputError, match="wanted M13"):
        parse_survey(TRANSPONDERS.splitlines(), "p.csv", transponder="M13")


def test_repeated_ping_numbers_are_replaced_and_said():
    reading = parse_survey("ping,lat_deg,lon_deg,oneway_s\n4,1,2,3\n4,1,2,4\n".splitlines(), "p.csv")
    assert reading.pings.number.tolist() == [1, 2]
    assert "repeat" in reading.notes[0]


def test_time_step_is_found_whatever_constant_is_added():
    times = np.array([2.986, 2.983, 2.981, 3.0165])
    assert time_step(times) == pytest.approx(5e-4)
    assert time_step(times + 137.25) == pytest.approx(5e-4)
    assert time_step(np.array([2.98612347, 2.98345671, 2.9]) + np.pi) == 0.0
    assert time_step(np.full(5, 2.0)) == 0.0


@pytest.mark.parametrize("text", ["5 42.3 W", "5 60.0 N", "91 00.0 N", "5.5", "", "-5 42.3 S"])
def test_latitudes_that_are_none(text):
    with pytest.raises(ValueError, match="wanted"):
        degrees_from_minutes(text, "latitude")


def test_day_of_year():
    assert utc_from_day_of_year("2020:366:23:59:59.5") == np.datetime64("2020-12-31T23:59:59.500")
    with pytest.raises(ValueError, match="wanted year:day of year"):
        utc_from_day_of_year("2019:366:00:00:00")
    with pytest.raises(ValueError, match="wanted year:day of year"):
        utc_from_day_of_year("2019:001:00:00")
