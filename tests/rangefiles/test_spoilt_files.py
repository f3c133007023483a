"""Any reader of the range's files answers a spoilt file with what is left of it or with a sentence, never otherwise."""

import json
import random
import re

import numpy as np
import pytest
from make_golden import GOLDEN

from trackerlib.crossover.edits import COLUMNS, parse_edits
from trackerlib.rangefiles.arrays import parse_arrays, read_arrays
from trackerlib.rangefiles.calibration_file import read_calibration
from trackerlib.rangefiles.campaign import parse_campaign
from trackerlib.rangefiles.corrected_tfile import corrected_copy
from trackerlib.rangefiles.covariance_files import read_covariances
from trackerlib.rangefiles.crossover_file import parse_crossover
from trackerlib.rangefiles.m_matrix_file import read_m_matrix
from trackerlib.rangefiles.offsets_file import parse_offsets
from trackerlib.rangefiles.segment_file import read_segment
from trackerlib.rangefiles.tfile import parse_tfile
from trackerlib.rangefiles.velocity_file import parse_velocity
from trackerlib.textfiles import InputError, decode_lines

ROUNDS = 120
SURVEY = read_arrays(GOLDEN / "ARRAYS.DAT").survey
PIECES = (
    b"", b"\r", b"\n", b"\t", b" ", b"\x00", b"\x1a", b"\x0c", b"-", b"+", b".", b",", b"9", b"e", b"nan", b"inf",
    b"1e400", b'"', b"\xff", b"\xe9", b"{", b"]", b"null", b"1_0", b"9" * 20, "é".encode(), "٣".encode(),
)  # fmt: skip
TURN = {"arrays": [{"array": 3, "rotation": np.eye(3).tolist(), "intercept_ft": [1, 2, 3]}]}
CAMPAIGN = {
    "arrays": "a", "profiles": {"1": "v"}, "runs": [{"day": 1, "run": 2, "tfile": "t", "mode": 7}],
}  # fmt: skip


def account_of_tfile(content, folder):
    """Every line is a report, a bad record or blank; and a copy of it moves what it should and nothing else."""
    reading = parse_tfile(content, "t", 31)
    written = [line for line in decode_lines(content, "t")[31:] if line[:68].strip(" ")]
    assert len(reading.reports) + len(reading.reports.bad_records) == len(written)
    which = np.flatnonzero(~reading.reports.flagged)
    copy = corrected_copy(content, reading, which, np.full((len(which), 3), -1.5), "CORRECTED COPY")
    again = parse_tfile(copy.content, "t", 31).reports
    assert np.array_equal(again.line, reading.reports.line)
    assert np.all(again.position[which] == -1.5)
    assert again.bad_records == reading.reports.bad_records


def of_covariances(content, folder):
    (folder / "OUTPUT1.COV").write_bytes((GOLDEN / "OUTPUT1.COV").read_bytes())
    (folder / "OUTPUT2.COV").write_bytes(content)
    read_covariances(folder)


def from_file(read):
    def of_content(content, folder):
        (folder / "file").write_bytes(content)
        read(folder / "file")

    return of_content


READERS = {
    "T-file": ("TFILE.DAT", account_of_tfile),
    "arrays": ("ARRAYS.DAT", lambda content, _: parse_arrays(content, "a")),
    "dated arrays": ("AR1.DAT", lambda content, _: parse_arrays(content, "a")),
    "arrays, CSV": (b"array,x,y,z\n1,2,3,-4\n2,3,4,-5\n", lambda content, _: parse_arrays(content, "a")),
    "profile": (b"0 4880\n25 4870\n50 4860\n", lambda content, _: parse_velocity(content, "v")),
    "crossover": ("CROSSOVER.DAT", lambda content, _: parse_crossover(content, "c", SURVEY)),
    "TRPDOTRX.DAT": ("TRPDOTRX.DAT", lambda content, _: parse_crossover(content, "c", SURVEY, (0, 7))),
    "MMATRIX.M": ("MMATRIX.M", from_file(read_m_matrix)),
    "OUTPUT2.COV": ("OUTPUT2.COV", of_covariances),
    "segment": (b"RANGE  4\n 1 2 3 4\n 2 3 4 5\n", from_file(read_segment)),
    "campaign": (
        json.dumps(CAMPAIGN).encode(),
        lambda content, folder: parse_campaign(content, "c.json", folder),
    ),
    "calibration": (json.dumps(TURN).encode(), from_file(read_calibration)),
    "offsets": (
        b"day,run,pair,offset_ms\n1,1,a,3\n1,1,b,4\n",
        lambda content, _: parse_offsets(decode_lines(content, "o"), "o"),
    ),
    "edits": (
        (",".join(COLUMNS) + "\nnow,exclude,7,1,2,321,44,45,t.dat,turning\n").encode(),
        lambda content, _: parse_edits(decode_lines(content, "e"), "e"),
    ),
}


def spoilt(content, chance):
    """The content with some bytes changed, put in, left out, or its end cut off."""
    out = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 3, 6))):
        place, kind = chance.randrange(len(out) + 1), chance.random()
        if kind < 0.7:
            out[place : place + (kind < 0.4)] = chance.choice(PIECES)
        elif kind < 0.85:
            del out[place : place + chance.randrange(1, 40)]
        else:
            out = out[:place]
    return bytes(out)


@pytest.mark.parametrize("name", READERS)
def test_a_spoilt_file_gives_what_is_left_of_it_or_a_sentence(name, tmp_path):
    whole, read = READERS[name]
    content = whole if isinstance(whole, bytes) else (GOLDEN / whole).read_bytes()
    read(content, tmp_path)
    sentences = []
    for seed in range(ROUNDS):
        try:
            read(spoilt(content, random.Random(seed)), tmp_path)
        except InputError as error:
            sentences.append(str(error))
    assert 0 < len(sentences) < ROUNDS
    assert all(re.match(r"\S+[:,] \w.*", one) for one in sentences)  # the file, and what is wrong with it
