"""Compiled kernel: the best chain of evenly spaced arrivals that ends with the newest one."""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled, warms

SETTLED = 5  # matches after which one match moves the interval by no more than a fifth
LONGEST = 40  # intervals that a chain goes back


@compiled
def gate(jitter_s, bend_s, gap, steps):
    """Half width [s] of the place of an arrival, `gap` intervals after a chain that spans `steps` of them."""
    return 4 * jitter_s * (1 + gap / steps) + bend_s * gap**2


@compiled
def follow_back(time_s, interval_s, jitter_s, bend, members):
    """Steps gone back from the last arrival and matches found; writes steps back into `members`, -1 for no match.

    time_s : (N,) in order; bend : greatest change of interval per second of time, relative [1/s]
    The chain ends with its last match.
    """
    members[:] = -1
    newest = len(time_s) - 1
    members[newest] = 0
    place, step, matched, last, k = time_s[newest], 0, 1, 0, newest - 1
    for step in range(1, LONGEST + 1):
        gap = step - last
        expected = place - gap * interval_s
        width = min(gate(jitter_s, bend * interval_s**2, gap, max(last, 1)), interval_s / 8)
        if expected < time_s[0] - width:
            break
        while k >= 0 and time_s[k] > expected + width:
            k -= 1
        best = k
        other = k
        while other >= 0 and time_s[other] >= expected - width:
            if abs(time_s[other] - expected) < abs(time_s[best] - expected):
                best = other
            other -= 1
        if best >= 0 and abs(time_s[best] - expected) <= width:
            members[best] = step
            interval_s -= (time_s[best] - expected) / gap / min(matched, SETTLED)
            place, last = time_s[best], step
            matched += 1
    return last, matched


@compiled
def surprise(matched, tried, chance):
    """Minus the logarithm of (a bound of) the probability that chance alone matches so many."""
    share = matched / tried
    if share <= chance:
        return 0.0
    miss = (1 - share) * np.log((1 - share) / (1 - chance)) if share < 1 else 0.0
    return tried * (share * np.log(share / chance) + miss)


@compiled
def best_chain(time_s, shortest_s, longest_s, jitter_s, bend, least_share, members):
    """Surprise of the best chain that ends with the last arrival; writes the steps back into `members` (N,).

    The interval is tried as the time to every earlier arrival in its range. The two arrivals that suggest it do
    not count as matches.
    """
    trial = np.empty(len(time_s), np.int64)
    best, newest = 0.0, len(time_s) - 1
    density = len(time_s) / max(time_s[newest] - time_s[0], longest_s)
    for k in range(newest - 1, -1, -1):
        suggested = time_s[newest] - time_s[k]
        if suggested > longest_s:
            break
        if suggested < shortest_s:
            continue
        steps, matched = follow_back(time_s, suggested, jitter_s, bend, trial)
        if steps < 3 or matched < least_share * (steps + 1):
            continue
        chance = 1 - np.exp(-density * 4 * gate(jitter_s, bend * suggested**2, 1, 2))
        found = surprise(matched - 2, steps - 1, chance)
        if found > best:
            best = found
            members[:] = trial
    return best


@warms
def _warm() -> None:
    best_chain(np.arange(10.0), 0.5, 5.0, 1e-3, 1e-4, 0.5, np.empty(10, np.int64))
