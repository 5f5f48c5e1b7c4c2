"""Collinearity: where a ground point appears in a photo, with all derivatives.

With u = R'(X - X0) the point in the photo's own axes, x = -c u1/u3 and y = -c u2/u3; u3 is
negative for a point in front of the photo (conventions: a ray is (x, y, -c)).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index

__all__ = ["Projection", "Projections", "project", "project_with_derivatives", "turns"]

_AT_ONCE = 8192  # rays whose components stay at hand while they are used


class Projection(NamedTuple):
    """Image coordinates of points.

    Attributes
    ----------
    xy
        (n, 2) image coordinates [mm].
    depth
        (n,) distance in front of the photo along its axis [m]; negative behind it.
    """

    xy: Array
    depth: Array


class Projections(NamedTuple):
    """Image coordinates of points and their derivatives.

    Attributes
    ----------
    xy
        (n, 2) image coordinates [mm].
    depth
        (n,) distance in front of the photo along its axis [m].
    photo
        (n, 2, 6) derivatives with respect to the projection centre [mm/m] and to a small rotation
        of the photo about the ground axes [mm/rad].
    point
        (n, 2, 3) derivatives with respect to the ground point [mm/m].
    """

    xy: Array
    depth: Array
    photo: Array
    point: Array


def project(
    centres: Array,
    rotations: Array,
    c: Array,
    points: Array,
    rays: tuple[Index, Index] | None = None,
) -> Projection:
    """Project points, one into each photo.

    Parameters
    ----------
    centres
        (n, 3) projection centres [m].
    rotations
        (n, 3, 3) rotations from image to ground.
    c
        (n,) camera constants [mm].
    points
        (n, 3) ground points [m].
    rays
        (m,) photos and (m,) points of rays, numbers in these arrays, which have a photo and a
        point for many rays then; None: every photo has its own point.

    Returns
    -------
    Projection
        A point in the plane of the projection centre gives infinite or NaN coordinates.
    """
    n = len(points) if rays is None else len(rays[0])
    xy, depth = np.empty((n, 2)), np.empty(n)
    for k, away, axes, scale in _portions(centres, rotations, c, points, rays):
        u = np.einsum("ik,ijk->jk", away, axes)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            xy[k] = (-scale / u[2] * u[:2]).T
        depth[k] = -u[2]
    return Projection(xy, depth)


def project_with_derivatives(
    centres: Array,
    rotations: Array,
    c: Array,
    points: Array,
    rays: tuple[Index, Index] | None = None,
) -> Projections:
    """Project points, one into each photo, and differentiate.

    Parameters
    ----------
    centres, rotations, c, points, rays
        As in `project`.

    Notes
    -----
    The rotation's derivatives refer to R -> (I + [d x]) R, d about the ground axes; with
    D = X - X0 and J = d(x, y)/dX they are J x D.
    """
    n = len(points) if rays is None else len(rays[0])
    xy, depth = np.empty((n, 2)), np.empty(n)
    photo, j = np.empty((n, 2, 6)), np.empty((n, 2, 3))
    for k, away, axes, scale in _portions(centres, rotations, c, points, rays):
        u = np.einsum("ik,ijk->jk", away, axes)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            factor = -scale / u[2]
            at = factor * u[:2]
            slope = -at / u[2]
        xy[k], depth[k] = at.T, -u[2]
        for row in range(2):
            jr = factor * axes[:, row] + slope[row] * axes[:, 2]
            j[k, row] = jr.T
            photo[k, row, :3] = -jr.T
            # d(x, y)/dX projects along the ray, so J (X - X0) = 0: J x D needs no other term
            photo[k, row, 3] = jr[1] * away[2] - jr[2] * away[1]
            photo[k, row, 4] = jr[2] * away[0] - jr[0] * away[2]
            photo[k, row, 5] = jr[0] * away[1] - jr[1] * away[0]
    return Projections(xy, depth, photo, j)


def _portions(
    centres: Array, rotations: Array, c: Array, points: Array, rays: tuple[Index, Index] | None
) -> Iterator[tuple[slice, Array, Array, Array]]:
    """Yield rays in portions: which, X - X0 (3, k), axes of their photos (3, 3, k), and c (k,).

    What a photo has is repeated for its rays here alone, a portion at a time.
    """
    n = len(points) if rays is None else len(rays[0])
    turned = rotations.transpose(1, 2, 0)
    if rays is not None:
        turned = np.ascontiguousarray(turned)
    for first in range(0, n, _AT_ONCE):
        k = slice(first, first + _AT_ONCE)
        photo, point = (k, k) if rays is None else (rays[0][k], rays[1][k])
        away = np.ascontiguousarray((points[point] - centres[photo]).T)
        yield k, away, np.ascontiguousarray(turned[:, :, photo]), c[photo]


def turns(vectors: Array) -> Array:
    """Return (n, 3, 3) rotations about (n, 3) vectors by their lengths [rad] (Rodrigues)."""
    n = len(vectors)
    angle = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    s = np.where(small, 1.0 - angle**2 / 6.0, np.sin(safe) / safe)
    k = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    out = k[:, None, None] * vectors[:, :, None] * vectors[:, None, :]
    x, y, z = (s * vectors[:, axis] for axis in range(3))
    out[:, 0, 1] -= z
    out[:, 1, 0] += z
    out[:, 0, 2] += y
    out[:, 2, 0] -= y
    out[:, 1, 2] -= x
    out[:, 2, 1] += x
    diagonal = 1.0 - k * angle**2
    for axis in range(3):
        out[:, axis, axis] += diagonal
    return out.reshape(n, 3, 3)
