"""Writes the golden files: the range's formats by code of its own that knows nothing of trackerlib.

    python tests/rangefiles/make_golden.py      (made-up numbers; nothing here was measured)

A number goes into its columns as Fortran's Fw.d and Iw put it: right justified, stars if it has no room.
"""

from pathlib import Path

GOLDEN = Path(__file__).parent / "golden"
ARRAYS = {0: (100.0, 200.0, -1300.4), 7: (7012.5, 150.2, -1299.9)}
COUNTS = (0, 1, 2, 998, 999)
M = ((4.25, 0.5, -0.125), (0.5, 3.0, 0.25), (-0.125, 0.25, 6.5))
D_X = ((4.0, 0.5, -0.25), (0.5, 9.0, 0.125), (-0.25, 0.125, 16.0))
D_Y = ((25.0, -0.5, 1.0), (-0.5, 4.0, 0.25), (1.0, 0.25, 9.0))
D_XY = ((1.0, 0.25, -0.5), (0.5, 2.0, 0.75), (-0.25, 1.5, 3.0))


def fortran(value, width, decimals=None):
    text = str(value) if decimals is None else format(value, f".{decimals}f")
    return text.rjust(width) if len(text) <= width else "*" * width


def place(count, array):
    """Where an array reports the vehicle: tenths of a foot, apart by a few feet."""
    return (3000.0 + count / 2 + array / 10, -40.5 + array / 5, -310.2 - array / 10)


def t_record(count, array, mode=7, mark="  "):
    x, y, z = (fortran(v, 7, 1) for v in place(count, array))
    return (
        fortran(count, 5)
        + mark
        + " "
        + x
        + "  "
        + y
        + "  "
        + z
        + " " * 30
        + fortran(array, 2)
        + "  "
        + str(mode)
    )


def crossover_record(count, first, second):
    return "  " + fortran(count, 5) + " " + "".join("  " + fortran(v, 11, 1) for v in (*first, *second))


def covariance_rows(*matrices):
    return ["".join(fortran(v, 14, 8) for v in row) for matrix in matrices for row in matrix]


def printed():
    """Cross correlations as Appendix C prints them, and M = D_x + D_y - D_xy - D_xy' (39)."""
    three = range(3)
    correlation = [[D_XY[i][j] / (D_X[j][j] * D_Y[i][i]) ** 0.5 for j in three] for i in three]
    gap = [[D_X[i][j] + D_Y[i][j] - D_XY[i][j] - D_XY[j][i] for j in three] for i in three]
    return correlation, gap


def files():
    head = ["SIMULATED RUN OF 6/20/85"] + [f"HEADER RECORD {n}" for n in range(2, 32)]
    records = [t_record(count, array) for count in COUNTS for array in ARRAYS]
    records += [t_record(2, 7, mode=2), t_record(2, 7, mark="ED")]
    rows = [crossover_record(count, place(count, 0), place(count, 7)) for count in COUNTS]
    first = " " * 16 + "NANOOSE".ljust(10) + "  " + fortran(0, 2) + "   " + fortran(7, 2)
    trailer = crossover_record(999, ARRAYS[0], ARRAYS[7])
    return {
        "TFILE.DAT": head + records,
        "CROSSOVER.DAT": [first, *rows],
        "TRPDOTRX.DAT": [*rows, trailer],
        "ARRAYS.DAT": ["".join(fortran(v, 12, 2) for v in p) + fortran(n, 6) for n, p in ARRAYS.items()],
        "AR1.DAT": [
            f"{n:4d}  {day}" + "".join(fortran(v, 12, 2) for v in p)
            for (n, p), day in zip(ARRAYS.items(), ("850620", "6/21/85"), strict=True)
        ],
        "SIXCOL.DAT": [row[8:] for row in rows],
        "OUTPUT1.COV": covariance_rows(D_X, D_Y),
        "OUTPUT2.COV": covariance_rows(*printed()),
        "VELOCITY.DAT": [fortran(25.0 * k, 9, 1) + fortran(4880.0 - k, 12, 2) for k in range(55)],
        "MMATRIX.M": ["".join(fortran(v, 12, 4) for v in row) for row in M],
    }


def main(folder=GOLDEN):
    for name, lines in files().items():
        (folder / name).write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
