"""Points that half rays may not determine: of a ray x or y is off, and what is left must meet.

Each coordinate that counts puts a point on a plane through the projection centre. Two photographs
and three planes meet in one point, but for one case that is usual: where the coordinate along the
base is off, both other planes are the same. Which points these are is not known before the
orientations are; and as three planes check nothing, orientations can do without them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.remade import without_points
from anaplot.bundle.start.approximate import state_of
from anaplot.bundle.start.subblock import SubBlock
from anaplot.errors import NotComputableError

__all__ = ["half_seen", "settled_points", "without_half_seen"]

_CERTAIN = 0.1  # of its distance: a larger standard deviation of a point is none


def half_seen(problem: Problem) -> Bools:
    """(points,) points with half rays and fewer than two whole ones, that nothing else holds."""
    out = np.zeros(len(problem.points), dtype=bool)
    if problem.rejected is None or problem.undetermined is not None:
        return out
    pair, of_pair = np.unique(
        problem.point * len(problem.photos) + problem.photo, return_inverse=True
    )
    counted = np.zeros((len(pair), 2), dtype=bool)
    np.logical_or.at(counted, of_pair, ~problem.rejected)
    point = pair // len(problem.photos)
    whole = np.bincount(point[counted.all(axis=1)], minlength=len(out))
    half = np.bincount(point[counted.any(axis=1) ^ counted.all(axis=1)], minlength=len(out))
    out = (half > 0) & (whole < 2)
    out &= ~(problem.fixed | np.isfinite(problem.ground_sigma).any(axis=0)).any(axis=1)
    if problem.given is not None:
        out &= ~problem.given.points_given(len(out))
    named = {name for one in problem.block.conditions for name in one.points}
    if named:
        out &= np.array([name not in named for name in problem.points])
    return out


def without_half_seen(problem: Problem) -> Problem | None:
    """Return the bundle without points that half rays may not determine.

    None where there are none, or where photos are not determined without them.
    """
    doubtful = half_seen(problem)
    if not doubtful.any():
        return None
    names = frozenset(problem.points[k] for k in np.flatnonzero(doubtful).tolist())
    try:
        firm = without_points(problem, names)
    except NotComputableError:
        return None
    return firm if firm.photos == problem.photos else None


def settled_points(
    problem: Problem, firm: Problem, state: BlockState
) -> tuple[Problem, BlockState]:
    """Return the bundle with what half rays determine, and its approximate values.

    Parameters
    ----------
    problem
        The bundle.
    firm, state
        The same `without_half_seen`, and its solution, with or without additional parameters.
    """
    doubtful = np.flatnonzero(half_seen(problem))
    places, certain = _met_planes(problem, state, doubtful)
    names = [problem.points[k] for k in doubtful.tolist()]
    kept = without_points(problem, frozenset(np.array(names)[~certain].tolist()))
    at = dict(zip(firm.points, state.points + state.origin, strict=True))
    at.update(zip(names, places, strict=True))
    subblock = SubBlock(
        state.centres + state.origin,
        state.rotations,
        np.array([at[name] for name in kept.points]),
    )
    return kept, replace(state_of(kept, subblock), own=state.own, shared=state.shared)


def _met_planes(problem: Problem, state: BlockState, points: Index) -> tuple[Array, Bools]:
    """(k, 3) where the planes of some points' coordinates meet [m], and which points they fix."""
    number = np.full(len(problem.points), -1)
    number[points] = np.arange(len(points))
    rays = np.flatnonzero(number[problem.point] >= 0)
    of_point, photo = number[problem.point[rays]], problem.photo[rays]
    turn, centre, c = state.rotations[photo], state.centres[photo], problem.c[photo]
    matrix, right = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    for axis in (0, 1):
        normal = np.zeros((len(rays), 3))
        normal[:, axis], normal[:, 2] = c, problem.ideal[rays, axis]
        normal = np.einsum("nij,nj->ni", turn, normal)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        if problem.rejected is not None:
            normal[problem.rejected[rays, axis]] = 0.0
        np.add.at(matrix, of_point, normal[:, :, None] * normal[:, None, :])
        np.add.at(right, of_point, normal * np.einsum("ni,ni->n", normal, centre)[:, None])
    weakest = np.linalg.eigvalsh(matrix)[:, 0]
    angle = np.zeros(len(points))
    np.maximum.at(angle, of_point, problem.sigma[rays] / c)
    certain = np.sqrt(np.maximum(weakest, 0.0)) * _CERTAIN > angle
    places = np.full((len(points), 3), np.nan)
    places[certain] = np.linalg.solve(matrix[certain], right[certain][:, :, None])[:, :, 0]
    depth = -np.einsum("ni,ni->n", turn[:, :, 2], places[of_point] - centre)
    behind = np.zeros(len(points), dtype=bool)
    behind[of_point[~(depth > 0.0)]] = True
    return places + state.origin, certain & ~behind
