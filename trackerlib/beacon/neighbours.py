"""Where the ship was at each ping, told by the others: nothing of the ping's own position error is in it.

    smooth, shared = smooth_track(ship, epochs, noise, neighbours, correlation)

The track is cut into blocks of a few pings. On either side of a block as many pings are taken as lie on a straight
line within the noise told, so that a line is long on a leg and ends at a corner. Where the two sides make one line,
that line is the ship's place in the block; where they do not, the ship turned in it, and the place goes over from one
line to the other. The block's own pings are in neither.
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled

BLOCKS, LONGEST_BLOCK = 64, 8  # blocks in a short survey, and pings in a block of a long one
FEWEST = 3  # pings that are taken for a line whatever they look like
DOUBT = 18.5  # chi-square of four degrees of freedom, one in a thousand, above which two lines are not one
UNSURE = 0.1  # weight of the line before a turn after it, and the other way round
LEAST_VARIANCE = 1e-6  # [m^2] of a position
LEAST_SPREAD = 1e-9  # of a line's instants
FORGOTTEN = 30.0  # correlation times after which nothing is shared
SUMS = 9  # of a block: pings, t, tt, x, tx, xx, y, ty, yy


@compiled
def smooth_track(ship, epochs, noise, neighbours, correlation):
    """Ship's places (N, 2), and the covariance (N,) of such a place and the ping's own over the variance of one.

    ship : (N, 3) in the order of the epochs (N,)
    noise : variances (2 or more,) of a position east and north
    neighbours : pings on either side that are taken at most
    correlation : time, in the unit of the epochs, in which the correlation of two errors falls to 1/e; 0 for none
    """
    count = len(ship)
    size = min(max(count // BLOCKS, 1), LONGEST_BLOCK)
    sums = _running_sums(ship, epochs, size)
    blocks = len(sums) - 1
    least = (FEWEST + size - 1) // size
    most = max(neighbours // size, least)
    smooth, shared = np.empty((count, 2)), np.zeros(count)
    left, right, together = np.empty(SUMS), np.empty(SUMS), np.empty(SUMS)
    before, after, both = np.empty(7), np.empty(7), np.empty(7)
    for b in range(blocks):
        left_from = _straight_to(sums, b, -1, least, most, noise)
        right_to = _straight_to(sums, b + 1, 1, least, most, noise)
        _fill(sums, left_from, b, left)
        _fill(sums, b + 1, right_to, right)
        apart = -_misfit(left, noise) - _misfit(right, noise)
        for i in range(SUMS):
            together[i] = left[i] + right[i]
        apart += _misfit(together, noise)
        one = left[0] < FEWEST or right[0] < FEWEST or apart < DOUBT
        _line(together, both)
        _line(left, before)
        _line(right, after)
        first, last = b * size, min((b + 1) * size, count)
        turn = _turn(before, after)
        for k in range(first, last):
            t = epochs[k] - epochs[0]
            share = (1 - UNSURE if t < turn else UNSURE) / _doubt(before, t)
            share /= share + (UNSURE if t < turn else 1 - UNSURE) / _doubt(after, t)
            for axis in range(2):
                at, speed = 3 + axis, 5 + axis
                if one:
                    place = both[at] + (t - both[1]) * both[speed]
                else:
                    place = share * (before[at] + (t - before[1]) * before[speed])
                    place += (1 - share) * (after[at] + (t - after[1]) * after[speed])
                smooth[k, axis] = place + ship[0, axis]
            if correlation > 0:
                sides = (left_from * size, first, last, min(right_to * size, count))
                if one:
                    shared[k] = _shared(both, epochs, k, sides[0], sides[1], correlation)
                    shared[k] += _shared(both, epochs, k, sides[2], sides[3], correlation)
                else:
                    shared[k] = share * _shared(before, epochs, k, sides[0], sides[1], correlation)
                    shared[k] += (1 - share) * _shared(after, epochs, k, sides[2], sides[3], correlation)
    return smooth, shared


@compiled
def _running_sums(ship, epochs, size):
    """Sums (blocks + 1, SUMS) of all blocks before each, counted from the first ping's place and instant."""
    count = len(ship)
    blocks = (count + size - 1) // size
    sums = np.zeros((blocks + 1, SUMS))
    for b in range(blocks):
        for k in range(b * size, min((b + 1) * size, count)):
            t, x, y = epochs[k] - epochs[0], ship[k, 0] - ship[0, 0], ship[k, 1] - ship[0, 1]
            one = sums[b + 1]
            one[0] += 1.0
            one[1], one[2] = one[1] + t, one[2] + t * t
            one[3], one[4], one[5] = one[3] + x, one[4] + t * x, one[5] + x * x
            one[6], one[7], one[8] = one[6] + y, one[7] + t * y, one[8] + y * y
        for i in range(SUMS):
            sums[b + 1, i] += sums[b, i]
    return sums


