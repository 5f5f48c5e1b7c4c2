"""Rays under the name of another point: one mistake that shows as several gross errors.

Gruen (1980) counts errors of numbering among the larger ones. A rejected ray whose point would be
seen where another ray of the photo was measured, or that was measured where another point would be
seen, may only bear the wrong name. That it does is found by trying: with the names put right the
block is adjusted, and takes the observations back that were rejected for it.

That it does not is often plain before. Of the rows that come in and go out, with misclosures e and
S = diag(1, -1), v'Pv grows linearly by

    e' (S + G)^-1 e,    G = J N^-1 J',

and (S + G)^-1 e and its matrix are residuals and cofactors of what comes in.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.onward import adjust_onward
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import function_cofactors
from anaplot.bundle.solve.imaging import imaged, imaged_places, seen_places
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.remade import laid_out_again
from anaplot.bundle.solve.runs import runs
from anaplot.bundle.solve.sorting import order_of
from anaplot.errors import NotComputableError

__all__ = ["MisnamedRay", "misnamed_rays"]

_NEAR = 50.0  # sigmas: that far from where a point is seen a ray may still be its own
_SURE = 5.0  # sigmas from there beyond which it is not, where other rays place the point
_ENOUGH = 3  # rays that do
_MOST = 6  # that are tried, the largest errors first
_PLAIN = 1.05  # times the limits: what is beyond them, linearly, is not adjusted
_FAR = 10.0  # the same where it may be far from linear
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
        if _plainly_wrong(block, rays, tried):
            continue
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
    problem = block.problem
    points = problem.block.image_points
    rays = np.flatnonzero(np.isin(problem.source, rows))
    ray_of = dict(zip(problem.source[rays].tolist(), rays.tolist(), strict=True))
    meant = _Meant(block, rays.tolist())
    given: set[frozenset[int]] = set()
    for row in filter(ray_of.__contains__, rows):
        ray = ray_of[row]
        others, lacking = meant.by(ray)
        for other in others:
            partner = int(problem.source[other])
            same = points[partner].model == points[row].model
            if same and frozenset((row, partner)) not in given:
                given.add(frozenset((row, partner)))
                yield _Candidate(row, points[partner].point, partner)
        for at in lacking:
            yield _Candidate(row, problem.points[at], None)


_Names = tuple[list[int], list[int]]
"""Other rays of a photo, the nearest first, and points that it lacks: what a ray may be."""


class _Meant:
    """What rejected rays may be that bear a wrong name.

    Parameters
    ----------
    block
        The block, adjusted without what is rejected.
    rejected
        Rays with rejected coordinates.
    """

    def __init__(self, block: AdjustedBlock, rejected: Sequence[int]) -> None:
        problem = self._problem = block.problem
        self._state = block.state
        self._placed = _Placed(problem)
        self._sigma = float(np.median(problem.sigma))
        self._seen = imaged(problem, block.state).xy.take(self._placed.order, axis=0)
        self._xy = problem.xy.take(self._placed.order, axis=0)
        self._rejected: dict[int, list[int]] = {}
        for ray in rejected:
            self._rejected.setdefault(int(problem.photo[ray]), []).append(ray)
        self._names: dict[int, _Names] = {}

    def by(self, ray: int) -> _Names:
        """Return what a rejected ray may be; looked for of all of its photo's at once."""
        if ray not in self._names:
            photo = int(self._problem.photo[ray])
            rays = self._rejected[photo]
            each = self._others(photo, rays), self._lacking(photo, rays)
            self._names.update(zip(rays, zip(*each, strict=True), strict=True))
        return self._names[ray]

    def _others(self, photo: int, rays: Sequence[int]) -> list[list[int]]:
        """Return other rays of a photo that some may be, the nearest first."""
        there, placed = self._placed.rays(photo), self._placed
        order, point = placed.order[there], placed.points[there]
        seen, xy = self._seen[there], self._xy[there]
        mine = np.searchsorted(order, rays)
        own = point[mine, None]
        as_other, instead = _far(seen, xy[mine]), _far(xy, seen[mine])
        off = np.minimum(instead, as_other)
        off[placed.elsewhere(point, as_other, self._sigma)] = np.inf
        off[placed.elsewhere(own, instead, self._sigma)] = np.inf
        off[point == own] = np.inf
        near = np.count_nonzero(off < _NEAR * self._sigma, axis=1).tolist()
        return [
            order[np.argsort(each)[:count]].tolist() if count else []
            for each, count in zip(off, near, strict=True)
        ]

    def _lacking(self, photo: int, rays: Sequence[int]) -> list[list[int]]:
        """Return points that a photo lacks and that some of its rays may be."""
        if self._problem.lens_units is not None:
            # only where points are seen that are measured there can be told
            return [[] for _ in rays]
        around = self._placed.points_around(photo)
        places = self._state.points.take(around, axis=0)
        seen = seen_places(self._problem, self._state, photo, places).xy
        far = _far(seen, self._problem.xy[rays])
        near = far < _NEAR * self._sigma
        near &= ~self._placed.elsewhere(around, far, self._sigma)
        return [around[each].tolist() for each in near]


