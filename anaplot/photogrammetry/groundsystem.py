"""The system that a block's ground coordinates are in, and that of the person whose they are.

An adjustment is cartesian: degrees are none, and a map's plane bends and stretches the ground. In
the frame "local" the axes point to the east, to the north and up at an origin, the plane touches
the ellipsoid there (a topocentric system), and nothing is lost on the way there and back. In the
frame "offset" coordinates are those of a projection less three numbers: the scale of the map stays
in them, and so does the earth's curvature, s^2 / 2R or 8 cm at 1 km.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Frame", "GroundSystem"]

Frame = Literal["local", "offset"]


@dataclass(frozen=True, slots=True)
class GroundSystem:
    """Where a block's ground coordinates lie.

    Attributes
    ----------
    crs
        The person's coordinate system: "EPSG:25832", or a proj string.
    frame
        "local": east, north, up [m] at the origin; "offset": its coordinates less the origin.
    origin
        Of a local frame longitude, latitude [degrees] and ellipsoidal height [m], of the system's
        own datum; of an offset one easting, northing and height [m].
    """

    crs: str
    frame: Frame
    origin: tuple[float, float, float]
