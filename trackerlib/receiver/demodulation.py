"""Compiled kernels of the matched filter: sound to coarse I and Q, their power, and the fine time of an arrival.

A cell is a short piece of the stream (a millisecond for a 10-ms pulse). Cell c begins at sample
c rate // cells_per_s, so cells need not hold a whole number of samples or of carrier cycles. Whatever is computed
belongs to one cell or one sample of the stream, always in the same order: where blocks were cut changes no bit.
"""

from __future__ import annotations

import numpy as np

from trackerlib.compiled import compiled, compiled_with, warms

MANTISSA, EXPONENT, ULP = np.int32(0x7FFFFF), np.float32(127), np.float32(2.0**-23)  # of a float32
BEND = np.float32(0.3466)  # of log2 between powers of two, to 0.01
SIGNAL = 7.0  # power over the mean of noise
TAIL = 30.0  # log likelihood below the best that no longer matters
SERIES = 0.02  # log likelihood below which three terms are exact to 1e-7, and a difference is not
SHARE = 0.95  # of the posterior that 1.96 sigma hold
SPREAD = 1.959964
WEAK = 0.12  # shrinkage u of pulses that only luck lifts over a threshold, -8.7 dB
OVERSHOOT = 2.5  # of the greatest log likelihood above the signal-to-noise ratio: 1 and, as the greatest, 3/2


@compiled
def start_of(cell, rate_hz, cells_per_s):
    """First sample of a cell."""
    return cell * rate_hz // cells_per_s


@compiled
def scale_whole_numbers(samples, gain, out):
    """Writes integers times a gain, as float32."""
    for n in range(len(samples)):
        out[n] = np.float32(samples[n]) * gain


# Reassociation lets the sum run in vector lanes. Every cell runs over the same padded width, and so in the same order.
@compiled_with("reassoc", "contract", "nsz")
def _mix(samples, cosine, sine):
    i, q = np.float32(0), np.float32(0)
    for m in range(len(cosine)):
        i += samples[m] * cosine[m]
        q += samples[m] * sine[m]
    return i, q


