"""What pings one at a time have said so far, in weighted sums that never grow.

    sums = LiveSums(unknowns)
    absorb(rows, first, last, count, theta, gps_variance, range_variance, cut, scale, *sums.arrays)
    solve_sums(sums.moments, theta)

An instrument is made at the place that the straight line through a ping's neighbours gives the ship, which holds
none of the ping's own noise; where neighbours lie too far apart for that, at the ping's own place, and what its noise
then leaves in the mean is taken out.
"""

from __future__ import annotations

import numpy as np

from trackerlib.beacon import squared_sums
from trackerlib.beacon.minimise import CUT
from trackerlib.beacon.small_systems import scaled_solve
from trackerlib.beacon.squared_sums import ONE
from trackerlib.beacon.squared_sums import RANGE as RANGES
from trackerlib.beacon.unbiased import NEIGHBOUR_SHARE
from trackerlib.compiled import compiled, warms

NEIGHBOURS = 10  # pings on either side whose straight line stands for the ship's place
LAGS = 128  # of residuals whose correlation is followed
STEPS = 30
AT_REST, ROUND_OFF = 1e-6, 0.01  # steps [m] that end the search: at once, and where they grow no smaller
RANGE_SQUARED = squared_sums.COLUMNS  # the sums' last column, after those of squared_sums
EAST, NORTH, UP, TIME, RANGE = range(5)  # columns of a ping


