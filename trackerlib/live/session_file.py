"""A recorded session in one file: raw bytes, periods, positions and settings, in an embedded database.

    with SessionFile(Path("hunt.session")) as file:
        file.add_settings({"sample_interval_s": 1e-3})
        file.add_period(run, period)
        file.add_fix(heard_s, fix)
    recorded = read_session(Path("hunt.session"))

A thread commits every COMMIT_S, so a kill at any instant loses no more than that, and a reader, even of a file that
is still written, sees everything up to a commit. Adding never waits for the disk and never raises; a disk that is
full is told in `trouble`, and what came since is kept in memory until there is room or BACKLOG is reached.
"""

from __future__ import annotations

import json
import math
import sqlite3
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from trackerlib.live.navigation_stream import DeckUnitRange, Fix
from trackerlib.receiver.periods import Period
from trackerlib.receiver.sail import Maximum
from trackerlib.textfiles import InputError

APPLICATION_ID = 0x5452_4B31  # "TRK1"
SCHEMA_VERSION = 1
COMMIT_S = 0.5
RETRY_S = 2.0  # after a failed commit
BACKLOG = 200_000  # rows kept in memory while nothing can be written
_SCHEMA = """
CREATE TABLE settings (utc_s REAL NOT NULL, content TEXT NOT NULL);
CREATE TABLE raw (utc_s REAL NOT NULL, source TEXT NOT NULL, bytes BLOB NOT NULL);
CREATE TABLE period (run INTEGER NOT NULL, number INTEGER NOT NULL, heard_s REAL NOT NULL, maxima TEXT NOT NULL,
                     attenuation_db REAL, period_samples INTEGER NOT NULL);
CREATE TABLE fix (heard_s REAL NOT NULL, time_s REAL NOT NULL, lat_deg REAL NOT NULL, lon_deg REAL NOT NULL,
                  hdop REAL, heading_rad REAL);
CREATE TABLE event (utc_s REAL NOT NULL, words TEXT NOT NULL);
"""
# Came after the first files of version 1, whose readers pass it over.
_RANGES = """
CREATE TABLE IF NOT EXISTS deck_range (heard_s REAL NOT NULL, two_way_s REAL, turnaround_removed INTEGER NOT NULL);
"""


class SessionFile:
    """Writes a session; made new, or carried on if it exists. Safe to add to from any thread.

    Raises InputError for a file that is no session, or of a later program, or that cannot be made.
    """

    def __init__(self, path: Path, commit_s: float = COMMIT_S):
        self.path, self.commit_s = Path(path), commit_s
        self.trouble: str | None = None
        self.lost_rows = 0
        self._waiting: deque[tuple[str, tuple]] = deque()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        _checked(self.path)
        try:
            self._database = sqlite3.connect(
                self.path, check_same_thread=False, isolation_level=None, timeout=5
            )
            _prepare(self._database)
            runs = self._database.execute("SELECT coalesce(max(run), 0) FROM period").fetchone()[0]
        except sqlite3.Error as error:
            raise InputError(f"{self.path}: cannot be written ({_words(error)})") from None
        self.runs: int = runs  # that were in the file when it was opened
        self._thread = threading.Thread(target=self._run, name="session file", daemon=True)
        self._thread.start()

    def add_settings(self, settings: dict) -> None:
        """Keeps settings as of now; of each, the last one counts when the file is opened again."""
        self._add("INSERT INTO settings VALUES (?, ?)", (time.time(), json.dumps(settings)))

    def add_raw(self, source: str, utc_s: float, data: bytes) -> None:
        """Keeps bytes as they came."""
        self._add("INSERT INTO raw VALUES (?, ?, ?)", (utc_s, source, data))

    def add_period(self, run: int, period: Period) -> None:
        """Keeps the maxima of a period; `run` counts how often sampling began."""
        maxima = json.dumps([[one.value, one.index] for one in period.maxima])
        attenuation = None if math.isnan(period.attenuation_db) else period.attenuation_db
        row = (run, period.number, period.heard_s, maxima, attenuation, period.period_samples)
        self._add("INSERT INTO period VALUES (?, ?, ?, ?, ?, ?)", row)

    def add_fix(self, heard_s: float, fix: Fix) -> None:
        """Keeps a position and when it was heard by the host's clock."""
        rest = (None if math.isnan(value) else value for value in (fix.hdop, fix.heading_rad))
        row = (heard_s, fix.time_s, fix.lat_deg, fix.lon_deg, *rest)
        self._add("INSERT INTO fix VALUES (?, ?, ?, ?, ?, ?)", row)

    def add_range(self, heard_s: float, found: DeckUnitRange) -> None:
        """Keeps a deck unit's range, or that there was no reply, and when it was heard by the host's clock."""
        row = (heard_s, found.two_way_s, int(found.turnaround_removed))
        self._add("INSERT INTO deck_range VALUES (?, ?, ?)", row)

    def add_event(self, utc_s: float, words: str) -> None:
        """Keeps a sentence about what happened."""
        self._add("INSERT INTO event VALUES (?, ?)", (utc_s, words))

    def close(self) -> None:
        """Writes what is left, once, and closes; what cannot be written counts as lost."""
        self._stop.set()
        self._thread.join(10)
        self.lost_rows += len(self._waiting)
        self._waiting.clear()
        self._database.close()

    def __enter__(self) -> SessionFile:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _add(self, statement: str, row: tuple) -> None:
        with self._lock:
            if len(self._waiting) >= BACKLOG:
                self._waiting.popleft()
                self.lost_rows += 1
            self._waiting.append((statement, row))

    def _run(self) -> None:
        while not self._stop.wait(RETRY_S if self.trouble else self.commit_s):
            self._commit()
        self._commit()

    def _commit(self) -> None:
        """Writes all that waits in one transaction; if it cannot be, it goes on waiting."""
        with self._lock:
            rows, self._waiting = self._waiting, deque()
        if not rows:
            return
        try:
            self._database.execute("BEGIN IMMEDIATE")
            for statement, row in rows:
                self._database.execute(statement, row)
            self._database.execute("COMMIT")
            self.trouble = None
        except sqlite3.Error as error:
            if self._database.in_transaction:
                self._database.execute("ROLLBACK")
            self.trouble = f"{self.path}: {_words(error)}; what comes is kept in memory until there is room"
            with self._lock:
                self._waiting.extendleft(reversed(rows))


