"""Least squares: a parametric adjustment, in combined form where observations ask for it.

The model is that of Kratky and El-Hakim (1983), eq. (2) and (3): A v + B g + u = 0 with cofactors
Q of the observations becomes B g + u = w, cofactors A Q A', where w = -A v are the closing
misclosures of the conditions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, sqrt

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import NotComputableError

__all__ = [
    "CONDITION_LIMIT",
    "Adjustment",
    "CombinedAdjustment",
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


@dataclass(frozen=True, slots=True, eq=False)
class Adjustment:
    """The outcome of a parametric adjustment of n rows and u unknowns.

    Attributes
    ----------
    unknowns
        Names, in the order of x and q_xx.
    x
        (u,) estimated unknowns (corrections, when the problem was linearised).
    w
        (n,) closing misclosures B x + u, in the rows' unit.
    q_l
        (n,) a-priori cofactors of the rows.
    root
        (n,) roots of the cofactors of the rows.
    basis
        (n, u) orthonormal columns that span those of the weighted design.
    back
        (u, u) what a step along each of them is in unknowns: misclosures u move these by
        - back basis' (u / root).
    q_xx
        (u, u) cofactors of the unknowns.
    q_vv
        (n, n) cofactors of the residuals, Q - B N^-1 B' (eq. 6).
    r
        (n,) redundancy numbers, the diagonal of Q_vv P.
    vtpv
        Weighted sum of squares.
    redundancy
        n - u.
    condition
        Condition number of the weighted design, columns scaled to unit length.
    """

    unknowns: tuple[str, ...]
    x: Array
    w: Array
    q_l: Array
    root: Array = field(repr=False)
    basis: Array = field(repr=False)
    back: Array = field(repr=False)
    q_xx: Array
    q_vv: Array = field(repr=False)
    r: Array
    vtpv: float
    redundancy: int
    condition: float

    @property
    def sigma0(self) -> float | None:
        """Estimated standard deviation of unit weight; None without redundancy."""
        return sqrt(self.vtpv / self.redundancy) if self.redundancy > 0 else None


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
    Solved through the singular values of the weighted, column-scaled design: they give the
    condition number, the undetermined unknowns and Q_vv in one step, and the projection stays
    idempotent to rounding whatever the condition.
    """
    n, u = design.shape
    if misclosure.shape != (n,) or cofactors.shape != (n,) or len(unknowns) != u:
        raise ValueError(f"shapes disagree: {design.shape}, {misclosure.shape}, {cofactors.shape}")
    if n and not float(cofactors.min()) > 0.0:
        raise ValueError("cofactors must be positive")
    root = np.sqrt(cofactors)
    return adjust_weighted(
        design.T / root,
        misclosure / root,
        cofactors,
        root,
        unknowns=unknowns,
        condition_limit=condition_limit,
    )


def adjust_weighted(
    design: Array,
    misclosure: Array,
    cofactors: Array,
    root: Array,
    *,
    unknowns: Sequence[str],
    condition_limit: float = CONDITION_LIMIT,
) -> Adjustment:
    """Adjust rows that are divided by the roots of their cofactors already; see `adjust`.

    Parameters
    ----------
    design
        (u, n) transposed design, a column a row.
    misclosure
        (n,) values of the conditions.
    cofactors, root
        (n,) of the rows as they were before, and their roots.
    unknowns, condition_limit
        As in `adjust`.
    """
    u, n = design.shape
    length = np.sqrt(np.einsum("ij,ij->i", design, design))
    sizes = length.tolist()
    if not abs(sum(sizes) + float(misclosure.sum())) < inf:
        raise ValueError("design and misclosures must be finite")
    if 0.0 in sizes:
        names = tuple(name for name, size in zip(unknowns, sizes, strict=True) if size == 0.0)
        raise RankDefectError(names, inf)
    scaled = (design / length[:, None]).T
    # straight to LAPACK: the wrapper costs as much as the decomposition of a model's size
    # loaded with the first adjustment: scipy.linalg costs more than the rest of a start
    from scipy.linalg.lapack import dgesdd

    basis, singular, right, info = dgesdd(scaled, full_matrices=0)
    values = singular.tolist()
    smallest = values[-1] if n >= u and info == 0 else 0.0
    condition = values[0] / smallest if smallest > 0.0 else inf
    if not condition < condition_limit:
        if n < u or info:
            _, singular, right = np.linalg.svd(scaled)
        firm = int(np.count_nonzero(singular * condition_limit > singular[:1]))
        raise RankDefectError(_participants(right[min(firm, u - 1) :], unknowns), condition)
    # `dot` rather than @, whose way to BLAS is twice as long: rows of a model are few
    projected = misclosure.dot(basis)
    back = right.T / singular
    back /= length[:, None]
    closing = misclosure - basis.dot(projected)
    projector = -basis.dot(basis.T)
    diagonal = np.einsum("ii->i", projector)
    diagonal += 1.0
    return Adjustment(
        unknowns=tuple(unknowns),
        x=-back.dot(projected),
        w=closing * root,
        q_l=cofactors,
        root=root,
        basis=basis,
        back=back,
        q_xx=back.dot(back.T),
        q_vv=projector * (root[:, None] * root),
        r=np.maximum(diagonal, 0.0),
        vtpv=float(closing.dot(closing)),
        redundancy=n - u,
        condition=condition,
    )


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
