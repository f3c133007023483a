"""The range's formats as an independent generator writes them, read, written again and read back."""

import make_golden
import numpy as np
import pytest
from make_golden import ARRAYS, COUNTS, GOLDEN, place

from trackerlib.crossover.gating import gate_reports
from trackerlib.rangefiles.arrays import read_arrays
from trackerlib.rangefiles.covariance_files import read_covariances, write_covariances
from trackerlib.rangefiles.crossover_file import read_crossover, write_crossover, write_trpdotrx
from trackerlib.rangefiles.m_matrix_file import read_m_matrix, write_m_matrix
from trackerlib.rangefiles.tfile import read_tfile
from trackerlib.rangefiles.velocity_file import read_velocity
from trackerlib.textfiles import InputError

SURVEY = read_arrays(GOLDEN / "ARRAYS.DAT").survey


def test_the_golden_files_are_those_of_the_generator(tmp_path):
    make_golden.main(tmp_path)
    for path in GOLDEN.iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes()


def test_the_t_file_gates_to_the_crossover_file_byte_for_byte(tmp_path):
    reading = read_tfile(GOLDEN / "TFILE.DAT")
    assert reading.run_date == np.datetime64("1985-06-20")
    result = gate_reports(reading.reports, SURVEY, 7, gap_counts=5000)
    (crossover,) = result.sets
    assert crossover.pair == (0, 7)
    assert tuple(crossover.point_count) == COUNTS
    write_crossover(tmp_path / "set.txt", crossover)
    ours, golden = (p.read_text().splitlines() for p in (tmp_path / "set.txt", GOLDEN / "CROSSOVER.DAT"))
    assert ours[1:] == golden[1:]
    assert ours[0][26:] == golden[0][26:]  # the range's name is not in a T-file


def test_a_set_that_ends_at_a_real_999_loses_nothing(tmp_path):
    with_trailer = read_crossover(GOLDEN / "TRPDOTRX.DAT", SURVEY).set
    with_first_line = read_crossover(GOLDEN / "CROSSOVER.DAT", SURVEY).set
    for crossover in (with_trailer, with_first_line):
        assert crossover.pair == (0, 7)
        assert tuple(crossover.point_count) == COUNTS
        assert crossover.y[-1].tolist() == pytest.approx(place(999, 7))
    write_trpdotrx(tmp_path / "TRPDOTRX.DAT", with_trailer, SURVEY)
    assert (tmp_path / "TRPDOTRX.DAT").read_bytes() == (GOLDEN / "TRPDOTRX.DAT").read_bytes()


def test_the_other_tables():
    assert dict(zip(SURVEY.number.tolist(), SURVEY.position.tolist(), strict=True)) == {
        number: list(position) for number, position in ARRAYS.items()
    }
    profile = read_velocity(GOLDEN / "VELOCITY.DAT").profile
    assert (profile.depth[0], profile.speed[0], len(profile.depth)) == (12.5, 4880.0, 55)
    assert read_m_matrix(GOLDEN / "MMATRIX.M").tolist() == [list(row) for row in make_golden.M]
    dated = read_arrays(GOLDEN / "AR1.DAT").survey
    assert np.array_equal(dated.position, SURVEY.position)
    assert dated.survey_date.astype(str).tolist() == ["1985-06-20", "1985-06-21"]


def test_covariances_of_a_pair_as_appendix_c_prints_them():
    told = (make_golden.D_X, make_golden.D_Y, make_golden.D_XY)
    for one, other in zip(read_covariances(GOLDEN), told, strict=True):
        assert np.allclose(one, other, atol=2e-7)  # of correlations with eight decimals


def test_a_six_column_file_holds_the_same_positions_without_their_counts():
    six = read_crossover(GOLDEN / "SIXCOL.DAT", pair=(0, 7)).set
    seven = read_crossover(GOLDEN / "CROSSOVER.DAT").set
    assert np.array_equal(six.x, seven.x)
    assert np.array_equal(six.y, seven.y)
    assert six.point_count.tolist() == [1, 2, 3, 4, 5]


def test_matrices_are_read_back_as_they_were(tmp_path):
    rng = np.random.default_rng(1)
    joint = np.cov(rng.normal(size=(6, 40)))
    first, second, cross = joint[:3, :3], joint[3:, 3:], joint[:3, 3:]
    write_covariances(tmp_path, first, second, cross)
    back = read_covariances(tmp_path)
    assert all(
        np.allclose(one, other, rtol=1e-14) for one, other in zip(back, (first, second, cross), strict=True)
    )
    gap = first + second - cross - cross.T
    write_m_matrix(tmp_path / "MMATRIX.M", gap)
    assert np.allclose(read_m_matrix(tmp_path / "MMATRIX.M"), gap, rtol=1e-15)


def test_a_track_without_noise_is_read_back_too(tmp_path):
    flat = np.diag([4.0, 9.0, 0.0])
    write_covariances(tmp_path, flat, flat, np.diag([1.0, 2.0, 0.0]))
    assert np.allclose(read_covariances(tmp_path)[2], np.diag([1.0, 2.0, 0.0]))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 2 3\n", "found 1 rows"),
        ("1 2 x\n", "line 1: found '1 2 x'"),
        ("9 0 0\n0 9 0\n0 0 9\n" * 2, "M is"),
    ],
)
def test_covariances_that_are_none_are_refused_in_words(tmp_path, text, words):
    write_covariances(tmp_path, np.eye(3), np.eye(3), np.zeros((3, 3)))
    (tmp_path / "OUTPUT2.COV").write_text(text)
    with pytest.raises(InputError, match=words):
        read_covariances(tmp_path)
