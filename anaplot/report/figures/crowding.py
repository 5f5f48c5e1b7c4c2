"""How many marks a map has room for, and how large they are."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.drawing.plot import Plot
from anaplot.drawing.thinning import thinned

__all__ = ["Sample", "sampled"]

_ROOM = 45.0  # of a mark, in square units of the drawing
_FEWEST = 150
_FULL = 13.0  # units of the drawing between marks that have their full size
_SMALLEST = 0.5


class Sample(NamedTuple):
    """What is drawn of many points.

    Attributes
    ----------
    chosen
        Indices.
    size
        Factor of the size of marks, 0.5 to 1: where they stand close they are small.
    """

    chosen: Index
    size: float


def sampled(plot: Plot, at: Array, among: Index, first: Index, most: int) -> Sample:
    """Return which points of a map are drawn: some before all others, then one in a cell of a grid.

    Which one of a cell is left to a fixed draw: the weakest would make every cell look weak.

    Parameters
    ----------
    plot
        The map.
    at
        (n, 2) where all points are.
    among
        Indices of those that may be drawn.
    first
        Those of them that are drawn before all others, the most important first.
    most
        How many at most.
    """
    places = plot.frame.places(at[among])
    area = float(np.prod(np.maximum(np.ptp(places, axis=0), 30.0))) if len(among) else 1.0
    most = min(most, max(int(area / _ROOM), _FEWEST))
    first = first[: most // 2]
    others = np.random.default_rng(0).permutation(np.setdiff1d(among, first))
    order = np.concatenate((first, others))
    important = np.arange(len(order)) < len(first)
    chosen = order[thinned(at[order], most, important)]
    spacing = sqrt(area / max(len(chosen), 1))
    return Sample(chosen, min(max(spacing / _FULL, _SMALLEST), 1.0))
