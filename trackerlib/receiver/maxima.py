"""Running sum of the levels and its largest maxima in every period, as the report's controller finds them.

Wojcik (1993), (5-5) and Appendix 2. The controller's window rule, mended where it fails:
  A maximum within a window of a larger one is the same signal; it is left out, and ties go to the later.
  The controller compares every sample, so that the tail of a strong signal, one window on, becomes its second
  maximum. Here only samples that rise above both neighbours count.
  Near the start and end of a period the controller replaces its first maximum, whatever it was, and the
  earlier signal is lost; a signal across the end is reported in both periods or in neither. Here maxima on both sides
  of a boundary are compared with each other and each belongs to the period of its leading edge.
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled, warms
from trackerlib.receiver.front_end import DB_PER_COUNT

SCALE = 256  # sums are integers, in parts of a count, so that they are exact
SUM_STATE = np.dtype(
    [
        ("total", np.int64),  # of the last `taps` levels, brought to no attenuation
        ("before", np.int64),  # the sum that last differed from the present one
        ("plateau", np.int64),  # number of the sample where the present sum was first reached
        ("rising", np.bool_),
        ("attenuation", np.float64),  # of the last sample [dB]
    ]
)
CANDIDATE = np.dtype(
    [
        ("place", np.float64),  # sample number, with its fraction
        ("total", np.int64),
        ("level", np.float64),  # mean of the levels as the recorder draws them
        ("attenuation", np.float64),
        ("verdict", np.int64),  # while a period is judged: one of those below
    ]
)
FREE, SHADOWED, PICKED, TAKEN = 0, 1, 2, 3


@compiled
def sum_levels(levels, attenuations, first, state, ring, candidates, found):
    """Adds the local maxima of the running sum to `candidates` after `found`; returns how many there are then.

    levels, attenuations : (M,) of samples from number `first` on
    ring : (taps,) the last levels brought to no attenuation, and nothing else of them; state : a SUM_STATE
    Levels are brought to one attenuation before they are added, so that a step of the gain in the midst of
    a signal does not move its maximum. The place of a maximum is the vertex of a parabola through three sums, or the
    middle of a plateau.
    """
    taps = len(ring)
    slot = first % taps
    last, lifted = state.attenuation, _lifted(state.attenuation)
    for k in range(len(levels)):
        if attenuations[k] != last:
            last, lifted = attenuations[k], _lifted(attenuations[k])
        level = SCALE * np.int64(levels[k]) + lifted
        total = state.total + level - ring[slot]
        ring[slot] = level
        slot = slot + 1 if slot + 1 < taps else 0
        if total < state.total and state.rising:
            _add(candidates[found], state, first + k, total, taps)
            found += 1
        if total != state.total:
            state.before = state.total
            state.rising = total > state.total
            state.plateau = first + k
            state.total = total
        state.attenuation = last
    return found


@compiled
def _lifted(attenuation):
    """What an attenuation took from a level, in parts of a count."""
    return np.int64(SCALE * attenuation / DB_PER_COUNT + 0.5)


@compiled
def _add(candidate, state, now, total, taps):
    """A maximum that ended before sample `now`, whose sum is `total`."""
    candidate.place = 0.5 * (state.plateau + now - 1)
    if now - state.plateau == 1:
        rise, fall = state.total - state.before, state.total - total
        candidate.place += 0.5 * (rise - fall) / (rise + fall)
    candidate.total = state.total
    candidate.level = max(state.total / (SCALE * taps) - state.attenuation / DB_PER_COUNT, 0.0)
    candidate.attenuation = state.attenuation
    candidate.verdict = FREE


@compiled
def judge(candidates, found, low, high, window, chosen):
    """Places in `candidates` of the largest maxima with low <= place < high, strongest first, in `chosen` (N,).

    Returns how many there are. Candidates reach two windows beyond either end; those that an earlier call
    chose keep their shadow.
    """
    for c in range(found):
        if candidates[c].verdict != TAKEN:
            candidates[c].verdict = FREE
    for c in range(found):
        if candidates[c].verdict == TAKEN:
            _shade(candidates, found, c, window)
    count = 0
    while count < len(chosen):
        best = -1
        for c in range(found):
            free = candidates[c].verdict == FREE
            if free and (best < 0 or candidates[c].total >= candidates[best].total):
                best = c
        if best < 0:
            break
        candidates[best].verdict = PICKED
        _shade(candidates, found, best, window)
        if low <= candidates[best].place < high:
            chosen[count] = best
            count += 1
    for c in chosen[:count]:
        candidates[c].verdict = TAKEN
    return count


@compiled
def _shade(candidates, found, best, window):
    """Leaves out what lies within a window of a larger maximum. Candidates stand in order of place."""
    c = best - 1
    while c >= 0 and candidates[best].place - candidates[c].place <= window:
        if candidates[c].verdict == FREE:
            candidates[c].verdict = SHADOWED
        c -= 1
    c = best + 1
    while c < found and candidates[c].place - candidates[best].place <= window:
        if candidates[c].verdict == FREE:
            candidates[c].verdict = SHADOWED
        c += 1


@compiled
def forget(candidates, found, before):
    """Drops the candidates that lie before a place; returns how many are left."""
    gone = 0
    while gone < found and candidates[gone].place < before:
        gone += 1
    for c in range(found - gone):
        candidates[c] = candidates[c + gone]
    return found - gone


@warms
def _warm():
    state, candidates = np.zeros(1, SUM_STATE), np.zeros(4, CANDIDATE)
    levels, attenuations = np.array([0, 9, 0], np.uint8), np.zeros(3)
    found = sum_levels(levels, attenuations, 0, state[0], np.zeros(1, np.int64), candidates, 0)
    judge(candidates, found, 0.0, 3.0, 1.0, np.zeros(1, np.int64))
    forget(candidates, found, 3.0)
