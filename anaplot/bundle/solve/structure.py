"""The structure of the normal equations: who is seen where, and the order of elimination."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.dissection import dissect
from anaplot.bundle.solve.factor import SparsityPattern, sparsity_pattern
from anaplot.bundle.solve.pointclusters import Cluster, point_sets
from anaplot.bundle.solve.pointgroups import Group
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.sorting import distinct

__all__ = ["Piece", "Structure", "make_structure"]


_CHUNK = 40_000_000  # bytes of the largest temporary array


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Some points of a group: no temporary array becomes large.

    Attributes
    ----------
    group, start, stop
        The group, and which of its points.
    """

    group: Group
    start: int
    stop: int

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
        Points of equal numbers of rays, in portions.
    clusters
        Points near each other.
    by_photo
        (photos, rays) sums over the rays of each photo.
    pairs
        Sorted, a number for the two photos of each block of the pattern.
    """

    pattern: SparsityPattern
    pieces: tuple[Piece, ...]
    clusters: tuple[Cluster, ...]
    by_photo: sparse.csr_matrix
    pairs: Index

    def take(self, blocks: Array, z: Array) -> None:
        """Take Z Z' of all points off the blocks between photos; see `Cluster.take`.

        Parameters
        ----------
        blocks
            (all, d, d).
        z
            (m, d, 3) Z of all rays.
        """
        most = max((len(cluster.of.photos) for cluster in self.clusters), default=0)
        room = np.empty((most * blocks.shape[1]) ** 2)
        for cluster in self.clusters:
            cluster.take(blocks, z, room)

    def by_points(self, z: Array) -> Iterator[tuple[Piece, Array]]:
        """Yield pieces, each with the (points, rays d, 3) Z of its points, of (m, d, 3) of rays."""
        for piece in self.pieces:
            yield piece, z[piece.rays].reshape(piece.stop - piece.start, -1, 3)

    def among(self, photos: Index, blocks: Array) -> Array:
        """Return (..., k d, k d) of (..., k) photos, each with each, from (all, d, d) blocks."""
        n, d, k = self.by_photo.shape[0], blocks.shape[1], photos.shape[-1]
        ids = _ids(self.pairs, photos[..., :, None] * n + photos[..., None, :])
        flipped = ids < 0
        ids[flipped] = ids.swapaxes(-1, -2)[flipped]
        each = blocks[ids]
        each[flipped] = each[flipped].transpose(0, 2, 1)
        out: Array = each.swapaxes(-3, -2).reshape(*photos.shape[:-1], k * d, k * d)
        return out


def make_structure(problem: Problem, places: Array) -> Structure:
    """Find the pattern of the normal equations and the order of elimination.

    Parameters
    ----------
    problem
        The bundle.
    places
        (photos, 3) rough projection centres, for the dissection.
    """
    n, m = len(problem.photos), len(problem.photo)
    sets = point_sets(problem, places)
    # of all pairs of photos that see a point in common, both ways round
    pairs = []
    for of in sets:
        i, j = of.together()
        pairs.append((i, j, of.photos[i] * n + of.photos[j]))
    alone = np.arange(n) * (n + 1)
    both = distinct(np.concatenate([alone, *(numbers for _, _, numbers in pairs)]))
    indptr = np.searchsorted(both, np.arange(n + 1) * n)
    order = dissect(places, indptr.astype(np.intp), both % n)
    position = order.position
    stored = both[position[both // n] >= position[both % n]]
    diagonal = _ids(stored, alone)
    clusters = []
    for of, (i, j, numbers) in zip(sets, pairs, strict=True):
        ids = _ids(stored, numbers)
        mine = ids >= 0
        # a photo that stands there again is beside itself
        twice = bool((np.diff(of.photos) == 0).any())
        clusters.append(Cluster(of, i[mine], j[mine], ids[mine], diagonal[of.photos], twice))
    pieces = []
    for group in problem.groups:
        step = max(1, _CHUNK // (8 * (group.rays * problem.per_photo) ** 2))
        for start in range(0, group.points, step):
            pieces.append(Piece(group, start, min(start + step, group.points)))
    by_photo = sparse.csr_matrix((np.ones(m), (problem.photo, np.arange(m))), shape=(n, m))
    pattern = sparsity_pattern(order, stored // n, stored % n, problem.per_photo, problem.in_border)
    return Structure(pattern, tuple(pieces), tuple(clusters), by_photo, stored)


def _ids(pairs: Index, asked: Index) -> Index:
    """Return where numbers stand among sorted ones; -1 where they do not."""
    at = np.minimum(np.searchsorted(pairs, asked), len(pairs) - 1)
    out: Index = np.where(pairs[at] == asked, at, -1)
    return out
