"""Least squares: a parametric adjustment, in combined form where observations ask for it.

The model is that of Kratky and El-Hakim (1983), eq. (2) and (3): A v + B g + u = 0 with cofactors
Q of the observations becomes B g + u = w, cofactors A Q A', where w = -A v are the closing
misclosures of the conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import inf, sqrt
from typing import Any

import numpy as np

from anaplot.adjustment import lapack
from anaplot.adjustment.scalars import ONE, ZERO
from anaplot.aliases import Array
from anaplot.errors import NotComputableError

__all__ = [
    "CONDITION_LIMIT",
    "Adjustment",
    "CombinedAdjustment",
    "MadeAgain",
    "RankDefectError",
    "adjust",
    "adjust_combined",
    "adjust_weighted",
]

CONDITION_LIMIT = 1e4
"""Condition number (columns scaled to unit length) from which a design counts as rank deficient."""


class RankDefectError(NotComputableError):
    """The observations do not determine every unknown.

    Attributes
    ----------
    undetermined
        Names of the unknowns that take part in the undetermined combination, most affected first.
    condition
        Condition number of the design, columns scaled to unit length.
    """

    def __init__(self, undetermined: tuple[str, ...], condition: float) -> None:
        self.undetermined = undetermined
        self.condition = condition
        super().__init__(
            f"not determined: {', '.join(undetermined)} (condition number {condition:.3g})"
        )


class MadeAgain:
    """Is pickled without its cached properties, which can be made again: base class."""

    def __getstate__(self) -> dict[str, Any]:
        kind = type(self)
        return {
            name: value
            for name, value in vars(self).items()
            if not isinstance(getattr(kind, name, None), cached_property)
        }


@dataclass(frozen=True, eq=False)
class Adjustment(MadeAgain):
    """The outcome of a parametric adjustment of n rows and u unknowns.

    Attributes
    ----------
    unknowns
        Names, in the order of x and q_xx.
    rows
        (u + 1, n) derivatives by the unknowns and misclosures, divided by the roots of the
        cofactors.
    root
        (n,) roots of the a-priori cofactors of the rows.
    triangle
        (n or u + 1, u + 1) triangular factor of the rows, on and above its diagonal; below it the
        reflections that made it.
    factors
        (n or u + 1,) factors of these.
    columns
        (n, k) orthonormal columns: the first u span those of the weighted design, the next is along
        `closing`; k is u + 1 at most, or n where all were asked for.
    closing
        (n,) closing misclosures, divided by the roots of the cofactors.
    r
        (n,) redundancy numbers, the diagonal of Q_vv P.
    vtpv
        Weighted sum of squares.
    redundancy
        n - u.
    at_most
        What the condition number does not exceed.
    """

    unknowns: tuple[str, ...]
    rows: Array = field(repr=False)
    root: Array = field(repr=False)
    triangle: Array = field(repr=False)
    factors: Array = field(repr=False)
    columns: Array = field(repr=False)
    closing: Array = field(repr=False)
    r: Array
    vtpv: float
    redundancy: int
    at_most: float

    @property
    def sigma0(self) -> float | None:
        """Estimated standard deviation of unit weight; None without redundancy."""
        return sqrt(self.vtpv / self.redundancy) if self.redundancy > 0 else None

    @property
    def w(self) -> Array:
        """(n,) closing misclosures B x + u, in the rows' unit."""
        return self.closing * self.root

    @cached_property
    def x(self) -> Array:
        """(u,) estimated unknowns (corrections, when the problem was linearised)."""
        u = len(self.unknowns)
        return np.asarray(-self.back.dot(self.triangle[:u, u]))

    @cached_property
    def back(self) -> Array:
        """(u, u) what a step along each column of `basis` is in unknowns.

        Misclosures u move these by - back basis' (u / root).
        """
        u = len(self.unknowns)
        return np.asarray(lapack.dtrtri(np.triu(self.triangle[:u, :u]))[0])

    @cached_property
    def q_xx(self) -> Array:
        """(u, u) cofactors of the unknowns."""
        return np.asarray(self.back.dot(self.back.T))

    @property
    def basis(self) -> Array:
        """(n, u) orthonormal columns that span those of the weighted design."""
        return self.columns[:, : len(self.unknowns)]

    @property
    def complement(self) -> Array:
        """(n, n - u) orthonormal columns orthogonal to `basis`; the first is along `closing`."""
        n, columns = len(self.columns), self.columns
        if columns.shape[1] < n:
            columns = _orthonormal(self.triangle, self.factors, n)
        return columns[:, len(self.unknowns) :]

    @cached_property
    def projector(self) -> Array:
        """(n, n) what is left of weighted misclosures, 1 - basis basis'."""
        basis = self.basis
        out: Array = -basis.dot(basis.T)
        diagonal = np.einsum("ii->i", out)
        diagonal += 1.0
        return out

    @property
    def q_vv(self) -> Array:
        """(n, n) cofactors of the residuals, Q - B N^-1 B' (eq. 6)."""
        return self.projector * (self.root[:, None] * self.root)

    @property
    def influence(self) -> Array:
        """(n, n) Q_vv P."""
        return self.projector * (self.root[:, None] / self.root)

    @cached_property
    def condition(self) -> float:
        """Condition number of the weighted design, columns scaled to unit length."""
        return _condition(_singular_values(self.rows[:-1]))

    def worse_than(self, limit: float) -> bool:
        """Whether the condition number is above a limit."""
        return self.at_most > limit and self.condition > limit


