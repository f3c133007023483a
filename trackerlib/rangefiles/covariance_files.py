"""OUTPUT1.COV and OUTPUT2.COV: covariances of the residuals of two versions of a track, ft^2.

Blocks of three rows of three numbers: D_x and D_y in OUTPUT1.COV, the cross correlations and M in OUTPUT2.COV;
x is the version of the pair's second array and y that of the first, as in the report's program PRINCOM3. The
layout inside the files is ours: of that program only what the two hold is known. The cross correlations are as it
printed them, D_xy(i,j) / sqrt(D_x(j,j) D_y(i,i)), where the text of appendix C has D_x(i,i) D_y(j,j): with the
text's form its printed sets do not close on M.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackerlib.rangefiles.m_matrix_file import matrix_rows
from trackerlib.textfiles import InputError, read_lines, write_text


def write_covariances(
    folder: str | Path, of_x: np.ndarray, of_y: np.ndarray, cross: np.ndarray
) -> tuple[Path, Path]:
    """Writes D_x, D_y to OUTPUT1.COV and what follows from D_xy to OUTPUT2.COV; (3, 3) each, ft^2."""
    size = np.sqrt(np.outer(np.diag(of_y), np.diag(of_x)))
    correlation = cross / np.where(size > 0, size, 1.0)  # a track without noise on an axis has none with it
    gap = of_x + of_y - cross - cross.T
    paths = Path(folder) / "OUTPUT1.COV", Path(folder) / "OUTPUT2.COV"
    write_text(paths[0], matrix_rows(of_x) + matrix_rows(of_y))
    write_text(paths[1], matrix_rows(correlation) + matrix_rows(gap))
    return paths


def read_covariances(folder: str | Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """D_x, D_y and D_xy (3, 3) of the two files in a folder, ft^2.

    Raises InputError where a file holds no two blocks, a variance is negative, or M is not that of the rest.
    """
    of_x, of_y = _two_blocks(Path(folder) / "OUTPUT1.COV")
    correlation, gap = _two_blocks(Path(folder) / "OUTPUT2.COV")
    if np.any(np.diag(of_x) < 0) or np.any(np.diag(of_y) < 0):
        raise InputError("OUTPUT1.COV: found a negative variance; wanted covariances")
    cross = correlation * np.sqrt(np.outer(np.diag(of_y), np.diag(of_x)))
    away = np.abs(of_x + of_y - cross - cross.T - gap).max()
    if away > 1e-3 * np.abs(gap).max() + 0.1:
        raise InputError(
            f"OUTPUT2.COV: M is {away:.2g} ft^2 from D_x + D_y - D_xy - D_xy'; wanted files of one set"
        )
    return of_x, of_y, cross


def _two_blocks(path: Path) -> np.ndarray:
    rows = []
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip():
            continue
        try:
            row = [float(cell) for cell in line.split()]
        except ValueError:
            row = []
        if len(row) != 3 or not np.isfinite(row).all():
            raise InputError(f"{path.name}, line {number}: found {line.strip()[:40]!r}; wanted three numbers")
        rows.append(row)
    if len(rows) != 6:
        raise InputError(f"{path.name}: found {len(rows)} rows; wanted two blocks of three rows")
    return np.array(rows).reshape(2, 3, 3)
