"""A corrected copy: only the positions change, whatever the file's line ends and letters."""

import numpy as np
import pytest

from trackerlib.rangefiles.corrected_tfile import corrected_copy
from trackerlib.rangefiles.tfile import parse_tfile

WORDS = "CORRECTED COPY OF t.dat"
HEADER = ["RANGE RUN OF 6/20/85  ", " END DVT"]


def record(count, x, array=1):
    return f"{count:5d}   {x:7.1f}  {4294.9:7.1f}  {-30.6:7.1f}{'':30}{array:2d}  7 $"


def text(records, header=HEADER, end="\n"):
    return end.join([*header, *records]) + end


def corrected(content, header_records=2):
    reading = parse_tfile(content, "t.dat", header_records)
    which = np.flatnonzero(reading.reports.array == 1)
    return corrected_copy(
        content, reading, which, reading.reports.position[which] + [0.5, 0, 0], WORDS
    ).content


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\r\r\n"])
@pytest.mark.parametrize("encoding", ["latin-1", "utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("tail", ["", "\x1a", "\n\n"])
def test_all_else_stays_line_ends_and_letters_too(end, encoding, tail):
    header = [HEADER[0], " SÖREN µ"]
    records = [record(1, 100.0), record(1, 300.0, 2), "rubbish é", record(2, 200.0)]
    moved = [record(1, 100.5), record(1, 300.0, 2), "rubbish é", record(2, 200.5)]
    copy = corrected((text(records, header, end) + tail).encode(encoding))
    told = [f"{header[0].rstrip()}  {WORDS}", header[1]]
    assert copy == (text(moved, told, end) + tail).encode(encoding)


def test_without_a_header_the_words_stand_behind_the_columns_of_the_first_record():
    for first in (record(1, 100.0), "cut"):
        copy = corrected(text([first, record(2, 200.0)], []).encode(), 0).decode().splitlines()
        assert copy[0].index(WORDS) >= 68
        assert copy[1] == record(2, 200.5)
        again = parse_tfile("\n".join(copy).encode(), "c.dat", 0)
        assert len(again.reports) == (2 if first != "cut" else 1)
        assert again.doubts[-1] == f"the positions were corrected before: {WORDS}"


@pytest.mark.parametrize(
    ("old", "new"),
    [("-12345.6", "-12345.1"), ("-10000.3", " -9999.8"), ("123456.7", "123457.2"), (" 99999.4", " 99999.9")],
)
def test_a_position_of_eight_columns_is_written_in_eight(old, new):
    rest = record(1, 0.0)[15:]
    copy = corrected(text([f"    1  {old}{rest}", record(2, 200.0)]).encode()).decode().splitlines()
    assert copy[2] == f"    1  {new}{rest}"


def test_a_position_that_outgrows_its_columns_stays():
    records = [record(1, 99999.7), f"    2  999999.7{record(2, 0.0)[15:]}", record(3, 200.0)]
    reading = parse_tfile(text(records).encode(), "t.dat", 2)
    position = reading.reports.position + np.array([0.5, 0, 0])
    copy = corrected_copy(text(records).encode(), reading, np.arange(3), position, WORDS)
    assert copy.written.tolist() == [False, False, True]
    assert [bad.line for bad in copy.too_wide] == [3, 4]
    assert copy.content.decode().splitlines()[2:] == [*records[:2], record(3, 200.5)]


def test_a_copy_says_so_when_it_is_read():
    copy = parse_tfile(corrected(text([record(1, 100.0)]).encode()), "c.dat", 2)
    assert copy.doubts == (f"the positions were corrected before: {WORDS}",)
    assert copy.header[0] == f"RANGE RUN OF 6/20/85  {WORDS}"
    assert copy.run_date == np.datetime64("1985-06-20")


def test_one_record_without_a_line_end_is_a_file_too():
    copy = corrected(record(1, 100.0).encode(), 0).decode()
    assert copy == f"{record(1, 100.5)}  {WORDS}"