def _checked(path: Path) -> int | None:
    """Schema version of a session; None if there is no file yet, or an empty one."""
    if not path.exists() or (path.is_file() and path.stat().st_size == 0):
        return None
    if path.is_dir():
        raise InputError(f"{path}: found a folder, wanted a session file")
    try:
        database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
        try:
            mark = database.execute("PRAGMA application_id").fetchone()[0]
            version = database.execute("PRAGMA user_version").fetchone()[0]
        finally:
            database.close()
    except sqlite3.Error as error:
        raise InputError(
            f"{path}: found no session file ({_words(error)}), wanted one of this program"
        ) from None
    if mark != APPLICATION_ID:
        raise InputError(f"{path}: found a database of another program, wanted a session file of this one")
    if version != SCHEMA_VERSION:
        raise InputError(f"{path}: found a session file of version {version}, wanted {SCHEMA_VERSION}")
    return version


def _prepare(database: sqlite3.Connection) -> None:
    """Tables in a new file; a write-ahead log that is on the disk at each commit."""
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    if database.execute("PRAGMA user_version").fetchone()[0] == 0:
        database.executescript(
            f"BEGIN IMMEDIATE; {_SCHEMA} PRAGMA application_id = {APPLICATION_ID}; "
            f"PRAGMA user_version = {SCHEMA_VERSION}; COMMIT;"
        )
    database.execute(_RANGES)


def _words(error: sqlite3.Error) -> str:
    text = str(error)
    known = {
        "full": "the disk is full",
        "readonly": "no permission to write it",
        "unable to open": "it cannot be opened; does the folder exist, and may you write there?",
        "locked": "another program is writing it",
        "not a database": "it is another kind of file",
    }
    return next((words for part, words in known.items() if part in text), text)


@dataclass(frozen=True, eq=False)
class RecordedSession:
    """A session read back."""

    settings: dict  # the last of each
    runs: dict[int, tuple[Period, ...]]  # periods of each time that sampling began, in order
    fixes: tuple[tuple[float, Fix], ...]  # when each was heard by the host's clock, and the position
    ranges: tuple[DeckUnitRange, ...]  # of a deck unit, by when each was heard by the host's clock
    events: tuple[tuple[float, str], ...]
    raw_bytes: int


def read_session(path: Path) -> RecordedSession:
    """What a session file holds, also while it is written or after a kill. Raises InputError."""
    path = Path(path)
    if _checked(path) is None:
        raise InputError(f"{path}: no such file, or an empty one; wanted a session file")
    try:
        # Not read-only: after a kill the log must be taken into the file, which sqlite does by itself.
        database = sqlite3.connect(path, timeout=5)
        try:
            return _read(database)
        finally:
            database.close()
    except (sqlite3.Error, ValueError, TypeError) as error:
        raise InputError(f"{path}: the session cannot be read ({error})") from None


def _read(database: sqlite3.Connection) -> RecordedSession:
    settings: dict = {}
    for (content,) in database.execute("SELECT content FROM settings ORDER BY rowid"):
        settings |= json.loads(content)
    runs: dict[int, list[Period]] = {}
    for run, number, heard, maxima, attenuation, samples in database.execute(
        "SELECT run, number, heard_s, maxima, attenuation_db, period_samples FROM period ORDER BY run, number"
    ):
        found = tuple(Maximum(value, index) for value, index in json.loads(maxima))
        period = Period(number, heard, found, math.nan if attenuation is None else attenuation, samples)
        runs.setdefault(run, []).append(period)
    fixes = tuple(
        (heard, Fix(time_s, lat, lon, *(math.nan if value is None else value for value in rest)))
        for heard, time_s, lat, lon, *rest in database.execute("SELECT * FROM fix ORDER BY rowid")
    )
    return RecordedSession(
        settings,
        {run: tuple(periods) for run, periods in runs.items()},
        fixes,
        _ranges(database),
        tuple(database.execute("SELECT utc_s, words FROM event ORDER BY rowid")),
        database.execute("SELECT coalesce(sum(length(bytes)), 0) FROM raw").fetchone()[0],
    )


def _ranges(database: sqlite3.Connection) -> tuple[DeckUnitRange, ...]:
    if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'deck_range'").fetchone() is None:
        return ()
    rows = database.execute("SELECT * FROM deck_range ORDER BY rowid")
    return tuple(DeckUnitRange(heard_s, two_way_s, bool(removed)) for heard_s, two_way_s, removed in rows)


def raw_of(path: Path, source: str | None = None) -> Sequence[tuple[float, str, bytes]]:
    """Instant, source and bytes of what a session heard, in order."""
    if _checked(Path(path)) is None:
        raise InputError(f"{path}: no such file, or an empty one; wanted a session file")
    database = sqlite3.connect(path, timeout=5)
    try:
        every = database.execute("SELECT utc_s, source, bytes FROM raw ORDER BY rowid")
        return [row for row in every if source is None or row[1] == source]
    finally:
        database.close()