class LiveSums:
    """All that the pings absorbed so far have to say."""

    def __init__(self, unknowns: int):
        self.moments = np.zeros((unknowns, RANGE_SQUARED + 1))
        self.spread = np.zeros((unknowns, unknowns))
        self.tally = np.zeros(3)  # pings used, weighted squares, squares of range residuals [m^2]
        self.products = np.zeros(LAGS + 1)  # of whitened residuals, by lag
        self.recent = np.zeros(LAGS + 1)  # the last of them, newest at `tally[0] % (LAGS + 1)`
        self.told = np.zeros((unknowns, unknowns))  # covariance of the fix that new pings are held against

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """All that kernels write to, in the order in which they take it."""
        return self.moments, self.spread, self.tally, self.products, self.recent, self.told

    def copy(self) -> LiveSums:
        """The same sums, to be added to apart from these."""
        other = LiveSums(len(self.spread))
        for mine, theirs in zip(self.arrays, other.arrays, strict=True):
            theirs[:] = mine
        return other

    def autocorrelation(self) -> np.ndarray:
        """Autocorrelation of the residuals at lags 0, 1, ..., as far as a quarter of the series."""
        lags = min(int(self.tally[0]) // 4, LAGS) + 1
        return self.products[:lags] / max(self.products[0], 1e-300)


@compiled
def absorb(
    rows, first, last, count, theta, gps_variance, range_variance, cut, scale,
    moments, spread, tally, products, recent, told,
):  # fmt: skip
    """Adds pings first to last (their running numbers) to the sums; `last`."""
    unknowns, kept = len(theta), len(rows)
    instrument, column = np.empty(unknowns), np.empty(RANGE_SQUARED + 1)
    gps, rng = gps_variance * scale * scale, range_variance * scale * scale
    for k in range(first, last):
        row = rows[k % kept]
        t, up = row[TIME], row[UP]
        vx, vy, vz = (theta[4], theta[5], theta[6]) if unknowns > 4 else (0.0, 0.0, 0.0)
        x, y, z = row[EAST] - theta[0] - t * vx, row[NORTH] - theta[1] - t * vy, theta[2] + t * vz - up
        s = row[RANGE] - theta[3]
        q = x * x + y * y - 2 * gps + z * z - s * s + rng
        east, north, near = _place_by_neighbours(
            rows, k, max(count - kept, 0), count, NEIGHBOUR_SHARE * abs(s)
        )
        ix, iy = (east - theta[0] - t * vx, north - theta[1] - t * vy) if near else (x, y)
        h2 = ix * ix + iy * iy
        s2 = h2 + z * z
        w = 1 / (4 * (h2 + gps) * gps_variance + (4 * s2 + 2 * rng) * range_variance)
        whitened = q * np.sqrt(w)
        instrument[0], instrument[1], instrument[2], instrument[3] = -2 * ix, -2 * iy, 2 * z, 2 * np.sqrt(s2)
        for i in range(4, unknowns):
            instrument[i] = t * instrument[i - 4]
        if abs(whitened) > cut * scale * np.sqrt(1 + w * _form(told, instrument)):
            continue
        _fill_column(row, rng - 2 * gps, column)
        for i in range(unknowns):
            for j in range(RANGE_SQUARED + 1):
                moments[i, j] += w * instrument[i] * column[j]
            for j in range(unknowns):
                spread[i, j] += w * instrument[i] * instrument[j]
        if not near:
            for axis in (EAST, NORTH):
                _take_out_own(axis, row, instrument, w, gps, gps_variance + range_variance, moments)
        _follow_residual(whitened, int(tally[0]), products, recent)
        tally[0] += 1
        tally[1] += whitened * whitened
        tally[2] += q * q / (4 * s2)
    return last


@compiled
def _form(matrix, vector):
    """vector' matrix vector."""
    total = 0.0
    for i in range(len(vector)):
        for j in range(len(vector)):
            total += vector[i] * matrix[i, j] * vector[j]
    return total


@compiled
def invert_spread(spread, told):
    """Fills the inverse of a spread (P, P); it stays as it was where there is none."""
    inverse = np.eye(len(spread))
    if scaled_solve(spread.copy(), inverse):
        told[:] = inverse


@compiled
def _fill_column(row, known, column):
    """Fills what a ping's instrument is multiplied by; `known` is what its noise adds to q in the mean."""
    x, y, up, r, t = row[EAST], row[NORTH], row[UP], row[RANGE], row[TIME]
    column[0] = x * x + y * y + up * up - r * r + known
    column[1], column[2], column[3], column[RANGES], column[ONE] = x, y, up, r, 1.0
    column[6], column[7], column[8], column[9], column[10] = t * x, t * y, t * up, t, t * t
    column[RANGE_SQUARED] = r * r


@compiled
def _follow_residual(whitened, used, products, recent):
    """Adds a residual, the `used`-th, to the products by lag."""
    lags = len(products)
    recent[used % lags] = whitened
    for lag in range(min(used, lags - 1) + 1):
        products[lag] += whitened * recent[(used - lag) % lags]


@compiled
def _place_by_neighbours(rows, k, oldest, count, reach):
    """Where the straight line through the neighbours of ping k has the ship, and whether they all lie near."""
    here, kept = rows[k % len(rows)], len(rows)
    n = 0
    st = stt = sx = sy = stx = sty = farthest = 0.0
    for j in range(max(k - NEIGHBOURS, oldest), min(k + NEIGHBOURS, count - 1) + 1):
        if j == k:
            continue
        other = rows[j % kept]
        lag, x, y = other[TIME] - here[TIME], other[EAST] - here[EAST], other[NORTH] - here[NORTH]
        n += 1
        st, stt = st + lag, stt + lag * lag
        sx, sy, stx, sty = sx + x, sy + y, stx + lag * x, sty + lag * y
        farthest = max(farthest, x * x + y * y)
    bottom = n * stt - st * st
    if bottom > 0:
        east, north = (stt * sx - st * stx) / bottom, (stt * sy - st * sty) / bottom
    else:
        east, north = sx / max(n, 1), sy / max(n, 1)
    return here[EAST] + east, here[NORTH] + north, n > 0 and farthest < reach * reach


@compiled
def _take_out_own(axis, row, instrument, w, gps, variances, moments):
    """Takes out of the moments what an instrument at the ping's own noisy place leaves in the mean.

    As `squared_sums.take_out_shared` does, all of the error being shared.
    """
    unknowns, t = len(instrument), row[TIME]
    d, s = -instrument[axis] / 2, instrument[3]
    by_weight = -16 * gps * d * w * w * variances
    for i in range(unknowns):
        change = by_weight * instrument[i]
        if i % 4 == axis:
            change -= 4 * gps * w * (1.0 if i < 4 else t)
        elif i == 3:
            change += 8 * gps * w * d / s
        moments[i, 0] -= change * row[axis]
        moments[i, 1 + axis] -= change / 2
        moments[i, 6 + axis] -= change * t / 2


@compiled
def solve_sums(moments, theta):
    """Newton's steps to where the score of the sums is zero, in place; whether they came to rest."""
    unknowns = len(theta)
    score, own = np.empty(unknowns), np.empty((unknowns, unknowns))
    before = np.inf
    for _ in range(STEPS):
        squared_sums.score(moments, theta, score, own)
        scale = np.sqrt(np.abs(np.diag(own)))
        if not np.all(scale > 0) or not np.all(np.isfinite(own)):
            return False
        scaled = own / scale.reshape(-1, 1) / scale.reshape(1, -1)
        if abs(np.linalg.det(scaled)) < 1e-30:
            return False
        step = np.linalg.solve(scaled, -score / scale) / scale
        theta += step
        size = np.max(np.abs(step))
        if size < AT_REST or (size < ROUND_OFF and size >= before):
            return True
        before = size
    return False


@warms
def _warm() -> None:
    for unknowns in (4, 7):
        theta = np.zeros(unknowns)
        theta[2] = -100.0
        sums = LiveSums(unknowns)
        rows = np.random.default_rng(1).normal(size=(40, 5))
        absorb(rows, 0, 30, 40, theta, 1.0, 1.0, CUT, 1.0, *sums.arrays)
        solve_sums(sums.moments, theta)
        invert_spread(np.eye(unknowns), sums.told)
