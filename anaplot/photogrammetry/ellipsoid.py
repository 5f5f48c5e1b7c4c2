"""Places on an ellipsoid: geodetic, geocentric, and east, north and up at one of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array

__all__ = ["WGS84", "Ellipsoid", "LocalFrame", "geocentric", "geodetic"]

_STEPS = 6  # each gains three digits or more; near the earth's surface two are enough


class Ellipsoid(NamedTuple):
    """An ellipsoid of revolution.

    Attributes
    ----------
    a
        Semi-major axis [m].
    f
        Flattening.
    """

    a: float
    f: float


WGS84 = Ellipsoid(6378137.0, 1.0 / 298.257223563)


def geocentric(places: Array, ellipsoid: Ellipsoid) -> Array:
    """Return (n, 3) geocentric coordinates [m].

    Parameters
    ----------
    places
        (n, 3) longitude, latitude [rad] and height above the ellipsoid [m].
    ellipsoid
        The ellipsoid.
    """
    longitude, latitude, height = places.T
    a, f = ellipsoid
    e2 = f * (2.0 - f)
    across = a / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    radius = (across + height) * np.cos(latitude)
    return np.stack(
        (
            radius * np.cos(longitude),
            radius * np.sin(longitude),
            (across * (1.0 - e2) + height) * np.sin(latitude),
        ),
        axis=1,
    )


def geodetic(xyz: Array, ellipsoid: Ellipsoid) -> Array:
    """Return (n, 3) longitude, latitude [rad] and height [m]: `geocentric` undone.

    Bowring's (1976) iteration over the parametric latitude; to the last digits within some
    thousand kilometres of the surface.
    """
    x, y, z = xyz.T
    a, f = ellipsoid
    e2 = f * (2.0 - f)
    b = a * (1.0 - f)
    p = np.hypot(x, y)
    latitude = np.arctan2(z, (1.0 - f) ** 2 * p)
    for _ in range(_STEPS):
        beta = np.arctan2((1.0 - f) * np.sin(latitude), np.cos(latitude))
        latitude = np.arctan2(
            z + e2 / (1.0 - e2) * b * np.sin(beta) ** 3, p - e2 * a * np.cos(beta) ** 3
        )
    sine = np.sin(latitude)
    height = p * np.cos(latitude) + z * sine - a * np.sqrt(1.0 - e2 * sine**2)
    return np.stack((np.arctan2(y, x), latitude, height), axis=1)


class LocalFrame(NamedTuple):
    """East, north and up at a place.

    Attributes
    ----------
    ellipsoid
        The ellipsoid.
    origin
        (3,) geocentric [m].
    axes
        (3, 3) rows: east, north, up in the geocentric system.
    """

    ellipsoid: Ellipsoid
    origin: Array
    axes: Array

    @classmethod
    def at(
        cls, longitude: float, latitude: float, height: float, ellipsoid: Ellipsoid
    ) -> LocalFrame:
        """Return the frame at a place [degrees, m]."""
        lon, lat = np.radians((longitude, latitude))
        origin = geocentric(np.array([[lon, lat, height]]), ellipsoid)[0]
        so, co, sa, ca = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
        axes = np.array([[-so, co, 0.0], [-sa * co, -sa * so, ca], [ca * co, ca * so, sa]])
        return cls(ellipsoid, origin, axes)

    def local(self, xyz: Array) -> Array:
        """Return (n, 3) east, north, up of (n, 3) geocentric coordinates [m]."""
        out: Array = (xyz - self.origin) @ self.axes.T
        return out

    def geocentric(self, local: Array) -> Array:
        """Return (n, 3) geocentric coordinates of (n, 3) local ones [m]."""
        out: Array = self.origin + local @ self.axes
        return out
