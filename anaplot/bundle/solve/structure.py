"""The structure of the normal equations: who is seen where, and the order of elimination."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.dissection import dissect
from anaplot.bundle.solve.factor import SparsityPattern, sparsity_pattern
from anaplot.bundle.solve.pointgroups import Group
from anaplot.bundle.solve.problem import Problem

__all__ = ["Piece", "Structure", "make_structure"]


_CHUNK = 40_000_000  # bytes of the largest temporary array


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Some points of a group: no temporary array becomes large.

    Attributes
    ----------
    group, start, stop
        The group, and which of its points.
    pairs
        Point within the piece, row ray and column ray of every block that it adds to.
    sums
        (blocks, pairs) which pair belongs to which block.
    block, flipped
        (points, k, k) ids of the blocks, for the selected inverse, and whether a block is stored
        the other way round.
    """

    group: Group
    start: int
    stop: int
    pairs: tuple[Index, Index, Index]
    sums: sparse.csr_matrix
    block: Index
    flipped: Bools

    @property
    def points(self) -> slice:
        """Of arrays over points."""
        first = self.group.first_point
        return slice(first + self.start, first + self.stop)

    @property
    def rays(self) -> slice:
        """Of arrays over rays."""
        first, k = self.group.first_ray, self.group.rays
        return slice(first + self.start * k, first + self.stop * k)


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """What depends on who is seen where, but on no number.

    Attributes
    ----------
    pattern
        The symbolic factorisation.
    pieces
        Points in portions.
    by_photo
        (photos, rays) sums over the rays of each photo.
    """

    pattern: SparsityPattern
    pieces: tuple[Piece, ...]
    by_photo: sparse.csr_matrix


def make_structure(problem: Problem, places: Array) -> Structure:
    """Find the pattern of the normal equations and the order of elimination.

    Parameters
    ----------
    problem
        The bundle.
    places
        (photos, 3) rough projection centres, for the dissection.
    """
    n = len(problem.photos)
    d, g = problem.per_photo, problem.in_border
    keys = []
    for group in problem.groups:
        photo = problem.photo[group.ray_slice].reshape(group.points, group.rays)
        pair = (photo[:, :, None] * n + photo[:, None, :]).reshape(-1)
        keys.append(np.unique(pair))
    both = np.unique(np.concatenate(keys))
    indptr = np.searchsorted(both, np.arange(n + 1) * n)
    order = dissect(places, indptr.astype(np.intp), both % n)
    position = order.position
    first, second = both // n, both % n
    lower = position[first] >= position[second]
    rows, columns = first[lower], second[lower]
    # id of the block of every ordered pair of photos, by binary search in `both`
    ids = np.full(len(both), -1)
    ids[lower] = np.arange(len(rows))
    mirrored = np.searchsorted(both, second[~lower] * n + first[~lower])
    ids[~lower] = ids[mirrored]
    pieces = []
    for group in problem.groups:
        k = group.rays
        step = max(1, _CHUNK // (8 * (k * d) ** 2))
        photo = problem.photo[group.ray_slice].reshape(group.points, k)
        for start in range(0, group.points, step):
            stop = min(start + step, group.points)
            mine = photo[start:stop]
            at = np.searchsorted(both, mine[:, :, None] * n + mine[:, None, :])
            keep = lower[at]
            which, row, column = np.nonzero(keep)
            block = ids[at]
            count = len(which)
            sums = sparse.csr_matrix(
                (np.ones(count), (block[keep], np.arange(count))), shape=(len(rows), count)
            )
            pieces.append(Piece(group, start, stop, (which, row, column), sums, block, ~keep))
    m = len(problem.photo)
    by_photo = sparse.csr_matrix((np.ones(m), (problem.photo, np.arange(m))), shape=(n, m))
    return Structure(sparsity_pattern(order, rows, columns, d, g), tuple(pieces), by_photo)
