"""Model points: where the two rays of a point meet."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from anaplot.adjustment.scalars import ZERO
from anaplot.aliases import Array, Bools

__all__ = ["Intersection", "intersect", "lie_in_front", "ray_factors"]

_Base: TypeAlias = "tuple[float, float, float] | tuple[Array, Array, Array]"


class Intersection(NamedTuple):
    """Points where pairs of rays meet.

    Attributes
    ----------
    points
        (3, ..., n) coordinates, as seen from the left projection centre.
    left, right
        (..., n) factors of the left and right rays; positive in front of the photo.
    """

    points: Array
    left: Array
    right: Array

    @property
    def in_front(self) -> Bools:
        """(..., n) whether a point lies in front of both photos."""
        return lie_in_front(self.left, self.right)


def lie_in_front(left: Array, right: Array) -> Bools:
    """Return (..., n) whether points of such factors of their rays lie in front of both photos."""
    return np.minimum(left, right) > ZERO


def ray_factors(base: _Base, x1: Array, x2: Array) -> tuple[Array, Array]:
    """Return the (..., n) factors of left and right rays that `intersect` finds, of the same."""
    bx, _, bz = base
    left_x, left_z, right_x, right_z = x1[0], x1[2], x2[0], x2[2]
    determinant = right_x * left_z - left_x * right_z
    left = (bz * right_x - bx * right_z) / determinant
    right = (bz * left_x - bx * left_z) / determinant
    return left, right


def intersect(base: _Base, x1: Array, x2: Array) -> Intersection:
    """Intersect rays in the XZ plane; Y is the mean of the two rays (conventions).

    Parameters
    ----------
    base
        Right projection centre minus the left one; (m, 1) each of m models.
    x1, x2
        (3, n), (3, m, n) rays of the left and right photo in the object system.

    Returns
    -------
    Intersection
        Parallel rays give infinite or NaN coordinates; the caller silences the division by zero.
    """
    left, right = ray_factors(base, x1, x2)
    points = left * x1
    y = points[1]
    y += base[1] + right * x2[1]
    y *= 0.5
    return Intersection(points, left, right)