@compiled
def advance(buffer, filled, base, done, numbers, mixing, rotation, iq, power, scale):
    """Levels (M,) of the milliseconds that the samples known so far complete, and the first cell they do not.

    buffer : float32, from cell `base` on, `filled` of them known; padded by the width of `mixing`
    done : first cell that was not complete before; numbers : rate_hz, cells_per_s, cells a pulse, cells a millisecond
    mixing : (2, 2, width) float32: the carrier over a cell of the shorter and of the longer length, then zeros
    rotation : (2, M) carrier's phase at sample n modulo M
    iq, power : (2, cells) and (cells,) float32 from cell `base` on, written: power of the pulse-long window that ends
        with each cell; scale : (2,) float32, see `log_levels`
    The first cell is told as -1 if the samples are not finite.
    """
    rate_hz, cells_per_s, cells, each = numbers
    drawn = done // each
    first = done - base
    done = _demodulate(buffer, filled, base, done, mixing, rotation, iq, rate_hz, cells_per_s)
    finite = _window_power(iq, power, first, done - base, cells)
    levels = np.empty(done // each - drawn, np.uint8)
    log_levels(power[drawn * each - base : done // each * each - base], scale[0], scale[1], levels)
    return levels, done if finite else -1


@compiled
def _demodulate(buffer, filled, base, done, mixing, rotation, iq, rate_hz, cells_per_s):
    """Mixes every cell that is complete down to zero frequency; returns the number of the next cell."""
    origin = start_of(base, rate_hz, cells_per_s)
    period, width = rotation.shape[1], mixing.shape[2]
    shorter = rate_hz // cells_per_s
    begin = start_of(done, rate_hz, cells_per_s)
    turn = begin % period
    while True:
        end = start_of(done + 1, rate_hz, cells_per_s)
        if end - origin > filled:
            return done
        row = end - begin - shorter
        i, q = _mix(buffer[begin - origin : begin - origin + width], mixing[row, 0], mixing[row, 1])
        c, s = rotation[0, turn], rotation[1, turn]
        iq[0, done - base] = i * c - q * s
        iq[1, done - base] = i * s + q * c
        turn = (turn + end - begin) % period
        begin = end
        done += 1


@compiled
def _window_power(iq, power, first, last, cells):
    """Writes |sum of the `cells` cells that end with each|^2 for places first to last of `power` (float32).

    Returns whether all of it is finite.
    """
    count = last - first
    i, q = np.zeros(count, np.float32), np.zeros(count, np.float32)
    for back in range(cells):
        earlier_i, earlier_q = iq[0, first - back : last - back], iq[1, first - back : last - back]
        for m in range(count):
            i[m] += earlier_i[m]
            q[m] += earlier_q[m]
    out, total = power[first:last], np.float32(0)
    for m in range(count):
        out[m] = i[m] * i[m] + q[m] * q[m]
        total += out[m]
    return np.isfinite(total)


@compiled
def log_levels(power, black, counts_per_octave, levels):
    """Writes 8-bit levels (M,) of powers (M * K,), the largest of each K: linear in decibels.

    black : level of a power of 1; a float32 read as an integer is nearly its logarithm, and BEND mends the rest
    """
    each = len(power) // len(levels) if len(levels) else 1
    largest = np.empty(len(levels), np.float32)
    for m in range(len(levels)):
        largest[m] = power[m * each]
        for k in range(1, each):
            largest[m] = max(largest[m], power[m * each + k])
    bits = largest.view(np.int32)
    for m in range(len(levels)):
        part = np.float32(bits[m] & MANTISSA) * ULP
        octaves = np.float32(bits[m]) * ULP - EXPONENT + BEND * part * (np.float32(1) - part)
        level = np.int32(black + counts_per_octave * octaves + np.float32(0.5))
        levels[m] = min(max(level, np.int32(0)), np.int32(255))


@compiled
def censored_mean(power, kept):
    """Mean of exponentially distributed powers from the `kept` smallest: the others may hold signals.

    A power above seven times the mean is a signal (of noise, one in a thousand is) and no part of the sample.
    """
    order = np.sort(power)
    weakest = 0.0
    for value in order[:kept]:
        weakest += value
    edge = float(order[kept - 1])
    mean = (weakest + (len(order) - kept) * edge) / kept
    noise = max(np.searchsorted(order, np.float32(SIGNAL * mean)), kept)
    return (weakest + (noise - kept) * edge) / kept


@compiled
def local_maxima(power, first, last, window, least):
    """Places in [first, last) where `power` is above `least` and the largest within `window` places to each side."""
    places = np.empty(last - first, np.int64)
    count = 0
    for c in range(first, last):
        here = power[c]
        if not (here > least and here > power[c - 1] and here >= power[c + 1]):
            continue
        for other in range(1, window + 1):
            if power[c - other] >= here or power[c + other] > here:
                break
        else:
            places[count] = c
            count += 1
    return places[:count]


@compiled
def log_likelihood(buffer, first, phase, count, length, rotation, noise):
    """Log likelihood (count,) of a pulse of `length` samples that begins at each of `count` samples.

    Amplitude and phase are free: it is the energy that a carrier explains by least squares, over twice the
    noise's variance a sample. phase : number of sample `first` of `buffer` in the stream; noise : that variance
    """
    period = rotation.shape[1]
    i, q = 0.0, 0.0
    for m in range(length):
        turn = (phase + m) % period
        i += buffer[first + m] * rotation[0, turn]
        q += buffer[first + m] * rotation[1, turn]
    # S = sum of exp(-2j w m) over the pulse: what is left of the carrier's second harmonic.
    double_i, double_q = 0.0, 0.0
    for m in range(length):
        c, s = rotation[0, (phase + m) % period], rotation[1, (phase + m) % period]
        double_i += c * c - s * s
        double_q += 2 * c * s
    scale = 1 / (noise * (length**2 - double_i**2 - double_q**2))
    result = np.empty(count)
    old, new = phase % period, (phase + length) % period
    for n in range(count):
        cross = double_i * (i * i - q * q) + double_q * 2 * i * q  # Re(S conj(Y)^2)
        result[n] = (length * (i * i + q * q) - cross) * scale
        c, s, d, r = rotation[0, old], rotation[1, old], rotation[0, new], rotation[1, new]
        i += buffer[first + n + length] * d - buffer[first + n] * c
        q += buffer[first + n + length] * r - buffer[first + n] * s
        double_i += (d * d - r * r) - (c * c - s * s)
        double_q += 2 * (d * r - c * s)
        old = old + 1 if old + 1 < period else 0
        new = new + 1 if new + 1 < period else 0
    return result


@compiled
def posterior_time(likelihood, threshold, lucky):
    """Mean, standard error [samples] and largest log likelihood of a pulse's begin, any begin as likely before.

    likelihood : (N,) of begins up to a pulse before and after the loudest: noise may have shown it in a wrong place
    threshold : log likelihood below which the pulse would not have been told; lucky : see `told_weight`
    A gate that opens between two samples first shows in the later one, so sample n stands for begins in (n-1, n],
    all alike. The standard error is a 1.96th of the half width round the mean that holds 95 % of the posterior.
    """
    best = likelihood.max()
    below = np.zeros(len(likelihood) + 1)  # probability of a begin before n - 1
    moment = 0.0
    for n in range(len(likelihood)):
        weight = told_weight(likelihood[n], best, threshold, lucky) if likelihood[n] > best - TAIL else 0.0
        below[n + 1] = below[n] + weight
        moment += weight * (n - 0.5)
    mean = moment / below[-1]
    low, high = 0.0, float(len(likelihood))
    for _ in range(40):
        half = (low + high) / 2
        inside = _interpolated(below, mean + 1 + half) - _interpolated(below, mean + 1 - half)
        if inside < SHARE * below[-1]:
            low = half
        else:
            high = half
    return mean, high / SPREAD, best


@compiled
def told_weight(likelihood, best, threshold, lucky):
    """Weight of a begin, over exp(best), of a pulse that is told because it passed a threshold.

    lucky : share of weak pulses among those there may be
    A weak pulse passes when noise lifts it, and is timed by that noise. Given that it passed, its likelihood is over
    the probability of that: (1 - u) exp(u z) over exp(-(1 - u) threshold) for one of Rayleigh amplitude. It matters
    for what comes near the threshold and for nothing far above it.
    """
    weak = lucky * (1 - WEAK) * np.exp(threshold + WEAK * (likelihood - threshold) - best)
    return fading_weight(likelihood, best) + weak


@compiled
def fading_weight(likelihood, best):
    """Likelihood of a begin with the pulse's strength unknown, over exp(best); z is its greatest log likelihood.

    The greatest alone, exp(z), takes luck for strength: a weak pulse would seem as well timed as its loudest noise.
    A pulse of random phase and Rayleigh amplitude, of mean signal-to-noise ratio a, has the likelihood
    (1 - u) exp(u z) with u = a/(1 + a). Any shrinkage u in (0, 1) is as likely as another before (Strawderman's
    prior: a = 1, 0 dB, is the median), which makes it (exp(z) - 1 - z)/z^2.
    """
    if likelihood < SERIES:
        return np.exp(-best) * (0.5 + likelihood / 6 + likelihood**2 / 24)
    return (np.exp(likelihood - best) - (1 + likelihood) * np.exp(-best)) / likelihood**2


@compiled
def _interpolated(values, place):
    if place <= 0:
        return values[0]
    if place >= len(values) - 1:
        return values[-1]
    whole = int(place)
    return values[whole] + (place - whole) * (values[whole + 1] - values[whole])


@warms
def _warm() -> None:
    iq, power = np.ones((2, 40), np.float32), np.ones(40, np.float32)
    mixing, rotation = np.ones((2, 2, 64), np.float32), np.array([[1.0, 0.0], [0.0, 1.0]])
    buffer = np.ones(2200, np.float32)
    for kind in (np.int16, np.int32):
        scale_whole_numbers(np.ones(3, kind), np.float32(1), power[:3])
    scale = np.ones(2, np.float32)
    advance(buffer, 1100, -20, 0, (48000, 1000, 10, 1), mixing, rotation, iq, power, scale)
    log_levels(power[20:30], scale[0], scale[1], np.empty(10, np.uint8))
    local_maxima(power, 15, 20, 10, censored_mean(power[::10], 3))
    posterior_time(log_likelihood(buffer, 0, 0, 50, 480, rotation, 1.0), 10.0, 1e-3)
