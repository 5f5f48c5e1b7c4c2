"""The image coordinates of a geometry, linearised, and what they check of each other."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.photogrammetry.collinearity import project_with_derivatives

__all__ = ["image_design", "residual_matrix"]


def image_design(
    centres: Array, rotations: Array, c: float, points: Array, rays: Index, known: Array
) -> Array:
    """Return (2 m, u) derivatives of x and y of m rays [mm per m and per rad].

    Parameters
    ----------
    centres, rotations
        (p, 3) and (p, 3, 3), image to ground.
    c
        Camera constant [mm].
    points
        (q, 3) ground points.
    rays
        (m, 2) photo and point of every ray.
    known
        (q, 3) which coordinates are control free of error: they are no unknowns.
    """
    photo, point = rays.T
    m, p = len(rays), len(centres)
    seen = project_with_derivatives(centres[photo], rotations[photo], np.full(m, c), points[point])
    design = np.zeros((m, 2, 6 * p + points.size))
    at = np.arange(m)
    for k in range(6):
        design[at, :, 6 * photo + k] = seen.photo[:, :, k]
    for k in range(3):
        design[at, :, 6 * p + 3 * point + k] = seen.point[:, :, k]
    free = np.concatenate([np.ones(6 * p, dtype=bool), ~np.asarray(known, dtype=bool).ravel()])
    return design.reshape(2 * m, -1)[:, free]


def residual_matrix(design: Array) -> Array:
    """Return (n, n) R = I - A (A'A)^-1 A' of rows of equal weight.

    Parameters
    ----------
    design
        (n, u).

    Raises
    ------
    ValueError
        Columns that depend on each other.
    """
    length = np.sqrt(np.einsum("ij,ij->j", design, design))
    if not length.all():
        raise ValueError("nothing observes some of the unknowns")
    left, singular, _ = np.linalg.svd(design / length, full_matrices=False)
    if singular[-1] < 1e-9 * singular[0]:
        raise ValueError("the rows do not determine all unknowns")
    matrix: Array = np.eye(len(design)) - left @ left.T
    return matrix
