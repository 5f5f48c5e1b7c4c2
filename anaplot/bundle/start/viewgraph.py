"""The view graph of a bundle: which photos see how many points in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from anaplot.aliases import Bools, Index
from anaplot.bundle.solve.problem import Problem

__all__ = ["ViewGraph", "view_graph"]


@dataclass(frozen=True, slots=True, eq=False)
class ViewGraph:
    """Photos, and an edge between any two that see two points and more in common.

    Attributes
    ----------
    pairs
        (e, 2) photos of each edge, the lower number first; edges in the order of these numbers.
    common
        (e,) number of common points.
    """

    pairs: Index
    common: Index

    def strongest_of_each(self, count: int) -> Index:
        """Return (k, 2) the pairs that are among the `count` of one of their photos with most."""
        ends = np.concatenate((self.pairs, self.pairs[:, ::-1]))
        order = np.lexsort((ends[:, 1], -np.tile(self.common, 2), ends[:, 0]))
        photo = ends[order, 0]
        rank = np.arange(len(order)) - np.searchsorted(photo, photo)
        chosen = np.unique(order[rank < count] % max(len(self.pairs), 1))
        return np.asarray(self.pairs[chosen])

    def strongest(self, fewest: int, among: Bools) -> Index:
        """Return (k, 2) the pairs of some photos with so many common points, those with most first.

        Where no two of them are such a pair, those of one of them and another photo.

        Parameters
        ----------
        fewest
            Common points that a pair has at least.
        among
            (photos,) which photos.
        """
        ends = np.where(self.common >= fewest, among[self.pairs].sum(axis=1), 0)
        good = np.flatnonzero((ends > 0) & (ends == ends.max(initial=0)))
        return np.asarray(self.pairs[good[np.argsort(-self.common[good], kind="stable")]])

    def with_neighbours(self, among: Bools) -> Bools:
        """Return (photos,) some photos, and those that have common points with them."""
        out = among.copy()
        out[self.pairs[among[self.pairs].any(axis=1)]] = True
        return out


def view_graph(problem: Problem, use: Bools | None = None) -> ViewGraph:
    """Return the view graph of a bundle; cost and memory are linear in pairs and rays.

    Parameters
    ----------
    problem
        The bundle.
    use
        (m,) which of its rays; None: all.
    """
    n, p = len(problem.photos), len(problem.points)
    photo, point = problem.photo, problem.point
    if use is not None:
        photo, point = photo[use], point[use]
    seen = sparse.coo_array(
        (np.ones(len(photo), dtype=np.int32), (photo, point)), shape=(n, p)
    ).tocsr()
    # what a photo has twice is seen once
    seen.data[:] = 1
    common = sparse.triu(seen @ seen.T, 1).tocoo()
    good = common.data >= 2
    row, column, count = common.row[good], common.col[good], common.data[good]
    order = np.lexsort((column, row))
    pairs = np.stack((row[order], column[order]), axis=1).astype(np.intp)
    return ViewGraph(pairs, count[order].astype(np.intp))
