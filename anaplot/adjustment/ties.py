"""Which of the rows to reject that no statistic can tell apart.

Rows whose residuals are fully correlated have the same abs(w). Rounding alone decides which is the
largest, and decides badly where a redundancy number r is small: R is known to some 1e-13, so w to
that over r. The row with the larger r then explains the misclosures as well, by an error that is
smaller in proportion to its r.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["EQUAL", "UNSURE", "surest"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]

EQUAL = 1e-9
"""Relative difference below which two statistics cannot be told apart, however large r."""

_ROUNDING = 1e-13  # of R
UNSURE = _ROUNDING / EQUAL
"""Redundancy number below which rounding makes more of a difference than `EQUAL`."""


def surest(size: Array, r: Array, columns: Array, rows: Index) -> Index:
    """Return the rows themselves, or their partners with the largest redundancy numbers.

    Parameters
    ----------
    size
        (m, n) abs(w) in m cases, or proportional to it; NaN: not to be chosen.
    r
        (m, n) redundancy numbers.
    columns
        (m, n) columns of R of the rows.
    rows
        (m,) rows with the largest size, or nearly so.

    Returns
    -------
    ndarray
        (m,) where the r of a row is less than `UNSURE`: of the rows that differ from it in size,
        and from a full correlation, by no more than rounding, the one with the largest r, of equal
        ones the first.
    """
    at = (np.arange(len(rows)), rows)
    own = r[at][:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        same = 1.0 - 2.0 * EQUAL - _ROUNDING / r - _ROUNDING / own
        tied = (size >= size[at][:, None] * same) & (np.abs(columns) >= np.sqrt(r * own) * same)
    best = np.where(tied & (r > own) & (own < UNSURE), r, 0.0)
    most = best.max(axis=1, keepdims=True)
    first = np.argmax(best >= most * (1.0 - 1e-6), axis=1)
    return np.where(most[:, 0] > 0.0, first, rows).astype(np.intp)
