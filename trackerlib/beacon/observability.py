"""What the geometry of a survey cannot see, said in words that help."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# A direction counts as unseen when its standard error exceeds this share of the slant range: the
# linear picture behind any ellipse has broken down by then.
UNSEEN_SHARE = 0.1
LEVEL_SHARE = 0.02  # of the slant range: a beacon nearer to the hydrophone's depth is about level with it
UPRIGHT = 0.9  # least cosine of the vertical and a direction that counts as depth
ROUND_M = 10.0  # step of a depth that is advised
STRAIGHT_SHARE = 0.03  # sideways spread over length of a track that may count as straight


@dataclass(frozen=True, eq=False)
class Unobservable:
    """A direction in which the beacon can move without the arrival times telling."""

    direction_enu: tuple[float, float, float]  # unit vector, east north up
    why: str
    leg_helps: bool = True  # whether another leg of the ship would tell


@dataclass(frozen=True, eq=False)
class StraightTrack:
    """The straight line that a ship's track follows."""

    centre: np.ndarray  # (3,) [m]
    along: np.ndarray  # (3,) unit vector, horizontal, from the first ping towards the last
    across: np.ndarray  # (3,) unit vector, horizontal, to the right of `along`
    length_m: float
    spread_m: float  # root-mean-square distance of the pings from the line

    def is_straight(self, ship_sigma_m: float) -> bool:
        """Whether nothing but a line is known of the track, its positions being that uncertain.

        Sideways spread that is no more than position errors must not be taken for ship movement: a
        fit would find that the times do not follow it and conclude that the beacon lies below.
        """
        return self.spread_m < min(STRAIGHT_SHARE * self.length_m, 3 * ship_sigma_m)


def straight_track(ship: np.ndarray) -> StraightTrack:
    """The line through the horizontal track of a ship (N, 3), by principal components."""
    centre = ship.mean(axis=0)
    horizontal = ship[:, :2] - centre[:2]
    values, vectors = np.linalg.eigh(np.cov(horizontal.T))
    along = vectors[:, 1]
    if along @ (ship[-1, :2] - ship[0, :2]) < 0:
        along = -along
    return StraightTrack(
        centre=centre,
        along=np.array([along[0], along[1], 0.0]),
        across=np.array([along[1], -along[0], 0.0]),
        length_m=float(np.ptp(horizontal @ along)),
        spread_m=float(np.sqrt(max(values[0], 0.0))),
    )


def unseen_beside_line(track: StraightTrack) -> tuple[Unobservable, ...]:
    """The two directions that a straight track leaves unseen: across it, and depth."""
    why = (
        f"the ship sailed a straight line ({track.length_m:.0f} m long, {track.spread_m:.1f} m of sideways "
        "spread): turning the beacon about that line changes no travel time, so across-track and depth "
        "cannot be told apart; sail a leg across the line"
    )
    return Unobservable(tuple(track.across.tolist()), why), Unobservable((0.0, 0.0, 1.0), why)


def unseen_directions(
    covariance, slant_range_m: float, track: StraightTrack, below_m: float
) -> tuple[Unobservable, ...]:
    """Directions whose standard error exceeds UNSEEN_SHARE of the slant range, with the reason.

    covariance : (3, 3) [m^2] east, north, up
    below_m : the beacon below the hydrophone, negative above it
    """
    values, vectors = np.linalg.eigh(covariance)
    sigma = np.sqrt(np.maximum(values, 0))
    return tuple(
        _unseen(vectors[:, k], float(sigma[k]), slant_range_m, track, below_m)
        for k in np.flatnonzero(sigma > UNSEEN_SHARE * slant_range_m)
    )


def _unseen(direction, sigma_m: float, slant_range_m: float, track: StraightTrack, below_m: float):
    enu = tuple(direction.tolist())
    if abs(direction[2]) > UPRIGHT and abs(below_m) < LEVEL_SHARE * slant_range_m:
        lower_m = ROUND_M * np.ceil(UNSEEN_SHARE * slant_range_m / ROUND_M)
        why = (
            "the beacon lies about level with the hydrophone, where times hardly change with its depth; lower the "
            f"hydrophone by {lower_m:.0f} m and hear more pings"
        )
        return Unobservable(enu, why, leg_helps=False)
    moves = f"by {sigma_m:.0f} m" if sigma_m < slant_range_m else "farther than that"
    why = (
        f"the ship covered {track.length_m:.0f} m at {slant_range_m:.0f} m of slant range: the beacon can move "
        f"{moves} this way within the noise; sail further, on another bearing"
    )
    return Unobservable(enu, why)
