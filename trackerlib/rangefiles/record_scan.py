"""Compiled scan of T-file records: well-formed ones become numbers, all others are left to be judged.

Eight columns are looked at in one step, as the eight bytes of a word: whether all are digits, blanks or a sign
in the right order, and what number they make (tenths of a foot, whole), without a string and without a loop.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numba
import numpy as np

from trackerlib.compiled import compiled, in_threads, warms

COLUMNS = 68
MARGIN = 80  # bytes behind the last record that a scan may look at
EVERY_MODE = -1
_CHUNK_BYTES = 4_000_000  # a thread of its own is worth its start
_NEWLINE, _RETURN = 10, 13

_word = np.uint64
_BLANKS, _ZEROS, _HIGH = _word(0x2020202020202020), _word(0x3030303030303030), _word(0x8080808080808080)
_NOT_DIGIT = _word(0x7676767676767676)  # added to (byte ^ '0'), sets the high bit of all but digits
_TO_HIGH = _word(0x6060606060606060)  # added to a byte, sets the high bit of all but control characters
_ONES = _word(0x0101010101010101)
_MINUS = _word(0x0D0D0D0D0D0D0D0D)  # '-' ^ ' ' in every byte
_NO_MARK = 0x2020
_LINES = 64  # looked at together


class Scan(NamedTuple):
    """Records of one stretch of a file that are well formed, and where the other lines are."""

    line: np.ndarray  # (N,) of the stretch, from 0
    point_count: np.ndarray  # (N,)
    position: np.ndarray  # (N, 3) ft
    array: np.ndarray  # (N,)
    mode: np.ndarray  # (N,)
    flagged: np.ndarray  # (N,)
    odd: np.ndarray  # (K, 3) line, start and length of every other line, blank ones too
    lines: int  # in the stretch
    well_formed: int  # of these, of any mode
    first_line: int  # of the first well-formed record of any mode, -1 for none
    modes: np.ndarray  # (10,) well-formed records of each mode
    foreign: bool  # a carriage return or a byte that is no ASCII: the scan stopped


def scan_records(text: np.ndarray, start: int, mode: int = EVERY_MODE) -> list[Scan]:
    """Scans of the stretches of a file's bytes (uint8) from `start` on, one after the other.

    mode : keep only records of that mode without an edit mark; all are checked and counted nonetheless
    The text must have one byte a character; stretches run in threads and end where lines end.
    """
    safe = _line_start(text, max(len(text) - 2 * MARGIN, start))
    stretch = max(_CHUNK_BYTES, (safe - start) // (2 * (os.cpu_count() or 1)) + 1)
    cuts = [start]
    while safe - cuts[-1] > stretch:
        cuts.append(min(_line_start(text, cuts[-1] + stretch), safe))
    if safe > cuts[-1]:
        cuts.append(safe)
    jobs = [(text, first, last, mode) for first, last in pairwise(cuts)]
    scans = in_threads(_scan_stretch, jobs)
    tail = np.full(len(text) - safe + MARGIN, ord(" "), dtype=np.uint8)
    tail[: len(text) - safe] = text[safe:]
    last = _scan_stretch(tail, 0, len(text) - safe, mode)
    last.odd[:, 1] += safe
    return [*scans, last]


def _line_start(text: np.ndarray, place: int) -> int:
    """Start of the first line that begins at `place` or later."""
    while 0 < place < len(text) and text[place - 1] != _NEWLINE:
        place += 1
    return place


def _scan_stretch(text: np.ndarray, start: int, stop: int, mode: int) -> Scan:
    text = text.view()
    text.flags.writeable = False  # as a mapped file is, so that one compilation serves both
    aligned = text[: len(text) // 8 * 8].view(np.uint64)
    size = (stop - start) // (COLUMNS + 1) + _LINES
    # made here and not in the kernel: NumPy asks the system for large pages
    line, count = np.empty(size, np.int32), np.empty(size, np.int32)
    position, array = np.empty((size, 3)), np.empty(size, np.int16)
    modes, flagged = np.empty(size, np.int8), np.empty(size, np.bool_)
    kept, *rest = _scan(text, aligned, start, stop, mode, line, count, position, array, modes, flagged)
    return Scan(line[:kept], count[:kept], position[:kept], array[:kept], modes[:kept], flagged[:kept], *rest)


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
def _read_numbers(words, values, faults):
    """Numbers that words spell in the columns `ddddd.d`, blanks and a minus in front allowed; a fault is not 0.

    The words are independent and hold no branch, so that the compiler works on several at once.
    """
    five = numba.uint64(0xFFFFFFFFFF)
    one, byte, point, nine = numba.uint64(1), numba.uint64(255), numba.uint64(46), numba.uint64(0x76)
    high, low = numba.uint64(0x000F424000000064), numba.uint64(0x0000271000000001)
    pair_mask = numba.uint64(0x000000FF000000FF)
    for k in range(len(words)):
        word = words[k]
        value = (word ^ _ZEROS) & five
        other = (value + _NOT_DIGIT) & _HIGH & five
        before = other | (other - (other >> numba.uint64(7)))  # all ones in bytes that hold no digit
        mark = (word ^ _BLANKS) & before
        sign = _MINUS & (before ^ (before >> numba.uint64(8)))  # what a minus before the first digit leaves
        minus = mark != numba.uint64(0)
        tenth = ((word >> numba.uint64(48)) & byte) ^ numba.uint64(48)
        faults[k] = (
            (before & (before + one))
            | (mark ^ (sign if minus else numba.uint64(0)))
            | (((word >> numba.uint64(40)) & byte) ^ point)
            | ((tenth + nine) & numba.uint64(128))
        )
        digits = ((value & ~before) << numba.uint64(16)) | (tenth << numba.uint64(56))
        pairs = digits * numba.uint64(10) + (digits >> numba.uint64(8))
        number = (
            (pairs & pair_mask) * high + ((pairs >> numba.uint64(16)) & pair_mask) * low
        ) >> numba.uint64(32)
        feet = numba.int64(number) / 10.0
        values[k] = -feet if minus else feet


@compiled
def _take_words(text, place, step, words, faults, arrays, modes, marks):
    """Fills words (4, n) with the columns of count, x, y and z of n records `step` apart, and the small columns.

    `faults` gets what is wrong with array number, mode and the count's last digit.
    """
    five, tail = numba.uint64(0xFFFFFFFFFF), numba.uint64(0x00302E0000000000)  # '.0' behind five columns
    zero, ten, byte = numba.uint64(48), numba.uint64(9), numba.uint64(255)
    for k in range(len(modes)):
        begin, end = _load(text, place), _load(text, place + 60)
        words[0, k] = (begin & five) | tail
        words[1, k] = _load(text, place + 8)
        words[2, k] = _load(text, place + 17)
        words[3, k] = _load(text, place + 26)
        marks[k] = (begin >> numba.uint64(40)) & numba.uint64(0xFFFF)
        tens, units = (end >> numba.uint64(24)) & byte, ((end >> numba.uint64(32)) & byte) ^ zero
        mode, last = (end >> numba.uint64(56)) ^ zero, ((begin >> numba.uint64(32)) & byte) ^ zero
        blank = tens == numba.uint64(32)
        tens ^= zero
        arrays[k] = units if blank else numba.uint64(10) * tens + units
        modes[k] = mode
        faults[k] = (units > ten) | (mode > ten) | (last > ten) | ((tens > ten) & ~blank)
        place += step


@compiled
def _is_plain(text, aligned, place, stop, lines, step):
    """Whether so many lines of one length begin here, and nothing else than their ends is no plain ASCII."""
    if place + lines * step > stop:
        return False
    for k in range(1, lines + 1):
        if text[place + k * step - 1] != _NEWLINE:
            return False
    first, last = (place + 7) // 8, (place + lines * step) // 8
    found, strange = numba.uint64(0), numba.uint64(0)
    for k in range(first, last):
        word = aligned[k]
        strange |= word
        controls = (~(word + _TO_HIGH) & _HIGH) >> numba.uint64(7)
        found += (controls * _ONES) >> numba.uint64(56)
    for k in range(place, 8 * first):
        found += numba.uint64(text[k] < 32)
        strange |= numba.uint64(text[k])
    for k in range(8 * last, place + lines * step):
        found += numba.uint64(text[k] < 32)
        strange |= numba.uint64(text[k])
    return found == numba.uint64(lines) and (strange & _HIGH) == numba.uint64(0)


@compiled
def _line_end(text, place, stop):
    """Where the line that begins at `place` ends; -1 if it holds what is no one-byte text of Unix lines."""
    while place < stop and text[place] != _NEWLINE:
        if text[place] == _RETURN or text[place] > 127:
            return -1
        place += 1
    return place


@compiled
def _scan(text, aligned, start, stop, wanted, line, count, position, array, mode, flagged):
    """Fills the columns of a Scan for the lines from `start` to `stop`, behind which MARGIN more bytes are.

    Returns how many reports are kept, and the Scan's other fields.
    """
    words, faults = np.empty((4, _LINES), np.uint64), np.empty((4, _LINES), np.uint64)
    values, wrong = np.empty((4, _LINES), np.float64), np.empty(_LINES, np.bool_)
    arrays, modes, marks = np.empty(_LINES, np.int64), np.empty(_LINES, np.int64), np.empty(_LINES, np.int64)
    odd, odds = np.empty((16, 3), np.int64), 0
    of_mode = np.zeros(10, np.int64)
    kept, lines, good, first, usual, single, foreign = 0, 0, 0, -1, COLUMNS, 0, False
    place = start
    while place < stop:
        step, many = usual + 1, _LINES
        if single > 0 or not _is_plain(text, aligned, place, stop, _LINES, step):
            single, many = (single if single > 0 else _LINES) - 1, 1
            length = _line_end(text, place, stop) - place
            if length < 0:
                foreign = True
                break
            usual, step = max(length, COLUMNS), length + 1
        _take_words(text, place, step, words, wrong[:many], arrays[:many], modes[:many], marks[:many])
        _read_numbers(words.reshape(4 * _LINES), values.reshape(4 * _LINES), faults.reshape(4 * _LINES))
        for k in range(many):
            fault = faults[0, k] | faults[1, k] | faults[2, k] | faults[3, k]
            if fault != numba.uint64(0) or wrong[k] or step <= COLUMNS:
                if odds == len(odd):
                    odd = np.concatenate((odd, np.empty_like(odd)))
                odd[odds, 0], odd[odds, 1], odd[odds, 2] = lines + k, place + k * step, step - 1
                odds += 1
                continue
            good += 1
            of_mode[modes[k]] += 1
            if first < 0:
                first = lines + k
            line[kept], count[kept] = lines + k, values[0, k]
            position[kept, 0], position[kept, 1], position[kept, 2] = values[1, k], values[2, k], values[3, k]
            array[kept], mode[kept], flagged[kept] = arrays[k], modes[k], marks[k] != _NO_MARK
            kept += (wanted < 0) | ((modes[k] == wanted) & (marks[k] == _NO_MARK))
        lines += many
        place += many * step
    return kept, odd[:odds], lines, good, first, of_mode, foreign


def first_lines(scans: Sequence[Scan], first_line: int) -> list[int]:
    """Number of the first line of each stretch, where that of the first stretch is told."""
    return np.cumsum([first_line, *(scan.lines for scan in scans[:-1])]).tolist()


def joined(scans: Sequence[Scan], first_line: int) -> list[np.ndarray]:
    """Columns of all scans: line, point count, position, array, mode, flag; lines numbered from `first_line`."""
    for scan, number in zip(scans, first_lines(scans, first_line), strict=True):
        scan.line[:] += number
        scan.odd[:, 0] += number
    filled = [scan for scan in scans if len(scan.line)] or [scans[0]]
    if len(filled) == 1:
        return list(filled[0][:6])
    return in_threads(np.concatenate, [([scan[k] for scan in filled],) for k in range(6)])


@warms
def _warm() -> None:
    record = b"  188   49473.6   4294.9    -30.6" + b" " * 30 + b"36  2\n"
    scan_records(np.frombuffer(record * 10, dtype=np.uint8), 0)