@compiled
def _fill(sums, first, last, out):
    """Fills the sums (SUMS,) of blocks first to last, either way round, from the running sums."""
    for i in range(SUMS):
        out[i] = sums[last, i] - sums[first, i] if last > first else sums[first, i] - sums[last, i]


@compiled
def _straight_to(sums, edge, way, least, most, noise):
    """Block edge up to which the track from `edge` on, forwards (way 1) or backwards (-1), is one straight line.

    As many blocks again are added as long as the line through them is the same (Chow's test).
    """
    last = len(sums) - 1
    reach = least
    end = min(max(edge + way * reach, 0), last)
    part = np.empty(SUMS)
    _fill(sums, edge, end, part)
    misfit = _misfit(part, noise)
    while reach < most and 0 < end < last:
        wider = min(2 * reach, most)
        end_there = min(max(edge + way * wider, 0), last)
        _fill(sums, end, end_there, part)
        added = _misfit(part, noise)
        _fill(sums, edge, end_there, part)
        together = _misfit(part, noise)
        if together - misfit - added > DOUBT:
            break
        reach, end, misfit = wider, end_there, together
    return end


@compiled
def _misfit(s, noise):
    """Chi-square of a straight line, sailed steadily, through the pings of sums s (SUMS,)."""
    n = s[0]
    if n < 1:
        return 0.0
    spread, misfit = s[2] - s[1] * s[1] / n, 0.0
    slope = 1 / spread if spread > LEAST_SPREAD * s[2] else 0.0
    for axis in range(2):
        x, tx, xx = s[3 + 3 * axis], s[4 + 3 * axis], s[5 + 3 * axis]
        squares = xx - x * x / n - (tx - s[1] * x / n) ** 2 * slope
        misfit += max(squares, 0.0) / max(noise[axis], LEAST_VARIANCE)
    return misfit


@compiled
def _line(s, line):
    """Fills count, mean instant, spread of instants, mean place and velocity (7,) of the pings of sums s (SUMS,)."""
    n = max(s[0], 1.0)
    line[0], line[1], line[2] = s[0], s[1] / n, s[2] - s[1] * s[1] / n
    line[3], line[4] = s[3] / n, s[6] / n
    if line[2] > LEAST_SPREAD * s[2]:
        line[5] = (s[4] - s[1] * line[3]) / line[2]
        line[6] = (s[7] - s[1] * line[4]) / line[2]
    else:  # one instant: its mean place
        line[2], line[5], line[6] = np.inf, 0.0, 0.0


@compiled
def _doubt(line, t):
    """Variance of the place that a line tells for an instant, over that of a position; huge without pings."""
    return 1 / line[0] + (t - line[1]) ** 2 / line[2] if line[0] > 0 else 1e300


@compiled
def _turn(before, after):
    """Instant at which two lines pass closest: where the ship went over from one to the other."""
    apart = speed = 0.0
    for at in (3, 4):
        change = after[at + 2] - before[at + 2]
        gap = after[at] - after[1] * after[at + 2] - before[at] + before[1] * before[at + 2]
        apart += gap * change
        speed += change * change
    return -apart / max(speed, 1e-300)


@compiled
def _shared(line, epochs, k, first, last, correlation):
    """Covariance of ping k's error with what pings first to last say through a line, over a position's variance."""
    total = 0.0
    away = (epochs[k] - epochs[0] - line[1]) / line[2]
    for j in range(first, last):
        lag = abs(epochs[j] - epochs[k]) / correlation
        if lag < FORGOTTEN:
            total += (1 / line[0] + away * (epochs[j] - epochs[0] - line[1])) * np.exp(-lag)
    return total
