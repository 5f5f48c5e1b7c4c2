"""Nested dissection of the photos: in which order they are eliminated.

A block of photos is cut in two across its longer side; the photos along the cut that share points
with the other half separate the halves and are eliminated after both. Repeated, this gives a tree
of small dense fronts. Two photos that share a point always meet in one front, so the selected
inverse over the fronts holds everything that reliability asks for. The work grows with the number
of photos to the power 1.5; a band ordered along the short side takes the power 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.runs import runs

__all__ = ["Dissection", "Front", "dissect"]


_LEAF = 40  # photos below which a front is not cut further: a dense matrix of 240 is at its best


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """One dense front of the elimination tree.

    Attributes
    ----------
    first, last
        Its pivots are the positions first ... last - 1 of the elimination order.
    border
        Positions, ascending, of later photos coupled to it.
    parent
        Index of the front that takes up its border; -1 for none.
    """

    first: int
    last: int
    border: Index
    parent: int


@dataclass(frozen=True, slots=True, eq=False)
class Dissection:
    """An elimination order of the photos.

    Attributes
    ----------
    order
        (n,) photo at each position.
    position
        (n,) position of each photo.
    fronts
        Children before their parents.
    """

    order: Index
    position: Index
    fronts: tuple[Front, ...]


def dissect(places: Array, indptr: Index, indices: Index, leaf: int = _LEAF) -> Dissection:
    """Order the photos.

    Parameters
    ----------
    places
        (n, k) coordinates of the photos; only the order along the axes of the block matters.
    indptr, indices
        Adjacency in compressed rows: photos that share a point.
    leaf
        Number of photos up to which a part is kept whole.
    """
    n = len(places)
    pieces: list[Index] = []
    children: list[list[int]] = []
    side = np.zeros(n, dtype=np.int8)

    def cut(members: Index) -> list[int]:
        """Add the fronts of a part; return those without a parent in it."""
        if len(members) <= leaf:
            pieces.append(members)
            children.append([])
            return [len(pieces) - 1]
        halves, separator = _bisect(members, places, indptr, indices, side)
        if 2 * len(separator) > len(members):
            # nothing is gained: the photos are all tied together
            pieces.append(members)
            children.append([])
            return [len(pieces) - 1]
        roots = [root for half in halves if len(half) for root in cut(half)]
        if len(separator) == 0:
            return roots
        pieces.append(separator)
        children.append(roots)
        return [len(pieces) - 1]

    if n:
        cut(np.arange(n))
    order = np.concatenate(pieces) if pieces else np.arange(0)
    position = np.empty(n, dtype=np.intp)
    position[order] = np.arange(n)
    return Dissection(order, position, _fronts(pieces, children, position, indptr, indices))


def _bisect(
    members: Index,
    places: Array,
    indptr: Index,
    indices: Index,
    side: NDArray[np.int8],
) -> tuple[tuple[Index, Index], Index]:
    """Halves without the separator, and the separator; `side` is all zero before and after."""
    here = places[members]
    axis = int(np.argmax(np.ptp(here, axis=0)))
    # ties broken by the other axes, so that a regular block is cut along a line
    keys = [here[:, k] for k in range(here.shape[1]) if k != axis]
    ranked = members[np.lexsort((*keys, here[:, axis]))]
    middle = _line_cut(places[ranked, axis])
    side[ranked[:middle]] = 1
    side[ranked[middle:]] = 2
    touching: list[Index] = []
    for half, other in ((ranked[:middle], 2), (ranked[middle:], 1)):
        rows, neighbours = _neighbours(half, indptr, indices)
        touching.append(half[np.unique(rows[side[neighbours] == other])])
    side[members] = 0
    which = int(len(touching[1]) < len(touching[0]))
    separator = touching[which]
    halves = [ranked[:middle], ranked[middle:]]
    halves[which] = np.setdiff1d(halves[which], separator)
    return (halves[0], halves[1]), np.sort(separator)


def _line_cut(values: Array) -> int:
    """Index near the middle at which the sorted values jump most: between two columns."""
    n = len(values)
    low, high = int(n * 0.4), int(n * 0.6) + 1
    jumps = np.diff(values[low : high + 1])
    if len(jumps) == 0 or jumps.max() <= 0.0:
        return n // 2
    good = np.nonzero(jumps >= 0.5 * jumps.max())[0] + low + 1
    return int(good[np.argmin(np.abs(good - n // 2))])


def _neighbours(rows: Index, indptr: Index, indices: Index) -> tuple[Index, Index]:
    """(index into rows, neighbour) of every neighbour of the rows."""
    counts = indptr[rows + 1] - indptr[rows]
    owner = np.repeat(np.arange(len(rows)), counts)
    return owner, indices[runs(indptr[rows], counts)]


def _fronts(
    pieces: list[Index],
    children: list[list[int]],
    position: Index,
    indptr: Index,
    indices: Index,
) -> tuple[Front, ...]:
    parent = np.full(len(pieces), -1)
    for up, below in enumerate(children):
        parent[below] = up
    ends = np.cumsum([len(piece) for piece in pieces])
    borders: list[Index] = []
    fronts = []
    for k, piece in enumerate(pieces):
        last = int(ends[k])
        _, neighbours = _neighbours(piece, indptr, indices)
        reached = np.unique(
            np.concatenate([position[neighbours], *(borders[c] for c in children[k])])
        )
        borders.append(reached[reached >= last])
        fronts.append(Front(last - len(piece), last, borders[-1], int(parent[k])))
    return tuple(fronts)
