"""When a recording began, as its head or its name tells."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

# 20240501T123456Z, 2024-05-01_12-34-56, 2024-05-01T12:34:56.250Z: what recorders and people write.
STAMP = re.compile(
    r"(?<!\d)(\d{4})[-_:. ]?(\d\d)[-_:. ]?(\d\d)[T_\- \0]?(\d\d)[-_:.]?(\d\d)[-_:.]?(\d\d)(?:[.,](\d{1,6}))?(?!\d)"
)
FIRST_YEAR = 1970
HEAD_BYTES = 65_536
BROADCAST = slice(
    320, 338
)  # date and time in a WAV's bext chunk (EBU Tech 3285), from the chunk's first byte


def recording_began(path: Path, date: str) -> tuple[float, str] | None:
    """Seconds since 1970 of the first sample, and what tells it: its head, or its name; None if neither does.

    date : the date in the file's head, empty if there is none. Times without a zone are taken as UTC.
    """
    for text, where in ((date, "head"), (_broadcast(path), "head"), (path.stem, "name")):
        seconds = instant_in(text)
        if seconds is not None:
            return seconds, where
    return None


def instant_in(text: str) -> float | None:
    """Seconds since 1970 of the date and time in a text, as UTC; None if it holds none."""
    for found in STAMP.finditer(text):
        year, month, day, hour, minute, second = (int(part) for part in found.groups()[:6])
        fraction = float(f"0.{found[7] or 0}")
        try:
            moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
        except ValueError:
            continue
        if moment.year >= FIRST_YEAR:
            return moment.timestamp() + fraction
    return None


def _broadcast(path: Path) -> str:
    """Date and time of a WAV's bext chunk, if it has one."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    place = head.find(b"bext", 12)
    if head[8:12] != b"WAVE" or place < 0:
        return ""
    text = head[place + 8 :][BROADCAST].decode("latin-1")
    return f"{text[:10]} {text[10:]}"
