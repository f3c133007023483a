"""Every byte of a line in a file of the UTC day, before anything has interpreted it.

    log = RawLog(Path("raw"), "gps")
    log.write(data, time.time())            # raw/gps-2026-06-01.raw, raw/gps-2026-06-01.index
    read_day(Path("raw/gps-2026-06-01.raw"))

The .raw file holds the bytes and nothing else. The .index beside it says when: a line `offset,seconds since 1970`
for bytes from that offset on, at most one every INDEX_STEP_S.
"""

from __future__ import annotations

import contextlib
import errno
import re
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path

import numpy as np

INDEX_STEP_S = 0.01
RETRY_S = 5.0  # after a failed write


class RawLog:
    """Writes one line's bytes at once. A disk that fills is told in `trouble`, and the bytes it cost are counted."""

    def __init__(self, folder: Path, name: str):
        self.folder, self.name = Path(folder), re.sub(r"[^A-Za-z0-9.-]+", "_", name).strip("_")
        self.trouble: str | None = None
        self.lost_bytes = 0
        self._day = ""
        self._raw: FileIO | None = None
        self._index: FileIO | None = None
        self._indexed_s = self._failed_s = -np.inf

    def write(self, data: bytes, utc_s: float) -> None:
        """Keeps bytes that came at an instant; never raises."""
        if self.trouble is not None and time.monotonic() - self._failed_s < RETRY_S:
            self.lost_bytes += len(data)
            return
        kept = 0
        try:
            raw, index = self._files(datetime.fromtimestamp(utc_s, UTC).strftime("%Y-%m-%d"))
            if not 0 <= utc_s - self._indexed_s < INDEX_STEP_S:
                index.write(f"{raw.tell()},{utc_s:.6f}\n".encode("ascii"))
                self._indexed_s = utc_s
            kept = raw.write(data)
            if kept < len(data):
                raise OSError(errno.ENOSPC, "")
            self.trouble = None
        except OSError as error:
            self._failed(error, len(data) - kept)

    def close(self) -> None:
        """Closes the files."""
        files = (self._raw, self._index)
        self._raw = self._index = None
        for file in files:
            if file is not None:
                with contextlib.suppress(OSError):
                    file.close()

    def _files(self, day: str) -> tuple[FileIO, FileIO]:
        """The files of a day, open for appending, with nothing buffered."""
        if self._raw is None or self._index is None or day != self._day:
            self.close()
            self.folder.mkdir(parents=True, exist_ok=True)
            path = self.folder / f"{self.name}-{day}.raw"
            self._raw, self._index = FileIO(path, "a"), FileIO(path.with_suffix(".index"), "a")
            self._day, self._indexed_s = day, -np.inf
        return self._raw, self._index

    def _failed(self, error: OSError, lost: int) -> None:
        self.lost_bytes += lost
        self._failed_s = time.monotonic()
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        why = "the disk is full" if full else (error.strerror or str(error)).lower()
        self.trouble = f"raw log of {self.name} in {self.folder}: {why}; bytes that come now are not kept"
        self.close()


@dataclass(frozen=True, eq=False)
class RawDay:
    """A day file read back."""

    content: bytes
    offset: np.ndarray  # (K,) where each piece begins
    utc_s: np.ndarray  # (K,) when it came, seconds since 1970

    def pieces(self):
        """Instant and bytes of each piece, in order."""
        ends = [*self.offset[1:].tolist(), len(self.content)]
        for began, end, when in zip(self.offset.tolist(), ends, self.utc_s.tolist(), strict=True):
            yield when, self.content[began:end]


def read_day(path: Path) -> RawDay:
    """A day file and its index; an index line that a crash cut short is left out. Raises OSError."""
    content = Path(path).read_bytes()
    rows = []
    for line in Path(path).with_suffix(".index").read_text(encoding="ascii").splitlines():
        found = re.fullmatch(r"(\d+),(\d+\.\d{6})", line)
        if found and int(found[1]) <= len(content):
            rows.append((int(found[1]), float(found[2])))
    offset, utc = zip(*rows, strict=True) if rows else ((), ())
    return RawDay(content, np.array(offset, int), np.array(utc, float))