def adjust(
    design: Array,
    misclosure: Array,
    cofactors: Array,
    *,
    unknowns: Sequence[str],
    condition_limit: float = CONDITION_LIMIT,
) -> Adjustment:
    """Adjust uncorrelated rows: minimise w' P w with w = B x + u.

    Parameters
    ----------
    design
        (n, u) matrix B.
    misclosure
        (n,) vector u, the value of each condition at the approximate unknowns.
    cofactors
        (n,) a-priori cofactors of the rows, positive.
    unknowns
        u names.
    condition_limit
        Condition number from which the design counts as rank deficient.

    Raises
    ------
    RankDefectError
        Fewer rows than unknowns, or dependent columns; names the unknowns.
    ValueError
        Shapes disagree, a number is not finite or a cofactor is not positive.

    Notes
    -----
    Solved by orthogonal triangularisation of the weighted rows, design and misclosures side by
    side: it gives v'Pv and the closing misclosures beside the projection, which stays idempotent
    to rounding whatever the condition. Columns of unit length have a condition number below 2 over
    the determinant of their triangular factor (Guggenheimer, Edelman and Johnson 1995); singular
    values are computed only where that leaves doubt.
    """
    n, u = design.shape
    if misclosure.shape != (n,) or cofactors.shape != (n,) or len(unknowns) != u:
        raise ValueError(f"shapes disagree: {design.shape}, {misclosure.shape}, {cofactors.shape}")
    if n and not float(cofactors.min()) > 0.0:
        raise ValueError("cofactors must be positive")
    root = np.sqrt(cofactors)
    rows = np.vstack((design.T, misclosure)) / root
    return adjust_weighted(rows, root, unknowns=unknowns, condition_limit=condition_limit)


def adjust_weighted(
    rows: Array,
    root: Array,
    *,
    unknowns: Sequence[str],
    condition_limit: float = CONDITION_LIMIT,
    complete: bool = False,
) -> Adjustment:
    """Adjust rows that are divided by the roots of their cofactors already; see `adjust`.

    Parameters
    ----------
    rows
        (u + 1, n) transposed design and the values of the conditions.
    root
        (n,) what they are divided by.
    unknowns, condition_limit
        As in `adjust`.
    complete
        Whether the outcome has n orthonormal columns.
    """
    u, n = len(rows) - 1, rows.shape[1]
    # `dot` rather than @, whose way to BLAS is twice as long: rows of a model are few
    squares: list[float] = rows.dot(rows.T).diagonal().tolist()
    if not sum(squares) < inf:
        raise ValueError("design and misclosures must be finite")
    *squares, _ = squares
    if 0.0 in squares:
        names = tuple(name for name, size in zip(unknowns, squares, strict=True) if size == 0.0)
        raise RankDefectError(names, inf)
    if n < u:
        raise _rank_defect(rows[:-1], unknowns, condition_limit, inf)
    # of n = u rows none is left to check: the triangle has no last row, and nothing is to close
    triangle, factors, _, _ = lapack.dgeqrf(rows.T)
    q = _orthonormal(triangle, factors, n if complete else len(factors))
    diagonal: list[float] = triangle.diagonal().tolist()
    determinant = 1.0
    for square, size in zip(squares, diagonal, strict=False):
        determinant *= size * size / square
    at_most = 2.0 / sqrt(determinant) if determinant > 0.0 else inf
    if not at_most < condition_limit:
        condition = _condition(_singular_values(rows[:-1]))
        if not condition < condition_limit:
            raise _rank_defect(rows[:-1], unknowns, condition_limit, condition)
    basis = q[:, :u]
    hat = basis.dot(basis.T)
    return Adjustment(
        unknowns=tuple(unknowns),
        rows=rows,
        root=root,
        triangle=triangle,
        factors=factors,
        columns=q,
        closing=q[:, u] * diagonal[u] if n > u else np.zeros(n),
        r=np.maximum(ONE - hat.diagonal(), ZERO),
        vtpv=diagonal[u] ** 2 if n > u else 0.0,
        redundancy=n - u,
        at_most=at_most,
    )


