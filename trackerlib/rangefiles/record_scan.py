"""Compiled scan of T-file records: well-formed ones become numbers, all others are left to be judged.

Eight columns are looked at in one step, as the eight bytes of a word: whether all are digits, blanks or a sign
in the right order, and what number they make (tenths of a foot, whole), without a string and without a loop.
"""

from __future__ import annotations

import mmap
import os
import threading
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numba
import numpy as np

from trackerlib.compiled import compiled, in_threads, warms

COLUMNS = 68
MARGIN = 80  # bytes behind the last record that a scan may look at
EVERY_MODE = -1
_STRETCH_BYTES = 16_000_000  # what is kept of so many is near at hand until it is put in its place
_NEWLINE, _RETURN = 10, 13

_word = np.uint64
_BLANKS, _HIGH = _word(0x2020202020202020), _word(0x8080808080808080)
_NUMBER = _word(0x00302E3030303030)  # six zeros, the point before the last
_NOT_NUMBER = _word(0x00767F7676767676)  # added to (word ^ _NUMBER), sets the high bit of whatever differs
_MINUS = _word(0x0D0D0D0D0D0D0D0D)  # '-' ^ ' ' in every byte
_NO_MARK = 0x2020
_LINES = 64  # looked at together
# A tenth in two parts, the first so short that its product with a number of six digits is exact: the sum of both
# products is then rounded once, to what a division by ten gives, which takes five times as long.
_TENTH, _TENTH_REST = float.fromhex("0x1.99999998p-4"), float.fromhex("0x1.999999999999ap-36")


@dataclass(frozen=True, eq=False)
class Scan:
    """Records of a file that are well formed, and where the other lines are."""

    columns: list[
        np.ndarray
    ]  # line, point count, position (N, 3) ft, array, mode, edit mark, of (N,) reports
    odd: np.ndarray  # (K, 3) line, start and length of every other line, blank ones too
    modes: np.ndarray  # (10,) well-formed records of each mode
    first_line: int | None  # of the first well-formed record of any mode


class _Part(NamedTuple):
    """The same of one stretch, its lines counted from 0."""

    columns: list[np.ndarray]
    odd: np.ndarray
    lines: int
    first_line: int  # -1 for none
    modes: np.ndarray
    foreign: bool  # a carriage return or a byte that is no ASCII: the scan stopped


