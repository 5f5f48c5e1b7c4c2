"""Points that half rays may not determine: of a ray x or y is off, and what is left must meet.

Each coordinate that counts puts a point on a plane through the projection centre. Two photographs
and three planes meet in one point, but for one case that is usual: where the coordinate along the
base is off, both other planes are the same. Which points these are is not known before the
orientations are; and as three planes check nothing, orientations can do without them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.remade import without_points
from anaplot.bundle.solve.selection import counted_in_photos
from anaplot.bundle.start.approximate import state_of
from anaplot.bundle.start.subblock import SubBlock
from anaplot.errors import NotComputableError

__all__ = [
    "by_rays_alone",
    "half_seen",
    "met_planes",
    "plane_normals",
    "settled_points",
    "unchecked",
    "without_doubtful",
]

_FEWEST = 3  # coordinates that determine a point
# of its distance: a larger standard deviation of a point is none; by its rays alone, and
# orientations make it up to three times as large
_CERTAIN = 0.03


def half_seen(problem: Problem) -> Bools:
    """(points,) points that half rays may not determine, and that nothing else holds.

    Those of which x, or y, counts in one photo at most.
    """
    out: Bools = np.zeros(len(problem.points), dtype=bool)
    if problem.rejected is None or problem.undetermined is not None:
        return out
    x, y = _photos_counting(problem)
    out = (x != y) & (np.minimum(x, y) <= 1)
    return out & by_rays_alone(problem)


def by_rays_alone(problem: Problem) -> Bools:
    """(points,) points of which nothing but their rays knows where they are."""
    held = problem.fixed | np.isfinite(problem.ground_sigma).any(axis=0)
    out: Bools = ~np.asarray(held.any(axis=1))
    if problem.given is not None:
        out &= ~problem.given.points_given(len(out))
    observed = (one for one in problem.block.conditions if one.use == "control")
    named = {name for one in observed for name in one.points}
    if named:
        out &= np.array([name not in named for name in problem.points])
    return out


def unchecked(problem: Problem) -> Bools:
    """(points,) those among `half_seen` of which no more than three coordinates count."""
    x, y = _photos_counting(problem)
    few: Bools = x + y <= _FEWEST
    return half_seen(problem) & few


def _photos_counting(problem: Problem) -> tuple[Index, Index]:
    """Return in how many photos (points,) x counts, and y."""
    counted = np.ones((len(problem.photo), 2), dtype=bool)
    if problem.rejected is not None:
        counted = ~problem.rejected
    _, point, axes, _ = counted_in_photos(problem.photo, problem.point, counted)
    x, y = (np.bincount(point[axes[:, k]], minlength=len(problem.points)) for k in (0, 1))
    return x, y


def without_doubtful(problem: Problem, doubtful: Bools) -> Problem | None:
    """Return the bundle without (points,) doubtful points.

    None where there are none, or where photos are not determined without them.
    """
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
        The same `without_doubtful` points, and its solution, with or without additional parameters.
    """
    there = set(firm.points)
    doubtful = np.flatnonzero([name not in there for name in problem.points])
    places, certain = met_planes(problem, state, doubtful)
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


def plane_normals(problem: Problem, rotations: Array, rays: Index) -> Iterator[Array]:
    """Yield (k, 3) unit normals of the planes that x, then y, of some rays puts their points on.

    Of coordinates that do not count they are zero.

    Parameters
    ----------
    problem, rotations
        The bundle, and (photos, 3, 3) rotations of its photos.
    rays
        (k,) of the bundle.
    """
    photo = problem.photo[rays]
    turn, c = rotations[photo], problem.c[photo]
    for axis in (0, 1):
        normal = np.zeros((len(rays), 3))
        normal[:, axis], normal[:, 2] = c, problem.ideal[rays, axis]
        normal = np.einsum("nij,nj->ni", turn, normal)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        if problem.rejected is not None:
            normal[problem.rejected[rays, axis]] = 0.0
        yield normal


def met_planes(problem: Problem, state: BlockState, points: Index) -> tuple[Array, Bools]:
    """Return (k, 3) where the planes of some points' coordinates meet [m], and which they fix."""
    number = np.full(len(problem.points), -1)
    number[points] = np.arange(len(points))
    rays = np.flatnonzero(number[problem.point] >= 0)
    of_point, photo = number[problem.point[rays]], problem.photo[rays]
    turn, centre, c = state.rotations[photo], state.centres[photo], problem.c[photo]
    matrix, right = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    for normal in plane_normals(problem, state.rotations, rays):
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
