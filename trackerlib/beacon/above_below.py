"""Above or below the hydrophone: what the pings tell of it, and what would.

A track at one depth turned over about that depth is itself, so the mirror place on the other side of the hydrophone
fits as well, but for what bent rays tell, wherever it is not above the surface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trackerlib.beacon.paths import depth_below_surface

if TYPE_CHECKING:
    from trackerlib.beacon.result import BeaconFix, Solution

MIRROR_SHARE = 0.05  # of the slant range: how far apart on the map a place and its mirror may stand
NOT_LEVEL = 2.0  # standard errors of depth from the hydrophone's, from which the side is told
LINE_SHARE = 0.02  # of the range from a straight track: a shallower hydrophone has no room above it
LOWERED_M = 10.0  # step in which a change of the hydrophone's depth is advised
LATER_PINGS = 10  # heard at the other depth
TOLD = 3.0  # standard errors by which they should tell


def mirrored(state: np.ndarray, level_up: float) -> np.ndarray:
    """States (..., P) on the other side of a height [m], a moving one moving the other way up or down."""
    out = np.array(state, float)
    out[..., 2] = 2 * level_up - out[..., 2]
    out[..., 5:] *= -1
    return out


def mirror_of(fix: BeaconFix) -> Solution | None:
    """The alternative of a fix at its place on the map, but on the other side of the hydrophone; None if none is."""
    if fix.position is None:
        return None
    level, reach = _level_up(fix), MIRROR_SHARE * _slant_range(fix)
    for other in fix.alternatives:
        apart = np.hypot(other.east_m - fix.position[0], other.north_m - fix.position[1])
        if apart < reach and (-other.depth_m < level) != (fix.position[2] < level):
            return other
    return None


def side_words(fix: BeaconFix) -> str | None:
    """On which side of the hydrophone a fix is told, where there is anything to say of it; None where there is not."""
    if not fix.used.any():
        return None
    hydrophone_m = float(np.mean(depth_below_surface(fix.ship[fix.used])))
    if fix.position is None:
        if fix.along_track_m is None or hydrophone_m < LINE_SHARE * fix.closest_slant_range_m:
            return None
        return f"places above the hydrophone, {hydrophone_m:.0f} m deep, fit as well as those below it; told below it"
    above_m = hydrophone_m - fix.depth_m
    told = f"told {'above' if above_m > 0 else 'below'} it"
    if (mirror := mirror_of(fix)) is not None:
        depths = sorted([fix.depth_m, mirror.depth_m])
        return (
            f"the ship's level track cannot tell above from below the hydrophone, {hydrophone_m:.0f} m deep: "
            f"{depths[0]:.0f} m and {depths[1]:.0f} m of depth fit about as well; {told}"
        )
    sigma_m = 0.0 if fix.sigma is None else float(fix.sigma[2])
    if abs(above_m) < min(NOT_LEVEL * sigma_m, hydrophone_m):
        return (
            f"the beacon lies about level with the hydrophone, {hydrophone_m:.0f} m deep, and the pings do not tell "
            f"above from below it; {told}"
        )
    if above_m > 0:
        return (
            f"the beacon lies {above_m:.0f} m above the hydrophone, which is {hydrophone_m:.0f} m deep; no place below "
            "it fits as well"
        )
    return None


def depth_that_helps(fix: BeaconFix, noise_m: float) -> str:
    """By how much to raise or lower the hydrophone so that a few more pings tell the side.

    noise_m : error of one range
    """
    above_m = abs(float(fix.position[2]) - _level_up(fix))
    changed = 2 * above_m / _slant_range(fix)  # between the ranges from both places, a metre
    needed = TOLD * noise_m / max(changed, 1e-3) * np.sqrt(2 / LATER_PINGS)
    step_m = LOWERED_M * np.ceil(needed / LOWERED_M)
    return f"lower or raise the hydrophone by {step_m:.0f} m and hear {LATER_PINGS} more pings"


def _level_up(fix: BeaconFix) -> float:
    """Height [m] of the hydrophone over the pings used."""
    return float(np.mean(fix.ship[fix.used, 2]))


def _slant_range(fix: BeaconFix) -> float:
    return float(np.median(np.linalg.norm(fix.position - fix.ship[fix.used], axis=1)))
