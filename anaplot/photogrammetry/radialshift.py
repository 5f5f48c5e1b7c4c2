"""A radial displacement of image coordinates: put on, taken off, and its derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.airandearth import AirAndEarth
from anaplot.photogrammetry.planar import as_points

__all__ = ["RadialShift"]

_STEPS = 20


class RadialShift(NamedTuple):
    """A radial displacement dr = linear r + cubic r^3 about the principal point [mm].

    r is where the image is, and dr is subtracted to give the place without it.
    """

    linear: float
    cubic: float

    @classmethod
    def of(cls, air: AirAndEarth, c: float) -> RadialShift:
        """Return what air and earth do in a camera of constant `c` [mm]."""
        return cls(*air.radial(c))

    def at(self, radius: float) -> float:
        """Return dr [mm] at a radius [mm]."""
        return self.linear * radius + self.cubic * radius**3

    def taken_off(self, xy: Array) -> Array:
        """Return (n, 2) places without the displacement, of (n, 2) displaced ones [mm]."""
        places = as_points(xy)
        square = np.sum(places * places, axis=1, keepdims=True)
        free: Array = places * (1.0 - self.linear - self.cubic * square)
        return free

    def put_on(self, xy: Array) -> Array:
        """Return (n, 2) displaced places, the inverse of `taken_off`.

        Raises
        ------
        NotComputableError
            So far out that nothing is imaged there.
        """
        free = as_points(xy)
        square = np.sum(free * free, axis=1, keepdims=True)
        ratio = np.ones_like(square)  # of displaced to free radius
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for _ in range(_STEPS):
                bent = self.cubic * square * ratio**2
                gap = ratio * (1.0 - self.linear - bent) - 1.0
                ratio = ratio - gap / (1.0 - self.linear - 3.0 * bent)
            gap = ratio * (1.0 - self.linear - self.cubic * square * ratio**2) - 1.0
        if not (np.abs(gap) < 1e-12).all() or not (ratio > 0.0).all():
            raise NotComputableError("refraction and curvature cannot be inverted so far out")
        shifted: Array = free * ratio
        return shifted

    def jacobian(self, xy: Array) -> Array:
        """Return (n, 2, 2) derivatives of `taken_off` at (n, 2) displaced places [mm]."""
        places = as_points(xy)
        square = np.sum(places * places, axis=1)
        scale = 1.0 - self.linear - self.cubic * square
        outer = places[:, :, None] * places[:, None, :]
        derivative: Array = scale[:, None, None] * np.eye(2) - 2.0 * self.cubic * outer
        return derivative
