"""What a fix from experiments minimises, as functions of the beacon's place: for contours and for checks.

Wojcik (1993): chi-square of the misfits alone (2-18), and the Lagrangian (2-23) with the measurements solved for
at each place. His Figures 2-2 and 2-3 draw both for the same vectors and call the second far less eccentric.
"""

from __future__ import annotations

import numpy as np


def misfits(places, ship, ranges, pairs) -> tuple[np.ndarray, np.ndarray]:
    """Misfits g (S, N) [m] (2-19) of experiments at places (S, 3) of a still beacon, and slant ranges (S, R).

    ship (R, 3), ranges (R,), pairs (N, 2) as for `fix_pairs`
    """
    distance = np.linalg.norm(np.asarray(places)[:, None, :] - ship, axis=2)
    miss = distance - ranges
    return miss[:, pairs[:, 0]] - miss[:, pairs[:, 1]], distance


def chi_square(places, ship, ranges, pairs, range_rms_m: float) -> np.ndarray:
    """Chi-square (S,) of the misfits as if times alone erred (2-18), its divisor in metres."""
    g, _ = misfits(places, ship, ranges, pairs)
    return np.sum(g**2, axis=1) / (2 * range_rms_m**2)


def lagrangian(
    places, ship, ranges, pairs, gps_rms_m: float, range_rms_m: float, rounds: int = 12
) -> np.ndarray:
    """The Lagrangian (S,) (2-23) with every measurement's correction solved for: half the weighted squares (2-28).

    Corrections are -lambda V a with g = 0 (2-70), found by turning a with them until it rests.
    """
    places, first, second = np.asarray(places), ship[pairs[:, 0]], ship[pairs[:, 1]]
    measured = ranges[pairs[:, 0]] - ranges[pairs[:, 1]]
    shift = np.zeros((2, len(places), len(pairs), 2))
    for _ in range(rounds):
        offset = np.stack([first - places[:, None, :], second - places[:, None, :]])
        offset[..., :2] += shift
        distance = np.linalg.norm(offset, axis=-1)
        direction = offset[..., :2] / distance[..., None]
        c = gps_rms_m**2 * np.sum(direction**2, axis=(0, 3)) + 2 * range_rms_m**2
        moved = np.sum(direction[0] * shift[0], axis=-1) - np.sum(direction[1] * shift[1], axis=-1)
        multiplier = (distance[0] - distance[1] - measured - moved) / c
        shift = gps_rms_m**2 * multiplier[..., None] * np.stack([-direction[0], direction[1]])
    return 0.5 * np.sum(multiplier**2 * c, axis=1)


def axis_ratio(objective, place, step_m: float = 5.0) -> float:
    """How eccentric contours are in east and north close to a minimum: long axis over short, from second differences.

    objective : function of places (S, 3)
    """
    east, north = np.array([step_m, 0.0, 0.0]), np.array([0.0, step_m, 0.0])
    around = [0 * east, east, -east, north, -north, east + north, -east - north, east - north, north - east]
    f = objective(np.asarray(place) + np.array(around))
    xx, yy = f[1] + f[2] - 2 * f[0], f[3] + f[4] - 2 * f[0]
    xy = (f[5] + f[6] - f[7] - f[8]) / 4
    low, high = np.linalg.eigvalsh([[xx, xy], [xy, yy]])
    return float(np.sqrt(high / low)) if low > 0 else np.inf
