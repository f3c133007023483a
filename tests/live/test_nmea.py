"""NMEA 0183, strictly: what each sentence says, and that no fix is never a position."""

from __future__ import annotations

import math

import pytest
from pynmeagps import NMEAReader

from trackerlib.live.navigation_stream import DeckUnitRange, NavigationStream, decode_deck_unit
from trackerlib.live.nmea import SentenceError, checksum, decode, instant_near

NOON = 1_780_315_200.0  # 2026-06-01 12:00 UTC
MIDNIGHT = NOON + 43_200


def sentence(body):
    return f"${body}*{checksum(body):02X}"


# Talkers GPS, GLONASS, Galileo, mixed, gyro, sounder; hemispheres of all kinds.
GOOD = [
    "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,",
    "GNGGA,235959.50,0452.9270,S,17959.9990,W,4,12,1.25,3.0,M,,M,,",
    "GPRMC,081836,A,3751.65,S,14507.36,E,000.0,360.0,130998,011.3,E",
    "GNRMC,120000.00,A,3930.0000,N,06730.0000,W,9.72,090.0,010626,,,D",
    "GPGLL,4916.45,N,12311.12,W,225444,A,A",
    "GPVTG,054.7,T,034.4,M,005.5,N,010.2,K,A",
    "GPZDA,201530.00,04,07,2002,00,00",
    "GPHDT,274.07,T",
    "GPTHS,77.52,A",
    "HCHDG,98.3,0.0,E,12.6,W",
    "SDDBT,17.0,f,5.1,M,2.8,F",
    "SDDPT,2.4,0.5,",
]


@pytest.mark.parametrize("body", GOOD)
def test_it_reads_what_an_independent_parser_reads(body):
    mine, other = decode(sentence(body)), NMEAReader.parse(sentence(body) + "\r\n")
    assert mine.kind == other.msgID
    if mine.position is not None:
        # pynmeagps gives ten decimals of a degree
        assert (mine.position.lat_deg, mine.position.lon_deg) == pytest.approx(
            (other.lat, other.lon), abs=1e-9
        )
    if mine.kind == "GGA":
        assert mine.position.hdop == other.HDOP
    if mine.time_of_day_s is not None:
        t = other.time
        assert mine.time_of_day_s == pytest.approx(
            3600 * t.hour + 60 * t.minute + t.second + t.microsecond * 1e-6
        )
    if mine.kind == "RMC":
        assert mine.date == (other.date.year, other.date.month, other.date.day)
        assert mine.speed_mps == pytest.approx(other.spd * 1852 / 3600)
    if mine.kind == "ZDA":
        assert mine.date == (other.year, other.month, other.day)
    if mine.kind in ("HDT", "THS"):
        assert mine.heading_true_deg == (other.headingT if mine.kind == "HDT" else other.headt)
    if mine.kind == "VTG":
        assert (mine.course_true_deg, mine.speed_mps) == pytest.approx((other.cogt, other.sogn * 1852 / 3600))
    if mine.kind == "DBT":
        assert mine.depth_m == 5.1
    if mine.kind == "DPT":
        assert mine.depth_m == pytest.approx(2.9)
    if mine.kind == "HDG":
        assert mine.heading_true_deg == pytest.approx(85.7)


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("GPGGA,123519,,,,,0,00,,,M,,M,,", "no fix"),
        ("GPGGA,123519,0000.000,N,00000.000,E,0,00,99.9,,M,,M,,", "no fix"),
        ("GPGGA,123519,4807.038,N,01131.000,E,6,00,1.0,,M,,M,,", "dead reckoning"),
        ("GPGGA,123519,4807.038,N,01131.000,E,8,00,1.0,,M,,M,,", "a simulator"),
        ("GPGGA,123519,,,,,1,08,0.9,,M,,M,,", "no fix"),
        ("GPGGA,123519,0000.000,N,00000.000,E,1,00,,,M,,M,,", "no satellites"),
        ("GPGGA,123519,4807.038,N,01131.000,E,2,0,0.9,,M,,M,,", "no satellites"),
        ("GPRMC,081836,V,3751.65,S,14507.36,E,,,130998,,", "no fix"),
        ("GPRMC,081836,A,3751.65,S,14507.36,E,,,130998,,,E", "dead reckoning"),
        ("GPGLL,,,,,225444,V,N", "no fix"),
    ],
)
def test_a_sentence_without_a_fix_is_not_a_position(body, why):
    message = decode(sentence(body))
    assert (message.position, message.no_position) == (None, why)
    stream = NavigationStream()
    assert stream.feed(sentence(body), NOON) is None
    assert len(stream.fixes().time_s) == 0
    assert stream.refused[f"{message.kind}: {why}"] == 1


