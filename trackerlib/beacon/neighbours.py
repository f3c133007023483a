"""Where the ship was at each ping, told by the others: nothing of the ping's own position error is in it.

    smooth, shared = smooth_track(ship, epochs, noise, neighbours, correlation)

The track is cut into blocks of a few pings. On either side of a block as many pings are taken as lie on a straight
line within the noise told, so that a line is long on a leg and ends at a corner. Where the two sides make one line,
that line is the ship's place in the block; where they do not, the ship turned in it, and the place goes over from one
line to the other. The block's own pings are in neither.
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled_with

BLOCKS, LONGEST_BLOCK = 64, 8  # blocks in a short survey, and pings in a block of a long one
FEWEST = 3  # pings that are taken for a line whatever they look like
DOUBT = 18.5  # chi-square of four degrees of freedom, one in a thousand, above which two lines are not one
UNSURE = 0.1  # weight of the line before a turn after it, and the other way round
LEAST_VARIANCE = 1e-6  # [m^2] of a position
LEAST_SPREAD = 1e-9  # of a line's instants
FORGOTTEN = 30.0  # correlation times after which nothing is shared
SUMS = 8  # of a block: pings, t, tt, x, tx, y, ty, xx + yy; places in standard errors

_compiled = compiled_with("contract")


@_compiled
def smooth_track(ship, epochs, noise, neighbours, correlation):
    """Ship's places (N, 2), and the covariance (N,) of such a place and the ping's own over the variance of one.

    ship : (N, 3) in the order of the epochs (N,)
    noise : variances (2 or more,) of a position east and north
    neighbours : pings on either side that are taken at most
    correlation : time, in the unit of the epochs, in which the correlation of two errors falls to 1/e; 0 for none
    """
    count = len(ship)
    size = min(max(count // BLOCKS, 1), LONGEST_BLOCK)
    scale = (np.sqrt(max(noise[0], LEAST_VARIANCE)), np.sqrt(max(noise[1], LEAST_VARIANCE)))
    sums = _running_sums(ship, epochs, size, scale)
    least = (FEWEST + size - 1) // size
    most = max(neighbours // size, least)
    smooth, shared = np.empty((count, 2)), np.zeros(count)
    begins = _straight_ends(sums, -1, least, most)
    ends = _straight_ends(sums, 1, least, most)
    for b in range(len(begins)):
        left, right = _between(sums, begins[b], b), _between(sums, b + 1, ends[b])
        both = _together(left, right)
        reach = (begins[b] * size, b * size, min((b + 1) * size, count), min(ends[b] * size, count))
        one = left[0] < FEWEST or right[0] < FEWEST
        if one or _misfit(both) - _misfit(left) - _misfit(right) < DOUBT:
            _along_one(_line(both, ship, scale), epochs, reach, correlation, smooth, shared)
        else:
            before, after = _line(left, ship, scale), _line(right, ship, scale)
            _round_a_turn(before, after, epochs, reach, correlation, smooth, shared)
    return smooth, shared


@_compiled
def _along_one(line, epochs, reach, correlation, smooth, shared):
    """Fills the places of pings reach[1] to reach[2] from a line through those before and after, to reach[0], [3]."""
    start = epochs[0] + line[1]
    for k in range(reach[1], reach[2]):
        t = epochs[k] - start
        smooth[k, 0] = line[3] + t * line[5]
        smooth[k, 1] = line[4] + t * line[6]
    if correlation > 0:
        for k in range(reach[1], reach[2]):
            shared[k] = _shared(line, epochs, k, reach[0], reach[1], correlation)
            shared[k] += _shared(line, epochs, k, reach[2], reach[3], correlation)


@_compiled
def _round_a_turn(before, after, epochs, reach, correlation, smooth, shared):
    """The same from two lines: by what each is worth, and by which side of the turn a ping is on."""
    turn, one, other = _turn(before, after), _doubt(before), _doubt(after)
    for k in range(reach[1], reach[2]):
        t = epochs[k] - epochs[0]
        from_one, from_other = t - before[1], t - after[1]
        sure = 1 - UNSURE if t < turn else UNSURE
        for_one = sure * (other[0] + from_other * from_other * other[1])
        share = for_one / (for_one + (1 - sure) * (one[0] + from_one * from_one * one[1]))
        rest = 1 - share
        smooth[k, 0] = share * (before[3] + from_one * before[5]) + rest * (after[3] + from_other * after[5])
        smooth[k, 1] = share * (before[4] + from_one * before[6]) + rest * (after[4] + from_other * after[6])
        if correlation > 0:
            shared[k] = share * _shared(before, epochs, k, reach[0], reach[1], correlation)
            shared[k] += rest * _shared(after, epochs, k, reach[2], reach[3], correlation)


@_compiled
def _running_sums(ship, epochs, size, scale):
    """Sums (blocks + 1, SUMS) of all blocks before each, from the first ping's place, in `scale`, and instant."""
    count = len(ship)
    blocks = (count + size - 1) // size
    sums = np.empty((blocks + 1, SUMS))
    t0, x0, y0 = epochs[0], ship[0, 0], ship[0, 1]
    per_x, per_y = 1 / scale[0], 1 / scale[1]
    n = st = stt = sx = stx = sy = sty = square = 0.0
    for b in range(blocks + 1):
        sums[b, 0], sums[b, 1], sums[b, 2], sums[b, 3] = n, st, stt, sx
        sums[b, 4], sums[b, 5], sums[b, 6], sums[b, 7] = stx, sy, sty, square
        for k in range(b * size, min((b + 1) * size, count)):
            t, x, y = epochs[k] - t0, (ship[k, 0] - x0) * per_x, (ship[k, 1] - y0) * per_y
            n, st, stt = n + 1, st + t, stt + t * t
            sx, stx, sy, sty = sx + x, stx + t * x, sy + y, sty + t * y
            square += x * x + y * y
    return sums


