"""The block seen from above: where photos and points lie, and how well points are checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.placeaccuracy import error_ellipses

__all__ = ["BlockMap", "PointKind", "block_map", "flagged_points", "mean_redundancy"]

PointKind = Literal["tie", "control", "check"]


@dataclass(frozen=True, slots=True, eq=False)
class BlockMap:
    """What a map of an adjusted block shows; X and Y are those of the ground system [m].

    Attributes
    ----------
    photos
        (p,) names.
    centres
        (p, 2) projection centres.
    strips
        Of every strip its photos in order, as indices of `photos`.
    points
        (n,) names, in the order of the file of image points.
    places
        (n, 2) where they are.
    kinds
        (n,) whether control.csv has them as control or as check points.
    r
        (n,) mean redundancy number of the point's image coordinates that count; NaN where none
        does.
    flagged
        (n,) whether the test rejects one of its image coordinates, or of its control coordinates.
    ellipses
        (n, 3) standard ellipses in plan: semi-axes a, b [m], and the direction of a from X towards
        Y [rad]; NaN without a sigma.
    """

    photos: tuple[str, ...] = field(repr=False)
    centres: Array = field(repr=False)
    strips: tuple[tuple[int, ...], ...] = field(repr=False)
    points: tuple[str, ...] = field(repr=False)
    places: Array = field(repr=False)
    kinds: tuple[PointKind, ...] = field(repr=False)
    r: Array = field(repr=False)
    flagged: Bools = field(repr=False)
    ellipses: Array = field(repr=False)


def block_map(adjusted: AdjustedBlock) -> BlockMap:
    """Return the map of an adjusted block."""
    problem, state = adjusted.problem, adjusted.state
    count = len(problem.points)
    first = np.full(count, len(problem.block.image_points))
    np.minimum.at(first, problem.point, problem.source)
    order = np.argsort(first, kind="stable")
    at = {name: k for k, name in enumerate(problem.photos)}
    kinds = _kinds(adjusted)
    return BlockMap(
        photos=problem.photos,
        centres=(state.centres + state.origin)[:, :2],
        strips=tuple(
            tuple(at[photo] for photo in strip.photos if photo in at)
            for strip in problem.block.strips
        ),
        points=tuple(problem.points[k] for k in order.tolist()),
        places=(state.points + state.origin)[order, :2],
        kinds=tuple(kinds.get(problem.points[k], "tie") for k in order.tolist()),
        r=mean_redundancy(adjusted)[order],
        flagged=flagged_points(adjusted)[order],
        ellipses=_ellipses(adjusted)[order],
    )


def _kinds(adjusted: AdjustedBlock) -> dict[str, PointKind]:
    found: dict[str, PointKind] = {}
    for row in adjusted.problem.block.control:
        if row.use in ("control", "check"):
            found[row.point] = "control" if row.use == "control" else "check"
    return found


def _ellipses(adjusted: AdjustedBlock) -> Array:
    if adjusted.sigma is None:
        return np.full((len(adjusted.problem.points), 3), np.nan)
    return error_ellipses(adjusted.sigma**2 * adjusted.cofactors.points[:, :2, :2])


def mean_redundancy(block: AdjustedBlock) -> Array:
    """Return (p,) mean redundancy numbers of the image coordinates that count; NaN without any."""
    problem = block.problem
    counts = (~block.rejected).sum(axis=1)
    n = len(problem.points)
    total = np.bincount(problem.point, weights=block.cofactors.r.sum(axis=1), minlength=n)
    rays = np.bincount(problem.point, weights=counts, minlength=n)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(rays > 0, total / rays, np.nan))


def flagged_points(block: AdjustedBlock) -> Bools:
    """Return (p,) which points have a flagged image or control coordinate."""
    problem, tested, rows = block.problem, block.tested, block.observations
    out = np.zeros(len(problem.points), dtype=bool)
    out[problem.point[block.flagged.any(axis=1)]] = True
    control = tested.flagged[rows.image : rows.starts[1]]
    out[rows.ground[control, 1]] = True
    return out
