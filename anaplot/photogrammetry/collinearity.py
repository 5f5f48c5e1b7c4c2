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
        point for many rays then; None: every photo has its own point, or a single one has all.

    Returns
    -------
    Projection
        A point in the plane of the projection centre gives infinite or NaN coordinates.
    """
    n = len(points) if rays is None else len(rays[0])
    xy, depth = np.empty((n, 2)), np.empty(n)
    for k, away, axes, scale in _portions(centres, rotations, c, points, rays):
        u = _in_photo(axes, away)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            xy[k] = (-scale / u[2] * u[:2]).T
        np.negative(u[2], out=depth[k])
    return Projection(xy, depth)


def project_with_derivatives(
    centres: Array,
    rotations: Array,
    c: Array,
    points: Array,
    rays: tuple[Index, Index] | None = None,
    weight: Array | None = None,
) -> Projections:
    """Project points, one into each photo, and differentiate.

    Parameters
    ----------
    centres, rotations, c, points, rays
        As in `project`.
    weight
        (n, 2) what the derivatives of x and y are multiplied by; None: by nothing.

    Notes
    -----
    The rotation's derivatives refer to R -> (I + [d x]) R, d about the ground axes; with
    D = X - X0 and J = d(x, y)/dX they are J x D.
    """
    n = len(points) if rays is None else len(rays[0])
    xy, depth = np.empty((n, 2)), np.empty(n)
    photo, j = np.empty((n, 2, 6)), np.empty((n, 2, 3))
    for k, away, axes, scale in _portions(centres, rotations, c, points, rays):
        u = _in_photo(axes, away)
        # a point in the plane of its projection centre has neither an image nor derivatives
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            factor = -scale / u[2]
            at = factor * u[:2]
            slope = -at / u[2]
            by_point, by_photo = np.empty((2, 3, len(factor))), np.empty((2, 6, len(factor)))
            for row, (jr, each) in enumerate(zip(by_point, by_photo, strict=True)):
                across, along = factor, slope[row]
                if weight is not None:
                    across, along = across * weight[k, row], along * weight[k, row]
                for axis in range(3):
                    np.multiply(across, axes[axis, row], out=jr[axis])
                    jr[axis] += along * axes[axis, 2]
                np.negative(jr, out=each[:3])
                # d(x, y)/dX projects along the ray, so J (X - X0) = 0: J x D needs no other term
                for out, (p, q) in zip(each[3:], ((1, 2), (2, 0), (0, 1)), strict=True):
                    np.multiply(jr[p], away[q], out=out)
                    out -= jr[q] * away[p]
        xy[k] = at.T
        np.negative(u[2], out=depth[k])
        j[k], photo[k] = by_point.transpose(2, 0, 1), by_photo.transpose(2, 0, 1)
    return Projections(xy, depth, photo, j)


def _in_photo(axes: Array, away: Array) -> Array:
    """(3, k) components of X - X0 along the axes of the photos."""
    out = np.empty_like(away)
    for own, (x, y, z) in zip(out, axes.transpose(1, 0, 2), strict=True):
        np.multiply(x, away[0], out=own)
        own += y * away[1]
        own += z * away[2]
    return out


def _portions(
    centres: Array, rotations: Array, c: Array, points: Array, rays: tuple[Index, Index] | None
) -> Iterator[tuple[slice, Array, Array, Array]]:
    """Yield rays in portions: which, X - X0 (3, k), axes of their photos (3, 3, k), and c (k,).

    What a photo has is repeated for its rays here alone, a portion at a time.
    """
    turned = rotations.transpose(1, 2, 0)
    if rays is None:
        for k in _slices(len(points)):
            own = slice(0, 1) if len(centres) == 1 else k
            away = np.ascontiguousarray((points[k] - centres[own]).T)
            yield k, away, np.ascontiguousarray(turned[:, :, own]), c[own]
        return
    rows, at, of = (np.ascontiguousarray(each) for each in (turned, centres.T, points.T))
    for k in _slices(len(rays[0])):
        photo, point = rays[0][k], rays[1][k]
        away = of.take(point, axis=1)
        away -= at.take(photo, axis=1)
        yield k, away, rows.take(photo, axis=2), c.take(photo)


def _slices(count: int) -> Iterator[slice]:
    return (slice(first, first + _AT_ONCE) for first in range(0, count, _AT_ONCE))


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
