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
    weight = 1 / np.maximum(noise[:2], LEAST_VARIANCE)
    begins = _straight_ends(sums, -1, least, most, weight)
    ends = _straight_ends(sums, 1, least, most, weight)
    left, right, together, nothing = np.empty(SUMS), np.empty(SUMS), np.empty(SUMS), np.zeros(SUMS)
    before, after, both = np.empty(7), np.empty(7), np.empty(7)
    for b in range(blocks):
        left_from, right_to = begins[b], ends[b]
        for i in range(SUMS):
            left[i], right[i] = sums[b, i] - sums[left_from, i], sums[right_to, i] - sums[b + 1, i]
            together[i] = left[i] + right[i]
        apart = (
            _misfit(together, nothing, weight)
            - _misfit(left, nothing, weight)
            - _misfit(right, nothing, weight)
        )
        one = left[0] < FEWEST or right[0] < FEWEST or apart < DOUBT
        reach = (left_from * size, b * size, min((b + 1) * size, count), min(right_to * size, count))
        if one:
            _line(together, both)
            _along_one(both, ship, epochs, reach, correlation, smooth, shared)
        else:
            _line(left, before)
            _line(right, after)
            _round_a_turn(before, after, ship, epochs, reach, correlation, smooth, shared)
    return smooth, shared


@compiled
def _along_one(line, ship, epochs, reach, correlation, smooth, shared):
    """Fills the places of pings reach[1] to reach[2] from a line through those before and after, to reach[0], [3]."""
    for k in range(reach[1], reach[2]):
        t = epochs[k] - epochs[0] - line[1]
        smooth[k, 0] = line[3] + t * line[5] + ship[0, 0]
        smooth[k, 1] = line[4] + t * line[6] + ship[0, 1]
        if correlation > 0:
            shared[k] = _shared(line, epochs, k, reach[0], reach[1], correlation)
            shared[k] += _shared(line, epochs, k, reach[2], reach[3], correlation)


@compiled
def _round_a_turn(before, after, ship, epochs, reach, correlation, smooth, shared):
    """The same from two lines: by what each is worth, and by which side of the turn a ping is on."""
    turn = _turn(before, after)
    for k in range(reach[1], reach[2]):
        t = epochs[k] - epochs[0]
        share = (1 - UNSURE if t < turn else UNSURE) / _doubt(before, t)
        share /= share + (UNSURE if t < turn else 1 - UNSURE) / _doubt(after, t)
        for axis in range(2):
            place = share * (before[3 + axis] + (t - before[1]) * before[5 + axis])
            place += (1 - share) * (after[3 + axis] + (t - after[1]) * after[5 + axis])
            smooth[k, axis] = place + ship[0, axis]
        if correlation > 0:
            shared[k] = share * _shared(before, epochs, k, reach[0], reach[1], correlation)
            shared[k] += (1 - share) * _shared(after, epochs, k, reach[2], reach[3], correlation)


@compiled
def _running_sums(ship, epochs, size):
    """Sums (blocks + 1, SUMS) of all blocks before each, counted from the first ping's place and instant."""
    count = len(ship)
    blocks = (count + size - 1) // size
    sums = np.zeros((blocks + 1, SUMS))
    t0, x0, y0 = epochs[0], ship[0, 0], ship[0, 1]
    for b in range(blocks):
        last = min((b + 1) * size, count)
        st = stt = sx = stx = sxx = sy = sty = syy = 0.0
        for k in range(b * size, last):
            t, x, y = epochs[k] - t0, ship[k, 0] - x0, ship[k, 1] - y0
            st, stt = st + t, stt + t * t
            sx, stx, sxx = sx + x, stx + t * x, sxx + x * x
            sy, sty, syy = sy + y, sty + t * y, syy + y * y
        own = (float(last - b * size), st, stt, sx, stx, sxx, sy, sty, syy)
        for i in range(SUMS):
            sums[b + 1, i] = sums[b, i] + own[i]
    return sums


@compiled
def _straight_ends(sums, way, least, most, weight):
    """For each block, the edge up to which the track beside it, after (way 1) or before (-1), is one straight line.

    From block to block the end stays and the beginning moves up. Then half as much again is added as long as the line
    through it is the same (Chow's test).
    """
    last = len(sums) - 1
    ends = np.empty(last, np.int64)
    end = 0 if way > 0 else last
    for n in range(last):
        b = n if way > 0 else last - 1 - n
        edge = b + 1 if way > 0 else b
        if way * (end - edge) < least:
            end = min(max(edge + way * least, 0), last)
        while 0 < end < last and way * (end - edge) < most:
            further = end + way * max(way * (end - edge) // 2, least)
            further = min(max(further, 0), last)
            apart = _misfit(sums[edge], sums[further], weight) - _misfit(sums[edge], sums[end], weight)
            if apart - _misfit(sums[end], sums[further], weight) > DOUBT:
                break
            end = further
        ends[b] = end
    return ends


@compiled
def _misfit(one, other, weight):
    """Chi-square of a straight line, sailed steadily, through the pings between two running sums, either way round."""
    n, t, tt = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    spread = n * tt - t * t
    if not spread > LEAST_SPREAD * n * tt:
        return 0.0
    per, misfit = 1 / spread, 0.0
    for axis in range(2):
        k = 3 + 3 * axis
        x, tx, xx = one[k] - other[k], one[k + 1] - other[k + 1], one[k + 2] - other[k + 2]
        misfit += abs(xx - (tt * x * x - 2 * t * x * tx + n * tx * tx) * per) * weight[axis]
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
