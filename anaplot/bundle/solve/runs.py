"""Runs of numbers, as one array."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Index

__all__ = ["runs"]


def runs(first: Index, count: Index) -> Index:
    """Return numbers that follow each other, from each of some on, one run after the other.

    Parameters
    ----------
    first, count
        (k,) where the runs begin, and how long they are.

    Returns
    -------
    (sum of count,) array
    """
    out: Index = np.arange(count.sum()) + np.repeat(first - (np.cumsum(count) - count), count)
    return out