@_compiled
def _between(sums, first, last):
    """The sums (SUMS,) of blocks first to last."""
    a, b = sums[first], sums[last]
    return (
        b[0] - a[0], b[1] - a[1], b[2] - a[2], b[3] - a[3], b[4] - a[4], b[5] - a[5], b[6] - a[6], b[7] - a[7],
    )  # fmt: skip


@_compiled
def _together(a, b):
    return (
        a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7],
    )  # fmt: skip


@_compiled
def _straight_ends(sums, way, least, most):
    """For each block, the edge up to which the track beside it, after (way 1) or before (-1), is one straight line.

    From block to block the end stays and the beginning moves up. Then half as much again is added as long as the line
    through it is the same (Chow's test). Where that came to an end, it is tried again when the line is a sixteenth
    shorter, as the answer hardly changes before.
    """
    last = len(sums) - 1
    ends = np.empty(last, np.int64)
    end = 0 if way > 0 else last
    tried = 2 * most
    for n in range(last):
        b = n if way > 0 else last - 1 - n
        edge = b + 1 if way > 0 else b
        if way * (end - edge) < least:
            end, tried = min(max(edge + way * least, 0), last), 2 * most
        length = way * (end - edge)
        if 0 < end < last and length < most and 16 * length <= 15 * tried:
            end = _further(sums, edge, end, way, least, most)
            tried = way * (end - edge)
        ends[b] = end
    return ends


@_compiled
def _further(sums, edge, end, way, least, most):
    last = len(sums) - 1
    misfit = _misfit(_between(sums, edge, end))
    while 0 < end < last and way * (end - edge) < most:
        further = end + way * max(way * (end - edge) // 2, least)
        further = min(max(further, 0), last)
        whole = _misfit(_between(sums, edge, further))
        if whole - misfit - _misfit(_between(sums, end, further)) > DOUBT:
            break
        end, misfit = further, whole
    return end


@_compiled
def _misfit(s):
    """Chi-square of a straight line, sailed steadily, through the pings of sums s (SUMS,), taken either way round."""
    n, t, tt, x, tx, y, ty, square = s
    spread = n * tt - t * t
    if not spread > LEAST_SPREAD * n * tt:
        return 0.0
    told = tt * (x * x + y * y) - 2 * t * (x * tx + y * ty) + n * (tx * tx + ty * ty)
    return abs(square - told / spread)


@_compiled
def _line(s, ship, scale):
    """Count, mean instant, spread of instants, mean place and velocity (7,) of the pings of sums s (SUMS,)."""
    n, t, tt, x, tx, y, ty, _ = s
    per = 1 / max(n, 1.0)
    mean, spread = t * per, tt - t * t * per
    mean_x, mean_y = x * per, y * per
    east, north = mean_x * scale[0] + ship[0, 0], mean_y * scale[1] + ship[0, 1]
    if not spread > LEAST_SPREAD * tt:  # one instant: its mean place
        return n, mean, np.inf, east, north, 0.0, 0.0
    steep = 1 / spread
    return (
        n, mean, spread, east, north, (tx - t * mean_x) * steep * scale[0], (ty - t * mean_y) * steep * scale[1],
    )  # fmt: skip


@_compiled
def _doubt(line):
    """Variance of the place that a line tells at its mean instant, over that of a position, huge without pings; and
    what the square of the time from there adds."""
    return (1 / line[0], 1 / line[2]) if line[0] > 0 else (1e300, 0.0)


@_compiled
def _turn(before, after):
    """Instant at which two lines pass closest: where the ship went over from one to the other."""
    apart = speed = 0.0
    for at in (3, 4):
        change = after[at + 2] - before[at + 2]
        gap = after[at] - after[1] * after[at + 2] - before[at] + before[1] * before[at + 2]
        apart += gap * change
        speed += change * change
    return -apart / max(speed, 1e-300)


@_compiled
def _shared(line, epochs, k, first, last, correlation):
    """Covariance of ping k's error with what pings first to last say through a line, over a position's variance."""
    total = 0.0
    away = (epochs[k] - epochs[0] - line[1]) / line[2]
    for j in range(first, last):
        lag = abs(epochs[j] - epochs[k]) / correlation
        if lag < FORGOTTEN:
            total += (1 / line[0] + away * (epochs[j] - epochs[0] - line[1])) * np.exp(-lag)
    return total
