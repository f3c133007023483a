"""Crossover files: what is told by the first line, the trailer and the call; and the 999 rule."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.rangefiles.arrays import parse_arrays
from trackerlib.rangefiles.crossover_file import parse_crossover, read_crossover, write_crossover
from trackerlib.textfiles import InputError

SURVEY = parse_arrays(b"19463.16 -174.99 -1308.76 1\n23173.89 -6488.40 -1312.09 11\n", "arrays").survey
FIRST = "                   NANOOSE      1    11\n"
ROWS = "    413   19463.2   -3300.0    -500.1   19466.2   -3301.0    -503.1\n" * 1
ROWS += "    414   19473.2   -3300.0    -500.1   19476.2   -3301.0    -503.1\n"
TRAILER = "    999   19463.2    -175.0   -1308.8   23173.9   -6488.4   -1312.1\n"


def parse(text, **more):
    return parse_crossover(text.encode(), "TRPDOTRX.DAT", **more)


def test_first_line_names_range_and_arrays():
    crossover = parse(FIRST + ROWS).set
    assert crossover.pair == (1, 11)
    assert crossover.range_name == "NANOOSE"
    assert crossover.point_count.tolist() == [413, 414]
    assert crossover.gap[0] == pytest.approx([-3, 1, 3])


def test_trailer_names_the_arrays_and_is_no_point():
    reading = parse(ROWS + TRAILER, survey=SURVEY)
    assert reading.set.pair == (1, 11)
    assert reading.set.points == 2
    assert "999" in reading.notes[0]


def test_first_line_and_trailer_together():
    assert parse(FIRST + ROWS + TRAILER, survey=SURVEY).set.points == 2


@pytest.mark.parametrize(
    "text",
    [
        FIRST + ROWS + TRAILER.replace("-175.0", "-176.5"),  # not a position to a foot
        FIRST
        + ROWS
        + TRAILER.replace("23173.9   -6488.4   -1312.1", "19463.2    -175.0   -1308.8"),  # one array
        FIRST + ROWS + TRAILER + ROWS.splitlines(True)[1].replace("414", "1000").replace("  1000", " 1000"),
    ],
)
def test_any_other_999_is_a_point_count(text):
    assert 999 in parse(text, survey=SURVEY).set.point_count


def test_without_a_table_999_is_a_point_count():
    assert parse(FIRST + ROWS + TRAILER).set.points == 3


def test_the_call_names_the_arrays_last():
    assert parse(ROWS, pair=(1, 11)).set.pair == (1, 11)
    with pytest.raises(InputError, match="--set"):
        parse(ROWS)
    with pytest.raises(InputError, match="11 and 1 in the call"):
        parse(FIRST + ROWS, pair=(11, 1))


def test_six_columns_are_counted():
    six = "".join(line[8:] + "\n" for line in ROWS.splitlines())
    reading = parse(six, pair=(4, 5))
    assert reading.set.point_count.tolist() == [1, 2]
    assert reading.set.y[1, 0] == 19476.2
    assert "six columns" in reading.notes[0]


def test_bad_records_are_told_and_the_rest_is_kept():
    text = (
        FIRST
        + ROWS
        + "  413  1 2 3 4 5 6\n  415 1 2 3 4 5\n  416 1 2 3 4 5 ****\n 417 1 2 3 4 5 nan\n 41.5 1 2 3 4 5 6\n"
    )
    reading = parse(text)
    assert reading.set.point_count.tolist() == [413, 414]
    assert [b.line for b in reading.bad_records] == [4, 5, 6, 7, 8]
    assert "line 2 is kept" in reading.bad_records[0].why


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"RIFF\x00\x01", "binary"),
        (FIRST.encode(), "found no record"),
        (b"  1 2 3.5\n", "line 1: found '1 2 3.5', wanted point count and six coordinates"),
        (FIRST.replace("11", " 1").encode() + ROWS.encode(), "twice"),
    ],
)
def test_a_file_that_is_none_is_refused_in_words(content, words):
    with pytest.raises(InputError, match=words):
        parse_crossover(content, "x.txt")


def test_windows_ends_and_order():
    reading = parse(FIRST.replace("\n", "\r\n") + "\r\n".join(reversed(ROWS.splitlines())))
    assert reading.set.point_count.tolist() == [413, 414]
    assert "order" in reading.notes[0]


@given(
    counts=st.lists(st.integers(0, 99_999), min_size=1, max_size=20, unique=True),
    pair=st.lists(st.integers(0, 99), min_size=2, max_size=2, unique=True),
    name=st.sampled_from(["", "NANOOSE", "AREA 3", "W"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_what_is_written_is_read_back(tmp_path_factory, counts, pair, name, seed):
    x, y = np.round(np.random.default_rng(seed).uniform(-99_999, 99_999, (2, len(counts), 3)), 1)
    written = CrossoverSet(tuple(pair), np.sort(counts), x, y, pass_number=2, range_name=name)
    path = tmp_path_factory.mktemp("sets") / "crossover_01_02_2.txt"
    write_crossover(path, written)
    back = read_crossover(path, survey=SURVEY).set
    assert (back.pair, back.range_name, back.pass_number) == (written.pair, name, 2)
    assert np.array_equal(back.point_count, written.point_count)
    assert np.array_equal(back.x, x)
    assert np.array_equal(back.y, y)


def test_written_columns_are_those_of_keygate(tmp_path):
    write_crossover(tmp_path / "a.txt", parse(FIRST + ROWS).set)
    first, row = (tmp_path / "a.txt").read_text().splitlines()[:2]
    assert (first[16:26].strip(), first[28:30], first[33:35]) == ("NANOOSE", " 1", "11")
    assert (row[2:7], row[10:21], row[75:86]) == ("  413", "    19463.2", "     -503.1")
