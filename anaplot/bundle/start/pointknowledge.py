"""What is known of points besides their rays: control, priors, conditions, given coordinates."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem
from anaplot.photogrammetry.objectconditions import ObjectCondition

__all__ = ["WIDE", "equations_knowing"]

WIDE = 0.05
"""Share of the principal distance: a ray that misses by so much was meant for another point."""

_SHARP = WIDE / 10.0  # of the length of rays: such a sigma shows it at ten sigmas
_FARTHEST = 0.95  # of all rays are shorter: where a point's rays do not meet it may be anywhere


def equations_knowing(problem: Problem, state: BlockState) -> Index:
    """Return how many equations besides those of its rays know where a point is.

    What is known too badly to see that a ray was meant for another point is no knowledge.

    Parameters
    ----------
    problem
        The bundle.
    state
        Where points and photos are, about.

    Returns
    -------
    (points,) integers
        Coordinates free of error, of control, of priors, and conditions; 3 of what is given.
    """
    ray = state.points.take(problem.point, axis=0)
    ray -= state.centres.take(problem.photo, axis=0)
    away = np.sqrt(np.einsum("ij,ij->i", ray, ray))
    count = np.bincount(problem.point, minlength=len(problem.points))
    own = np.bincount(problem.point, away, len(count)) / np.maximum(count, 1)
    worst = _SHARP * np.minimum(own, np.quantile(away, _FARTHEST))
    sharp = (problem.ground_sigma <= worst[:, None]).any(axis=0)
    known: Index = (problem.fixed | sharp).sum(axis=1)
    if problem.given is not None:
        known[problem.given.points_given(len(known))] = 3
    observed = [one for one in problem.block.conditions if one.use == "control"]
    index = {name: k for k, name in enumerate(problem.points)} if observed else {}
    for one in observed:
        points = np.array([index.get(name, -1) for name in one.points])
        if (points >= 0).all():
            sigma = _metres(one, state.points[points])
            known[points[sigma <= worst[points]]] += 1
    return known


def _metres(one: ObjectCondition, places: Array) -> Array:
    """(k,) sigma of a condition at each of its points [m]."""
    if one.kind != "angle":
        return np.full(len(places), one.sigma)
    legs = np.linalg.norm(places - places[1], axis=1)
    legs[1] = min(legs[0], legs[2])
    out: Array = one.sigma * legs
    return out
