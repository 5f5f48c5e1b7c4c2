"""Rays under the name of another point: one mistake that shows as several gross errors.

Gruen (1980) counts errors of numbering among the larger ones. A rejected ray whose point would be
seen where another ray of the photo was measured, or that was measured where another point would be
seen, may only bear the wrong name. That it does is found by trying: with the names put right the
block is adjusted, and takes the observations back that were rejected for it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array
from anaplot.bundle.adjust import adjust_problem
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.imaging import imaged, seen_places
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.remade import laid_out_again
from anaplot.errors import NotComputableError

__all__ = ["MisnamedRay", "misnamed_rays"]

_NEAR = 50.0  # sigmas: that far from where a point is seen a ray may still be its own
_MOST = 6  # that are tried, the largest errors first


class MisnamedRay(NamedTuple):
    """A ray that fits under another name.

    Attributes
    ----------
    photo, point, model
        The ray as it is named.
    meant
        The point whose name it should bear.
    interchanged
        Whether the photo's ray of that name should bear this one's: two names were exchanged.
    sigma0
        Of the block with the names put right.
    taken_back
        How many of the rejected coordinates then fit.
    """

    photo: str
    point: str
    model: str | None
    meant: str
    interchanged: bool
    sigma0: float | None
    taken_back: int


def misnamed_rays(
    block: AdjustedBlock, rejected: Collection[ObservationName], watch: Watch | None = None
) -> tuple[MisnamedRay, ...]:
    """Return the rays that only bear a wrong name.

    Parameters
    ----------
    block
        The block, adjusted without the rejected observations.
    rejected
        What was rejected in it; other things than image coordinates stay as they are.
    watch
        Told of every name that is tried; where it asks for the end, no more are.
    """
    watch = Watch() if watch is None else watch
    rays = _rejected_rays(block, rejected)
    found: list[MisnamedRay] = []
    settled: set[int] = set()
    for tried in islice(_candidates(block, list(rays)), _MOST):
        if watch.stopped:
            break
        if not settled.isdisjoint(tried.rows):
            continue
        watch("wrong names", 0.0)
        right = _put_right(block, rays, tried)
        if right is not None:
            found.append(right)
            settled.update(tried.rows)
    return tuple(found)


class _Candidate(NamedTuple):
    row: int  # of the ray among the block's image points
    meant: str
    other: int | None  # the row whose name it is; None: the photo has none

    @property
    def rows(self) -> tuple[int, ...]:
        return (self.row,) if self.other is None else (self.row, self.other)


def _rejected_rays(
    block: AdjustedBlock, rejected: Collection[ObservationName]
) -> dict[int, frozenset[str]]:
    """Return the rejected axes by row of the block's image points, the largest errors first."""
    names = {
        (row.photo, row.point, row.model): k
        for k, row in enumerate(block.problem.block.image_points)
    }
    axes: dict[int, set[str]] = {}
    for kind, *rest in rejected:
        if kind == "image":
            photo, point, model, axis = rest
            axes.setdefault(names[str(photo), str(point), model], set()).add(str(axis))
    size = {
        int(row): float(np.abs(v).max())
        for row, v in zip(block.problem.source, block.v, strict=True)
    }
    order = sorted(axes, key=lambda row: -size.get(row, np.inf))
    return {row: frozenset(axes[row]) for row in order}


def _candidates(block: AdjustedBlock, rows: Sequence[int]) -> Iterator[_Candidate]:
    """Yield the names that the rejected rays may have borne, each exchange once."""
    problem, state = block.problem, block.state
    points = problem.block.image_points
    seen = imaged(problem, state).xy
    ray_of = {int(row): ray for ray, row in enumerate(problem.source)}
    near = _NEAR * float(np.median(problem.sigma))
    given: set[frozenset[int]] = set()
    for row in rows:
        ray = ray_of.get(row)
        if ray is None:
            continue
        photo = problem.photo[ray]
        others = np.flatnonzero((problem.photo == photo) & (problem.point != problem.point[ray]))
        off = np.minimum(_far(problem.xy[others], seen[ray]), _far(seen[others], problem.xy[ray]))
        for other in others[np.argsort(off)][: np.count_nonzero(off < near)].tolist():
            partner = int(problem.source[other])
            same = points[partner].model == points[row].model
            if same and frozenset((row, partner)) not in given:
                given.add(frozenset((row, partner)))
                yield _Candidate(row, points[partner].point, partner)
        if problem.lens_units is not None:
            continue  # only where points are seen that are measured there can be told
        places = seen_places(problem, state, int(photo), state.points).xy
        held = set(problem.point[problem.photo == photo].tolist())
        for at in np.flatnonzero(_far(places, problem.xy[ray]) < near).tolist():
            if at not in held:
                yield _Candidate(row, problem.points[at], None)


def _far(places: Array, place: Array) -> Array:
    with np.errstate(invalid="ignore"):
        distance: Array = np.abs(places - place).max(axis=1)
    return np.where(np.isfinite(distance), distance, np.inf)


def _put_right(
    block: AdjustedBlock, rejected: dict[int, frozenset[str]], tried: _Candidate
) -> MisnamedRay | None:
    """Return the ray when the block takes it under the other name, by v'Pv and by its test."""
    problem = block.problem
    rows = list(problem.block.image_points)
    row = rows[tried.row]
    for k, axes in rejected.items():
        if k not in tried.rows:
            rows[k] = replace(rows[k], use=rows[k].use_without(axes))
    rows[tried.row] = replace(row, point=tried.meant)
    if tried.other is not None:
        rows[tried.other] = replace(rows[tried.other], point=row.point)
    try:
        changed = replace(problem.block, image_points=tuple(rows))
        right = adjust_problem(laid_out_again(problem, changed))
    except NotComputableError:
        return None
    back = sum(len(rejected.get(k, ())) for k in tried.rows)
    limit = critical_normal(problem.test.alpha) ** 2
    mine = np.isin(right.problem.source, tried.rows)
    if not mine.any() or right.flagged[mine].any():
        return None
    if _square(right) > _square(block) + limit * back:
        return None
    return MisnamedRay(
        row.photo, row.point, row.model, tried.meant, tried.other is not None, right.sigma0, back
    )


def _square(block: AdjustedBlock) -> float:
    """V'Pv with the a-priori sigmas."""
    return (block.sigma0 or 0.0) ** 2 * block.redundancy
