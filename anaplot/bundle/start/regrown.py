"""A start whose photos fit each other in parts only, grown again from the largest of them.

Weak ties break where a ray far off is among them: a strip is turned about the line of its common
points, half a strip lies beside the other half. Every photo agrees with its neighbours then, but
for those at the break. These fit either side by some of their rays, and would hold both together
as they are: they stand alone until the parts are joined.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import counted_misclosures
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.absolute import to_ground
from anaplot.bundle.start.approximate import grown_whole
from anaplot.bundle.start.robust import OF_A_PHOTO, OFF
from anaplot.bundle.start.subblock import SubBlock, unit_rays
from anaplot.bundle.start.viewgraph import view_graph

__all__ = ["regrown"]

_FIRM = 3  # rays that fit at a point which holds photos together
_TIES = 3  # such points of two photos
_LARGE = 0.2  # share of the photos that a part has from which it grows


def regrown(problem: Problem, state: BlockState) -> BlockState | None:
    """Return a start that has grown again from the largest part that holds together.

    Parameters
    ----------
    problem
        The bundle.
    state
        A robust solution.

    Returns
    -------
    State or None
        None where all hold together, or no part with a fifth of the photos does, and where
        nothing can be added to it.
    """
    label = _parts(problem, state)
    size = np.bincount(label)
    if len(size) == 1 or size.max() < max(2.0, _LARGE * len(label)):
        return None
    rays = unit_rays(problem)
    first, *others = (
        _alone(problem, state, rays, label == k)
        for k in np.argsort(-size, kind="stable").tolist()
        if size[k] > 1
    )
    to_ground(problem, first)
    return grown_whole(problem, first, others, state)


def _alone(problem: Problem, state: BlockState, rays: Array, photos: Bools) -> SubBlock:
    """Return (photos,) some photos of a state, and the points that they place."""
    part = SubBlock.empty(problem)
    part.centres[photos] = state.centres[photos] + state.origin
    part.rotations[photos] = state.rotations[photos]
    part.place(problem, rays)
    return part


def _parts(problem: Problem, state: BlockState) -> Index:
    """(photos,) numbers of the parts that points of three rays and more hold together.

    Photos of which many rays are off are parts by themselves.
    """
    n = len(problem.photos)
    e = counted_misclosures(problem, state)[0] * problem.sigma_xy
    fits = np.linalg.norm(e, axis=1) <= OFF * problem.sigma
    astray = np.bincount(problem.photo, ~fits, n) > OF_A_PHOTO * np.bincount(problem.photo, None, n)
    use = fits & ~astray[problem.photo]
    firm = np.bincount(problem.point, use, len(problem.points)) >= _FIRM
    use &= firm[problem.point]
    seen = view_graph(problem, use)
    tied = seen.common >= _TIES
    graph = sparse.coo_matrix((seen.common[tied], tuple(seen.pairs[tied].T)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.intp)
