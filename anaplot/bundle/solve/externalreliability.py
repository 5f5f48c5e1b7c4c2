"""External reliability: what errors that are not detected do to a block.

An error of the size of the smallest detectable one, nabla = delta0 sigma / sqrt(r), moves the
unknowns by N^-1 a' delta0 / sqrt(r), a being the whitened row of the observation; any function of
them by at most delta0 sqrt((1 - r) / r) of its standard deviations (Baarda 1968; Gruen 1980).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.conditionupdate import ConditionUpdate
from anaplot.bundle.solve.givenequations import GivenUpdate
from anaplot.bundle.solve.offsetequations import OffsetEquations, OffsetUpdate
from anaplot.bundle.solve.pointgroups import Group
from anaplot.bundle.solve.reliability import Cofactors, DatumChange

__all__ = ["MOST_RAYS", "ExternalReliability", "LargestEffect", "external_reliability"]


MOST_RAYS = 6000
"""Rays of a block up to which the largest effects are computed: the time grows with the square."""


class LargestEffect(NamedTuple):
    """The point that an undetected error of one observation moves farthest.

    Attributes
    ----------
    point
        Name.
    effect_m
        By how much in X, Y, Z [m], in the reported datum.
    """

    point: str
    effect_m: tuple[float, float, float]


_Pair = tuple[LargestEffect | None, LargestEffect | None]  # of x and y of a ray


@dataclass(frozen=True, eq=False)
class ExternalReliability:
    """Largest effects; None where an error cannot be detected at any size, or nobody looks.

    They are found when they are asked for, those of rays for the rays that are asked for: each
    takes a look at all points.

    Attributes
    ----------
    block
        The adjusted block.
    looked
        Whether anybody looks; else every effect is None.
    """

    block: AdjustedBlock = field(repr=False)
    looked: bool = True

    @cached_property
    def rays(self) -> list[_Pair]:
        """Of x and y, in the order of `AdjustedBlock.ray_rows`."""
        return self.rays_at(range(len(self._order)))

    def rays_at(self, at: Sequence[int]) -> list[_Pair]:
        """Return those of some rays, by their places in `rays`."""
        if not self.looked:
            return [(None, None)] * len(at)
        problem, rays = self.block.problem, self._order[list(at)]
        points = np.zeros(len(problem.points), dtype=np.bool_)
        points[problem.point[rays]] = True
        moves, _ = self._farthest.of_points(points, np.zeros((2, len(points), 3), dtype=np.bool_))
        rows = (2 * rays[:, None] + np.arange(2)).ravel()
        found = self._effects(rows, _Moves(moves.point[rays].ravel(),
                                           moves.of_one_sigma[rays].reshape(-1, 3)))  # fmt: skip
        return list(zip(found[::2], found[1::2], strict=True))

    @cached_property
    def control(self) -> list[LargestEffect | None]:
        """In the order of `AdjustedBlock.control_rows`."""
        return self._in_file_order(0)

    @cached_property
    def point_priors(self) -> list[LargestEffect | None]:
        """In the order of `AdjustedBlock.point_prior_rows`."""
        return self._in_file_order(1)

    @cached_property
    def priors(self) -> list[LargestEffect | None]:
        """In the order of `AdjustedBlock.prior_rows`."""
        _, second, _, fourth = self.block.observations.starts
        return self._others[second:fourth]

    @cached_property
    def conditions(self) -> list[LargestEffect | None]:
        """In the order of `AdjustedBlock.condition_rows`."""
        return self._others[self.block.observations.starts[3] :]

    def _in_file_order(self, kind: int) -> list[LargestEffect | None]:
        rows = self.block.observations
        return [self._others[rows.starts[0] + k] for k in rows.in_file_order(kind).tolist()]

    @cached_property
    def _order(self) -> Index:
        """(m,) the rays of the bundle in the order of the file."""
        return np.argsort(self.block.problem.source)

    @cached_property
    def _farthest(self) -> _Farthest:
        return _Farthest(self.block)

    @cached_property
    def _others(self) -> list[LargestEffect | None]:
        """Of every observation; of image coordinates None."""
        problem, rows = self.block.problem, self.block.observations
        if not self.looked:
            return [None] * len(self.block.tested)
        ground = np.isfinite(problem.ground_sigma)
        observed: Bools = np.asarray(ground.any(axis=(0, 2)))
        rays, known = self._farthest.of_points(observed, ground)
        parts = (
            rays,
            known,
            self._farthest.of_photos(),
            self._farthest.of_parameters(),
            self._farthest.of_conditions(),
            self._farthest.of_offsets(),
        )
        point = rows.gather(*(each.point for each in parts))
        moved = rows.gather(*(each.of_one_sigma for each in parts))
        first = rows.starts[0]
        others = np.arange(first, len(point))
        return [None] * first + self._effects(others, _Moves(point[first:], moved[first:]))

    def _effects(self, rows: Index, moves: _Moves) -> list[LargestEffect | None]:
        """Return the effects of some observations, of what errors of one sigma in them move."""
        sizes = self.block.tested.mdb[rows] / self.block.observations.sigma[rows]
        moved = moves.of_one_sigma * sizes[:, None]
        names = self.block.problem.points
        return [
            LargestEffect(names[k], (x, y, z)) if x == x else None
            for k, (x, y, z) in zip(moves.point.tolist(), moved.tolist(), strict=True)
        ]


def external_reliability(block: AdjustedBlock, *, most: int = MOST_RAYS) -> ExternalReliability:
    """Return what undetected errors do at most, of every observation of a block.

    Parameters
    ----------
    block
        The adjusted block.
    most
        Rays up to which the points that move farthest are looked for.
    """
    return ExternalReliability(block, len(block.problem.photo) <= most)


class _Moves(NamedTuple):
    """Of observations in an array: the point that each moves farthest, and how far [m].

    Attributes
    ----------
    point
        Indices.
    of_one_sigma
        (..., 3) by an error of one a-priori standard deviation.
    """

    point: Index
    of_one_sigma: Array

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> _Moves:
        return cls(np.zeros(shape, dtype=np.intp), np.zeros((*shape, 3)))


class _Taken(NamedTuple):
    """What conditions or a prior that ties unknowns together take of the moves without them.

    Attributes
    ----------
    gain
        G, of photos, points and shared parameters.
    by_rows
        (3 p, q) what errors of one in their rows do to the points.
    """

    gain: tuple[Array, Array, Array]
    by_rows: Array

    @classmethod
    def of(
        cls, added: ConditionUpdate | GivenUpdate | OffsetUpdate, change: DatumChange | None
    ) -> _Taken:
        """Return it in the datum that is reported."""
        moved = added.points if change is None else change.of_points(added.photos, added.points)
        return cls(added.gain, moved.reshape(-1, moved.shape[2]) @ added.inner)

    def up(self, shown: Array) -> Array:
        """Return (c, p, 3) what is taken of the moves by c errors, from (c, q) G'a'."""
        out: Array = (shown @ self.by_rows.T).reshape(len(shown), -1, 3)
        return out


class _OffsetMoves(NamedTuple):
    """What offsets take of the moves by errors of photos' priors, whose rows they have a part in.

    Attributes
    ----------
    equations
        The offsets.
    moves
        (k, 3 p) K^-1 C' times what errors do to the points in which the offsets are held.
    """

    equations: OffsetEquations
    moves: Array

    @classmethod
    def of(cls, cofactors: Cofactors, held: Array, takens: list[_Taken]) -> _OffsetMoves | None:
        """Return it from (n d, 3 p) K of the photos; None without offsets."""
        update = cofactors.normal.offset_update(cofactors.factor)
        if update is None:
            return None
        sides = update.sides.reshape(len(held), -1)
        moves = sides.T @ held
        for taken in takens:
            moves -= (sides.T @ taken.gain[0].reshape(len(held), -1)) @ taken.by_rows.T
        return cls(update.equations, update.equations.inverse @ moves)

    def by_rows(self, photo: int) -> Array:
        """Return (6, p, 3) for errors of one in the priors of a photo."""
        laid = self.equations.laid
        there = np.flatnonzero(laid.columns[photo] < len(laid))
        rows = self.equations.rows[photo][:, there]
        return np.asarray((rows @ self.moves[laid.columns[photo, there]]).reshape(6, -1, 3))

    def by_priors(self) -> Array:
        """Return (k, p, 3) for errors of one in what is known of the offsets."""
        root = np.sqrt(self.equations.laid.weight)[:, None]
        return np.asarray((root * self.moves).reshape(len(root), -1, 3))


class _Farthest:
    """Finds the points that observations move farthest.

    With K the cofactors of all points with the photos and the shared parameters, an observation
    with the rows a (photo), b (point) and h (parameters) moves the points by

        K (a' - W V^-1 b', h' - U V^-1 b')  and its own by V^-1 b' more,

    W and U being the point's part of the normal equations: everything but K is as small as the
    number of photos that see the point. Conditions between points, and a prior that ties unknowns
    together, change that by G M^-1 G' (see `anaplot.bundle.solve.conditionupdate`).
    """

    def __init__(self, block: AdjustedBlock) -> None:
        problem, self._cofactors = block.problem, block.cofactors
        self._problem = problem
        normal = block.cofactors.normal
        n, d, g = len(problem.photos), problem.per_photo, problem.in_border
        every = n * d + g
        unit = np.eye(every)
        x, shared = block.cofactors.factor.solve(unit[: n * d].reshape(n, d, every), unit[n * d :])
        inverse = np.concatenate((x.reshape(n * d, every), shared))
        points = np.empty((len(problem.points), 3, every))
        for group in problem.groups:
            for point, rays in _rays_of(group):
                # what elimination left of the point: M = V^-1 W'
                m = (
                    np.concatenate([*normal.z[rays], normal.t[point].T])
                    @ normal.inverse_root[point]
                )
                points[point] = -m.T @ inverse[self._unknowns(rays)]
        self._change = block.cofactors.change
        if self._change is not None:
            points = self._change.of_points(x, points)
        self._update = normal.update(block.cofactors.factor)
        self._taken = [
            _Taken.of(added, self._change) for added in normal.changes(block.cofactors.factor)
        ]
        # a row for every unknown: what a point needs of it lies together
        self._k = np.ascontiguousarray(points.reshape(-1, every).T)
        self._offsets = _OffsetMoves.of(block.cofactors, self._k[: n * d], self._taken)

    def _unknowns(self, rays: Index) -> Index:
        """Return the numbers of the unknowns of a point's photos, and of the shared parameters."""
        problem = self._problem
        d, n = problem.per_photo, len(problem.photos)
        own = (problem.photo[rays][:, None] * d + np.arange(d)).ravel()
        return np.concatenate((own, n * d + np.arange(problem.in_border)))

    def of_points(self, points: Bools, ground: Bools) -> tuple[_Moves, _Moves]:
        """Return what image coordinates (m, 2), control and priors of points (2, p, 3) move.

        Parameters
        ----------
        points
            (p,) of which points; nothing of others.
        ground
            (2, p, 3) which of their coordinates are observed.
        """
        problem, normal = self._problem, self._cofactors.normal
        linear = normal.linear
        d, g = problem.per_photo, problem.in_border
        of_rays, of_ground = _Moves.none(linear.e.shape), _Moves.none(ground.shape)
        columns = normal.border_columns(problem.additional_group) if g else None
        for group in problem.groups:
            k = group.rays
            for point, rays in _rays_of(group):
                if not points[point]:
                    continue
                kinds, axes = np.nonzero(ground[:, point])
                count = 2 * k + len(axes)
                b = np.zeros((3, count))
                b[:, : 2 * k] = linear.b[rays].reshape(2 * k, 3).T
                held = np.sqrt(linear.point_weight[kinds, point, axes])
                b[axes, 2 * k + np.arange(len(axes))] = held
                root = normal.inverse_root[point]
                y = root @ b
                right = np.concatenate((-np.matmul(normal.z[rays], y).reshape(k * d, count),
                                        -normal.t[point].T @ y))  # fmt: skip
                for ray in range(k):
                    mine = slice(2 * ray, 2 * ray + 2)
                    right[ray * d : ray * d + d, mine] += linear.a[rays[ray]].T
                    if columns is not None:
                        right[k * d + columns[rays[ray]], mine] += linear.h[rays[ray]].T
                moved = (right.T @ self._k[self._unknowns(rays)]).reshape(count, -1, 3)
                own = (root.T @ y).T
                moved[:, point] += own
                if self._change is not None:
                    part = np.linalg.solve(
                        self._change.defect, self._change.held_points[point].T @ own.T
                    )
                    moved -= np.einsum("nil,lk->kni", self._change.null_points, part)
                for taken in self._taken:
                    seen = normal.seen(*taken.gain, rays).reshape(2 * k, -1)
                    known = held[:, None] * taken.gain[1][point, axes]
                    moved -= taken.up(np.concatenate((seen, known)))
                most, effect = _largest(moved)
                of_rays.point[rays] = most[: 2 * k].reshape(k, 2)
                of_rays.of_one_sigma[rays] = effect[: 2 * k].reshape(k, 2, 3)
                of_ground.point[kinds, point, axes] = most[2 * k :]
                of_ground.of_one_sigma[kinds, point, axes] = effect[2 * k :]
        return of_rays, of_ground

    def of_conditions(self) -> _Moves:
        """Return what the rows of the conditions (n,) move."""
        if self._update is None:
            conditions = self._problem.conditions
            return _Moves.none((0 if conditions is None else len(conditions.rows),))
        # conditions are what is added last
        moved = self._taken[-1].up(self._update.equations.contrasts.toarray())
        change = self._change
        if change is not None and change.gives_scale:
            scale = np.linalg.inv(change.defect)[:, 6]
            larger = np.einsum("nil,l->ni", change.null_points, scale)
            moved += np.einsum("k,ni->kni", change.by_conditions, larger)
        return _Moves(*_largest(moved))

    def of_photos(self) -> _Moves:
        """Return what the priors on orientations (n, 6) move."""
        problem, rows = self._problem, self._cofactors.normal.linear.photo_rows
        out = _Moves.none(rows.shape[:2])
        d = problem.per_photo
        for photo in np.nonzero(np.isfinite(self._cofactors.r_photo).any(axis=1))[0].tolist():
            moved = (rows[photo] @ self._k[photo * d : (photo + 1) * d]).reshape(6, -1, 3)
            for taken in self._taken:
                moved -= taken.up(rows[photo] @ taken.gain[0][photo])
            if self._offsets is not None:
                moved -= self._offsets.by_rows(photo)
            out.point[photo], out.of_one_sigma[photo] = _largest(moved)
        return out

    def of_offsets(self) -> _Moves:
        """Return what is known of offsets beforehand (k,) moves."""
        if self._offsets is None:
            return _Moves.none((0,))
        return _Moves(*_largest(-self._offsets.by_priors()))

    def of_parameters(self) -> _Moves:
        """Return what the priors on additional parameters move, (n, q) or (g,)."""
        problem, linear = self._problem, self._cofactors.normal.linear
        n, d = len(problem.photos), problem.per_photo
        if not len(problem.additional_sigma):
            return _Moves.none((0,))
        if problem.photo_invariant:
            columns = np.arange(n)[:, None] * d + np.arange(6, d)
            weight = np.broadcast_to(linear.own_weight, columns.shape)
        else:
            columns, weight = n * d + np.arange(problem.in_border), linear.shared_weight
        held = np.sqrt(weight).reshape(-1, 1)
        moved = (self._k[columns.ravel()] * held).reshape(columns.size, -1, 3)
        for taken in self._taken:
            photos, _, shared = taken.gain
            both = np.concatenate((photos.reshape(n * d, -1), shared))
            moved -= taken.up(both[columns.ravel()] * held)
        most, effect = _largest(moved)
        return _Moves(most.reshape(columns.shape), effect.reshape(*columns.shape, 3))


def _rays_of(group: Group) -> Iterator[tuple[int, Index]]:
    """Return the points of a group with their rays."""
    for at in range(group.points):
        first = group.first_ray + at * group.rays
        yield group.first_point + at, np.arange(first, first + group.rays)


def _largest(moved: Array) -> tuple[Index, Array]:
    """Return (c,) the points that c observations move farthest, of (c, p, 3), and (c, 3) how."""
    most = np.argmax(np.einsum("cpi,cpi->cp", moved, moved), axis=1)
    return most, moved[np.arange(len(moved)), most]
