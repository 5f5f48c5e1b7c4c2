"""The adjustment of least absolute residuals: min sum abs(e - A d), e and A divided by the sigmas.

Its dual is a linear programme in n bounded variables, solved exactly by HiGHS,

    max e'y,    A'y = 0,    abs(y) <= 1,

whose multipliers are d. Where that is too slow the same optimum is reached by re-weighted least
squares: the primal-dual interior-point method for least absolute values (Portnoy, Koenker 1997,
section 3), every step of which is an adjustment A'QA with weights Q; some fifteen of them do, and
the gap between primal and dual says that it is the optimum. One more, of the rows alone that are
zero there, leads from next to the corner into it.

Without a design only R is known, R = Q_vv P. With its eigenvalues l and eigenvectors V the columns
V sqrt(1 - l) span the design; where l lies between 0 and 1 (priors that are no rows of the system)
there are rows beside those seen, with derivatives sqrt(l); where l exceeds 1 (correlated rows) more
is left than was observed, by that factor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import splu

from anaplot.adjustment.residualsystem import Designed, ResidualSystem, diagonal
from anaplot.aliases import Array

__all__ = [
    "MOST_ROWS_OF_PROGRAMME",
    "LeastAbsolute",
    "design_of",
    "least_absolute",
    "least_absolute_residuals",
]


MOST_ROWS_OF_PROGRAMME = 1_000
"""Rows up to which the linear programme is solved; beyond them it is re-weighted least squares."""

_ZERO = 1e-9  # eigenvalue of R that is none
_PROJECTOR = 1e-6  # largest element of R R - R that is rounding
_GAP = 1e-10  # per row: difference of primal and dual at which the optimum is reached
_ROUNDING = 1e-13  # of a sum
_MOST_ITERATIONS = 200
_TO_THE_WALL = 0.9995  # part of the way to the nearest bound that a step may go
_HOLD = 1e-13  # of a diagonal element: keeps what only the datum would determine


class LeastAbsolute(NamedTuple):
    """The residuals of least absolute sum.

    Attributes
    ----------
    residuals
        (n,) e - A d.
    total
        Sum of their absolute values, over all rows of the programme.
    iterations
        Of the re-weighting; None: a linear programme.
    """

    residuals: Array
    total: float
    iterations: int | None


def least_absolute_residuals(system: ResidualSystem) -> Array:
    """Return (n,) residuals of the least absolute sum of a system, in a-priori sigmas.

    Parameters
    ----------
    system
        All rows; where it is no `Designed` all columns of R are asked for.

    Raises
    ------
    ArithmeticError
        The optimum is not reached.
    """
    e = np.asarray(system.e, dtype=float)
    if isinstance(system, Designed):
        design = system.design()
        if design is not None:
            return least_absolute(design, e).residuals
    design, misclosures = _from_residual_matrix(system.columns(np.arange(len(e))), e)
    return least_absolute(design, misclosures).residuals[: len(e)]


def design_of(matrix: Array) -> csr_array | None:
    """Return (n, u) a design with this R; None where it is no projector: see above.

    Parameters
    ----------
    matrix
        (n, n) R.
    """
    design, misclosures = _from_residual_matrix(matrix, np.zeros(len(matrix)))
    projector = float(np.abs(matrix @ matrix - matrix).max(initial=0.0)) < _PROJECTOR
    return design if projector and len(misclosures) == len(matrix) else None


def _from_residual_matrix(matrix: Array, e: Array) -> tuple[csr_array, Array]:
    """Return a design with this R and its misclosures, those of further rows at the end."""
    value, vector = np.linalg.eigh(0.5 * (matrix + matrix.T))
    value = np.maximum(value, 0.0)
    beyond = value > 1.0 + _ZERO
    along = vector[:, beyond]
    e = e + along @ ((1.0 / value[beyond] - 1.0) * (along.T @ e))
    bound = value < 1.0 - _ZERO
    value, vector = value[bound], vector[:, bound]
    beside = np.flatnonzero(value > _ZERO)
    held = value[beside]
    below = np.zeros((len(beside), len(value)))
    below[np.arange(len(beside)), beside] = np.sqrt(held)
    design = csr_array(np.vstack((vector * np.sqrt(1.0 - value), below)))
    hidden = -np.sqrt((1.0 - held) / held) * (vector[:, beside].T @ e)
    return design, np.concatenate((e, hidden))


def least_absolute(
    design: csr_array, e: Array, most_rows: int = MOST_ROWS_OF_PROGRAMME
) -> LeastAbsolute:
    """Minimise the sum of absolute residuals.

    Parameters
    ----------
    design
        (n, u) A, each row divided by its sigma; its columns may depend on each other.
    e
        (n,) misclosures, likewise.
    most_rows
        Up to so many rows by a linear programme.

    Raises
    ------
    ArithmeticError
        The optimum is not reached.
    """
    length = np.sqrt(np.asarray(design.multiply(design).sum(axis=0)).ravel())
    used = np.flatnonzero(length > 0.0)
    scaled = csr_array(csc_array(design)[:, used] @ diagonal(1.0 / length[used]))
    # of the size of the errors that are not gross: what is absolute in the solvers is relative
    unit = max(float(np.abs(e).max(initial=0.0)), 1e-300)
    if len(e) <= most_rows:
        residuals, iterations = _programme(scaled, e / unit) * unit, None
    else:
        found, iterations = _reweighted(scaled, e / unit)
        residuals = found * unit
    return LeastAbsolute(residuals, float(np.abs(residuals).sum()), iterations)


def _programme(design: csr_array, e: Array) -> Array:
    if not design.shape[1]:
        return e.copy()
    from scipy.optimize import linprog  # as long to load as NumPy, and seldom used

    found = linprog(  # type: ignore[call-overload]  # its stubs know no sparse matrices
        -e, A_eq=design.T, b_eq=np.zeros(design.shape[1]), bounds=(-1.0, 1.0), method="highs"
    )
    if not found.success:
        raise ArithmeticError(f"no least absolute sum: {found.message}")
    return np.asarray(e + design @ found.eqlin.marginals, dtype=float)


def _reweighted(design: csr_array, e: Array) -> tuple[Array, int]:
    """Return the residuals and the number of weighted adjustments."""
    n, u = design.shape
    transposed = csr_array(design.T)
    hold = diagonal(np.full(u, _HOLD))

    def adjustment(weights: Array) -> Callable[[Array], Array]:
        """Return what adjusts misclosures with these weights: d of them."""
        normal = csc_array(transposed @ diagonal(weights) @ design) + hold * weights.mean()
        normal = csc_array(normal)
        # SuperLU takes indices of 32 bits only
        narrow = normal.indices.astype(np.intc), normal.indptr.astype(np.intc)
        factor = splu(
            csc_array((normal.data, *narrow), shape=normal.shape),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

        def adjusted(of: Array) -> Array:
            d = factor.solve(transposed @ (weights * of))
            for _ in range(2):
                d += factor.solve(transposed @ (weights * (of - design @ d)))
            return np.asarray(d, dtype=float)

        return adjusted

    # v = plus - minus; the conditions are minus low = plus high = 0 with low = 1 + y, high = 1 - y
    d = adjustment(np.ones(n))(e)
    v = e - design @ d
    floor = max(1e-3 * float(np.abs(v).mean()), 1e-12)
    plus, minus = np.maximum(v, 0.0) + floor, np.maximum(-v, 0.0) + floor
    low, high = np.ones(n), np.ones(n)
    for iteration in range(_MOST_ITERATIONS):
        gap = float(minus @ low + plus @ high)
        if gap < _GAP * (n * floor + float(np.abs(v).sum())):
            # at the optimum these are zero: the corner that the programme has
            zero = np.abs(v) < float(np.abs(v).mean()) * np.minimum(low, high)
            there = v - design @ adjustment(zero.astype(float))(v)
            better = np.abs(there).sum() <= np.abs(v).sum() * (1.0 + _ROUNDING)
            return (there if better else v), iteration
        weights = 1.0 / (plus / high + minus / low)
        adjusted = adjustment(weights)
        # the first step without a centre tells how far to one the second one should keep
        wanted, centre = v, 0.0
        second_low = second_high = np.zeros(n)
        for corrected in (False, True):
            step = adjusted(wanted)
            dy = weights * (wanted - design @ step)
            d_minus = centre / low - minus - minus * dy / low - second_low
            d_plus = centre / high - plus + plus * dy / high + second_high
            far = min(_reach(low, dy), _reach(high, -dy))
            far_dual = min(_reach(minus, d_minus), _reach(plus, d_plus))
            if corrected or min(far, far_dual) == 1.0:
                break
            then = (minus + far_dual * d_minus) @ (low + far * dy)
            then += (plus + far_dual * d_plus) @ (high - far * dy)
            centre = gap * (float(then) / gap) ** 3 / (2 * n)
            second_low, second_high = dy * d_minus / low, dy * d_plus / high
            wanted = v - centre * (1.0 / high - 1.0 / low) - second_high - second_low
        low, high = low + far * dy, high - far * dy
        minus, plus = minus + far_dual * d_minus, plus + far_dual * d_plus
        d = d + far_dual * step
        v = e - design @ d
    raise ArithmeticError(f"no least absolute sum in {_MOST_ITERATIONS} adjustments")


def _reach(value: Array, change: Array) -> float:
    """Return how much of a step keeps values positive, at most all of it."""
    down = change < 0.0
    if not down.any():
        return 1.0
    return min(1.0, _TO_THE_WALL * float((-value[down] / change[down]).min()))
