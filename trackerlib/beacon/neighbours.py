"""Where the ship was at each ping, told by the others: nothing of the ping's own position error is in it.

    smooth = smooth_track(ship, epochs, neighbours)
    shared = shared_errors(epochs, neighbours, correlation)

A straight line through the neighbouring positions, the ping itself left out. Where position errors are correlated
in time, the neighbours share some of the ping's error after all: how much is known.
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled

LEAST_SPREAD = 1e-9  # of a line's instants, below which it is a mean


@compiled
def smooth_track(ship, epochs, neighbours):
    """Ship's places (N, 2) on lines through up to `neighbours` pings on either side.

    ship : (N, 3) in the order of the epochs (N,)
    """
    count = len(ship)
    smooth = np.empty((count, 2))
    middle = epochs[count // 2]
    x0, y0 = ship[count // 2, 0], ship[count // 2, 1]  # sums about the middle lose no digits
    n = first = 0
    st = stt = sx = sy = stx = sty = 0.0
    last = -1
    for k in range(count):
        while last < min(k + neighbours, count - 1):
            last += 1
            t, x, y = epochs[last] - middle, ship[last, 0] - x0, ship[last, 1] - y0
            n += 1
            st, stt, sx, sy, stx, sty = st + t, stt + t * t, sx + x, sy + y, stx + t * x, sty + t * y
        while first < k - neighbours:
            t, x, y = epochs[first] - middle, ship[first, 0] - x0, ship[first, 1] - y0
            n -= 1
            st, stt, sx, sy, stx, sty = st - t, stt - t * t, sx - x, sy - y, stx - t * x, sty - t * y
            first += 1
        t, x, y = epochs[k] - middle, ship[k, 0] - x0, ship[k, 1] - y0
        others = n - 1
        t1, tt = st - t, stt - t * t
        x1, y1, tx, ty = sx - x, sy - y, stx - t * x, sty - t * y
        spread = others * tt - t1 * t1
        if others > 1 and spread > LEAST_SPREAD * others * (tt + LEAST_SPREAD):
            per = 1 / spread
            a, b = (tt - t * t1) * per, (others * t - t1) * per
            smooth[k, 0] = a * x1 + b * tx + x0
            smooth[k, 1] = a * y1 + b * ty + y0
        else:
            smooth[k, 0], smooth[k, 1] = x1 / max(others, 1) + x0, y1 / max(others, 1) + y0
    return smooth


@compiled
def shared_errors(epochs, neighbours, correlation):
    """Covariance (N,) of a smoothed place and the ping's own, of each axis, over the variance of a position.

    correlation : time, in the unit of the epochs, in which the correlation of two errors falls to 1/e
    """
    count = len(epochs)
    shared = np.zeros(count)
    if not correlation > 0:
        return shared
    for k in range(count):
        n = st = stt = sr = str_ = 0.0
        for j in range(max(k - neighbours, 0), min(k + neighbours, count - 1) + 1):
            if j != k:
                t = epochs[j] - epochs[k]
                r = np.exp(-abs(t) / correlation)
                n, st, stt, sr, str_ = n + 1, st + t, stt + t * t, sr + r, str_ + t * r
        spread = n * stt - st * st
        if n > 1 and spread > LEAST_SPREAD * n * stt:
            shared[k] = (stt * sr - st * str_) / spread
        else:
            shared[k] = sr / max(n, 1)
    return shared
