"""The conditions of one model: coplanarity of every point, XZ collinearity of every tie.

Everything is in image units: each row's misclosure F and derivatives are divided by the
coefficient a of its observation (a_p = -z', a_L = -dZ), so that a row's cofactor is simply 2
for y and q_x for x (Kratky and El-Hakim 1983, eq. 1-4).
"""

from __future__ import annotations

from itertools import compress
from math import inf, sqrt
from statistics import median
from typing import NamedTuple, TypeVar

import numpy as np

from anaplot.aliases import Array
from anaplot.orientation.pair import Stereopair
from anaplot.photogrammetry.block import TieVariance
from anaplot.photogrammetry.conditions import ROWS, coefficients, products
from anaplot.photogrammetry.intersection import (
    Intersection,
    intersect,
    lie_in_front,
    ray_factors,
)

__all__ = ["Q_Y", "ConditionEquations", "ModelUnknowns", "tie_cofactor"]

Q_Y = 2.0
"""A-priori cofactor of a y row: q_yy = 2 q_xx, the experience of the NRC."""
_FACTOR_Y = np.array(-sqrt(0.5))
_DEPTHS = np.array((2, 2, 2))


_Ratio = TypeVar("_Ratio", float, Array)


def tie_cofactor(ratio: _Ratio, tie_variance: TieVariance) -> _Ratio:
    """Return the cofactor of an x row; `ratio` is new bx / old bx.

    "paper" takes the ties' model coordinates as free of error: 1. "propagated" adds what the
    image errors of the preceding model contribute: 1 + (1 + k)^2 + k^2, 6 for equal bases; "exact"
    has the same weights.
    """
    if tie_variance == "paper":
        return ratio**0
    return 1.0 + (1.0 + ratio) ** 2 + ratio * ratio


class ModelUnknowns(NamedTuple):
    """Unknowns of a model: bx [mm], by/bx, bz/bx, (3, 3) rotation of the right photo."""

    bx: float
    beta_y: float
    beta_z: float
    rotation: Array


