"""A block without some of its rows as what other sets of rows are seen from, and its places.

One factor and its selected inverse give what is left of all rows and all redundancy numbers,
however many rows are out. A place is a point with its rays, its control and its priors, or a photo
with its priors. Of a point every element of G = J N^-1 J' between its rows comes from the parts of
the inverse that belong to its photos, also of rows that are out, so that all of them can be brought
back by themselves:

    R = I - G',  G' = G - G_s (I + G_ss)^-1 G_s'.

Between rows of two points nothing but the photos can carry an error: with the point eliminated, a
row has A~ Q A~' of its own G by the photos, and abs(R_ij) is at most the root of the product of
both (Cauchy and Schwarz). Its root is the lever.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.places import inverse_among, reach_of, seen_without
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.errors.laterresiduals import AllRows
from anaplot.bundle.solve.linearised import effect
from anaplot.bundle.solve.reliability import Cofactors
from anaplot.bundle.solve.structure import Piece

__all__ = ["Basis", "Laid"]

_PORTION = 60_000_000  # bytes of the largest array while places are laid out
_KEPT = 300_000_000  # bytes of the places that are kept laid out


class Laid(NamedTuple):
    """Places of equal size, all of their own rows in.

    Attributes
    ----------
    numbers, rows
        (c,) which places, and (c, k) their rows, ascending.
    matrix
        (c, k, k) R; zeros for image coordinates that are switched off.
    lever
        (c, k) see `Place.lever`.
    """

    numbers: Index
    rows: Index
    matrix: Array
    lever: Array

    def some(self, at: Index) -> Laid:
        """Return some of them."""
        return Laid(self.numbers[at], self.rows[at], self.matrix[at], self.lever[at])

    def with_others(self, other: Laid) -> Laid:
        """Return them and others of the same size."""
        return Laid(
            np.concatenate((self.numbers, other.numbers)),
            np.concatenate((self.rows, other.rows)),
            np.concatenate((self.matrix, other.matrix)),
            np.concatenate((self.lever, other.lever)),
        )

    @property
    def size(self) -> int:
        """Bytes."""
        return sum(part.nbytes for part in self)


class Basis:
    """A block without some of its rows.

    Parameters
    ----------
    block
        All rows, linearised somewhere.
    cofactors
        Of the adjustment without the rows that are out, linearised there or very near.
    out
        Rows that are out.

    Attributes
    ----------
    gone
        (n,) whether a row is out.
    step
        Corrections of photos, points and shared parameters in one linear adjustment without what is
        out.
    e, vtpv
        (n,) misclosures after one linear adjustment without what is out, of all rows; v'Pv of those
        that are in.
    r
        (n,) redundancy numbers; of rows that are out those that they have if they come back.
    """

    def __init__(self, block: AllRows, cofactors: Cofactors, out: Index) -> None:
        self.block, self.cofactors = block, cofactors
        self.gone = np.zeros(len(block.names), dtype=bool)
        self.gone[out] = True
        count = len(block.problem.points) + len(block.problem.photos)
        self._kept: dict[int, Laid] = {}
        self._size, self._at = np.zeros(count, dtype=np.intp), np.zeros(count, dtype=np.intp)
        self._reach = np.full(count, np.nan)
        normal = cofactors.normal
        self.step = normal.solution(cofactors.factor, normal.gradient(block.linear))
        self.e = self._left()
        kept = self.e[~self.gone]
        self.vtpv = float(kept @ kept)
        self.r = self._redundancies(out)

    def places_of(self, rows: Index) -> Index:
        """Return (k,) the places of rows: points, then photos; -1: none."""
        problem, of = self.block.problem, self.block.rows
        first, second, third, _ = of.starts
        place = np.full(len(rows), -1, dtype=np.intp)
        mine = rows < first
        place[mine] = problem.point[rows[mine] // 2]
        mine = (rows >= first) & (rows < second)
        place[mine] = of.ground[rows[mine] - first, 1]
        mine = (rows >= second) & (rows < third)
        place[mine] = len(problem.points) + of.priors[rows[mine] - second, 0]
        return place

    def laid(self, numbers: Index) -> Iterator[Laid]:
        """Yield places by their numbers, those of as many rows together; each is laid out once."""
        numbers = numbers[numbers >= 0]
        sizes = self._size[numbers]
        for size in np.unique(sizes[sizes > 0]).tolist():
            mine, kept = numbers[sizes == size], self._kept[size]
            step = max(1, _PORTION // (8 * size**2))
            for start in range(0, len(mine), step):
                yield kept.some(self._at[mine[start : start + step]])
        for new in self._laid_out(numbers[sizes == 0]):
            self._keep(new)
            yield new

    def _keep(self, new: Laid) -> None:
        if sum(kept.size for kept in self._kept.values()) + new.size > _KEPT:
            return
        size = new.rows.shape[1]
        kept = self._kept.get(size)
        first = 0 if kept is None else len(kept.numbers)
        self._kept[size] = new if kept is None else kept.with_others(new)
        self._size[new.numbers] = size
        self._at[new.numbers] = first + np.arange(len(new.numbers))

    def reach(self, numbers: Index) -> Array:
        """Return (k,) the `reach_of` places."""
        for laid in self.laid(numbers[np.isnan(self._reach[numbers])]):
            self._reach[laid.numbers] = reach_of(np.einsum("cii->ci", laid.matrix), laid.lever)
        return np.asarray(np.nan_to_num(self._reach[numbers]))

    def _left(self) -> Array:
        """(n,) misclosures after one linear adjustment without what is out, of all rows."""
        of = self.block.rows
        before = of.gathered(self.block.linear)
        before += of.gathered(effect(self.block.problem, self.block.linear, self.step))
        return -np.asarray(before)

    def _redundancies(self, out: Index) -> Array:
        """(n,) redundancy numbers; of rows that are out those that they have if they come back."""
        cofactors = self.cofactors
        own = self.block.problem.photo_invariant
        held = cofactors.r_own if own else cofactors.r_shared
        r = self.block.rows.gather(
            cofactors.r,
            np.nan_to_num(cofactors.r_ground),
            np.nan_to_num(cofactors.r_photo),
            np.clip(held, 0.0, 1.0),
            cofactors.r_conditions,
        )
        for laid in self.laid(np.unique(self.places_of(out))):
            gone = self.gone[laid.rows]
            _, back = seen_without(laid.matrix, gone)
            r[laid.rows[gone]] = back[gone]
        return np.asarray(r)

    def _laid_out(self, numbers: Index) -> Iterator[Laid]:
        """Yield places of equal size, in portions."""
        problem, rows = self.block.problem, self.block.rows
        points = numbers[numbers < len(problem.points)]
        ground = np.bincount(rows.ground[:, 1], minlength=len(problem.points))
        for piece in self.cofactors.normal.structure.pieces:
            mine = points[(points >= piece.points.start) & (points < piece.points.stop)]
            wide = piece.group.rays * problem.per_photo
            step = max(1, _PORTION // (8 * wide * (wide + 4 * piece.group.rays)))
            for count in np.unique(ground[mine]).tolist():
                alike = mine[ground[mine] == count]
                for start in range(0, len(alike), step):
                    part = alike[start : start + step]
                    yield self._with_all(part, *self._of_points(piece, part, count))
        for number in numbers[numbers >= len(problem.points)].tolist():
            found = self._of_photo(number - len(problem.points))
            yield self._with_all(np.array([number]), *found)

    def _with_all(self, numbers: Index, rows: Index, g: Array, of_photos: Array) -> Laid:
        """Bring all rows of places back: (c,) numbers, (c, k) rows, (c, k, k) G, and its by photos.

        What the others keep of G is T G, T = I - G_s (I + G_ss)^-1: so its part by photos T . T'.
        """
        gone, one = self.gone[rows], np.eye(rows.shape[1])
        some = gone.any(axis=1)
        if some.any():
            taken = one - g[some] @ inverse_among(one + g[some], gone[some])
            g, of_photos = g.copy(), of_photos.copy()
            g[some] = taken @ g[some]
            of_photos[some] = taken @ of_photos[some] @ taken.transpose(0, 2, 1)
        matrix = one - g
        off = self._off(rows)
        matrix[off[:, :, None] | off[:, None, :]] = 0.0
        lever = np.sqrt(np.maximum(np.einsum("cii->ci", of_photos), 0.0))
        return Laid(numbers, rows, matrix, lever)

    def _off(self, rows: Index) -> Bools:
        """(c, k) image coordinates that are switched off: rows of zeros."""
        off, out = self.block.problem.off, np.zeros(rows.shape, dtype=bool)
        if off is not None:
            image = rows < self.block.rows.image
            out[image] = off.ravel()[rows[image]]
        return out

    def without_own(self, laid: Laid) -> Array:
        """Return (c, k, k) the G of places again: what is out of their rows is out."""
        gone, one = self.gone[laid.rows], np.eye(laid.rows.shape[1])
        g = one - laid.matrix
        some = gone.any(axis=1)
        if some.any():
            gone, matrix = gone[some], laid.matrix[some]
            inverse = inverse_among(matrix, gone)
            beside = matrix @ inverse
            kept = ~gone[:, :, None]
            across = np.where(kept, beside, 0.0)
            left = np.where(kept & ~gone[:, None, :], g[some] + beside @ matrix, 0.0)
            out = inverse - one * gone[:, :, None]
            g[some] = left + out - across - across.transpose(0, 2, 1)
        return g

    def _of_photo(self, photo: int) -> tuple[Index, Array, Array]:
        cofactors, rows = self.cofactors, self.block.rows
        mine = np.flatnonzero(rows.priors[:, 0] == photo)
        design = self.block.linear.photo_rows[photo, rows.priors[mine, 1]]
        diagonal = cofactors.normal.structure.pattern.diagonal[photo]
        g = design @ cofactors.inverse.blocks[diagonal] @ design.T
        return rows.starts[1] + mine[None], g[None], g[None]

    def _of_points(self, piece: Piece, points: Index, count: int) -> tuple[Index, Array, Array]:
        """Rows, G and its part by photos of points of a piece with `count` rows of the ground."""
        normal, inverse = self.cofactors.normal, self.cofactors.inverse
        problem, full = normal.problem, self.block.linear
        c, k, d, g = len(points), piece.group.rays, problem.per_photo, len(normal.corner)
        at = points - piece.points.start
        rays = piece.rays.start + at[:, None] * k + np.arange(k)
        design = np.zeros((c, 2 * k + count, k, d))
        b = np.zeros((c, 2 * k + count, 3))
        for i in range(k):
            design[:, 2 * i : 2 * i + 2, i] = full.a[rays[:, i]]
        b[:, : 2 * k] = full.b[rays].reshape(c, 2 * k, 3)
        rows = np.empty((c, 2 * k + count), dtype=np.intp)
        rows[:, : 2 * k] = (2 * rays[:, :, None] + np.arange(2)).reshape(c, 2 * k)
        if count:
            ground = self.block.rows.ground
            order = np.argsort(ground[:, 1], kind="stable")
            first = np.searchsorted(ground[order, 1], points)
            mine = order[first[:, None] + np.arange(count)]
            rows[:, 2 * k :] = self.block.rows.starts[0] + mine
            kind, _, axis = np.moveaxis(ground[mine], 2, 0)
            weight = full.point_weight[kind, points[:, None], axis]
            b[np.arange(c)[:, None], 2 * k + np.arange(count), axis] = np.sqrt(weight)
        root = normal.inverse_root[points]
        z = normal.z[rays].reshape(c, k * d, 3)
        b = b @ root.transpose(0, 2, 1)
        reduced = design.reshape(c, 2 * k + count, k * d) - b @ z.transpose(0, 2, 1)
        q = normal.structure.among(problem.photo[rays], inverse.blocks)
        of_photos = reduced @ q @ reduced.transpose(0, 2, 1)
        if g:
            h = np.zeros((c, 2 * k + count, g))
            for i in range(k):
                own = full.h[rays[:, i]]
                columns = normal.border_columns(problem.additional_group[rays[:, i]])
                np.put_along_axis(
                    h[:, 2 * i : 2 * i + 2],
                    np.broadcast_to(columns[:, None], own.shape),
                    own,
                    axis=2,
                )
            h -= b @ normal.t[points]
            beside = inverse.border[problem.photo[rays]].reshape(c, k * d, g)
            cross = reduced @ beside @ h.transpose(0, 2, 1)
            of_photos += cross + cross.transpose(0, 2, 1)
            of_photos += h @ inverse.corner @ h.transpose(0, 2, 1)
        total = of_photos + b @ b.transpose(0, 2, 1)
        return rows, total, of_photos
