"""Array tables in every layout, and which rows are no survey."""

import numpy as np
import pytest

from trackerlib.crossover.survey import find_placeholders
from trackerlib.rangefiles.arrays import parse_arrays, parse_date, read_arrays
from trackerlib.textfiles import InputError

XYZ_NUMBER = b"  12188.01   -131.52  -1295.33   0\n  19463.16  -174.99  -1308.76   1\n"
NUMBER_DATE = b" 0 850620 12188.01 -131.52 -1295.33\r\n 1 6/20/85 19463.16 -174.99 -1308.76\r\n"
CSV = (
    b"# a remark\narray,survey_date_iso,downrange_ft,crossrange_ft,depth_coordinate_ft,doubt\n"
    b'0,1985-06-20,12188.01,-131.52,-1295.33,\n1,1985-06-20,19463.16,-174.99,-1308.76,"a, b"\n'
)


@pytest.mark.parametrize(
    ("content", "layout", "dated"),
    [(XYZ_NUMBER, "xyz-number", False), (NUMBER_DATE, "number-date-xyz", True), (CSV, "csv", True)],
)
def test_each_layout_gives_the_same_arrays_and_is_named(content, layout, dated):
    reading = parse_arrays(content, "arrays.txt")
    assert reading.layout == layout
    assert reading.survey.number.tolist() == [0, 1]
    assert reading.survey.position_of(1).tolist() == [19463.16, -174.99, -1308.76]
    day = np.datetime64("1985-06-20") if dated else np.datetime64("NaT")
    assert np.array_equal(reading.survey.survey_date, [day, day], equal_nan=True)
    assert "2 arrays" in reading.notes[0]
    assert not reading.survey.placeholder.any()


@pytest.mark.parametrize(
    ("text", "day"),
    [
        ("850620", "1985-06-20"),
        ("6/20/85", "1985-06-20"),
        ("1/07/2003", "2003-01-07"),
        ("030107", "2003-01-07"),
    ],
)
def test_dates_in_either_style(text, day):
    assert parse_date(text) == np.datetime64(day)


@pytest.mark.parametrize("text", ["851320", "6-20-85", "yesterday", "2/30/85"])
def test_a_date_that_is_none_says_what_was_wanted(text):
    with pytest.raises(ValueError, match=r"wanted yymmdd"):
        parse_date(text)


def test_table_e1_has_exactly_five_placeholders(data):
    survey = read_arrays(data / "nanoose_arrays.csv").survey
    assert len(survey.number) == 29
    assert sorted(survey.number[survey.placeholder].tolist()) == [9, 10, 27, 28, 29]
    assert survey.survey_date[survey.number == 24] == np.datetime64("1989-04-17")


def test_table_e1_placeholders_do_not_need_the_doubt_column(data):
    survey = read_arrays(data / "nanoose_arrays.csv").survey
    assert set(survey.number[find_placeholders(survey.position)]) == {9, 10, 27, 28, 29}


def test_a_planned_grid_of_round_positions_is_no_table_of_placeholders():
    grid = np.array([[x, y, -1300.0] for x in (0, 7000, 14000) for y in (-3000, 3000)], dtype=float)
    assert not find_placeholders(grid).any()


def test_index_of_tells_arrays_that_are_not_there():
    survey = parse_arrays(b"1. 2. -3. 7\n4. 5. -6. 2\n", "a").survey
    assert survey.index_of([2, 7, 3, 99, -1]).tolist() == [1, 0, -1, -1, -1]
    with pytest.raises(InputError, match="array 3 is not in the array table a; it has 2, 7"):
        survey.position_of(3)


def test_bad_rows_are_told_by_line_and_the_rest_is_kept():
    content = b"1.5 2.5 -3.5 7\nNANOOSE\n1.5 2.5 x 8\n\n1.5 2.5 -3.5 9 9\n"
    content += b"1 2 -3.5 7\n1 2 nan 6\n4 5 -6.5 2.5\n1.5 2.5 -9.5 5\n"
    reading = parse_arrays(content, "a")
    assert reading.survey.number.tolist() == [7, 5]
    assert [b.line for b in reading.bad_records] == [2, 3, 5, 6, 7, 8]
    assert "line 1 is kept" in reading.bad_records[3].why
    assert "'2.5'" in reading.bad_records[5].why


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\n# nothing\n", "no array"),
        (b"RIFF\x00\x00\x10\x00WAVE", "binary"),
        (b"1 2 3\n4 5 6\n", "line 1: found 3 columns"),
        (b"a,b,c\n1,2,3\n", "found columns a, b, c"),
        (b"array,x_ft,y_ft,z_ft\n", "found no array"),
        (b"a b c d\n", "line 1: array number is 'd'"),
    ],
)
def test_a_table_that_is_none_is_refused_in_words(content, words):
    with pytest.raises(InputError, match=words):
        parse_arrays(content, "a")


def test_other_encodings_and_line_ends_read_alike():
    text = "array,x_ft,y_ft,z_ft,doubt\n3,1.5,2.5,-3.5,Vermessungstag ungewiß\n"
    for content in (text.encode("utf-16"), text.encode("latin-1"), text.encode("utf-8-sig")):
        assert parse_arrays(
            content.replace(b"\n", b"\r\n") if content[0] == 97 else content, "a"
        ).survey.number == [3]


def test_depths_for_heights_are_asked_about():
    reading = parse_arrays(
        b"array,x,y,z\n1,7952.45,1530.32,1200.08\n2,15080.91,1521.59,1210.33\n", "arrays.csv"
    )
    assert "are its z depths, positive down?" in reading.notes[-1]
