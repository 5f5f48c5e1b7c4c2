"""Multifrontal Cholesky factor of the photos' normal equations, and its selected inverse.

The matrix is given as d x d blocks of photos that share points, bordered by g columns that belong
to all photos (additional parameters). Of the inverse only the blocks inside that pattern are
computed, front by front from the root: with the factor of a front [L11; L21] and G = L21 L11^-1,

    Q_BP = -Q_BB G,    Q_PP = (L11 L11')^-1 + G' Q_BB G,

where Q_BB, the inverse over the front's border, is part of what the parent front has computed.
No matrix of the size of the block is ever formed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg.blas import dgemm, dsymm, dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.sparse import csr_array

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.dissection import Dissection

__all__ = ["Factor", "NotPositiveError", "SelectedInverse", "SparsityPattern", "sparsity_pattern"]

ShareProgress = Callable[[float], None]

_SMALLEST_PIVOT = 1e-13  # of the diagonal element; below it the unknown is not determined
_SMALLEST_IN_CORNER = 1e-12  # of the element before anything was eliminated: rounding is below it


class NotPositiveError(ArithmeticError):
    """The normal equations are singular.

    Attributes
    ----------
    photo
        The photo at which elimination came to a stop, or None for a column of the border.
    """

    def __init__(self, photo: int | None) -> None:
        self.photo = photo
        super().__init__(f"no positive pivot at photo {photo}")


@dataclass(frozen=True, slots=True, eq=False)
class _FrontPlan:
    """Where everything of one front comes from and goes to, in scalar indices."""

    pivots: int
    border: int
    first: int
    photos: int
    blocks: Index  # ids of the pattern's blocks that are assembled here
    cells: Index  # flat cells in (pivots + border, pivots), column by column, one row per block
    parent: int
    inner: Index  # rows of the border that are pivots of the parent, as indices there
    outer: Index  # the other rows of the border, as indices into the parent's border
    has_global: bool
    rows: Index  # border photos


@dataclass(frozen=True, slots=True, eq=False)
class SparsityPattern:
    """The symbolic factorisation: everything that does not depend on numbers.

    Attributes
    ----------
    d, g
        Unknowns of a photo, and of the border.
    rows, columns
        (m,) photos of the stored blocks: row eliminated after (or with) column.
    diagonal
        (n,) ids of the photos' own blocks.
    """

    d: int
    g: int
    n: int
    rows: Index
    columns: Index
    diagonal: Index
    order: Index
    plans: tuple[_FrontPlan, ...]


def _scalars(photos: Index, d: int) -> Index:
    return (photos[:, None] * d + np.arange(d)).ravel()


def sparsity_pattern(
    dissection: Dissection, rows: Index, columns: Index, d: int, g: int
) -> SparsityPattern:
    """Plan the elimination.

    Parameters
    ----------
    dissection
        Order of the photos.
    rows, columns
        (m,) photos of the stored blocks, each pair once, the row not before the column in the
        order; every photo's own block among them.
    d, g
        Unknowns of a photo, and of the border.
    """
    position = dissection.position
    n = len(position)
    column_at = position[columns]
    sort = np.argsort(column_at, kind="stable")
    starts = np.searchsorted(column_at[sort], np.arange(n + 1))
    diagonal = np.empty(n, dtype=np.intp)
    own = np.nonzero(rows == columns)[0]
    diagonal[rows[own]] = own
    fronts = dissection.fronts
    plans = []
    for front in fronts:
        blocks = sort[starts[front.first] : starts[front.last]]
        count = front.last - front.first
        row_at = position[rows[blocks]]
        local = np.where(
            row_at < front.last,
            row_at - front.first,
            count + np.searchsorted(front.border, row_at),
        )
        height = (count + len(front.border)) * d + g
        at = (column_at[blocks] - front.first) * d
        cells = (at[:, None] + np.arange(d))[:, None, :] * height + (
            local[:, None] * d + np.arange(d)
        )[:, :, None]
        if front.parent >= 0:
            up = fronts[front.parent]
            inside = front.border < up.last
            inner = _scalars(front.border[inside] - up.first, d)
            outer = _scalars(np.searchsorted(up.border, front.border[~inside]), d)
            if g:
                outer = np.concatenate((outer, len(up.border) * d + np.arange(g)))
            parent = front.parent
        else:
            # the columns of the border are the last front, above every root
            inner, outer = np.arange(g), np.arange(0)
            parent = len(fronts) if g else -1
        plans.append(
            _FrontPlan(
                count * d,
                len(front.border) * d + g,
                front.first * d,
                count,
                blocks,
                cells.reshape(len(blocks), d * d),
                parent,
                inner.astype(np.intp),
                outer.astype(np.intp),
                g > 0,
                front.border,
            )
        )
    if g:
        empty = np.arange(0)
        plans.append(
            _FrontPlan(
                g, 0, n * d, 0, empty, empty.reshape(0, d * d), -1, empty, empty, True, empty
            )
        )
    return SparsityPattern(d, g, n, rows, columns, diagonal, dissection.order, tuple(plans))


@dataclass(frozen=True, slots=True, eq=False)
class SelectedInverse:
    """The inverse inside the pattern.

    Attributes
    ----------
    blocks
        (m, d, d) blocks (row photo, column photo) of the pattern.
    border
        (n, d, g) between photos and the border's columns.
    corner
        (g, g) of the border's columns.
    """

    blocks: Array
    border: Array
    corner: Array


def _runs(index: Index) -> list[tuple[int, int, int]]:
    """(from, to, target) of the runs of consecutive targets."""
    if len(index) == 0:
        return []
    breaks = np.nonzero(np.diff(index) != 1)[0] + 1
    starts = np.concatenate(([0], breaks))
    ends = np.concatenate((breaks, [len(index)]))
    return [(int(s), int(e), int(index[s])) for s, e in zip(starts, ends, strict=True)]


def _scatter(target: Array, rows: Index, columns: Index, values: Array) -> None:
    """target[rows, columns] += values, by runs of consecutive indices.

    Of a symmetric part, whose rows are its columns, only the lower triangle is looked at later:
    what stands above the diagonal is left out, run by run.
    """
    down = _runs(rows)
    symmetric = rows is columns
    across = down if symmetric else _runs(columns)
    for k, (r0, r1, tr) in enumerate(down):
        for c0, c1, tc in across[: k + 1] if symmetric else across:
            target[tr : tr + r1 - r0, tc : tc + c1 - c0] += values[r0:r1, c0:c1]


def _gather(source: Array, rows: Index, columns: Index, out: Array) -> None:
    """Copy source[rows, columns] into out, by runs of consecutive indices."""
    for r0, r1, tr in _runs(rows):
        for c0, c1, tc in _runs(columns):
            out[r0:r1, c0:c1] = source[tr : tr + r1 - r0, tc : tc + c1 - c0]


class Factor:
    """A Cholesky factor over the fronts.

    Parameters
    ----------
    pattern
        The symbolic factorisation.
    blocks
        (m, d, d) blocks of the matrix, (row photo, column photo).
    border
        (n, d, g) columns of the border.
    corner
        (g, g) border by border.
    progress
        Called with the fraction done.
    corner_scale
        (g,) the corner's diagonal before other unknowns, which are not in this matrix, were
        eliminated; None: the corner's own.

    Raises
    ------
    NotPositiveError
        The matrix is singular to working precision.
    """

    def __init__(
        self,
        pattern: SparsityPattern,
        blocks: Array,
        border: Array,
        corner: Array,
        progress: ShareProgress | None = None,
        corner_scale: Array | None = None,
    ) -> None:
        self.pattern = pattern
        plans = pattern.plans
        count = len(plans)
        d, g = pattern.d, pattern.g
        flat = blocks.reshape(len(blocks), d * d)
        self._l11: list[Array] = []
        self._l21: list[Array] = []
        self._divided = False
        children: list[list[int]] = [[] for _ in plans]
        for k, plan in enumerate(plans):
            if plan.parent >= 0:
                children[plan.parent].append(k)
        waiting: dict[int, Array] = {}
        work = np.cumsum([p.pivots * (p.pivots + p.border) ** 2 + 1.0 for p in plans])
        self.smallest = 1.0
        for k, plan in enumerate(plans):
            p, b = plan.pivots, plan.border
            column = np.zeros((p, p + b))  # columns of the front, each contiguous
            column.reshape(-1)[plan.cells] = flat[plan.blocks]
            is_corner = plan.photos == 0 and plan.has_global
            if is_corner:
                column[:, :g] = corner
            elif g:
                mine = pattern.order[plan.first // d : plan.first // d + plan.photos]
                column[:, p + b - g :] = border[mine].reshape(p, g)
            f11 = np.array(column[:, :p]).T
            f21 = np.array(column[:, p:]).T
            f22 = np.zeros((b, b), order="F")
            for child in children[k]:
                below = plans[child]
                if below.border == 0:
                    continue
                schur = waiting.pop(child)
                i = len(below.inner)
                _scatter(f11, below.inner, below.inner, schur[:i, :i])
                _scatter(f21, below.outer, below.inner, schur[i:, :i])
                _scatter(f22, below.outer, below.outer, schur[i:, i:])
            before, least = np.diagonal(f11).copy(), _SMALLEST_PIVOT
            if is_corner:
                # all photos are eliminated: what is left of an open column is rounding alone
                before = np.diagonal(corner) if corner_scale is None else corner_scale
                least = _SMALLEST_IN_CORNER
            l11, info = dpotrf(f11, lower=1, clean=1, overwrite_a=1)
            if info != 0:
                raise NotPositiveError(self._photo(plan, info - 1))
            ratio = np.diagonal(l11) ** 2 / before
            worst = int(np.argmin(ratio))
            if not ratio[worst] > least:
                raise NotPositiveError(self._photo(plan, worst))
            self.smallest = min(self.smallest, float(ratio[worst]))
            if b:
                f21 = dtrsm(1.0, l11, f21, side=1, lower=1, trans_a=1, overwrite_b=1)
                waiting[k] = dsyrk(-1.0, f21, beta=1.0, c=f22, lower=1, overwrite_c=1)
            self._l11.append(l11)
            self._l21.append(f21)
            if progress is not None:
                progress(float(work[k] / work[count - 1]))

    def _photo(self, plan: _FrontPlan, row: int) -> int | None:
        if plan.photos == 0:
            return None
        return int(self.pattern.order[(plan.first + row) // self.pattern.d])

    def _divide(self) -> None:
        """Turn every L21 into G = L21 L11^-1."""
        if not self._divided:
            for k, (l11, l21) in enumerate(zip(self._l11, self._l21, strict=True)):
                if l21.size:
                    self._l21[k] = dtrsm(1.0, l11, l21, side=1, lower=1, overwrite_b=1)
            self._divided = True

    def solve(self, photos: Array, border: Array) -> tuple[Array, Array]:
        """Solve for right-hand sides.

        Parameters
        ----------
        photos
            (n, d, k).
        border
            (g, k).
        """
        pattern = self.pattern
        n, d, g = pattern.n, pattern.d, pattern.g
        k = photos.shape[2]
        x = np.empty((n * d + g, k), order="F")
        x[: n * d] = photos[pattern.order].reshape(n * d, k)
        x[n * d :] = border
        targets = [self._targets(plan) for plan in pattern.plans]
        for plan, l11, l21, rows in zip(pattern.plans, self._l11, self._l21, targets, strict=True):
            own = slice(plan.first, plan.first + plan.pivots)
            if self._divided:
                x[rows] -= l21 @ x[own]
                x[own] = dtrsm(1.0, l11, x[own], lower=1)
            else:
                x[own] = dtrsm(1.0, l11, x[own], lower=1)
                x[rows] -= l21 @ x[own]
        for plan, l11, l21, rows in zip(
            reversed(pattern.plans),
            reversed(self._l11),
            reversed(self._l21),
            reversed(targets),
            strict=True,
        ):
            own = slice(plan.first, plan.first + plan.pivots)
            if self._divided:
                x[own] = dtrsm(1.0, l11, x[own], lower=1, trans_a=1) - l21.T @ x[rows]
            else:
                x[own] = dtrsm(1.0, l11, x[own] - l21.T @ x[rows], lower=1, trans_a=1)
        out = np.empty((n, d, k))
        out[pattern.order] = x[: n * d].reshape(n, d, k)
        return out, np.array(x[n * d :])

    def inner_products(self, sides: csr_array) -> Array:
        """Return (k, k) S' N^-1 S of sparse right-hand sides S, of the elimination alone.

        N = L L', so it is F'F with F = L^-1 S; a side is zero in all fronts but those above its
        own photos, and the product of a front takes the sides that reach it.

        Parameters
        ----------
        sides
            (n d + g, k): photos, and below them the border's columns.
        """
        pattern = self.pattern
        rows = np.concatenate(
            (_scalars(pattern.order, pattern.d), pattern.n * pattern.d + np.arange(pattern.g))
        )
        ordered = csr_array(sides[rows])
        ordered.sum_duplicates()
        count = ordered.shape[1]
        out = np.zeros((count, count))
        waiting: dict[int, list[tuple[_FrontPlan, Index, Array]]] = {}
        for k, (plan, l11, l21) in enumerate(zip(pattern.plans, self._l11, self._l21, strict=True)):
            p = plan.pivots
            starts = ordered.indptr[plan.first : plan.first + p + 1]
            own = slice(starts[0], starts[-1])
            below = waiting.pop(k, [])
            columns = np.unique(
                np.concatenate([ordered.indices[own], *(reached for _, reached, _ in below)])
            )
            if not len(columns):
                continue
            x = np.zeros((p + plan.border, len(columns)))
            at = np.searchsorted(columns, ordered.indices[own])
            x[np.repeat(np.arange(p), np.diff(starts)), at] = ordered.data[own]
            for child, reached, left in below:
                places, i = np.searchsorted(columns, reached), len(child.inner)
                x[np.ix_(child.inner, places)] += left[:i]
                x[np.ix_(p + child.outer, places)] += left[i:]
            f = dtrsm(1.0, l11, x[:p], lower=1)
            out[np.ix_(columns, columns)] += f.T @ f
            if plan.border:
                left = x[p:] - l21 @ (x[:p] if self._divided else f)
                waiting.setdefault(plan.parent, []).append((plan, columns, left))
        return out

    def _targets(self, plan: _FrontPlan) -> Index:
        if plan.photos == 0:
            return np.arange(0)
        rows = _scalars(plan.rows, self.pattern.d)
        if self.pattern.g:
            start = self.pattern.n * self.pattern.d
            rows = np.concatenate((rows, start + np.arange(self.pattern.g)))
        return rows

    def selected_inverse(self, progress: ShareProgress | None = None) -> SelectedInverse:
        """Compute the inverse inside the pattern (Takahashi's recursion, by fronts)."""
        self._divide()
        pattern = self.pattern
        plans = pattern.plans
        d, g, n = pattern.d, pattern.g, pattern.n
        blocks = np.empty((len(pattern.rows), d * d))
        border = np.empty((n, d, g))
        corner = np.empty((g, g))
        left = np.zeros(len(plans), dtype=np.intp)
        for plan in plans:
            if plan.parent >= 0:
                left[plan.parent] += 1
        held: dict[int, tuple[Array, Array, Array]] = {}
        work = np.cumsum([p.pivots * (p.pivots + p.border) ** 2 + 1.0 for p in plans[::-1]])
        for step, k in enumerate(range(len(plans) - 1, -1, -1)):
            plan = plans[k]
            p, b = plan.pivots, plan.border
            own, _ = dpotri(self._l11[k], lower=1)
            if b:
                up_pp, up_bp, up_bb = held[plan.parent]
                i = len(plan.inner)
                q_bb = np.empty((b, b), order="F")
                _gather(up_pp, plan.inner, plan.inner, q_bb[:i, :i])
                _gather(up_bp, plan.outer, plan.inner, q_bb[i:, :i])
                _gather(up_bb, plan.outer, plan.outer, q_bb[i:, i:])
                ratio = self._l21[k]
                q_bp = dsymm(-1.0, q_bb, ratio, lower=1)
                own = dgemm(-1.0, ratio, q_bp, trans_a=1, beta=1.0, c=own, overwrite_c=1)
            else:
                q_bp, q_bb = np.empty((0, p)), np.empty((0, 0))
            if plan.parent >= 0:
                left[plan.parent] -= 1
                if left[plan.parent] == 0:
                    del held[plan.parent]
            _mirror(own)
            column = np.empty((p, p + b))
            column[:, :p] = own.T
            column[:, p:] = q_bp.T
            if plan.photos:
                blocks[plan.blocks] = column.reshape(-1)[plan.cells]
                if g:
                    mine = pattern.order[plan.first // d : plan.first // d + plan.photos]
                    border[mine] = column[:, p + b - g :].reshape(plan.photos, d, g)
            else:
                corner[:] = own
            if left[k]:
                held[k] = own, q_bp, q_bb
            if progress is not None:
                progress(float(work[step] / work[-1]))
        return SelectedInverse(blocks.reshape(-1, d, d), border, corner)


def _mirror(matrix: Array) -> None:
    """Copy the lower triangle into the upper one, tile by tile."""
    n = len(matrix)
    tile = 256
    for i in range(0, n, tile):
        for j in range(0, i, tile):
            matrix[j : j + tile, i : i + tile] = matrix[i : i + tile, j : j + tile].T
        block = matrix[i : i + tile, i : i + tile]
        upper = np.triu_indices(len(block), 1)
        block[upper] = block.T[upper]
