"""Which of very many things are drawn."""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from anaplot.aliases import Array, Bools, Index

__all__ = ["thinned"]


def thinned(at: Array, most: int, first: Bools | None = None) -> Index:
    """Return which points are drawn: those that matter, and of the others one in a cell of a grid.

    Parameters
    ----------
    at
        (n, 2) where they are, the more important ones of a cell first.
    most
        How many at most.
    first
        (n,) which are drawn before all others; where there are more than `most`, the first ones.

    Returns
    -------
    (k,) array
        Ascending; all of them where there are not more than `most`.
    """
    n = len(at)
    if n <= most:
        return np.arange(n)
    chosen = np.zeros(n, dtype=bool)
    if first is not None:
        chosen[np.flatnonzero(first)[:most]] = True
    left = most - int(chosen.sum())
    others = np.flatnonzero(~chosen)
    if left > 0:
        chosen[others[_one_a_cell(at[others], left)]] = True
    return np.flatnonzero(chosen)


def _one_a_cell(at: Array, most: int) -> Index:
    low = at.min(axis=0)
    extent = np.maximum(at.max(axis=0) - low, 1e-300)
    side = max(1, int(sqrt(most)))
    # as many columns and rows as make cells nearly square
    columns = min(max(1, ceil(side * sqrt(min(extent[0] / extent[1], float(most))))), most)
    rows = max(1, most // columns)
    cell = np.minimum(
        ((at - low) / extent * [columns, rows]).astype(np.intp), [columns - 1, rows - 1]
    )
    _, found = np.unique(cell[:, 0] * rows + cell[:, 1], return_index=True)
    return np.sort(found)
