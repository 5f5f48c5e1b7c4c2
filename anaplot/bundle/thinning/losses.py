"""What the rays of a bundle would lose of their redundancy numbers without a point more.

A point with c coordinates takes c - 3 redundancies with it. Its own rays have the sum of their
redundancy numbers; the rest, L = c - 3 - sum r, is what the other rays lose: what the point tells
of orientations. Exactly, ray i loses R_ip R_pp^-1 R_pi of R = Q_vv P, on the combinations of the
point's coordinates that do not place the point itself. What is lost far away is next to nothing:
looked at are the rays of all points in the photos that see this one, which have the whole loss of
these photos, and further ones where it matters.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.runs import runs
from anaplot.bundle.solve.structure import Piece
from anaplot.bundle.thinning.thinned import Thinned

__all__ = ["Loss", "Losses"]

_Unknowns = tuple[Array, Array, Array]
_COLUMNS = 256  # right-hand sides at a time
_NOBODY: Index = np.zeros(0, dtype=np.intp)
_OPEN = 1e-7  # smallest redundancy of a combination of rays that the others still control


class Loss(NamedTuple):
    """What rays lose without a point.

    Attributes
    ----------
    point
        The point, of the whole bundle.
    rays
        Rays of the whole bundle, but those of the point.
    lost
        (rays,) what x and y lose together; infinite where something is not determined without it.
    """

    point: int
    rays: Index
    lost: Array


class _Sides(NamedTuple):
    """Points with the same number of rays, and their free combinations as right-hand sides.

    Attributes
    ----------
    points, rays
        (c,) and (c, k) of the thinner bundle.
    white
        (c, k, 2, w) combinations of the image coordinates.
    photos, shared
        (c, k, d, w) and (c, g, w) right-hand sides.
    """

    points: Index
    rays: Index
    white: Array
    photos: Array
    shared: Array

    def part(self, some: slice) -> _Sides:
        """Return those of some of the points."""
        return _Sides(
            self.points[some],
            self.rays[some],
            self.white[some],
            self.photos[some],
            self.shared[some],
        )


class Losses:
    """Losses in a thinned bundle.

    Parameters
    ----------
    thinned
        The bundle.
    """

    def __init__(self, thinned: Thinned) -> None:
        self.thinned = thinned
        cofactors = thinned.cofactors
        self.normal, self.factor, self.inverse = (
            cofactors.normal, cofactors.factor, cofactors.inverse,
        )  # fmt: skip
        self.problem, self.linear = self.normal.problem, self.normal.linear
        self.changes = self.normal.changes(self.factor)
        problem = self.problem
        self._number = np.full(int(thinned.points.max()) + 1, -1)
        self._number[thinned.points] = np.arange(len(thinned.points))
        self._first = np.searchsorted(problem.point, np.arange(len(problem.points) + 1))
        order = np.argsort(problem.photo, kind="stable")
        ends = np.searchsorted(problem.photo[order], np.arange(len(problem.photos) + 1))
        self._of_photo = [problem.point[order[a:b]] for a, b in itertools.pairwise(ends)]

    def at_least(self, points: Index) -> Iterator[Loss]:
        """Yield what rays lose at least, by elements of the inverse that are there.

        Of points that are seen in no other photo than the one that goes.
        """
        d, among = self.linear.a.shape[2], self.normal.structure.among
        for _, mine in self._pieces(points):
            sides = self._sides(mine)
            count, k = sides.rays.shape
            q = np.stack([among(photos, self.inverse.blocks) for photos in
                          self.problem.photo[sides.rays]])  # fmt: skip
            right = sides.photos.reshape(count, k * d, -1)
            x, s = np.matmul(q, right), sides.shared
            if s.shape[1]:
                beside = self.inverse.border[self.problem.photo[sides.rays]]
                beside = beside.reshape(count, k * d, -1)
                x += np.matmul(beside, s)
                s = np.matmul(beside.transpose(0, 2, 1), right) + np.matmul(self.inverse.corner, s)
            x = x.reshape(count, k, d, -1)
            known = np.zeros(len(self.problem.photos), dtype=bool)
            there = np.zeros((len(known), *x.shape[2:]))
            for one in range(count):
                photos = self.problem.photo[sides.rays[one]]
                known[photos], there[photos] = True, x[one]
                yield self._loss(sides, one, there, s[one], known)
                known[photos] = False

    def near(
        self, points: Index, further: Mapping[int, Index] = MappingProxyType({})
    ) -> Iterator[Loss]:
        """Yield what the rays of all points lose that are seen in one photo with this one.

        And, for some of the points, those of further points wherever they are.
        """
        known = np.ones(len(self.problem.photos), dtype=bool)
        n, d = len(known), self.linear.a.shape[2]
        for _, mine in self._pieces(points):
            every = self._sides(mine)
            count, _k, _, wide = every.white.shape
            step = max(1, _COLUMNS // wide)
            for start in range(0, count, step):
                sides = every.part(slice(start, start + step))
                some = len(sides.points)
                right = np.zeros((n, some, d, wide))
                at = self.problem.photo[sides.rays], np.arange(some)[:, None]
                np.add.at(right, at, sides.photos)
                corner = sides.shared.transpose(1, 0, 2).reshape(-1, some * wide)
                x, s = self.factor.solve(
                    right.transpose(0, 2, 1, 3).reshape(n, d, some * wide), corner
                )
                x = x.reshape(n, d, some, wide)
                for one in range(some):
                    own = s[:, one * wide : (one + 1) * wide]
                    yield self._loss(sides, one, x[:, :, one], own, known, further)

    def _pieces(self, points: Index) -> Iterator[tuple[Piece, Index]]:
        """Yield points of the whole bundle as those of the thinner one, piece by piece."""
        wanted = np.sort(self._number[points])
        for piece in self.normal.structure.pieces:
            mine = wanted[(wanted >= piece.points.start) & (wanted < piece.points.stop)]
            if len(mine):
                yield piece, mine

    def _sides(self, points: Index) -> _Sides:
        first = self._first[points]
        each = int(self._first[points[0] + 1] - first[0])
        rays, count = first[:, None] + np.arange(each), len(points)
        b = self.linear.b[rays].reshape(count, 2 * each, 3)
        # what of the image coordinates does not place the point: its own unknowns fall out
        # (rows of rejected coordinates are zero: they tell nothing, and lose nothing)
        free = np.linalg.qr(b, mode="complete")[0][:, :, 3:]
        white = free.reshape(count, each, 2, free.shape[2])
        photos = np.einsum("cred,crew->crdw", self.linear.a[rays], white)
        shared = np.zeros((count, len(self.normal.corner), free.shape[2]))
        if shared.shape[1]:
            groups = self.problem.additional_group[rays.ravel()]
            columns = self.normal.border_columns(groups).reshape(count, each, -1)
            by_shared = np.einsum("creq,crew->crqw", self.linear.h[rays], white)
            np.add.at(shared, (np.arange(count)[:, None, None], columns), by_shared)
        return _Sides(points, rays, white, photos, shared)

    def _loss(
        self, sides: _Sides, one: int, x: Array, s: Array, known: Bools,
        further: Mapping[int, Index] = MappingProxyType({}),
    ) -> Loss:  # fmt: skip
        """Return a loss, by (photos, d, w) and (g, w) solutions that are known of some photos."""
        problem, thinned = self.problem, self.thinned
        own, point = sides.rays[one], int(sides.points[one])
        photos = problem.photo[own]
        white = sides.white[one].reshape(-1, sides.white.shape[3])
        gone = [
            (change.gain, change.inner @ self._along(change.gain, photos, sides, one))
            for change in self.changes
        ]
        beside = self._number[further.get(int(thinned.points[point]), _NOBODY)]
        near = (self._of_photo[k] for k in set(photos.tolist()))
        others = np.unique(np.concatenate((beside, *near)))
        others = others[others != point]
        rays, starts = self._rays(others)
        if not known.all():
            inside = np.logical_and.reduceat(known[problem.photo[rays]], starts)
            rays, starts = self._rays(others[inside])
        mine = self._seen(own, np.zeros(1, dtype=np.intp), x, s, gone)
        inner = np.eye(white.shape[1]) - white.T @ mine.reshape(white.shape)
        values, vectors = np.linalg.eigh(0.5 * (inner + inner.T))
        if values[0] < _OPEN:
            rays, lost = own, np.full(len(own), np.inf)
            return Loss(int(thinned.points[point]), thinned.rays[rays], lost)
        if len(rays) == 0:
            return Loss(int(thinned.points[point]), rays, np.zeros(0))
        turned = self._seen(rays, starts, x, s, gone) @ (vectors / np.sqrt(values))
        lost = np.einsum("mew,mew->m", turned, turned)
        return Loss(int(thinned.points[point]), thinned.rays[rays], lost)

    def _along(self, gain: _Unknowns, photos: Index, sides: _Sides, one: int
               ) -> Array:  # fmt: skip
        """(q, w) what right-hand sides have along what is added to the equations."""
        out: Array = np.einsum("rdq,rdw->qw", gain[0][photos], sides.photos[one])
        if len(gain[2]):
            out += gain[2].T @ sides.shared[one]
        return out

    def _rays(self, points: Index) -> tuple[Index, Index]:
        """Return the rays of points, one after the other, and where each begins."""
        first, count = self._first[points], np.diff(self._first)[points]
        return runs(first, count), np.cumsum(count) - count

    def _seen(
        self, rays: Index, starts: Index, x: Array, s: Array, gone: list[tuple[_Unknowns, Array]]
    ) -> Array:
        """(rays, 2, w) what solutions do to the rays of whole points."""
        normal, problem, linear = self.normal, self.problem, self.linear
        there = x[problem.photo[rays]]
        moved = -np.add.reduceat(np.matmul(normal.z[rays].transpose(0, 2, 1), there), starts)
        points = problem.point[rays[starts]]
        if len(s):
            moved -= np.matmul(normal.t[points], s)
        placed = np.matmul(normal.inverse_root[points].transpose(0, 2, 1), moved)
        size = np.diff(np.append(starts, len(rays)))
        out = np.matmul(linear.a[rays], there)
        out += np.matmul(linear.b[rays], np.repeat(placed, size, axis=0))
        if len(s):
            out += np.matmul(
                linear.h[rays], s[normal.border_columns(problem.additional_group[rays])]
            )
        for gain, weights in gone:
            out -= np.matmul(normal.seen(*gain, rays), weights)
        return np.asarray(out)
