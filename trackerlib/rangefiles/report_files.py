"""A crossover set as the files of the 1990 report's programs: what PRINCOM3 wrote of it, and what TIMECOR read."""

from __future__ import annotations

from pathlib import Path

from trackerlib.crossover.noise import residual_noise
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.straight_line import MIN_POINTS
from trackerlib.crossover.survey import ArraySurvey
from trackerlib.rangefiles.covariance_files import write_covariances
from trackerlib.rangefiles.crossover_file import write_trpdotrx
from trackerlib.rangefiles.m_matrix_file import write_m_matrix


def write_report_files(folder: str | Path, crossover: CrossoverSet, survey: ArraySurvey) -> list[Path]:
    """Writes TRPDOTRX.DAT, and where the points are enough OUTPUT1.COV, OUTPUT2.COV and MMATRIX.M; which files.

    The covariances are those of all points about straight lines, by `residual_noise`. PRINCOM3's X is the second
    array of the pair and its Y the first (Read 1990, appendix E).
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    track, matrix = folder / "TRPDOTRX.DAT", folder / "MMATRIX.M"
    write_trpdotrx(track, crossover, survey)
    if crossover.points < MIN_POINTS:
        return [track]
    noise = residual_noise(crossover.x, crossover.y, crossover.point_count)
    covariances = write_covariances(folder, noise.second, noise.first, noise.cross.T)
    write_m_matrix(matrix, noise.gap)
    return [track, *covariances, matrix]
