"""How well each photo of an adjusted block is checked, and what it shares with its neighbours."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy import sparse

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.overlap import footprints, overlap_shares

__all__ = [
    "MOST_NEIGHBOURS",
    "Overlap",
    "PhotoCheck",
    "photo_checks",
    "photo_formats",
    "photo_overlaps",
]

MOST_NEIGHBOURS = 8
"""Neighbours of a photo that are told, those with the most points in common first."""

_PAIRS = 4096  # of photos that are looked at at once


class PhotoCheck(NamedTuple):
    """What checks a photo.

    Attributes
    ----------
    rays
        Rays of which a coordinate counts.
    redundancy
        Sum of the redundancy numbers of its image coordinates.
    mean_r, least_r
        Mean and smallest of them; None where no coordinate counts.
    rms_x_um, rms_y_um
        Root mean squares of the residuals that count [um]; None where none does.
    flagged
        Number of its flagged image coordinates.
    """

    rays: int
    redundancy: float
    mean_r: float | None
    least_r: float | None
    rms_x_um: float | None
    rms_y_um: float | None
    flagged: int


class Overlap(NamedTuple):
    """What a photo shares with a neighbour.

    Attributes
    ----------
    photo, other
        Names.
    points
        Number of points in both.
    share
        Of the photo's points.
    overlap
        Which part of what the photo shows the other one shows too, in the plane through the middle
        of the common points across the mean of both axes; None where a corner looks past it.
    """

    photo: str
    other: str
    points: int
    share: float
    overlap: float | None


def photo_checks(block: AdjustedBlock) -> tuple[PhotoCheck, ...]:
    """Return what checks each photo, in the block's order."""
    problem, counts = block.problem, ~block.rejected
    n = len(problem.photos)
    r = np.where(counts, block.cofactors.r, 0.0)
    rays = np.bincount(problem.photo, counts.any(axis=1), n).astype(int)
    number = np.bincount(problem.photo, counts.sum(axis=1), n)
    total = np.bincount(problem.photo, r.sum(axis=1), n)
    least = np.full(n, np.inf)
    np.minimum.at(least, problem.photo, np.where(counts, r, np.inf).min(axis=1))
    rms = _rms_um(block, counts)
    flagged = np.bincount(problem.photo, block.flagged.sum(axis=1), n).astype(int)
    return tuple(
        PhotoCheck(k, s, s / m if m else None, max(low, 0.0) if m else None, x, y, wrong)
        for k, s, m, low, (x, y), wrong in zip(
            rays.tolist(), total.tolist(), number.tolist(), least.tolist(), rms, flagged.tolist(),
            strict=True,
        )
    )  # fmt: skip


def _rms_um(block: AdjustedBlock, counts: Bools) -> list[tuple[float | None, float | None]]:
    problem, n = block.problem, len(block.problem.photos)
    v = np.where(counts, 1e3 * block.v * problem.sigma_xy, 0.0)
    columns = []
    for axis in range(2):
        squares = np.bincount(problem.photo, v[:, axis] ** 2, n)
        number = np.bincount(problem.photo, counts[:, axis], n)
        columns.append(
            [sqrt(s / m) if m else None for s, m in zip(squares, number.tolist(), strict=True)]
        )
    return list(zip(*columns, strict=True))


def photo_overlaps(block: AdjustedBlock) -> tuple[Overlap, ...]:
    """Return what each photo shares with up to `MOST_NEIGHBOURS` others; photos in their order.

    Without a stated format that of the camera is what its measured points span.
    """
    problem, state = block.problem, block.state
    seen = _seen(block)
    first, second, common = _neighbours(seen)
    if not len(first):
        return ()
    own = np.asarray(seen.sum(axis=1)).ravel()
    middle = _middles(seen, state.points, first, second)
    axes = -state.rotations[:, :, 2]
    normals = axes[first] + axes[second]
    size = np.linalg.norm(normals, axis=1)
    normals /= np.where(size > 0.0, size, np.nan)[:, None]
    formats = photo_formats(problem)
    places = [
        footprints(state.centres[k], state.rotations[k], problem.c[k], formats[k], middle, normals)
        for k in (first, second)
    ]
    plane = _plane(normals)
    mine, other = (np.einsum("nij,nkj->nki", plane, one - middle[:, None]) for one in places)
    shares = overlap_shares(mine, other)
    return tuple(
        Overlap(
            problem.photos[i],
            problem.photos[j],
            count,
            count / all_of,
            None if np.isnan(share) else share,
        )
        for i, j, count, all_of, share in zip(
            first.tolist(), second.tolist(), common.tolist(), own[first].tolist(), shares.tolist(),
            strict=True,
        )
    )  # fmt: skip


def _seen(block: AdjustedBlock) -> sparse.csr_array:
    """Return (photos, points) 1 where a point is measured in a photo, by a ray that counts."""
    problem = block.problem
    counts = ~block.rejected.all(axis=1)
    shape = (len(problem.photos), len(problem.points))
    places = (problem.photo[counts], problem.point[counts])
    seen = sparse.csr_array((np.ones(int(counts.sum()), dtype=np.int64), places), shape=shape)
    seen.sum_duplicates()
    seen.data[:] = 1
    return seen


def _neighbours(seen: sparse.csr_array) -> tuple[Index, Index, Index]:
    """Return photos, their neighbours and how many points both have."""
    both = sparse.csr_array(seen @ seen.T)
    both.setdiag(0)
    both.eliminate_zeros()
    first = np.repeat(np.arange(both.shape[0]), np.diff(both.indptr))
    order = np.lexsort((both.indices, -both.data, first))
    rank = np.arange(len(first)) - both.indptr[first]
    kept = order[rank < MOST_NEIGHBOURS]
    return first[kept], both.indices[kept].astype(np.intp), both.data[kept]


def _middles(seen: sparse.csr_array, points: Array, first: Index, second: Index) -> Array:
    """Return (n, 3) the middle of the points that pairs of photos have in common."""
    out = np.empty((len(first), 3))
    ones = np.column_stack([points, np.ones(len(points))])
    for k in range(0, len(first), _PAIRS):
        some = slice(k, k + _PAIRS)
        sums = seen[first[some]].multiply(seen[second[some]]) @ ones
        out[some] = sums[:, :3] / sums[:, 3:]
    return out


def photo_formats(problem: Problem) -> Array:
    """Return (photos, 2) width and height [mm]; without a format what a camera's points span."""
    camera = problem.cameras[problem.photo]
    formats = np.zeros((len(problem.block.cameras), 2))
    np.maximum.at(formats, camera, 2.0 * np.abs(problem.xy))
    for k, one in enumerate(problem.block.cameras):
        if one.format is not None:
            formats[k] = one.format
    return np.asarray(formats[problem.cameras])


def _plane(normals: Array) -> Array:
    """Return (n, 2, 3) two axes in each plane."""
    least = np.eye(3)[np.argmin(np.abs(np.nan_to_num(normals)), axis=1)]
    one = np.cross(normals, least)
    one /= np.linalg.norm(one, axis=1)[:, None]
    return np.stack([one, np.cross(normals, one)], axis=1)
