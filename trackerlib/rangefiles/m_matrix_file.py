"""MMATRIX.M: the residual covariance M of a crossover set, three rows of three numbers, ft^2."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackerlib.textfiles import InputError, read_lines, write_text


def read_m_matrix(path: str | Path) -> np.ndarray:
    """M (3, 3) [ft^2] of a file. Raises InputError unless it is a symmetric matrix with no negative variance."""
    name = Path(path).name
    rows = []
    for number, line in enumerate(read_lines(path), 1):
        if not line.strip() or line.lstrip().startswith(("%", "#")):
            continue
        try:
            rows.append([float(cell) for cell in line.strip().strip("[];").replace(",", " ").split()])
        except ValueError:
            raise InputError(
                f"{name}, line {number}: found {line.strip()[:40]!r}; wanted three numbers"
            ) from None
    if [len(row) for row in rows] != [3, 3, 3]:
        raise InputError(
            f"{name}: found rows of {[len(row) for row in rows]} numbers; wanted three rows of three"
        )
    matrix = np.array(rows)
    if not np.isfinite(matrix).all() or not matrix.any():
        raise InputError(
            f"{name}: found {'zeros' if not matrix.any() else 'nan or inf'}; wanted a covariance in ft^2"
        )
    if not np.allclose(matrix, matrix.T, rtol=1e-3, atol=1e-3 * np.abs(matrix).max()):
        raise InputError(f"{name}: found a matrix that is not symmetric; wanted a covariance")
    matrix = (matrix + matrix.T) / 2
    if np.linalg.eigvalsh(matrix)[0] < -1e-6 * np.trace(matrix):
        raise InputError(f"{name}: found a matrix with a negative variance; wanted a covariance")
    return matrix


def write_m_matrix(path: str | Path, matrix: np.ndarray) -> None:
    """Writes M (3, 3) so that reading it gives the same numbers."""
    write_text(path, matrix_rows(matrix))


def matrix_rows(matrix: np.ndarray) -> str:
    """Rows of a matrix as text that gives the same numbers when it is read."""
    return "".join("".join(f" {value!r:>24}" for value in row) + "\n" for row in matrix.tolist())
