"""Points where their rays meet best while the photos stay: after steps that strain them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import Linearised, linearise
from anaplot.bundle.solve.problem import Problem

__all__ = ["reintersected"]


_ROUNDS = 6
_DAMPING = 1e-3  # of the first step


def reintersected(problem: Problem, state: BlockState) -> BlockState:
    """Return the state with every point intersected anew from its own rays and control.

    Each point takes damped Gauss-Newton steps of its own, and only such that bring its own sum of
    squares down: the result is never worse than `state`. Photos and parameters are held, and so are
    points of a prior that ties them together.

    Parameters
    ----------
    problem, state
        The bundle, and where it is.
    """
    count = len(problem.points)
    damping = np.full(count, _DAMPING)
    still = np.zeros(count, dtype=bool)
    if problem.given is not None:
        still = problem.given.points_given(count)
    problem = replace(problem, conditions=None, given=None)  # those tie points together
    linear = linearise(problem, state)
    cost = _costs(problem, linear)
    for _ in range(_ROUNDS):
        step = np.where(still[:, None], 0.0, _steps(problem, linear, damping))
        trial = replace(state, points=state.points + step)
        there = linearise(problem, trial)
        trial_cost = _costs(problem, there)
        better = trial_cost < cost
        better &= _in_front(problem, there) >= _in_front(problem, linear)
        if not better.any():
            if damping.min() > 1e3:
                break
            damping *= 10.0
            continue
        state = replace(state, points=np.where(better[:, None], trial.points, state.points))
        gain = float(np.sum((cost - trial_cost)[better]))
        damping = np.where(better, damping * 0.1, damping * 10.0)
        linear = linearise(problem, state)
        cost = np.where(better, trial_cost, cost)
        if gain < 1e-6 * float(cost.sum()):
            break
    return state


def _costs(problem: Problem, linear: Linearised) -> Array:
    """(p,) sums of squares of the points' rays and control; infinite where there is none."""
    of_rays = np.bincount(
        problem.point, np.einsum("mi,mi->m", linear.e, linear.e), minlength=len(problem.points)
    )
    return np.asarray(np.nan_to_num(of_rays + (linear.point_e**2).sum(axis=(0, 2)), nan=np.inf))


def _in_front(problem: Problem, linear: Linearised) -> Index:
    """(p,) rays that see their point in front of the photo."""
    seen = problem.point[linear.depth > 0.0]
    return np.bincount(seen, minlength=len(problem.points))


def _steps(problem: Problem, linear: Linearised, damping: Array) -> Array:
    """(p, 3) damped corrections; zero where nothing can be solved for."""
    count = len(problem.points)
    matrix, right = np.empty((count, 3, 3)), np.empty((count, 3))
    b, e = linear.b, linear.e
    for i in range(3):
        right[:, i] = -np.bincount(
            problem.point, np.einsum("mi,mi->m", b[:, :, i], e), minlength=count
        )
        for j in range(i + 1):
            product = np.einsum("mi,mi->m", b[:, :, i], b[:, :, j])
            matrix[:, i, j] = np.bincount(problem.point, product, minlength=count)
            matrix[:, j, i] = matrix[:, i, j]
    right -= (np.sqrt(linear.point_weight) * linear.point_e).sum(axis=0)
    diagonal = np.einsum("nii->ni", matrix)
    diagonal += linear.point_weight.sum(axis=0)
    diagonal *= 1.0 + damping[:, None]
    largest = diagonal.max(axis=1, keepdims=True)
    diagonal += 1e-14 * largest
    diagonal[problem.fixed] = 1.0
    usable = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
    usable &= (diagonal > 0.0).all(axis=1)
    out = np.zeros((count, 3))
    out[usable] = np.linalg.solve(matrix[usable], right[usable][:, :, None])[:, :, 0]
    return np.where(problem.fixed, 0.0, out)
