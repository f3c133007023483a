"""The gates in plain NumPy, one after the other: what the compiled passes are held against."""

from itertools import combinations

import numpy as np

from trackerlib.crossover.gating import gate_mode_and_flag, split_passes
from trackerlib.crossover.pairs import CrossoverSet
from trackerlib.crossover.repeats import NEIGHBOUR_COUNTS, NEIGHBOURS_PER_SIDE


def plain_gating(reports, survey, mode, limit=4700.0, gap=30):
    """Counts after each gate, crossover sets, and (count, array, kept line, distances) of each repeat."""
    vehicle = gate_mode_and_flag(reports, mode)
    paired = several_arrays(vehicle)
    row = survey.index_of(paired.array)
    placed = paired.only((row >= 0) & ~survey.placeholder[row])
    slant = np.linalg.norm(placed.position - survey.position[survey.index_of(placed.array)], axis=1)
    in_range = placed.only(slant <= limit)
    repaired = several_arrays(in_range)
    single, choices = plain_repeats(repaired, vehicle)
    counts = tuple(len(kept) for kept in (vehicle, paired, in_range, repaired, single))
    return counts, plain_pairs(single, gap), choices


def several_arrays(reports):
    seen = np.unique(np.column_stack([reports.point_count, reports.array]), axis=0)
    count, arrays = np.unique(seen[:, 0], return_counts=True)
    return reports.only(np.isin(reports.point_count, count[arrays >= 2]))


def plain_pairs(reports, gap):
    tracks = {int(number): reports.only(reports.array == number) for number in np.unique(reports.array)}
    sets = []
    for a, b in combinations(tracks, 2):
        counts, in_a, in_b = np.intersect1d(
            tracks[a].point_count, tracks[b].point_count, assume_unique=True, return_indices=True
        )
        if len(counts):
            whole = CrossoverSet((a, b), counts, tracks[a].position[in_a], tracks[b].position[in_b])
            sets += split_passes(whole, gap)
    return sets


def plain_repeats(reports, tracks):
    keys = list(zip(reports.point_count.tolist(), reports.array.tolist(), strict=True))
    keep, choices = np.ones(len(reports), bool), []
    for key in sorted({key for key in keys if keys.count(key) > 1}):
        group = np.array([k for k, other in enumerate(keys) if other == key])
        group = group[np.argsort(reports.line[group])]
        away = tracks.point_count - key[0]
        own = (tracks.array == key[1]) & (away != 0) & (np.abs(away) <= NEIGHBOUR_COUNTS)
        before = np.flatnonzero(own & (away < 0))[-NEIGHBOURS_PER_SIDE:]
        after = np.flatnonzero(own & (away > 0))[:NEIGHBOURS_PER_SIDE]
        near = np.concatenate([before, after])
        expected = plain_prediction(key[0], tracks.point_count[near], tracks.position[near])
        distance = np.linalg.norm(reports.position[group] - expected, axis=1)
        best = int(np.argmin(distance)) if len(near) else 0
        keep[np.delete(group, best)] = False
        choices.append((*key, int(reports.line[group[best]]), distance))
    return reports.only(keep), choices


def plain_prediction(point_count, counts, positions):
    away = counts.astype(float) - point_count
    if len(counts) == 0:
        return np.full(3, np.nan)
    i, j = np.triu_indices(len(counts), k=1)
    i, j = i[away[i] != away[j]], j[away[i] != away[j]]
    if not len(i):
        return np.median(positions, axis=0)
    share = -away[i] / (away[j] - away[i])
    prediction = positions[i] + share[:, None] * (positions[j] - positions[i])
    weight = 1.0 / np.hypot(share, 1.0 - share)
    order = np.argsort(prediction, axis=0, kind="stable")
    total = np.cumsum(weight[order], axis=0)
    middle = np.argmax(total >= (0.5 - 1e-12) * total[-1], axis=0)  # two halves may differ by rounding
    return prediction[order[middle, np.arange(3)], np.arange(3)]
