"""Which flagged image coordinates to look at first, and what cannot be told apart from them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.partners import likeliest
from anaplot.adjustment.reliability import HARD_TO_TELL
from anaplot.aliases import Array, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.photogrammetry.imagepoints import columns_of

__all__ = ["ImageCoordinate", "Suspect", "likeliest_suspect", "likeliest_suspects"]

_AT_ONCE = 256
"""Flagged coordinates whose points are looked at together."""


class ImageCoordinate(NamedTuple):
    """One image coordinate of a point.

    Attributes
    ----------
    photo, model, axis
        The ray (model: None where none is named) and "x" or "y".
    """

    photo: str
    model: str | None
    axis: str


class Suspect(NamedTuple):
    """An image coordinate that is probably wrong, or one of its partners is.

    Attributes
    ----------
    point
        Its point.
    where
        The coordinate.
    w, r
        abs(w), and redundancy number.
    partners
        Coordinates of the point whose residuals are so highly correlated with its own that they
        are hard to tell apart, the largest redundancy number first.
    """

    point: str
    where: ImageCoordinate
    w: float
    r: float
    partners: tuple[ImageCoordinate, ...]


def likeliest_suspects(block: AdjustedBlock) -> tuple[Suspect, ...]:
    """Return the flagged image coordinates, the largest abs(w) first, one for those alike.

    Of coordinates of a point that are hard to tell apart the likeliest stands for all, see
    `adjustment.partners`: at a point of two rays that with the largest redundancy number.
    """
    return tuple(_suspects(block, _AT_ONCE))


def likeliest_suspect(block: AdjustedBlock) -> Suspect | None:
    """Return the first of `likeliest_suspects`, without looking at the others."""
    return next(_suspects(block, 1), None)


def _suspects(block: AdjustedBlock, at_once: int) -> Iterator[Suspect]:
    """Yield suspects; of some flagged coordinates at once the points are looked at together."""
    problem = block.problem
    flagged = np.argwhere(block.flagged)
    order = np.argsort(-np.abs(block.w[flagged[:, 0], flagged[:, 1]]), kind="stable")
    known: set[tuple[int, int]] = set()
    for first in range(0, len(order), at_once):
        some = flagged[order[first : first + at_once]].tolist()
        points = problem.point[[ray for ray, axis in some if (ray, axis) not in known]]
        of_point = dict(block.cofactors.several_correlations(points.tolist()))
        for ray, axis in some:
            if (ray, axis) not in known:
                point = int(problem.point[ray])
                suspect, alike = _suspect(block, *of_point[point], (ray, axis))
                known.update(alike)
                yield suspect


def _suspect(
    block: AdjustedBlock, rays: Index, rho: Array, flagged: tuple[int, int]
) -> tuple[Suspect, list[tuple[int, int]]]:
    """Return what stands for a flagged coordinate (ray, axis), and all that is like it."""
    ray, axis = flagged
    at = 2 * int(np.flatnonzero(rays == ray)[0]) + axis
    r, w = block.cofactors.r[rays].ravel(), block.w[rays].ravel()
    columns = np.nan_to_num(rho[at]) * np.sqrt(r * r[at])
    best = int(likeliest(w[None], r[None], columns[None], np.array([at], dtype=np.intp))[0])
    alike = np.flatnonzero(np.abs(np.nan_to_num(rho[best])) >= HARD_TO_TELL)
    alike = alike[np.argsort(-r[alike], kind="stable")]
    where = {k: _where(block, int(rays[k // 2]), k % 2) for k in (*alike.tolist(), best)}
    suspect = Suspect(
        block.problem.points[block.problem.point[ray]],
        where[best],
        float(abs(w[best])),
        float(r[best]),
        tuple(where[k] for k in alike.tolist() if k != best),
    )
    return suspect, [(int(rays[k // 2]), int(k % 2)) for k in (*alike.tolist(), at)]


def _where(block: AdjustedBlock, ray: int, axis: int) -> ImageCoordinate:
    problem = block.problem
    models = columns_of(problem.block.image_points).model
    photo = problem.photos[problem.photo[ray]]
    return ImageCoordinate(photo, models.at(problem.source[ray]), "xy"[axis])
