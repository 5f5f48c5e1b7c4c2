"""Points whose rays do not meet at an angle: far away, or seen from one place.

The sky above a roof, the moon, what a panorama alone has seen: as far as noise lets anybody see,
such rays are parallel. No coordinates make a minimum, the points run away, and their equations have
no solution. What they have to say, about rotations, is little beside all others: they are left out,
as points of one ray are.
"""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.gaussnewton import NoConvergenceError
from anaplot.bundle.solve.imaging import BlockState, without_additional
from anaplot.bundle.solve.openmovement import LeftOpenError
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.remade import among_points, without_points
from anaplot.bundle.solve.selection import NO_ANGLE
from anaplot.bundle.start.approximate import LostPointsError, state_of
from anaplot.bundle.start.halfrays import by_rays_alone, plane_normals
from anaplot.bundle.start.subblock import SubBlock, intersect_rays, unit_rays
from anaplot.errors import NotComputableError

__all__ = ["parallel", "with_meeting", "without_parallel"]

# standard deviations of their directions by which rays are off a common one that meet at an angle:
# that of two is then six, and what is known of their point's distance a quarter of it
_MEETS = 3.0


def without_parallel(
    problem: Problem, error: NotComputableError
) -> tuple[Problem, BlockState] | None:
    """Return the bundle without the points whose rays are parallel where an adjustment ended.

    Parameters
    ----------
    problem
        The bundle without additional parameters.
    error
        Why it has no solution.

    Returns
    -------
    Bundle and state, or None
        Without them, and where it may begin; None where there are none, where nobody knows where
        the photos are, or where photos hang on such points.
    """
    match error:
        case LeftOpenError() | NoConvergenceError():
            out = parallel(problem, error.state.rotations)
        case LostPointsError():
            rotations = error.subblock.rotations
            if not np.isfinite(rotations).all():
                return None
            out = parallel(problem, rotations) | (by_rays_alone(problem) & ~error.subblock.placed)
        case _:
            return None
    names = [problem.points[k] for k in np.flatnonzero(out).tolist()]
    if not names:
        return None
    try:
        smaller = without_points(problem, names, NO_ANGLE)
        if smaller.photos != problem.photos:
            return None
        if not isinstance(error, LostPointsError):
            return smaller, among_points(problem, smaller, without_additional(error.state))
        there = error.subblock
        kept = SubBlock(there.centres, there.rotations, there.points[~out])
        return smaller, state_of(smaller.bare, kept)
    except NotComputableError:
        return None


def with_meeting(
    problem: Problem, smaller: Problem, state: BlockState
) -> tuple[Problem, BlockState] | None:
    """Return the bundle with those points again whose rays meet at an angle after all.

    Parameters
    ----------
    problem
        The bundle with all its points.
    smaller, state
        As `without_parallel` left it, and its solution, with or without additional parameters.

    Returns
    -------
    Bundle and state, or None
        With them, and where it may begin; None where there are none.
    """
    there = {name: k for k, name in enumerate(smaller.points)}
    out = parallel(problem, state.rotations)
    back = ~out & np.array([name not in there for name in problem.points])
    if not back.any():
        return None
    away = [name for k, name in enumerate(problem.points) if not back[k] and name not in there]
    kept = without_points(problem, away, NO_ANGLE) if away else problem
    place = np.array([there.get(name, -1) for name in kept.points])
    new, points = place < 0, (state.points + state.origin)[place]
    subblock = SubBlock(state.centres + state.origin, state.rotations, points)
    points[new] = intersect_rays(kept, subblock, unit_rays(kept), new)[new]
    try:
        return kept, state_of(kept.bare, subblock)
    except NotComputableError:
        return None


def parallel(problem: Problem, rotations: Array) -> Bools:
    """(points,) points that nothing but parallel rays knows.

    Parameters
    ----------
    problem
        The bundle without additional parameters.
    rotations
        (photos, 3, 3) of its photos.
    """
    count = len(problem.points)
    matrix, coordinates = np.zeros((count, 3, 3)), np.zeros(count)
    certain = (problem.c[problem.photo] / problem.sigma)[:, None]
    for normal in plane_normals(problem, rotations, np.arange(len(problem.photo))):
        coordinates += np.bincount(problem.point, normal.any(axis=1), count)
        normal *= certain
        np.add.at(matrix, problem.point, normal[:, :, None] * normal[:, None, :])
    weakest = np.linalg.eigvalsh(matrix)[:, 0]
    off = weakest <= _MEETS**2 * np.maximum(coordinates - 2.0, 1.0)
    return by_rays_alone(problem) & off
