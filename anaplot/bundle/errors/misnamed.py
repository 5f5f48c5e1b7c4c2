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
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.onward import adjust_onward
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.imaging import imaged, seen_places
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.remade import laid_out_again
from anaplot.errors import NotComputableError

__all__ = ["MisnamedRay", "misnamed_rays"]

_NEAR = 50.0  # sigmas: that far from where a point is seen a ray may still be its own
_SURE = 5.0  # sigmas from there beyond which it is not, where other rays place the point
_ENOUGH = 3  # rays that do
_MOST = 6  # that are tried, the largest errors first
_FEW = 5_000  # points of a block that are all looked for in a photo


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
    axes: dict[int, set[str]] = {}
    size: dict[int, float] = {}
    for name in rejected:
        if name[0] == "image":
            ray = block.observations.row_of(name) // 2
            row = int(block.problem.source[ray])
            axes.setdefault(row, set()).add(str(name[-1]))
            size[row] = float(np.abs(block.v[ray]).max())
    order = sorted(axes, key=lambda row: -size[row])
    return {row: frozenset(axes[row]) for row in order}


def _candidates(block: AdjustedBlock, rows: Sequence[int]) -> Iterator[_Candidate]:
    """Yield the names that the rejected rays may have borne, each exchange once."""
    problem, state = block.problem, block.state
    points = problem.block.image_points
    seen = imaged(problem, state).xy
    ray_of = dict(zip(problem.source.tolist(), range(len(problem.source)), strict=True))
    sigma = float(np.median(problem.sigma))
    placed = _Placed(problem)
    given: set[frozenset[int]] = set()
    for row in rows:
        ray = ray_of.get(row)
        if ray is None:
            continue
        photo, own = int(problem.photo[ray]), int(problem.point[ray])
        there = placed.rays(photo)
        others = there[problem.point[there] != own]
        as_other, instead = _far(seen[others], problem.xy[ray]), _far(problem.xy[others], seen[ray])
        off: Array = np.minimum(instead, as_other)
        off[placed.elsewhere(problem.point[others], as_other, sigma)] = np.inf
        off[placed.elsewhere(np.full(len(others), own), instead, sigma)] = np.inf
        for other in others[np.argsort(off)][: np.count_nonzero(off < _NEAR * sigma)].tolist():
            partner = int(problem.source[other])
            same = points[partner].model == points[row].model
            if same and frozenset((row, partner)) not in given:
                given.add(frozenset((row, partner)))
                yield _Candidate(row, points[partner].point, partner)
        if problem.lens_units is not None:
            continue  # only where points are seen that are measured there can be told
        around = placed.points_around(photo)
        far = _far(seen_places(problem, state, photo, state.points[around]).xy, problem.xy[ray])
        far[placed.elsewhere(around, far, sigma)] = np.inf
        for at in around[far < _NEAR * sigma].tolist():
            yield _Candidate(row, problem.points[at], None)


class _Placed:
    """Rays and points of the photos of a bundle, and which points other rays place.

    Parameters
    ----------
    problem
        The bundle, without what is rejected.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._order = np.argsort(problem.photo, kind="stable")
        self._starts = np.searchsorted(
            problem.photo[self._order], np.arange(len(problem.photos) + 1)
        )
        whole: Bools = np.ones(len(problem.photo), dtype=bool)
        if problem.rejected is not None:
            whole &= ~problem.rejected.any(axis=1)
        self._enough = np.bincount(problem.point[whole], minlength=len(problem.points)) > _ENOUGH
        self._around: dict[int, Index] = {}

    def rays(self, photo: int) -> Index:
        """Return the rays of a photo, ascending."""
        return self._order[self._starts[photo] : self._starts[photo + 1]]

    def points_around(self, photo: int) -> Index:
        """Return the points that a photo lacks, of a large block those of photos beside it."""
        if photo not in self._around:
            problem, mine = self._problem, np.zeros(len(self._problem.points), dtype=bool)
            near = ~mine
            mine[problem.point[self.rays(photo)]] = True
            if len(mine) > _FEW:
                beside = np.zeros(len(problem.photos), dtype=bool)
                beside[problem.photo[mine[problem.point]]] = True
                near[:] = False
                near[problem.point[beside[problem.photo]]] = True
            self._around[photo] = np.flatnonzero(near & ~mine)
        return self._around[photo]

    def elsewhere(self, points: Index, far: Array, sigma: float) -> Bools:
        """Return which points are surely not what was measured that far from where they are seen.

        What other rays place is seen with less than the sigma of a measurement: the difference has
        less than one and a half, and the test is passed up to its critical value.
        """
        out: Bools = self._enough[points] & (far > _SURE * sigma)
        return out


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
        right = adjust_onward(laid_out_again(problem, changed), block)
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