@pytest.mark.parametrize(
    "line",
    [
        "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*48",
        "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,",
        "GPGGA,123519",
        "$GPGGA,123519*",
        "",
        "\xff\xfe$GP",
        sentence("GPGGA,12351"),
        sentence("GPGGA,253519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPGGA,123519,4867.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPGGA,123519,4807.038,X,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPGGA,123519,9107.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPGGA,123519,48 7.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"),
        sentence("GPRMC,081836,A,3751.65,S,14507.36,E,000.0,360.0,320998,011.3,E"),
        sentence("GPHDT,474.07,T"),
        sentence("GPHDT,nan,T"),
    ],
)
def test_what_cannot_be_believed_is_refused_in_words(line):
    with pytest.raises(SentenceError, match="wanted"):
        decode(line)
    stream = NavigationStream()
    stream.feed(line, NOON)
    assert sum(stream.refused.values()) == 1


def test_a_missing_checksum_can_be_waived_a_wrong_one_cannot():
    assert decode("$GPHDT,274.07,T", checksum_required=False).heading_true_deg == 274.07
    with pytest.raises(SentenceError):
        decode("$GPHDT,274.07,T*00", checksum_required=False)


@pytest.mark.parametrize("body", ["GPGSV,3,1,11,03,03,111,00", "PASHR,1", "GPTXT,01,01,02,ok"])
def test_sentences_of_other_kinds_are_passed_over(body):
    assert decode(sentence(body)) is None


@pytest.mark.parametrize("body", ["GPHDT,,T", "GPTHS,77.52,V", "HCHDG,98.3,,,,"])
def test_a_heading_that_is_not_told_is_none(body):
    assert decode(sentence(body)).heading_true_deg is None


def gga(clock):
    return sentence(f"GPGGA,{clock},4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")


def test_a_time_of_day_goes_over_midnight_without_a_date():
    stream = NavigationStream()
    for clock, came in (("235959", MIDNIGHT + 0.2), ("000000", MIDNIGHT + 0.3), ("000001", MIDNIGHT + 1.3)):
        stream.feed(gga(clock), came)
    assert stream.fixes().time_s.tolist() == [MIDNIGHT - 1, MIDNIGHT, MIDNIGHT + 1]


@pytest.mark.parametrize(
    "dated", ["GPZDA,235959,02,07,2002,00,00", "GPRMC,235959,A,4807.038,N,01131.000,E,0,0,020702,,"]
)
def test_the_date_comes_from_zda_or_rmc_and_changes_at_midnight(dated):
    stream = NavigationStream()
    stream.feed(sentence(dated), NOON)
    stream.feed(gga("235959"), NOON)
    stream.feed(gga("000001"), NOON + 2)
    july_3_2002 = 1_025_654_400.0
    assert stream.fixes().time_s[-2:].tolist() == [july_3_2002 - 1, july_3_2002 + 1]
    assert stream.dated_by in ("ZDA", "RMC")


@pytest.mark.parametrize("seconds", [0.0, 43_000.0, 86_399.0])
@pytest.mark.parametrize("away", [-43_000.0, 0.0, 43_000.0])
def test_the_nearest_day_is_found_within_half_a_day(seconds, away):
    instant = MIDNIGHT + seconds
    assert instant_near(seconds, instant + away) == instant


def test_headings_go_with_the_fixes_that_follow_until_they_are_old():
    stream = NavigationStream()
    stream.feed(gga("120000"), NOON)
    stream.feed(sentence("HEHDT,90.0,T"), NOON + 0.5)
    stream.feed(gga("120001"), NOON + 1)
    stream.feed(gga("120009"), NOON + 9)
    heading = stream.fixes().heading_rad
    assert math.isnan(heading[0])
    assert heading[1] == pytest.approx(math.pi / 2)
    assert math.isnan(heading[2])


def test_deck_unit_lines_are_ranges():
    stream = NavigationStream()
    assert stream.feed("RNG: TX = 11.0 RX = 12.0 time = 08.807 Sec.", NOON) == DeckUnitRange(
        NOON, 8.807, True
    )
    assert stream.feed("IN 08807 mS", NOON + 1) == DeckUnitRange(NOON + 1, 8.807, False)
    assert stream.feed("RNG: TX = 11.0 RX = 12.0 time = --.--- Sec.", NOON) == DeckUnitRange(NOON, None, True)
    assert decode_deck_unit("CMD: 265023", NOON) is None
    assert len(stream.ranges) == 3


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("RNG: TX = 11.0 RX = 12.0 time = 00.000 Sec.", "0 s"),
        ("RNG: TX = 11.0 RX = 12.0 time = 8 Sec.", "'8'"),
        ("RNG: TX = 11.0 RX = 12.0 time = 0-.80 Sec.", "'0-.80'"),
        ("RNG: TX = 11.0 RX = 12.0 time = nan Sec.", "'nan'"),
        ("IN 00000 mS", "0 s"),
    ],
)
def test_a_deck_unit_s_time_that_is_none_is_refused(line, found):
    stream = NavigationStream()
    assert stream.feed(line, NOON) is None
    assert len(stream.ranges) == 0
    assert dict(stream.refused) == {"a range that cannot be read": 1}
    assert found in stream.last_refused
    assert "wanted" in stream.last_refused
