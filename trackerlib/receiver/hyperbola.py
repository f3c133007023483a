"""What one pass along a straight leg tells: a bearing line at right angles to the ship's track."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackerlib.frames import LocalFrame


@dataclass(frozen=True)
class BearingLine:
    """The line on the map that a pass puts a beacon on: through the ship's closest point, across her track.

    A straight leg does not tell port from starboard, so the line goes to both sides.
    """

    lat_deg: float  # of the ship at closest approach
    lon_deg: float
    bearing_deg: float  # to starboard, from true north, 0 to 360; the other side is opposite
    sigma_along_m: float  # standard error of the line along the track, at the ship
    sigma_bearing_deg: float  # standard error of its direction
    distance_m: float | None = None  # slant distance at closest approach; None where the marks do not tell
    sigma_m: float | None = None  # standard error of distance_m
    correlation: float = 0.0  # between the errors along the track and in distance_m

    def ends(self, length_m: float | None = None, depth_m: float = 0.0) -> np.ndarray:
        """Latitude and longitude (2, 2) [degrees] of the line's ends, to starboard and to port.

        length_m : to each side; None draws the beacon's two mirror places at `depth_m` below the hydrophone
        Raises ValueError where there is neither a length nor a distance greater than the depth.
        """
        if length_m is None:
            if self.distance_m is None or not self.distance_m > depth_m:
                raise ValueError(
                    f"distance_m is {self.distance_m}; wanted more than the depth, {depth_m:g} m"
                )
            length_m = float(np.sqrt(self.distance_m**2 - depth_m**2))
        bearing = np.radians(self.bearing_deg + np.array([0.0, 180.0]))
        plane = length_m * np.stack([np.sin(bearing), np.cos(bearing), np.zeros(2)], axis=-1)
        lat, lon, _ = LocalFrame(self.lat_deg, self.lon_deg).to_geodetic(plane)
        return np.stack([lat, lon], axis=-1)