class _Gathering:
    """Puts what stretches find one behind the other in the order of the file, whichever ends first."""

    def __init__(self, records: int, first_line: int):
        self._columns = _columns(records)
        self._rooms: list[list[np.ndarray]] = []  # free ones
        self._lock = threading.Lock()
        self._early: dict[int, _Part] = {}
        self._next, self._filled, self._line = 0, 0, first_line
        self._odd, self._modes, self._first_line = [np.empty((0, 3), np.int64)], np.zeros(10, np.int64), -1
        self._foreign = False

    def room(self) -> list[np.ndarray]:
        """Columns for a stretch to fill; used again and again, they stay in the processor's cache."""
        with self._lock:
            return self._rooms.pop() if self._rooms else _columns(_STRETCH_BYTES // (COLUMNS + 1) + _LINES)

    def add(self, number: int, part: _Part) -> None:
        """Takes the part of a stretch; one that comes early waits until those before it have come."""
        with self._lock:
            self._early[number] = part
            ready = []
            while self._next in self._early:
                part = self._early.pop(self._next)
                ready.append((part, self._filled, self._line))
                self._append(part)
        for part, begin, line in ready:
            part.columns[0][:] += line
            for whole, column in zip(self._columns, part.columns, strict=True):
                whole[begin : begin + len(column)] = column
            with self._lock:
                self._rooms.append([column.base for column in part.columns])

    def _append(self, part: _Part) -> None:
        part.odd[:, 0] += self._line
        self._odd.append(part.odd)
        self._modes += part.modes
        if self._first_line < 0 <= part.first_line:
            self._first_line = self._line + part.first_line
        self._next, self._filled, self._line = (
            self._next + 1, self._filled + len(part.columns[0]), self._line + part.lines
        )  # fmt: skip
        self._foreign |= part.foreign

    def scan(self) -> Scan | None:
        """All of it, None where the text is foreign."""
        if self._foreign:
            return None
        columns = [column[: self._filled] for column in self._columns]
        first_line = None if self._first_line < 0 else self._first_line
        return Scan(columns, np.concatenate(self._odd), self._modes, first_line)


def scan_records(text: np.ndarray, start: int, first_line: int, mode: int = EVERY_MODE) -> Scan | None:
    """The scan of a file's bytes (uint8) from `start` on, where line `first_line` begins.

    mode : keep only records of that mode without an edit mark; all are checked and counted nonetheless
    The text must have one byte a character and lines of Unix; None where a byte tells that it has not. Stretches
    run in threads and end where lines end.
    """
    safe = _line_start(text, max(len(text) - 2 * MARGIN, start))
    cuts = [start]
    while safe - cuts[-1] > _STRETCH_BYTES:
        cuts.append(min(_line_start(text, cuts[-1] + _STRETCH_BYTES), safe))
    if safe > cuts[-1]:
        cuts.append(safe)
    # Pages that nothing is written to take no memory, so there is room for all records to be kept.
    gathering = _Gathering((len(text) - start) // (COLUMNS + 1) + 1, first_line)

    stretches = enumerate(pairwise(cuts))

    def work() -> None:
        for number, (first, last) in stretches:  # each thread takes the next one
            gathering.add(number, _scan_stretch(text, first, last, mode, gathering.room()))
            _let_go(text, first, last)

    in_threads(work, [()] * min(os.cpu_count() or 1, len(cuts)))
    tail = np.full(len(text) - safe + MARGIN, ord(" "), dtype=np.uint8)
    tail[: len(text) - safe] = text[safe:]
    last = _scan_stretch(tail, 0, len(text) - safe, mode, gathering.room())
    last.odd[:, 1] += safe
    gathering.add(len(cuts) - 1, last)
    return gathering.scan()


def _let_go(text: np.ndarray, start: int, stop: int) -> None:
    """Lets go of pages of a mapped file, which are read again if asked for.

    So a large file takes no memory for long, and no single thread has to let go of all of it at the end.
    """
    mapped = getattr(text.base, "obj", None)  # of the memory view that an array of a mapping stands on
    if isinstance(mapped, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        first, last = -(-start // mmap.PAGESIZE) * mmap.PAGESIZE, stop // mmap.PAGESIZE * mmap.PAGESIZE
        if last > first:
            mapped.madvise(mmap.MADV_DONTNEED, first, last - first)


def _columns(records: int) -> list[np.ndarray]:
    # made here and not in the kernel: NumPy asks the system for large pages
    kinds = (np.int32, np.int32, np.float64, np.int16, np.int8, np.bool_)
    return [np.empty((records, 3) if kind is np.float64 else records, kind) for kind in kinds]


def _line_start(text: np.ndarray, place: int) -> int:
    """Start of the first line that begins at `place` or later."""
    while 0 < place < len(text) and text[place - 1] != _NEWLINE:
        place += 1
    return place


def _scan_stretch(text: np.ndarray, start: int, stop: int, mode: int, columns: list[np.ndarray]) -> _Part:
    text = text.view()
    text.flags.writeable = False  # as a mapped file is, so that one compilation serves both
    kept, *rest = _scan(text, text.view(np.int8), start, stop, mode, *columns)
    return _Part([column[:kept] for column in columns], *rest)


@compiled
def _load(text, place):
    """Eight bytes as a word, the first one lowest."""
    p = numba.uint64(place)
    return (
        numba.uint64(text[p])
        | (numba.uint64(text[p + numba.uint64(1)]) << numba.uint64(8))
        | (numba.uint64(text[p + numba.uint64(2)]) << numba.uint64(16))
        | (numba.uint64(text[p + numba.uint64(3)]) << numba.uint64(24))
        | (numba.uint64(text[p + numba.uint64(4)]) << numba.uint64(32))
        | (numba.uint64(text[p + numba.uint64(5)]) << numba.uint64(40))
        | (numba.uint64(text[p + numba.uint64(6)]) << numba.uint64(48))
        | (numba.uint64(text[p + numba.uint64(7)]) << numba.uint64(56))
    )


@compiled
def _number(word):
    """Feet that a word spells in the columns `ddddd.d`, and what is wrong with it, 0 for nothing.

    Blanks and a minus in front are allowed.
    """
    one, byte, eight = numba.uint64(1), numba.uint64(255), numba.uint64(8)
    value = word ^ _NUMBER
    other = (value + _NOT_NUMBER) & _HIGH
    before = other | (other - (other >> numba.uint64(7)))  # all ones in bytes that hold something else
    mark = (word ^ _BLANKS) & before
    sign = _MINUS & (before ^ (before >> eight))  # what a minus before the first digit leaves
    minus = mark != numba.uint64(0)
    fault = (
        (before & (before + one))
        | (mark ^ (sign if minus else numba.uint64(0)))
        | (before >> numba.uint64(40))
    )
    digits = value & ~before
    pairs = digits * numba.uint64(10) + (digits >> eight)
    number = (
        (pairs & byte) * numba.uint64(10000)
        + ((pairs >> numba.uint64(16)) & byte) * numba.uint64(100)
        + ((pairs >> numba.uint64(32)) & byte)  # ten times the fifth, and the point's nothing
        + ((digits >> numba.uint64(48)) & byte)
    )
    tenths = numba.float64(numba.int64(number))
    feet = tenths * _TENTH + tenths * _TENTH_REST
    return -feet if minus else feet, fault


@compiled
def _read_numbers(words, values, wrong):
    """Fills the numbers (4, n) that words spell, adds to `wrong` (n,) those that do not; whether any is wrong.

    The words are independent and hold no branch, so that the compiler works on several at once.
    """
    found = False
    for k in range(_LINES):
        values[0, k], count = _number(words[0, k])
        values[1, k], x = _number(words[1, k])
        values[2, k], y = _number(words[2, k])
        values[3, k], z = _number(words[3, k])
        wrong[k] |= (count | x | y | z) != numba.uint64(0)
        found |= wrong[k]
    return found


@compiled
def _take_words(text, place, step, many, words, faults, arrays, modes, marks):
    """Fills words (4, n) with the columns of count, x, y and z of so many records `step` apart, and the small columns.

    `faults` gets what is wrong with array number, mode and the count's last digit, and whether anything stands right
    before x, y or z.
    """
    five, tail = numba.uint64(0xFFFFFFFFFF), numba.uint64(0x00302E0000000000)  # '.0' behind five columns
    zero, ten, byte, space = numba.uint64(48), numba.uint64(9), numba.uint64(255), numba.uint64(32)
    for k in range(many):
        begin, end = _load(text, place), _load(text, place + 60)
        words[0, k] = (begin & five) | tail
        words[1, k] = _load(text, place + 8)
        words[2, k] = _load(text, place + 17)
        words[3, k] = _load(text, place + 26)
        marks[k] = (begin >> numba.uint64(40)) & numba.uint64(0xFFFF)
        tens, units = (end >> numba.uint64(24)) & byte, ((end >> numba.uint64(32)) & byte) ^ zero
        mode, last = (end >> numba.uint64(56)) ^ zero, ((begin >> numba.uint64(32)) & byte) ^ zero
        blank = tens == space
        tens ^= zero
        arrays[k] = units if blank else numba.uint64(10) * tens + units
        modes[k] = mode
        before = (begin >> numba.uint64(56)) | numba.uint64(text[numba.uint64(place + 16)])
        before |= numba.uint64(text[numba.uint64(place + 25)])
        faults[k] = (units > ten) | (mode > ten) | (last > ten) | ((tens > ten) & ~blank) | (before != space)
        place += step


@compiled
def _least_bytes(step):
    """The least byte that may stand at each place of so many lines of one length: a blank, or the line's end."""
    least = np.full(_LINES * step, np.int8(32))
    least[step - 1 :: step] = _NEWLINE
    return least


@compiled
def _is_plain(signed, place, least, step):
    """Whether _LINES lines of one length begin here, and nothing else than their ends is no plain ASCII."""
    for end in range(place + step - 1, place + len(least), step):
        if signed[end] != _NEWLINE:
            return False
    strange, begin = False, numba.uint64(place)
    for k in range(len(least)):
        strange |= signed[begin + numba.uint64(k)] < least[numba.uint64(k)]  # bytes above 127 are below 0
    return not strange


@compiled
def _line_end(text, place, stop):
    """Where the line that begins at `place` ends; -1 if it holds what is no one-byte text of Unix lines."""
    while place < stop and text[place] != _NEWLINE:
        if text[place] == _RETURN or text[place] > 127:
            return -1
        place += 1
    return place


@compiled
def _pick(modes, marks, wrong, faulty, wanted, many, of_mode, pick):
    """Counts the good records of each mode, in four rows so that none waits for the last, and lists those to keep."""
    picked = 0
    for k in range(many):
        if faulty and wrong[k]:
            continue
        of_mode[numba.uint64(k & 3), numba.uint64(modes[k])] += 1
        pick[numba.uint64(picked)] = k
        picked += (wanted < 0) | ((modes[k] == wanted) & (marks[k] == _NO_MARK))
    return picked


@compiled
def _scan(text, signed, start, stop, wanted, line, count, position, array, mode, flagged):
    """Fills the columns of a _Part for the lines from `start` to `stop`, behind which MARGIN more bytes are.

    Returns how many reports are kept, and the other fields of a _Part.
    """
    words, values = np.empty((4, _LINES), np.uint64), np.empty((4, _LINES), np.float64)
    wrong = np.zeros(_LINES, np.bool_)
    arrays, modes, marks = np.empty(_LINES, np.int64), np.empty(_LINES, np.int64), np.empty(_LINES, np.int64)
    odd, odds = np.empty((16, 3), np.int64), 0
    of_mode, pick = np.zeros((4, 10), np.int64), np.empty(_LINES, np.int64)
    kept, lines, first, usual, single, foreign = 0, 0, -1, COLUMNS, 0, False
    least = _least_bytes(COLUMNS + 1)
    place = start
    while place < stop:
        step, many = usual + 1, _LINES
        if single == 0 and len(least) != _LINES * step:
            least = _least_bytes(step)
        if single > 0 or place + len(least) > stop or not _is_plain(signed, place, least, step):
            single, many = (single if single > 0 else _LINES) - 1, 1
            length = _line_end(text, place, stop) - place
            if length < 0:
                foreign = True
                break
            usual, step = max(length, COLUMNS), length + 1
        if many == _LINES and step == COLUMNS + 1:  # numbers that the compiler knows make it quicker
            _take_words(text, place, COLUMNS + 1, _LINES, words, wrong, arrays, modes, marks)
        else:
            _take_words(text, place, step, many, words, wrong, arrays, modes, marks)
        faulty = _read_numbers(words, values, wrong) or step <= COLUMNS
        if faulty:
            for k in range(many):
                if wrong[k] or step <= COLUMNS:
                    if odds == len(odd):
                        odd = np.concatenate((odd, np.empty_like(odd)))
                    odd[odds, 0], odd[odds, 1], odd[odds, 2] = lines + k, place + k * step, step - 1
                    wrong[k], odds = True, odds + 1
        picked = _pick(modes, marks, wrong, faulty, wanted, many, of_mode, pick)
        if first < 0 and odds < lines + many:
            first = lines + int(np.argmin(wrong[:many]))
        for j in range(picked):
            k, to = numba.uint64(pick[j]), numba.uint64(kept + j)
            line[to], count[to] = lines + pick[j], values[0, k]
            position[to, 0], position[to, 1], position[to, 2] = values[1, k], values[2, k], values[3, k]
            array[to], mode[to], flagged[to] = arrays[k], modes[k], marks[k] != _NO_MARK
        kept += picked
        lines += many
        place += many * step
    return kept, odd[:odds], lines, first, of_mode.sum(axis=0), foreign


@warms
def _warm() -> None:
    record = b"  188   49473.6   4294.9    -30.6" + b" " * 30 + b"36  2\n"
    scan_records(np.frombuffer(record * 10, dtype=np.uint8), 0, 1)