class _Placed:
    """Rays and points of the photos of a bundle, and which points other rays place.

    Parameters
    ----------
    problem
        The bundle, without what is rejected.

    Attributes
    ----------
    order, points
        (m,) rays and their points, photo by photo, ascending in each.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.order = order_of(problem.photo, len(problem.photos))
        self.points = problem.point.take(self.order)
        count = np.bincount(problem.photo, minlength=len(problem.photos))
        self._ends = [0, *np.cumsum(count).tolist()]
        self._seers = np.bincount(problem.point, minlength=len(problem.points))
        self._first = np.cumsum(self._seers) - self._seers
        whole: Bools = np.ones(len(problem.photo), dtype=bool)
        if problem.rejected is not None:
            whole &= ~problem.rejected.any(axis=1)
        self._enough = np.bincount(problem.point[whole], minlength=len(problem.points)) > _ENOUGH

    def rays(self, photo: int) -> slice:
        """Return where the rays of a photo stand."""
        return slice(self._ends[photo], self._ends[photo + 1])

    def points_around(self, photo: int) -> Index:
        """Return the points that a photo lacks, of a large block those of photos beside it."""
        mine = self.points[self.rays(photo)]
        near = np.ones(len(self._first), dtype=bool)
        if len(near) > _FEW:
            rays = runs(self._first[mine], self._seers[mine])
            beside = np.flatnonzero(np.bincount(self._problem.photo[rays])).tolist()
            near[:] = False
            near[np.concatenate([self.points[self.rays(other)] for other in beside])] = True
        near[mine] = False
        return np.flatnonzero(near)

    def elsewhere(self, points: Index, far: Array, sigma: float) -> Bools:
        """Return which points are surely not what was measured that far from where they are seen.

        What other rays place is seen with less than the sigma of a measurement: the difference has
        less than one and a half, and the test is passed up to its critical value.
        """
        out: Bools = self._enough[points] & (far > _SURE * sigma)
        return out


def _far(places: Array, others: Array) -> Array:
    """(k, n) how far (n, 2) places are from each of (k, 2), along the farther axis."""
    with np.errstate(invalid="ignore"):
        x, y = (np.abs(places[:, axis] - others[:, axis, None]) for axis in range(2))
        distance: Array = np.maximum(x, y)
    distance[~np.isfinite(distance)] = np.inf
    return distance


def _plainly_wrong(
    block: AdjustedBlock, rejected: dict[int, frozenset[str]], tried: _Candidate
) -> bool:
    """Whether the block cannot take the ray under the other name, as far as it is linear."""
    problem = block.problem
    if problem.additional is not None or problem.image_shift is not None or not block.critical:
        return False
    seen = _foreseen(block, tried)
    if seen is None:
        return False
    room, plain = _room(block, rejected, tried), _PLAIN if seen.near else _FAR
    if seen.growth > plain * room:
        return True
    sigma0 = max(sqrt((_square(block) + plain * room) / block.redundancy), 1.0)
    return bool((np.abs(seen.w) > plain * block.critical * sigma0).any())


class _Foreseen(NamedTuple):
    """What names put right do, linearly: to v'Pv, and standardized residuals of what comes in.

    `near`: they hardly move anything.
    """

    growth: float
    w: Array
    near: bool


def _foreseen(block: AdjustedBlock, tried: _Candidate) -> _Foreseen | None:
    """Return what it does to put names right; None where the rest leaves something open."""
    new, old = _exchanged(block, tried)
    rows, count = new.with_others(old), len(new.e)
    g = rows.cofactors(block)
    if not (np.isfinite(g).all() and np.isfinite(rows.e).all()):
        return None
    sign = np.where(np.arange(len(rows.e)) < count, 1.0, -1.0)
    try:
        inverse = np.linalg.inv(np.diag(sign) + g)
    except np.linalg.LinAlgError:
        return None
    v, r = (inverse @ rows.e)[:count], np.diag(inverse)[:count]
    if not (r > 0.0).all():
        return None
    near = np.abs(rows.e).max(initial=0.0) <= _NEAR and np.linalg.eigvalsh(g)[-1] <= 1.0
    return _Foreseen(float(rows.e @ inverse @ rows.e), v / np.sqrt(r), bool(near))


def _exchanged(block: AdjustedBlock, tried: _Candidate) -> tuple[_Rows, _Rows]:
    """Return the image coordinates that come in under other names, and those that go for them."""
    problem, linear = block.problem, block.cofactors.normal.linear
    rays = np.flatnonzero(np.isin(problem.source, tried.rows))
    rays = rays[np.argsort(problem.source[rays] != tried.row)]  # the ray itself first
    others = problem.point[rays[1:]].tolist() or [problem.points.index(tried.meant)]
    points = np.array([*others, int(problem.point[rays[0]])])[: len(rays)]
    photos, sigma = problem.photo[rays], problem.sigma_xy[rays]
    seen = imaged_places(problem, block.state, photos, block.state.points[points])
    new = _Rows(
        np.repeat(photos, 2),
        np.repeat(points, 2),
        (seen.photo / sigma[:, :, None]).reshape(-1, 6),
        (seen.point / sigma[:, :, None]).reshape(-1, 3),
        ((seen.xy - problem.xy[rays]) / sigma).ravel(),
    )
    old = _Rows(
        new.photo,
        np.repeat(problem.point[rays], 2),
        linear.a[rays].reshape(-1, 6),
        linear.b[rays].reshape(-1, 3),
        block.v[rays].ravel(),
    )
    off = np.zeros((len(rays), 2), dtype=bool) if problem.off is None else problem.off[rays]
    gone = off if problem.rejected is None else problem.rejected[rays]
    return new.some(~off.ravel()), old.some(~gone.ravel())


class _Rows(NamedTuple):
    """Image coordinates: photos, points, derivatives by both, and misclosures, whitened."""

    photo: Index
    point: Index
    a: Array
    b: Array
    e: Array

    def some(self, which: Bools) -> _Rows:
        return _Rows(
            self.photo[which], self.point[which], self.a[which], self.b[which], self.e[which]
        )

    def with_others(self, others: _Rows) -> _Rows:
        return _Rows(
            np.concatenate((self.photo, others.photo)),
            np.concatenate((self.point, others.point)),
            np.concatenate((self.a, others.a)),
            np.concatenate((self.b, others.b)),
            np.concatenate((self.e, others.e)),
        )

    def cofactors(self, block: AdjustedBlock) -> Array:
        """Return (k, k) G = J N^-1 J' between them."""
        problem, (k, d) = block.problem, self.a.shape
        first = len(problem.photos) * d
        columns = np.concatenate(
            (
                d * self.photo[:, None] + np.arange(d),
                first + 3 * self.point[:, None] + np.arange(3),
            ),
            axis=1,
        )
        values = np.concatenate((self.a, self.b), axis=1)
        rows = np.repeat(np.arange(k), d + 3)
        functions = csr_array(
            (values.ravel(), (rows, columns.ravel())),
            shape=(k, first + 3 * len(problem.points) + problem.in_border),
        )
        return function_cofactors(block, functions)


def _room(block: AdjustedBlock, rejected: dict[int, frozenset[str]], tried: _Candidate) -> float:
    """Return what v'Pv may grow by for the rejected coordinates that come back."""
    back = sum(len(rejected.get(k, ())) for k in tried.rows)
    return critical_normal(block.problem.test.alpha) ** 2 * back


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
    mine = np.isin(right.problem.source, tried.rows)
    if not mine.any() or right.flagged[mine].any():
        return None
    if _square(right) > _square(block) + _room(block, rejected, tried):
        return None
    return MisnamedRay(
        row.photo, row.point, row.model, tried.meant, tried.other is not None, right.sigma0, back
    )


def _square(block: AdjustedBlock) -> float:
    """V'Pv with the a-priori sigmas."""
    return (block.sigma0 or 0.0) ** 2 * block.redundancy
