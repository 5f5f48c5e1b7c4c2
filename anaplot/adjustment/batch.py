"""Many realisations of the errors of one linear(ised) design, tested all at once.

The observations of run m, in a-priori sigmas, leave e_m = R l_m: all runs are one matrix product.
Stepwise rejection updates every run that still rejects by one row per sweep (Gruen 1980, eq. 17),
so that there is a loop over sweeps but never one over runs.
"""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.findings import SearchSettings
from anaplot.adjustment.partners import likeliest
from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.aliases import Array, Bools, Index

__all__ = ["BATCH_TESTS", "batch_test", "reject_stepwise", "standardized"]


BATCH_TESTS = ("baarda", "tau")

# R carries rounding of about 1e-13, amplified by every elimination
_LOST = 1e-8


def standardized(e: Array, r: Array) -> Array:
    """Return |w| = |e| / sqrt(r), zero where a row cannot be tested; e and r (..., n)."""
    testable = r > _LOST
    statistic: Array = np.where(testable, np.abs(e) / np.sqrt(np.where(testable, r, 1.0)), 0.0)
    return statistic


def batch_test(
    test: str, e: Array, r: Array, redundancy: int, alpha: float
) -> tuple[Array, float | None]:
    """Return (m, n) statistics of e (m, n) with r (n,), all rows there, and their critical value.

    "baarda" goes by the a-priori sigma, "tau" by that of all rows of a run, and has no critical
    value where nothing can be located.
    """
    if test == "baarda":
        return standardized(e, r), critical_normal(alpha)
    vtpv = np.einsum("mn,mn->m", e, e)
    sigma0 = np.sqrt(np.maximum(vtpv, np.finfo(float).tiny) / redundancy)
    return standardized(e, r) / sigma0[:, None], critical_tau(alpha, redundancy)


def reject_stepwise(
    matrix: Array,
    errors: Array,
    test: str,
    alpha: float,
    *,
    redundancy: int | None = None,
) -> Bools:
    """Reject the row with the largest statistic, run by run, until none exceeds its critical value.

    Of rows that are hard to tell apart from it the likeliest goes (`partners`); every row is a
    measurement of its own. Never more than half of the redundancy is rejected.

    Parameters
    ----------
    matrix
        (n, n) R of a `ResidualSystem`: Q_vv P of the whitened design, symmetric and idempotent, or
        what stands for it with correlated rows.
    errors
        (m, n) errors of the observations in a-priori sigmas: noise and gross errors.
    test
        "baarda" (a-priori sigma) or "tau" (sigma from the rows that remain).
    alpha
        Significance number of the test of a single row.
    redundancy
        Rank of R; None: its trace, which it is where R is idempotent.

    Returns
    -------
    (m, n)
        Which rows are rejected in each run.

    Raises
    ------
    ValueError
        An unknown test, or shapes that do not belong together.
    """
    if test not in BATCH_TESTS:
        raise ValueError(f"no batch test {test!r}; there are {', '.join(BATCH_TESTS)}")
    n = matrix.shape[0]
    if matrix.shape != (n, n) or errors.ndim != 2 or errors.shape[1] != n:
        raise ValueError(f"errors {errors.shape} do not belong to a matrix {matrix.shape}")
    if redundancy is None:
        redundancy = round(float(np.trace(matrix)))
    runs = len(errors)
    e = errors @ matrix.T
    r = np.tile(np.diag(matrix), (runs, 1))
    vtpv = np.einsum("mn,mn->m", e, errors)  # l'R l, also where R is not idempotent
    rejected = np.zeros((runs, n), dtype=bool)
    active = np.arange(runs)
    stack = np.empty((runs, 0, n))  # orthogonalised, scaled columns of the active runs

    for step in range(SearchSettings().room(redundancy)):
        # every active run has rejected `step` rows
        left = redundancy - step
        statistic = standardized(e[active], r[active])
        if test == "tau":
            critical = critical_tau(alpha, left)
            if critical is None:
                break
            sigma0 = np.sqrt(np.maximum(vtpv[active], np.finfo(float).tiny) / left)
            statistic = statistic / sigma0[:, None]
        else:
            critical = critical_normal(alpha)
        row = np.argmax(statistic, axis=1)
        go = statistic[np.arange(len(active)), row] > critical
        active, row, stack = active[go], row[go], stack[go]
        if not len(active):
            break
        here = np.arange(len(active))
        column = _columns(matrix, stack, row)
        w = standardized(e[active], r[active])
        chosen = likeliest(w, r[active], column, row)
        other = np.flatnonzero(chosen != row)
        column[other] = _columns(matrix, stack[other], chosen[other])
        row = chosen
        column /= np.sqrt(column[here, row])[:, None]
        along = e[active, row] / column[here, row]
        e[active] -= along[:, None] * column
        r[active] -= column * column
        e[active, row] = 0.0
        r[active, row] = 0.0
        vtpv[active] = np.maximum(vtpv[active] - along * along, 0.0)
        rejected[active, row] = True
        stack = np.concatenate([stack, column[:, None, :]], axis=1)
    return rejected


def _columns(matrix: Array, stack: Array, row: Index) -> Array:
    """(m, n) column of R of a row in each run, given the rows that it has rejected."""
    along = stack[np.arange(len(row)), :, row]
    column: Array = matrix[row] - np.einsum("mk,mkn->mn", along, stack)
    return column
