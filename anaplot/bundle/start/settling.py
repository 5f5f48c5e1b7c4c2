"""A robust solution made better, until what it leaves off no longer hangs on where it began."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import counted_misclosures
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure
from anaplot.bundle.start.robust import RobustState, reoriented, robust_state
from anaplot.bundle.start.subblock import unit_rays
from anaplot.errors import NotComputableError

__all__ = ["settled"]


_ROUNDS = 4  # in which a robust solution may become better, at most
_OFF = 20.0  # sigmas by which a ray is off
_POINTS = 200  # that are intersected anew at most
_RAYS = 8  # of a point that are paired with each other


def settled(problem: Problem, structure: Structure, solution: RobustState) -> RobustState:
    """Return a robust solution that no other place to begin from makes better.

    The first one still shows where it began: a photo bent by its wild measurements, a point that a
    wild ray holds, control free of error that pulls. What is better says `better_than`.

    Parameters
    ----------
    problem, structure
        The bundle.
    solution
        A robust solution.
    """
    for _ in range(_ROUNDS):
        before = solution
        for place in (_as_it_is, reoriented, _points_by_most_rays):
            try:
                other = robust_state(problem, structure, place(problem, before.state))
            except (NotComputableError, np.linalg.LinAlgError):
                continue
            if other.better_than(solution, problem):
                solution = other
        if solution is before:
            break
    return solution


def _as_it_is(problem: Problem, state: BlockState) -> BlockState:
    return state


def _points_by_most_rays(problem: Problem, state: BlockState) -> BlockState:
    """Points with rays that are off, each where the two rays meet with which most others agree."""
    e = counted_misclosures(problem, state)[0] * problem.sigma_xy
    off = ~(np.linalg.norm(e, axis=1) <= _OFF * problem.sigma)
    rays = unit_rays(problem)
    points = state.points.copy()
    for point in np.unique(problem.point[off])[:_POINTS].tolist():
        mine = np.flatnonzero(problem.point == point)
        if len(mine) < 3 or problem.fixed[point].any():
            continue
        photos = problem.photo[mine]
        centres = state.centres[photos]
        directions = np.einsum("nij,nj->ni", state.rotations[photos], rays[mine])
        reach = _OFF * problem.sigma[mine] / problem.c[photos]
        least = float(len(mine))
        for i, j in combinations(range(min(len(mine), _RAYS)), 2):
            at = _meet(centres[[i, j]], directions[[i, j]])
            if at is None:
                continue
            away = at - centres
            away /= np.linalg.norm(away, axis=1)[:, None]
            cost = float(np.minimum(np.linalg.norm(away - directions, axis=1) / reach, 1.0).sum())
            if cost < least:
                least, points[point] = cost, at
    return replace(state, points=points)


def _meet(centres: Array, directions: Array) -> Array | None:
    """Return the place halfway between two rays where they are closest; None when parallel."""
    first, second = directions
    cosine = float(first @ second)
    apart = centres[1] - centres[0]
    square = 1.0 - cosine**2
    if not square > 1e-12:
        return None
    along = float(first @ apart) - cosine * float(second @ apart)
    back = cosine * float(first @ apart) - float(second @ apart)
    ends = centres + np.array([[along], [back]]) / square * directions
    return np.asarray(ends.mean(axis=0))
