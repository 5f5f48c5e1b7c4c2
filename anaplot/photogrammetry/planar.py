"""Many points of a plane, and many systems of two equations, at once."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array

__all__ = ["as_points", "solve_pairs"]


def as_points(xy: Array) -> Array:
    """Return xy as an (n, 2) array of floats; raises ValueError for another shape."""
    points = np.asarray(xy, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points of shape (n, 2) expected, not {points.shape}")
    return points


def solve_pairs(matrices: Array, right: Array) -> Array:
    """Return the (n, 2) solutions of n systems (n, 2, 2), (n, 2); not finite where singular."""
    a, b = matrices[:, 0, 0], matrices[:, 0, 1]
    c, d = matrices[:, 1, 0], matrices[:, 1, 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        determinant = a * d - b * c
        x = (d * right[:, 0] - b * right[:, 1]) / determinant
        y = (a * right[:, 1] - c * right[:, 0]) / determinant
    return np.column_stack((x, y))
