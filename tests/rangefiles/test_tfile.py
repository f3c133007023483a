"""T-files: fixed columns, bad records by line, odd files, and what the header offers."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackerlib.rangefiles import record_scan
from trackerlib.rangefiles import tfile as tfile_module
from trackerlib.rangefiles.tfile import judge_lines, parse_numbers, parse_tfile, read_tfile
from trackerlib.textfiles import InputError

TITLE = "RANGE RUN OF 6/20/85$"


def record(count, position=(49473.6, 4294.9, -30.6), array=6, mode=2, mark="  "):
    x, y, z = position
    rest = "   176.1  344.3   -6.07   82 5"
    return f"{count:5d}{mark}{x:8.1f} {y:8.1f} {z:8.1f}{rest}{array:2d}  {mode:d}"


def parse(lines, header_records=1, end="\n", encoding="latin-1"):
    return parse_tfile(end.join([TITLE, *lines]).encode(encoding), "t.dat", header_records)


def test_columns_by_hand():
    line = "  188   49473.6   4294.9    -30.6   176.1  344.3   -6.07   82 536  2$"
    reports = parse([line]).reports
    assert (reports.point_count[0], reports.array[0], reports.mode[0]) == (188, 36, 2)
    assert reports.position[0].tolist() == [49473.6, 4294.9, -30.6]
    assert (reports.line[0], reports.flagged[0]) == (2, False)


@settings(deadline=None)  # the first call may compile
@given(
    rows=st.lists(
        st.tuples(
            st.integers(0, 99_999),
            st.tuples(*[st.integers(-999_999, 9_999_999)] * 3),
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


@pytest.mark.parametrize(
    ("before", "x"),
    [
        ("-", -49473.6),
        ("1", 149473.6),
        ("+", 49473.6),
        ("V", 49473.6),
        ("*", 49473.6),
        ("\t", 49473.6),
        (".", None),
    ],
)
@pytest.mark.parametrize("places", [(7,), (16,), (25,), (7, 16, 25)])
def test_what_stands_right_before_a_position_is_read_where_it_belongs_to_it(before, x, places):
    line = record(188, (49473.6, 49473.6, 49473.6))
    for place in places:
        line = line[:place] + before + line[place + 1 :]
    reports = parse([record(187), line, record(189)]).reports
    if x is None:
        assert reports.point_count.tolist() == [187, 189]
        first = places[0] + 1
        assert re.match(rf"columns {first}-{first + 7} \(.*\) hold '\.49473\.6'", reports.bad_records[0].why)
    else:
        wanted = [x if place in places else 49473.6 for place in (7, 16, 25)]
        assert reports.position[1].tolist() == wanted
        assert not reports.bad_records


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


# the compiled scan against the plain judge of one record

NAMES = ("line", "point_count", "position", "array", "mode", "flagged")


def plainly(lines, first_line=2):
    """Line, count, position, array, mode, mark of each record, and the bad ones, all by the plain judge."""
    coded = [line.encode("latin-1") for line in lines]
    lengths = np.array([len(line) for line in coded])
    starts = np.concatenate([[0], np.cumsum(lengths + 1)[:-1]])
    places = np.column_stack([np.arange(first_line, first_line + len(lines)), starts, lengths])
    line, values, flagged, bad = judge_lines(np.frombuffer(b"\n".join(coded) + b"\n", np.uint8), places)
    return (line, values[:, 0], values[:, 1:4], values[:, 4], values[:, 5], flagged), bad


def agree(lines, end="\n", **more):
    columns, bad = plainly(lines)
    if not len(columns[0]):
        return
    reports = parse(lines, end=end, **more).reports
    for name, column in zip(NAMES, columns, strict=True):
        assert np.array_equal(getattr(reports, name), column), name
    assert list(reports.bad_records) == bad
    for mode in (2, 7):
        kept = (columns[4] == mode) & ~columns[5]
        only = parse_tfile(end.join([TITLE, *lines]).encode(), "t.dat", 1, mode).reports
        for name, column in zip(NAMES, columns, strict=True):
            assert np.array_equal(getattr(only, name), column[kept]), name
        assert list(only.bad_records) == bad
        assert len(only) + only.left_out == len(columns[0])


def spoilt(rng, line):
    """A record with a few characters changed, moved, taken or added, or as it was."""
    kind = rng.integers(0, 12)
    letters = " 0123456789.-+ED*\t"
    for _ in range(rng.integers(1, 4) if kind < 5 else 0):
        k = int(rng.integers(0, len(line)))
        line = line[:k] + letters[rng.integers(len(letters))] + line[k + 1 :]
    if kind == 5:
        line = line[: rng.integers(0, 69)]
    if kind == 6:
        line = line + " remark"[: rng.integers(0, 7)]
    if kind == 7:
        k = int(rng.integers(0, 60))
        line = line[:k] + " " + line[k:]
    return line


def random_lines(rng, size, spoil=spoilt):
    return [
        spoil(
            rng,
            record(
                int(rng.integers(-99, 99_999)),
                rng.integers(*((-99_999, 999_999) if rng.random() < 0.9 else (-999_999, 9_999_999)), 3) / 10,
                int(rng.integers(0, 99)),
                int(rng.choice([1, 2, 7])),
                str(rng.choice(["  ", "  ", "ED", " 1"])),
            ),
        )
        for _ in range(size)
    ]


@pytest.mark.parametrize("seed", range(30))
def test_the_scan_agrees_with_the_plain_judge(seed):
    rng = np.random.default_rng(seed)
    agree(random_lines(rng, int(rng.integers(1, 300))))


@pytest.mark.parametrize("rare", [70, 130])
def test_one_odd_line_among_many_equal_ones_changes_no_other(rare):
    rng = np.random.default_rng(rare)
    lines = random_lines(rng, 400, lambda rng, line: line)
    for odd in ("", "short", lines[0] + " longer", lines[0][:40] + "\t" + lines[0][41:], "  188   +9473.6"):
        agree([*lines[:rare], odd, *lines[rare:]])


@pytest.mark.parametrize("end", ["\r\n", "\r"])
def test_other_line_ends_go_a_slower_way_to_the_same_result(end):
    rng = np.random.default_rng(4)
    agree(random_lines(rng, 300), end=end)


def test_a_letter_beyond_ascii_far_down_changes_nothing():
    rng = np.random.default_rng(5)
    lines = random_lines(rng, 2000, lambda rng, line: line)
    lines[1500] = lines[1500][:40] + "é" + lines[1500][41:]
    agree(lines)


def test_every_number_of_six_digits_is_read_as_division_gives_it():
    tenths = np.arange(999_999)
    digits = np.char.zfill(tenths.astype("S6"), 6).view(np.uint8).reshape(-1, 3, 6)
    lines = np.tile(np.frombuffer(record(1).encode() + b"\n", np.uint8), (len(digits), 1))
    for k, first in enumerate((8, 17, 26)):
        lines[:, first : first + 5], lines[:, first + 6] = digits[:, k, :5], digits[:, k, 5]
    reports = parse_tfile(lines.tobytes(), "t.dat", 0).reports
    assert np.array_equal(reports.position.ravel(), tenths / 10.0)


def test_stretches_of_a_file_join_without_a_seam(monkeypatch):
    rng = np.random.default_rng(6)
    lines = random_lines(rng, 700)
    monkeypatch.setattr(record_scan, "_STRETCH_BYTES", 5_000)
    monkeypatch.setattr(tfile_module, "_CHUNK", 7)
    agree(lines)


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
