"""VELOCITY.DAT and MMATRIX.M."""

from __future__ import annotations

import numpy as np
import pytest

from trackerlib.rangefiles.m_matrix_file import read_m_matrix, write_m_matrix
from trackerlib.rangefiles.velocity_file import parse_velocity, read_velocity
from trackerlib.textfiles import InputError


def test_the_demo_table(data):
    reading = read_velocity(data / "range-demo/VELOCITY.DAT")
    assert reading.profile.unit == "ft"
    assert reading.profile.depth[:2].tolist() == [12.5, 37.5]  # speeds belong to the layers' middles
    assert reading.profile.speed_at(12.5) == pytest.approx(4880.55)


def test_speeds_at_the_depths_themselves():
    assert parse_velocity(b"0 4880\n25 4870\n", "v", speeds="boundary").profile.depth.tolist() == [0.0, 25.0]


def test_a_row_of_words_is_reported_and_the_rest_kept():
    reading = parse_velocity(b"depth speed\r\n0 4880\r\n25,4870\r\n", "v")
    assert [record.line for record in reading.bad_records] == [1]
    assert len(reading.profile.depth) == 2


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"0 4880\n0 4870\n", "v, line 2: found depth 0 ft after 0 ft"),
        (b"25 4880\n0 4870\n", "v, line 2: found depth 0 ft after 25 ft"),
        (b"0 1480\n25 1481\n", r"v, line 1: found speed 1480 \(metres per second\?\)"),
        (b"0 4880\n25 4870\ninf 4870\n", "v, line 3: found depth inf; wanted feet"),
        (b"0 4880\nnan 4870\n", "v, line 2: found depth nan; wanted feet"),
        (b"0 4880\n-25 4870\n", "v, line 2: found depth -25; wanted feet below the surface, positive down"),
        (b"0 4880\n", "found 1 rows, wanted two"),
        (b"", "empty"),
        (b"\x00\x01\x02\x03" * 9, "binary data"),
    ],
)
def test_tables_that_are_none_are_refused_in_words(content, words):
    with pytest.raises(InputError, match=words):
        parse_velocity(content, "v")


def test_m_matrix_there_and_back(tmp_path):
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3))
    write_m_matrix(tmp_path / "MMATRIX.M", root @ root.T)
    assert np.array_equal(read_m_matrix(tmp_path / "MMATRIX.M"), (root @ root.T + (root @ root.T).T) / 2)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 2 3\n4 5 6\n", "three rows of three"),
        ("1 0 0\n0 one 0\n0 0 1\n", "line 2: found '0 one 0'"),
        ("1 5 0\n0 1 0\n0 0 1\n", "not symmetric"),
        ("-1 0 0\n0 1 0\n0 0 1\n", "negative variance"),
    ],
)
def test_matrices_that_are_none_are_refused_in_words(tmp_path, text, words):
    (tmp_path / "m").write_text(text)
    with pytest.raises(InputError, match=words):
        read_m_matrix(tmp_path / "m")
