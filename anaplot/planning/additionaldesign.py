"""Whether additional parameters can be told apart on a regular grid of points (1978, eq. 4-7).

"The optimal choice of A4 is obtained, if the columns of A4 are orthogonal": to each other, and to
what an exterior orientation does, here that of a vertical photo over flat ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.additional import ParameterSet

__all__ = ["AdditionalDesign", "DesignedParameter", "additional_design"]

_SAME = 1e-12  # a cosine below is rounding


class DesignedParameter(NamedTuple):
    """A parameter on the grid.

    Attributes
    ----------
    name
        Its name.
    rms_mm
        Root mean square of what 1 mm of it does to x and y [mm].
    nearest, cosine
        The other parameter that it is least orthogonal to, and the cosine between both columns;
        None where there is no other, "" where it is orthogonal to all.
    orientation
        Share of its column, 0 to 1, that exterior orientations make: a cosine.
    """

    name: str
    rms_mm: float
    nearest: str
    cosine: float
    orientation: float


@dataclass(frozen=True, slots=True)
class AdditionalDesign:
    """A set of additional parameters on a grid.

    Attributes
    ----------
    parameters
        One after another, in the set's order.
    side
        Points along a side of the grid.
    largest, largest_orientation
        The largest cosines.
    rank
        Of all columns, with the six of the exterior orientation.
    """

    parameters: tuple[DesignedParameter, ...]
    side: int
    largest: float
    largest_orientation: float
    rank: int

    @property
    def orthogonal(self) -> bool:
        """Whether the parameters are orthogonal to each other."""
        return self.largest == 0.0


def additional_design(chosen: ParameterSet, side: int, b: float, c: float) -> AdditionalDesign:
    """Return what a set does on side x side points between -b and b.

    Parameters
    ----------
    chosen
        The set.
    side
        Points along a side.
    b, c
        Reach of the points and camera constant [mm].
    """
    line = np.linspace(-b, b, side)
    x, y = (axis.ravel() for axis in np.meshgrid(line, line))
    columns = chosen.terms(x, y, b, np.full(len(x), c)).reshape(2 * len(x), -1)
    effects = np.linalg.qr(_exterior(x / c, y / c).reshape(2 * len(x), 6))[0]
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0.0, size, 1.0)
    between = np.abs(unit.T @ unit)
    np.fill_diagonal(between, 0.0)
    between[between < _SAME] = 0.0
    shared = np.linalg.norm(effects.T @ unit, axis=0)
    shared[shared < _SAME] = 0.0
    nearest = between.argmax(axis=1)
    rows = tuple(
        DesignedParameter(
            name,
            float(size[k] / np.sqrt(2.0 * len(x))),
            chosen.names[nearest[k]] if between[k, nearest[k]] else "",
            float(between[k, nearest[k]]),
            float(min(shared[k], 1.0)),
        )
        for k, name in enumerate(chosen.names)
    )
    both = np.concatenate((unit, effects), axis=1)
    return AdditionalDesign(
        rows,
        side,
        max(one.cosine for one in rows),
        max(one.orientation for one in rows),
        int(np.linalg.matrix_rank(both, tol=1e-9)),
    )


def _exterior(x: Array, y: Array) -> Array:
    """Return (n, 2, 6) what X0, Y0, Z0, omega, phi and kappa do, for c = 1."""
    one, zero = np.ones_like(x), np.zeros_like(x)
    dx = [one, zero, x, x * y, 1.0 + x * x, -y]
    dy = [zero, one, y, 1.0 + y * y, x * y, x]
    return np.stack((np.stack(dx, axis=1), np.stack(dy, axis=1)), axis=1)
