"""Text files as people really have them: any line end, any encoding, sometimes not text at all.

Every reader of this package goes through `read_lines`, and says what it could not use with
`BadRecord` (one line, the rest is kept) or `InputError` (the file as a whole is no use).
"""

from __future__ import annotations

import contextlib
import mmap
import os
import re
import stat
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

# A raw log of a whole day at 10 lines a second is 80 MB; a T-file of four million records 300 MB.
MAX_BYTES = 2_000_000_000


# What a text file may hold: control characters are odd but for tabs, line ends, control-Z and escape.
_PLAIN_BYTES = bytes({*range(32, 256), 9, 10, 11, 12, 13, 26, 27})
_DOS_END = re.compile(rb"[\x1a\x00][\x1a\x00\s]*\Z")  # control-Z and what fills its last block
_LAST_BLOCK = 1024


class InputError(ValueError):
    """An input that cannot be used; the message says file, line, what was found, what was wanted."""


@dataclass(frozen=True)
class BadRecord:
    """One line of a file that could not be used, and why."""

    line: int  # line number in the file, from 1
    why: str  # what was found and what was wanted, as a sentence


def read_lines(path: str | Path) -> list[str]:
    """Lines of a text file without their line ends.

    UTF-8 with or without a byte-order mark, UTF-16 with one, else Latin-1; line ends of Unix,
    Windows or old Macintosh. A control-Z that DOS put at the end is dropped, and what stands behind it.
    Raises InputError if the file is missing, a folder, empty, larger than MAX_BYTES or not text.
    """
    return decode_lines(read_bytes(path), Path(path).name)


def read_bytes(path: str | Path) -> bytes:
    """The bytes of a file. Raises InputError if it is missing, a folder, unreadable, empty or huge."""
    content = _open_checked(path, lambda file: file.read())
    if not content.strip():
        raise InputError(f"{path}: the file is empty")
    return content


def map_bytes(path: str | Path) -> mmap.mmap | bytes:
    """The same without reading them: pages of a large file are read as they are looked at. A pipe is read."""

    def take(file):
        is_file = stat.S_ISREG(os.fstat(file.fileno()).st_mode)
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if is_file else file.read()

    return _open_checked(path, take)


def _open_checked(path: str | Path, take: Callable):
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: found a folder, wanted a file")
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{path}: found {size / 1e9:.1f} GB, wanted at most {MAX_BYTES / 1e9:.0f} GB")
        if size == 0 and path.is_file():
            raise InputError(f"{path}: the file is empty")
        with path.open("rb") as file:
            return take(file)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def decode_lines(content: bytes, name: str) -> list[str]:
    """Lines of text in `content`, which came from the file (or upload) called `name`."""
    encoding = text_encoding(content)
    if encoding != "utf-16":
        _refuse_binary(content, name)
        content = content[: text_end(content)]
    text = content.decode(encoding, errors="replace")
    if not text.strip():
        raise InputError(f"{name}: the file is empty")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return lines[:-1] if lines[-1] == "" else lines


def text_encoding(content: bytes) -> str:
    """How to decode the bytes of a text file: by its byte-order mark, as UTF-8 where that goes, else Latin-1."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig" if content[:3] == b"\xef\xbb\xbf" else "utf-8"


def text_end(content: bytes | mmap.mmap) -> int:
    """Where the text ends: before the control-Z that DOS put at the end, if there is one."""
    start = max(len(content) - _LAST_BLOCK, 0)
    found = _DOS_END.search(content[start:])
    return start + found.start() if found else len(content)


def write_text(path: str | Path, text: str) -> None:
    """Writes a text file whole or not at all, as `write_bytes`."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | Path, content: bytes) -> None:
    """Writes a file whole or not at all; devices and pipes are written to, links are followed.

    Raises OSError that names the file.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)
        else:
            _replace(Path(os.path.realpath(path)), content)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _replace(path: Path, content: bytes) -> None:
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    except BaseException:  # an interrupt too
        with contextlib.suppress(OSError):
            part.unlink()
        raise


def _refuse_binary(content: bytes, name: str) -> None:
    head = content[:65536]
    odd = len(head.translate(None, delete=_PLAIN_BYTES))
    if odd > 0.01 * len(head):
        raise InputError(f"{name}, line 1: found binary data, wanted a text file")
