"""How much of what one photograph shows another one shows too."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array

__all__ = ["footprints", "overlap_shares"]

_CORNERS = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])


def footprints(
    centres: Array, rotations: Array, c: Array, formats: Array, through: Array, normals: Array
) -> Array:
    """Return what photographs show of planes, one each.

    Parameters
    ----------
    centres, rotations
        (n, 3), and (n, 3, 3) image to ground.
    c, formats
        (n,) and (n, 2) width and height, in one unit.
    through, normals
        (n, 3) a point of each plane, and a vector across it.

    Returns
    -------
    ndarray
        (n, 4, 3) where the corners of the format lie in the plane, in the order of a walk around
        it; NaN where a corner looks past it.
    """
    corners = _CORNERS * formats[:, None, :]
    below = np.broadcast_to(-c[:, None, None], (len(c), 4, 1))
    rays = np.einsum("nij,nkj->nki", rotations, np.concatenate([corners, below], axis=2))
    height = np.einsum("ni,ni->n", normals, through - centres)
    with np.errstate(all="ignore"):
        along = height[:, None] / np.einsum("ni,nki->nk", normals, rays)
        places = centres[:, None, :] + along[:, :, None] * rays
    return np.where((along > 0.0)[:, :, None] & np.isfinite(places), places, np.nan)


def overlap_shares(mine: Array, other: Array) -> Array:
    """Return which share of areas lies in others as well.

    Parameters
    ----------
    mine, other
        (n, k, 2) and (n, m, 2) corners of convex areas in a plane, in the order of a walk around
        them, in either sense.

    Returns
    -------
    ndarray
        (n,) shares from 0 to 1; NaN where a corner is, or an area is none.
    """
    turned = np.sign(_areas(other))
    left = mine
    for k in range(other.shape[1]):
        start, end = other[:, k], other[:, (k + 1) % other.shape[1]]
        left = _cut(left, start, end - start, turned)
    with np.errstate(all="ignore"):
        shares = np.abs(_areas(left)) / np.abs(_areas(mine))
    return np.where(np.abs(turned) == 1.0, np.clip(shares, 0.0, 1.0), np.nan)


def _areas(corners: Array) -> Array:
    """(n,) signed areas; anticlockwise ones are positive."""
    x, y = (corners - corners[:, :1]).transpose(2, 0, 1)
    sums = np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    return np.asarray(0.5 * sums)


def _cut(corners: Array, start: Array, along: Array, turned: Array) -> Array:
    """Return (n, 2k, 2) areas without what lies outside of a line.

    A corner outside becomes its foot on the line. Between where the outline leaves and where it
    comes back it then runs along the line, to and fro perhaps, which encloses nothing.
    """
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    with np.errstate(all="ignore"):
        height = np.einsum("nki,ni->nk", corners - start[:, None], across)
        height /= np.sum(along**2, axis=1)[:, None]
        feet = corners - height[:, :, None] * across[:, None, :]
        outside = turned[:, None] * height < 0.0
        crosses = outside != np.roll(outside, -1, axis=1)
        part = height / (height - np.roll(height, -1, axis=1))
        crossing = corners + part[:, :, None] * (np.roll(corners, -1, axis=1) - corners)
    kept = np.where(outside[:, :, None], feet, corners)
    return np.stack([kept, np.where(crosses[:, :, None], crossing, kept)], axis=2).reshape(
        len(corners), -1, 2
    )
