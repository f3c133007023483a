"""T-files: fixed columns, bad records by line, odd files, and what the header offers."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackerlib.rangefiles import tfile as tfile_module
from trackerlib.rangefiles.tfile import parse_numbers, parse_tfile, read_tfile
from trackerlib.textfiles import InputError

TITLE = "RANGE RUN OF 6/20/85$"


def record(count, position=(49473.6, 4294.9, -30.6), array=6, mode=2, mark="  "):
    x, y, z = position
    rest = "   176.1  344.3   -6.07   82 5"
    return f"{count:5d}{mark} {x:7.1f}  {y:7.1f}  {z:7.1f}{rest}{array:2d}  {mode:d}"


def parse(lines, header_records=1, end="\n", encoding="latin-1"):
    return parse_tfile(end.join([TITLE, *lines]).encode(encoding), "t.dat", header_records)


def test_columns_by_hand():
    line = "  188   49473.6   4294.9    -30.6   176.1  344.3   -6.07   82 536  2$"
    reports = parse([line]).reports
    assert (reports.point_count[0], reports.array[0], reports.mode[0]) == (188, 36, 2)
    assert reports.position[0].tolist() == [49473.6, 4294.9, -30.6]
    assert (reports.line[0], reports.flagged[0]) == (2, False)


@given(
    rows=st.lists(
        st.tuples(
            st.integers(0, 99_999),
            st.tuples(*[st.integers(-99_999, 999_999)] * 3),
            st.integers(0, 99),
            st.integers(0, 9),
            st.sampled_from(["  ", "ED", " E", "D "]),
        ),
        min_size=1,
        max_size=8,
    )
)
def test_what_is_printed_is_read(rows):
    lines = [record(c, [v / 10 for v in p], a, m, mark) for c, p, a, m, mark in rows]
    reports = parse(lines).reports
    assert reports.point_count.tolist() == [r[0] for r in rows]
    assert reports.position.tolist() == [[v / 10 for v in r[1]] for r in rows]
    assert list(zip(reports.array, reports.mode, strict=True)) == [r[2:4] for r in rows]
    assert reports.flagged.tolist() == [r[4] != "  " for r in rows]


@pytest.mark.parametrize(
    ("text", "value"), [("49473.6", 49473.6), ("   -0.1", -0.1), ("   +7.0", 7.0), ("     .5", 0.5)]
)
def test_numbers_that_are_well_formed(text, value):
    got, good = parse_numbers(np.frombuffer(text.encode(), np.uint8)[None, :], 1)
    assert good[0]
    assert got[0] == value


@pytest.mark.parametrize(
    "text",
    ["9473.6 ", " 49473.", "*******", "1 234.5", "  1-2.3", "       ", " 1.2e.3", "  494736", "    nan"],
)
def test_numbers_that_are_not(text):
    assert not parse_numbers(np.frombuffer(text[-7:].encode(), np.uint8)[None, :], 1)[1][0]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda r: r[:40], "ends at column 40, wanted 68"),
        (lambda r: r[:67], "ends at column 67"),
        (lambda r: r[1:] + " ", "point count|downrange"),
        (lambda r: " " + r, "point count|downrange"),
        (lambda r: r[:30] + " " + r[30:], r"\(z\)"),
        (
            lambda r: r[:8] + "*******" + r[15:],
            r"columns 9-15 \(downrange\) hold '\*\*\*\*\*\*\*', wanted feet",
        ),
        (
            lambda r: r[:63] + "A6" + r[65:],
            r"columns 64-65 \(array number\) hold 'A6', wanted a whole number",
        ),
        (lambda r: r[:67] + "x", r"column 68 \(mode\)"),
        (lambda r: r.replace("4294.9", "4294\t9"), "crossrange"),
    ],
)
def test_a_bad_record_is_told_and_its_neighbours_are_kept(spoil, words):
    reports = parse([record(188), spoil(record(189)), "", record(190)]).reports
    assert reports.point_count.tolist() == [188, 190]
    assert [bad.line for bad in reports.bad_records] == [3]
    assert re.search(words, reports.bad_records[0].why)


def test_a_record_with_an_edit_mark_may_have_any_position():
    line = record(189, mark="ED")
    reports = parse([record(188), line[:8] + "*******" + line[15:]]).reports
    assert not reports.bad_records
    assert reports.flagged.tolist() == [False, True]


@pytest.mark.parametrize("end", ["\r\n", "\r", "\n"])
@pytest.mark.parametrize("encoding", ["latin-1", "utf-8", "utf-16", "utf-8-sig"])
def test_line_ends_and_encodings_change_nothing(end, encoding):
    lines = [record(188), record(189)[:34] + "µé" + record(189)[36:], record(190) + " remark ß\x1a"]
    reports = parse(lines, end=end, encoding=encoding).reports
    assert reports.point_count.tolist() == [188, 189, 190]
    assert reports.position[:, 0].tolist() == [49473.6] * 3


def test_files_are_read_in_chunks_alike(monkeypatch):
    lines = [record(c) if c % 3 else "bad" for c in range(10, 40)]
    whole = parse(lines).reports
    monkeypatch.setattr(tfile_module, "_CHUNK", 7)
    chunked = parse(lines).reports
    assert np.array_equal(whole.line, chunked.line)
    assert whole.bad_records == chunked.bad_records
    assert np.array_equal(whole.position, chunked.position)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\x00\x01\x02" * 50, "binary"),
        (b"\n".join([b"a"] * 31), "found 31 lines, wanted 31 of header"),
        (
            b"\n".join([b"a"] * 40),
            "no position record after 31 lines of header; line 32: the record ends at column 1",
        ),
        (b"mode,pc,x,y,z\n" + b"7,188,5239.80,1100.42,-210.10\n" * 40, "no position record"),
    ],
)
def test_a_file_that_is_no_t_file_is_refused_in_words(content, words):
    with pytest.raises(InputError, match=words):
        parse_tfile(content, "t.dat")


def test_a_huge_file_is_refused_before_it_is_read(tmp_path, monkeypatch):
    (tmp_path / "t.dat").write_text("x" * 2000)
    monkeypatch.setattr("trackerlib.textfiles.MAX_BYTES", 1000)
    with pytest.raises(InputError, match=r"found .* GB, wanted at most"):
        read_tfile(tmp_path / "t.dat")


def test_a_header_count_that_cuts_data_off_is_warned_about(data):
    (warning,) = read_tfile(data / "range-demo/tfile.dat", 40).warnings
    assert "cuts 9 position records off, from line 32 on; the header seems to have 31" in warning


def test_a_header_count_that_leaves_header_in_is_warned_about(data):
    reading = read_tfile(data / "range-demo/tfile.dat", 20)
    assert "may leave header in, 31 would not" in reading.warnings[0]
    assert [bad.line for bad in reading.reports.bad_records[:11]] == list(range(21, 32))


def test_the_header_is_found_where_its_count_is_not_told(data):
    assert len(read_tfile(data / "range-demo/tfile.dat", None).header) == 31
    assert len(parse([record(1), record(2)], header_records=None).header) == 1
    with pytest.raises(InputError, match="after 0 lines of header; line 1"):
        parse(["nothing"], header_records=None)


def test_the_demo_reads_whole_but_for_its_three_bad_records(data):
    reading = read_tfile(data / "range-demo/tfile.dat")
    assert len(reading.reports) + 3 == 18585
    assert [bad.line for bad in reading.reports.bad_records] == [6233, 11750, 17786]
    assert reading.simulated
    assert not reading.warnings


def test_the_header_offers_its_table_of_depth_and_speed(data):
    table = read_tfile(data / "range-demo/tfile.dat").sound_speed_table
    assert np.array_equal(table, np.loadtxt(data / "range-demo/VELOCITY.DAT"))


def test_the_table_is_offered_as_a_profile(data):
    reading = read_tfile(data / "range-demo/tfile.dat")
    middle, boundary = reading.profile(), reading.profile(speeds="boundary")
    assert (middle.depth[0], middle.speed[0]) == (12.5, 4880.55)
    assert (boundary.depth[0], boundary.speed[0]) == (0.0, 4880.55)
    assert "tfile.dat" in middle.name
    assert parse([record(1)]).profile() is None


def test_the_run_date_is_the_one_date_of_the_header():
    assert parse([record(1)]).run_date == np.datetime64("1985-06-20")
    two = parse_tfile("\n".join([TITLE, "PRINTED 7/1/85", record(1)]).encode(), "t.dat", 2)
    assert np.isnat(two.run_date)
