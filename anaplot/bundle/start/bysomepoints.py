"""Approximate values of a large block made better by some of its points.

Where photos have hundreds of rays, those of some points say nearly as well as all of them where the
photos are. The many steps from rough values are taken with these alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.somepoints import of_points, some_points
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.approximate import completed_state
from anaplot.bundle.start.robust import robust_state
from anaplot.errors import NotComputableError

__all__ = ["oriented_by_some"]

_NEAR = 2e-2  # of n: change in the last step; the missing rays leave more than what it has left


def oriented_by_some(
    problem: Problem, start: BlockState, progress: Progress | None = None
) -> BlockState | None:
    """Return a robust solution of some points of a large block, with the others placed by it.

    Parameters
    ----------
    problem
        The bundle, without additional parameters and conditions.
    start
        Approximate values.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    State or None
        None where the block is not large, and where that solution does not fit nearly all rays.
    """
    chosen = some_points(problem)
    if chosen is None:
        return None
    smaller = of_points(problem, chosen)
    try:
        structure = make_structure(smaller, start.centres)
        there = replace(start, points=start.points[chosen])
        found = robust_state(smaller, structure, there, firm=True, enough=_NEAR, progress=progress)
    except (NotComputableError, np.linalg.LinAlgError):
        return None
    if not found.explains(smaller):
        return None
    points = start.points.copy()
    points[chosen] = found.state.points
    return completed_state(problem, replace(found.state, points=points), chosen)