class ConditionEquations:
    """The conditions of one model, ready to be evaluated at any state.

    Parameters
    ----------
    pair
        The measurements.
    tie_variance
        Cofactor of x rows, see `tie_cofactor`.

    Attributes
    ----------
    y_index, x_index
        Rows in use, as positions in pair.points.
    y_points, x_points
        Names of their points.
    point
        (n + m,) position of the point of every row.
    p1, p2
        (3, points) left and right rays in the image systems.
    x1
        (3, points) left rays in the strip system.
    tie_points
        (3, m) ties' model coordinates from the left projection centre.
    left, right
        (6, n + m), (3, n + m) the vectors in which the conditions are bilinear: of y rows the left
        ray, as `plane` scales it, of x rows (X, Z, 1) of the tie in the last three; right rays.
    plane
        (n,) factors of the left rays, which put the conditions of y rows into weighted image units.
    """

    def __init__(self, pair: Stereopair, tie_variance: TieVariance = "paper") -> None:
        points, off, ties = pair.points, pair.off, pair.ties or {}
        self.tie_variance = tie_variance
        self.preceding_bx = pair.preceding_bx
        self.first = pair.ties is None
        self.p1, self.p2 = _rays(pair.xl, pair.c_left), _rays(pair.xr, pair.c_right)
        self.x1 = pair.fixed.rotation.dot(self.p1)
        self.y_index, self.y_points = list(range(len(points))), points
        self.x_index = list(compress(self.y_index, map(ties.__contains__, points)))
        self.x_points = tuple(filter(ties.__contains__, points))
        if off:
            self.y_index = [k for k in self.y_index if (points[k], "y") not in off]
            self.x_index = [k for k in self.x_index if (points[k], "x") not in off]
            self.y_points = tuple(points[k] for k in self.y_index)
            self.x_points = tuple(points[k] for k in self.x_index)
        self._n, self._m = n, m = len(self.y_index), len(self.x_index)
        self.point = np.array(self.y_index + self.x_index, dtype=np.intp)
        self.right = self.p2.take(self.point, axis=1)
        x1 = self.x1 if n == len(points) else self.x1.take(self.point[:n], axis=1)
        plane = _FACTOR_Y / x1.take(_DEPTHS, axis=0)
        self.plane = plane[0]
        self.left = np.zeros((6, n + m))
        self.left[:3, :n] = x1 * plane
        self.tie_points = self.x1[:, :0]
        if m:
            x, y, z = pair.fixed.centre.tolist()
            tied = map(ties.__getitem__, self.x_points)
            self.tie_points = np.array([(X - x, Y - y, Z - z) for X, Y, Z in tied]).T
            self.left[3:5, n:] = self.tie_points[::2]
            self.left[5, n:] = 1.0
        self._heights = self.tie_points[2].repeat(ROWS).reshape(m, ROWS)
        self._products = products(self.left, self.right).T

    @property
    def row_count(self) -> int:
        """Number of rows in use."""
        return self._n + self._m

    def unknown_rows(self) -> slice:
        """Which of the six derivatives are unknowns: a first model holds bx."""
        return slice(1, 6) if self.first else slice(0, 6)

    def cofactors(self, bx: float) -> Array:
        """Return (n + m,) a-priori cofactors of the rows, y first."""
        out = np.empty(self.row_count)
        out.fill(Q_Y)  # np.full takes twice as long
        if self._m:
            out[self._n :] = self._tie_cofactor(bx)
        return out

    def _tie_cofactor(self, bx: float) -> float:
        ratio = bx / self.preceding_bx if self.preceding_bx else 1.0
        return tie_cofactor(ratio, self.tie_variance)

    def evaluate(self, state: ModelUnknowns) -> Array:
        """Return (7, n + m) weighted derivatives and misclosures in image units [mm]."""
        return self.linearise(state)[0]

    def linearise(self, state: ModelUnknowns, *, ties: bool = True) -> tuple[Array, Array]:
        """Return what `evaluate` does, and the (7, 18) `coefficients` with which it was made."""
        bx, beta_y, beta_z, rotation = state
        if not (ties and self._m):
            factors = coefficients(bx, beta_y, beta_z, rotation)
            plane: Array = self._products[: self._n, :9].dot(factors[:, :9].T)
            return plane.T, factors
        factors = coefficients(bx, beta_y, beta_z, rotation, self.tie_weight(bx))
        # row by row: what the ties are divided by has their shape, and nothing is spread out
        rows: Array = self._products.dot(factors.T)
        of_ties = rows[self._n :]
        np.divide(of_ties, bx * beta_z - self._heights, of_ties)
        return rows.T, factors

    def tie_weight(self, bx: float) -> float:
        """Return the root of the weight of every x row."""
        return 1.0 / sqrt(self._tie_cofactor(bx))

    def tie_depths(self, bz: float) -> Array:
        """Return (m,) -dZ of the ties from a right projection centre bz above the left one."""
        depths: Array = bz - self.tie_points[2]
        return depths

    def meet(self, state: ModelUnknowns) -> Intersection:
        """Return where the rays of every point meet, as seen from the left projection centre."""
        bx, beta_y, beta_z, rotation = state
        return intersect((bx, bx * beta_y, bx * beta_z), self.x1, rotation.dot(self.p2))

    def front(self, state: ModelUnknowns) -> tuple[list[bool], float]:
        """Return which of the points lie in front of both photos, and how far they are.

        The latter as the root mean square of their distances, in those of their image points from
        the left projection centre: of all, the far ones count.
        """
        bx, beta_y, beta_z, rotation = state
        x2 = rotation.dot(self.p2)
        left, right = ray_factors((bx, bx * beta_y, bx * beta_z), self.x1, x2)
        front: list[bool] = lie_in_front(left, right).tolist()
        return front, sqrt(float(left.dot(left)) / len(front))

    def bx_of_ties(self, beta_z: float, rotation: Array) -> float | None:
        """Return the median bx that the ties ask for, one collinearity equation each."""
        asked = []
        rays = rotation.dot(self.right[:, self._n :]).tolist()
        for X, Z, x, z in zip(*self.tie_points[::2].tolist(), *rays[::2], strict=True):
            lever = z - beta_z * x
            bx = (X * z - Z * x) / lever if lever else inf
            if abs(bx) < inf:
                asked.append(bx)
        return median(asked) if asked else None


def _rays(xy: Array, c: float) -> Array:
    out = np.empty((3, len(xy)))
    out[:2] = xy.T
    out[2] = -c
    return out