def _orthonormal(triangle: Array, factors: Array, count: int) -> Array:
    """(n, count) columns that the reflections of a triangular factor make."""
    n, k = len(triangle), len(factors)
    reflections = triangle
    if count != triangle.shape[1]:
        reflections = np.zeros((n, count), order="F")
        reflections[:, :k] = triangle[:, :k]
    return np.asarray(lapack.dorgqr(reflections, factors)[0])


def _scaled(design: Array) -> Array:
    """(n, u) design of (u, n) transposed rows, columns of unit length."""
    length = np.sqrt(np.einsum("ij,ij->i", design, design))
    return np.asarray((design / length[:, None]).T)


def _singular_values(design: Array) -> list[float]:
    """Singular values of (u, n) transposed rows, columns scaled; none where they do not come."""
    _, singular, _, info = lapack.dgesdd(_scaled(design), full_matrices=0)
    return [] if info else singular.tolist()


def _condition(singular: list[float]) -> float:
    return singular[0] / singular[-1] if singular and singular[-1] > 0.0 else inf


def _rank_defect(
    design: Array, unknowns: Sequence[str], limit: float, condition: float
) -> RankDefectError:
    """Return the error of (u, n) transposed rows that do not determine every unknown."""
    _, singular, right = np.linalg.svd(_scaled(design))
    firm = int(np.count_nonzero(singular * limit > singular[:1]))
    return RankDefectError(_participants(right[min(firm, len(design) - 1) :], unknowns), condition)


def _participants(vectors: Array, unknowns: Sequence[str]) -> tuple[str, ...]:
    """Names of the unknowns that carry the given null vectors (scaled), largest first.

    All of them together, since which ones span the same null space is a matter of rounding.
    """
    size = np.linalg.norm(vectors, axis=0)
    limit = 0.2 * float(size.max())
    order = np.argsort(-size, kind="stable").tolist()
    return tuple(unknowns[k] for k in order if size[k] >= limit)


@dataclass(frozen=True, slots=True, eq=False)
class CombinedAdjustment:
    """The outcome of A v + B g + u = 0 for m observations and n conditions.

    Attributes
    ----------
    conditions
        The parametric adjustment of the (decorrelated) conditions.
    g
        (u,) unknowns.
    v
        (m,) residuals of the observations.
    q_vv
        (m, m) their cofactors.
    r
        (m,) redundancy numbers of the observations, the diagonal of Q_vv Q^-1.
    """

    conditions: Adjustment
    g: Array
    v: Array
    q_vv: Array = field(repr=False)
    r: Array


def adjust_combined(
    conditions: Array,
    design: Array,
    misclosure: Array,
    cofactors: Array,
    *,
    unknowns: Sequence[str],
    condition_limit: float = CONDITION_LIMIT,
) -> CombinedAdjustment:
    """Adjust A v + B g + u = 0 (Kratky and El-Hakim 1983, eq. 2).

    Parameters
    ----------
    conditions
        (n, m) matrix A.
    design
        (n, u) matrix B.
    misclosure
        (n,) vector u.
    cofactors
        (m,) or (m, m) cofactors Q of the observations.
    unknowns
        u names.
    condition_limit
        As in `adjust`.

    Raises
    ------
    RankDefectError
        Dependent conditions, or unknowns that are not determined.
    ValueError
        Shapes disagree or Q is not positive definite.
    """
    full = np.diag(cofactors) if cofactors.ndim == 1 else cofactors
    pseudo = conditions @ full @ conditions.T
    try:
        # A Q A' = L L': the conditions divided by L are uncorrelated with unit weight
        factor = np.linalg.cholesky(pseudo)
    except np.linalg.LinAlgError as error:
        raise RankDefectError(
            tuple(f"condition {k + 1}" for k in range(len(conditions))), inf
        ) from error
    solved = np.linalg.solve(factor, np.column_stack((design, misclosure, conditions)))
    u = design.shape[1]
    inner = adjust(
        solved[:, :u],
        solved[:, u],
        np.ones(len(conditions)),
        unknowns=unknowns,
        condition_limit=condition_limit,
    )
    whitened = solved[:, u + 1 :]
    gain = full @ whitened.T  # gain' Q^-1 is whitened again: Q itself is never inverted
    q_vv = gain @ inner.q_vv @ gain.T
    return CombinedAdjustment(
        conditions=inner,
        g=inner.x,
        v=-gain @ inner.w,
        q_vv=q_vv,
        r=np.einsum("ij,ji->i", gain @ inner.q_vv, whitened),
    )
