"""Text files: what DOS leaves at their end, pipes and devices, and writing that leaves nothing half done."""

import os
import threading

import pytest

from trackerlib import textfiles
from trackerlib.textfiles import InputError, decode_lines, map_bytes, write_bytes, write_text

posix = pytest.mark.skipif(os.name != "posix", reason="pipes and links of this kind are Unix's")


@pytest.mark.parametrize("end", [b"\x1a", b"\x1a\r\n", b"\r\n\x1a\x1a\x00\x00", b"\n\x1a\n\n"])
def test_what_dos_left_at_the_end_is_no_line(end):
    text = b"1 2\n" * 2000 + b"3 4"
    assert decode_lines(text + end, "t.dat") == ["1 2"] * 2000 + ["3 4"]


def test_a_control_z_inside_a_text_and_two_bytes_a_letter_stay():
    assert decode_lines(b"a\x1ab\nc\n", "t.dat") == ["a\x1ab", "c"]
    assert decode_lines("ab\ncd\n".encode("utf-16"), "t.dat") == ["ab", "cd"]


@pytest.mark.parametrize(
    "content", [b"", b" \n\n", b"\x1a", b"\n\x1a\r\n", b"\xef\xbb\xbf", b"\xff\xfe\n\x00"]
)
def test_a_text_without_a_word_is_empty(content):
    with pytest.raises(InputError, match=r"t\.dat: the file is empty"):
        decode_lines(content, "t.dat")


def test_a_few_bytes_of_nothing_do_not_make_a_text_binary():
    lines = decode_lines(b"1 2\n" * 20_000 + b"\x00" * 300 + b"\n5 6\n", "t.dat")
    assert (len(lines), lines[-1]) == (20_002, "5 6")
    with pytest.raises(InputError, match="binary data"):
        decode_lines(b"1 2\n\x00\x00", "t.dat")


@posix
def test_a_pipe_is_read_like_a_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=(tmp_path / "pipe").write_bytes, args=(b"1 2\n",))
    writer.start()
    assert map_bytes(tmp_path / "pipe") == b"1 2\n"
    writer.join()


@posix
def test_a_pipe_is_written_to_and_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    got = []
    reader = threading.Thread(target=lambda: got.append((tmp_path / "pipe").read_bytes()))
    reader.start()
    write_bytes(tmp_path / "pipe", b"1 2\n")
    reader.join()
    assert got == [b"1 2\n"]
    assert (tmp_path / "pipe").is_fifo()


@posix
def test_a_link_is_followed(tmp_path):
    (tmp_path / "file").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "new"


def test_an_error_names_the_file_that_was_asked_for(tmp_path):
    for path in (tmp_path, tmp_path / "none/out.csv"):
        with pytest.raises(OSError, match="directory") as caught:
            write_text(path, "text")
        assert caught.value.filename == str(path)


def test_an_interrupt_or_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    (tmp_path / "out.csv").write_text("old")
    for fault in (KeyboardInterrupt, OSError(28, "No space left on device")):

        def stop(*_, fault=fault):
            raise fault

        monkeypatch.setattr(textfiles.os, "replace", stop)
        with pytest.raises((KeyboardInterrupt, OSError)):
            write_text(tmp_path / "out.csv", "new")
        assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("out.csv", "old")]


@posix
def test_the_name_of_an_open_pipe_is_written_to():
    out, into = os.pipe()
    write_bytes(f"/dev/fd/{into}", b"1 2\n")
    os.close(into)
    with open(out, "rb") as pipe:
        assert pipe.read() == b"1 2\n"
