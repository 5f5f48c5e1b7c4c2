"""Which points a thinner block may not lose, whatever its redundancy numbers are.

What is known of a point, and what is said of it in control, conditions and priors, stays. Of
points that hold the block together some stay: in every photo and region, in every model and every
three photos in a row of a strip, in every photo to every other strip, and along a tree of the
photos that have most points in common, so that the block stays in one piece.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, vstack
from scipy.sparse.csgraph import minimum_spanning_tree

from anaplot.aliases import Bools, Index
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.thinning.imageparts import ImageParts

__all__ = ["Keeping", "keeping"]

_OF_PHOTO = 6  # points: where von Gruber put them
_OF_MODEL = 6
_OF_TRIPLE = 2  # that carry the scale from one model to the next, and a check
_TO_STRIP = 2  # from one photo to another strip
_OF_REGION = 1


class Keeping(NamedTuple):
    """What stays of the points.

    Attributes
    ----------
    firm
        (p,) points that stay in any case.
    sets
        (sets, p) sets of points, of which some stay; those of the parts of the photos first.
    need
        (sets,) how many.
    """

    firm: Bools
    sets: csr_array
    need: Index

    def whole(self, sets: Bools) -> Keeping:
        """Return the same with all points of the first sets that are marked."""
        every = np.asarray(self.sets.sum(axis=1)).astype(np.intp)
        need = self.need.copy()
        need[: len(sets)] = np.where(sets, every[: len(sets)], need[: len(sets)])
        return self._replace(need=need)


def keeping(problem: Problem, parts: ImageParts, names: Collection[str] = ()) -> Keeping:
    """Return what stays of the points of a bundle.

    Parameters
    ----------
    problem, parts
        The bundle, and the parts of its photos.
    names
        Further points that stay.
    """
    n, p, m = len(problem.photos), len(problem.points), len(problem.photo)
    known = _spoken_of(problem) | frozenset(names)
    firm = np.array([name in known for name in problem.points], dtype=bool)
    sees = _marked(problem.photo, problem.point, (n, p))
    of_rays = csr_array((np.ones(m), (np.arange(m), problem.point)), shape=(m, p))
    of_parts = _ones(parts.sums @ of_rays)
    pieces = [
        (of_parts, np.where(parts.cell < 0, _OF_PHOTO, _OF_REGION)),
        *_of_strips(problem, sees),
        _of_tree(sees),
    ]
    sets = csr_array(vstack([one for one, _ in pieces]))
    there = np.asarray(sets.sum(axis=1)).astype(np.intp)
    return Keeping(firm, sets, np.minimum(np.concatenate([need for _, need in pieces]), there))


def _spoken_of(problem: Problem) -> frozenset[str]:
    """Return the points of which the block says more than where they are seen."""
    block = problem.block
    names = {row.point for row in block.control} | {row.point for row in block.priors}
    names.update(point for one in block.conditions for point in one.points)
    if block.given is not None:
        names.update(one.owner for one in block.given.names if one.kind == "point")
    return frozenset(names)


_Sets = tuple[csr_array, Index]


def _of_strips(problem: Problem, sees: csr_array) -> list[_Sets]:
    """Return the points of models, of three photos in a row, and from photos to other strips."""
    place = {name: k for k, name in enumerate(problem.photos)}
    strips = [[place[name] for name in s.photos if name in place] for s in problem.block.strips]
    out = []
    for length, need in ((2, _OF_MODEL), (3, _OF_TRIPLE)):
        runs = [s[k : k + length] for s in strips for k in range(len(s) - length + 1)]
        if runs:
            columns = np.array(runs, dtype=np.intp).T
            common = sees[columns[0]]
            for column in columns[1:]:
                common = common.multiply(sees[column])
            out.append((csr_array(common), np.full(len(runs), need)))
    n = len(problem.photos)
    rows = [k for k, photos in enumerate(strips) for _ in photos]
    member = _marked(rows, [photo for photos in strips for photo in photos], (len(strips), n))
    if len(strips) > 1:
        in_strip = _ones(member @ sees)
        common = (sees @ in_strip.T).tocoo()
        own = np.asarray(member.T.toarray() > 0)[common.row, common.col]
        photo, strip = common.row[~own], common.col[~own]
        if len(photo):
            ties = csr_array(sees[photo].multiply(in_strip[strip]))
            out.append((ties, np.full(len(photo), _TO_STRIP)))
    return out


def _of_tree(sees: csr_array) -> _Sets:
    """Return the points that photos next to each other have in common, on a tree of the photos."""
    common = csr_array(sees @ sees.T)
    common.setdiag(0.0)
    common.eliminate_zeros()
    common.data = 1.0 / common.data  # the most in common: the shortest way
    # the indices that every SciPy's graphs take
    common.indices, common.indptr = (a.astype(np.int32) for a in (common.indices, common.indptr))
    tree = minimum_spanning_tree(common).tocoo()
    ties = csr_array(sees[tree.row].multiply(sees[tree.col]))
    return ties, np.full(len(tree.row), _OF_MODEL)


def _marked(rows: Collection[int] | Index, columns: Collection[int] | Index,
            shape: tuple[int, int]) -> csr_array:  # fmt: skip
    """Return ones at places, also where one is named several times."""
    ones = np.ones(len(rows))
    return _ones(csr_array((ones, (np.asarray(rows, int), np.asarray(columns, int))), shape=shape))


def _ones(matrix: csr_array) -> csr_array:
    out = csr_array(matrix)
    out.sum_duplicates()
    out.data = np.ones(len(out.data))
    return out
