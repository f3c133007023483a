"""Simulated pulses that pass a threshold, however rarely such pulses do, each with the weight it has among them."""

from __future__ import annotations

import numpy as np
from scipy.stats import ncx2

RATE_HZ, CARRIER_HZ, PULSE_S = 8000, 2000.0, 0.010
LENGTH, CELL = 80, 8  # samples of a pulse and of a cell, each a whole number of cycles


def passing_pulses(rng, snr_db, least, count, apart):
    """Sound (count * apart,), begins (count,) [samples] of a pulse every `apart` of them, and their weights (count,).

    least : power over noise that one window of the detector at least exceeds, by noise drawn for it; windows near the
        pulse take turns in proportion to their chances, and a pulse that several exceed for weighs less by that
    """
    sound = rng.standard_normal((count, apart))
    begin = apart / 2 + rng.uniform(0, CELL, count)
    carrier = np.exp(2j * np.pi * CARRIER_HZ / RATE_HZ * np.arange(apart))
    window = np.arange(apart // 2 - LENGTH, apart // 2 + LENGTH + 1, CELL)
    weight = np.empty(count)
    for one in range(count):
        first = int(np.ceil(begin[one]))
        size = 10 ** (snr_db / 20) * np.exp(1j * rng.uniform(0, 2 * np.pi))
        pulse = 2 / np.sqrt(LENGTH) * (size * carrier).real
        sound[one, first : first + LENGTH] += pulse[first : first + LENGTH]
        part = size * np.clip(1 - np.abs(window - first) / LENGTH, 0, 1)
        chance = np.maximum(ncx2.sf(2 * least, 2, 2 * np.abs(part) ** 2 + 1e-9), 1e-300)
        which = rng.choice(len(window), p=chance / chance.sum())
        power = ncx2.isf(rng.uniform() * chance[which], 2, 2 * np.abs(part[which]) ** 2 + 1e-9) / 2
        turn = rng.vonmises(np.angle(part[which]), 2 * np.abs(part[which]) * np.sqrt(power))
        here = slice(window[which], window[which] + LENGTH)
        wanted = np.sqrt(power) * np.exp(1j * turn) * np.sqrt(LENGTH)
        lacking = wanted - sound[one, here] @ carrier[here].conj()
        sound[one, here] += 2 / LENGTH * (lacking * carrier[here]).real
        total = np.concatenate([[0], np.cumsum(sound[one] * carrier.conj())])
        passed = np.abs(total[window + LENGTH] - total[window]) ** 2 / LENGTH > 0.999999 * least
        weight[one] = chance.sum() / passed.sum()
    return 0.01 * sound.ravel(), begin + apart * np.arange(count), weight
