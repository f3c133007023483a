"""Lines and rings cut where they cross 180 degrees, as GeoJSON wants them (RFC 7946, 3.1.9)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

Points = list[tuple[float, float]]  # (lon, lat) [degrees]


def cut_line(lon_deg, lat_deg) -> list[Points]:
    """Parts of a line, none of which crosses 180 degrees; the cuts stand at +-180 on either side."""
    lon = np.unwrap(lon_deg, period=360).tolist()
    lat = np.asarray(lat_deg, float).tolist()
    turns = [int((x + 180) // 360) for x in lon]
    parts: list[Points] = [[(lon[0] - 360 * turns[0], lat[0])]]
    for k in range(1, len(lon)):
        if turns[k] != turns[k - 1]:
            edge = 360 * max(turns[k], turns[k - 1]) - 180
            at = lat[k - 1] + (edge - lon[k - 1]) / (lon[k] - lon[k - 1]) * (lat[k] - lat[k - 1])
            parts[-1].append((edge - 360.0 * turns[k - 1], at))
            parts.append([(edge - 360.0 * turns[k], at)])
        parts[-1].append((lon[k] - 360 * turns[k], lat[k]))
    return parts


def cut_ring(lon_deg, lat_deg) -> list[Points]:
    """Closed parts of a closed convex ring, in its sense of turning, none of which crosses 180 degrees."""
    lon = np.unwrap(lon_deg, period=360)
    ring = list(zip(lon.tolist(), np.asarray(lat_deg, float).tolist(), strict=True))
    parts = []
    for turn in range(int((lon.min() + 180) // 360), int((lon.max() + 180) // 360) + 1):
        west, east = 360.0 * turn - 180, 360.0 * turn + 180
        part = _clip(_clip(ring, west, 1.0), east, -1.0)
        if len(part) > 3:
            parts.append([(x - 360 * turn, y) for x, y in part])
    return parts


def _clip(ring: Points, edge: float, side: float) -> Points:
    """The closed part of a closed ring whose longitude is beyond `edge` on `side` (+1 east, -1 west)."""
    kept: Points = []
    for (x0, y0), (x1, y1) in pairwise(ring):
        inside, ends_inside = side * (x0 - edge) >= 0, side * (x1 - edge) >= 0
        if inside:
            kept.append((x0, y0))
        if inside != ends_inside:
            kept.append((edge, y0 + (edge - x0) / (x1 - x0) * (y1 - y0)))
    return [*kept, kept[0]] if kept else []
