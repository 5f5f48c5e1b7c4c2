"""Points where their rays meet best while the photos stay: after steps that strain them."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import counted_misclosures, point_rows
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
    known = _Known(np.nan_to_num(problem.ground_sigma**-2.0), problem.ground - state.origin)
    cost, front = _costs(problem, known, state)
    design: tuple[Array, Array] | None = None
    for _ in range(_ROUNDS):
        if design is None:
            design = point_rows(problem, state)
        step = np.where(still[:, None], 0.0, _steps(problem, known, state, design, damping))
        trial = replace(state, points=state.points + step)
        trial_cost, trial_front = _costs(problem, known, trial)
        better = trial_cost < cost
        better &= trial_front >= front
        if not better.any():
            if damping.min() > 1e3:
                break
            damping *= 10.0
            continue
        state = replace(state, points=np.where(better[:, None], trial.points, state.points))
        gain = float(np.sum((cost - trial_cost)[better]))
        damping = np.where(better, damping * 0.1, damping * 10.0)
        design = None
        cost = np.where(better, trial_cost, cost)
        front = np.where(better, trial_front, front)
        if gain < 1e-6 * float(cost.sum()):
            break
    return state


class _Known(NamedTuple):
    """(2, points, 3) weights of control and of the points' priors, and where these are [m]."""

    weight: Array
    place: Array

    def misclosures(self, state: BlockState) -> Array:
        """(2, points, 3) how far points are off [m]; zero where nothing is known."""
        return np.where(self.weight > 0.0, state.points - self.place, 0.0)


def _costs(problem: Problem, known: _Known, state: BlockState) -> tuple[Array, Index]:
    """(p,) sums of squares of the points' rays and control; infinite where there is none.

    And (p,) rays that see their point in front of the photo.
    """
    e, depth = counted_misclosures(problem, state)
    count = len(problem.points)
    squares = np.bincount(problem.point, np.einsum("mi,mi->m", e, e), minlength=count)
    squares += (known.weight * known.misclosures(state) ** 2).sum(axis=(0, 2))
    front = np.bincount(problem.point[depth > 0.0], minlength=count)
    return np.asarray(np.nan_to_num(squares, nan=np.inf)), front


def _steps(
    problem: Problem,
    known: _Known,
    state: BlockState,
    design: tuple[Array, Array],
    damping: Array,
) -> Array:
    """(p, 3) damped corrections; zero where nothing can be solved for."""
    count = len(problem.points)
    matrix, right = np.empty((count, 3, 3)), np.empty((count, 3))
    b, e = design
    for i in range(3):
        right[:, i] = -np.bincount(
            problem.point, np.einsum("mi,mi->m", b[:, :, i], e), minlength=count
        )
        for j in range(i + 1):
            product = np.einsum("mi,mi->m", b[:, :, i], b[:, :, j])
            matrix[:, i, j] = np.bincount(problem.point, product, minlength=count)
            matrix[:, j, i] = matrix[:, i, j]
    right -= (known.weight * known.misclosures(state)).sum(axis=0)
    diagonal = np.einsum("nii->ni", matrix)
    diagonal += known.weight.sum(axis=0)
    diagonal *= 1.0 + damping[:, None]
    largest = diagonal.max(axis=1, keepdims=True)
    diagonal += 1e-14 * largest
    diagonal[problem.fixed] = 1.0
    usable = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(right).all(axis=1)
    usable &= (diagonal > 0.0).all(axis=1)
    out = np.zeros((count, 3))
    out[usable] = np.linalg.solve(matrix[usable], right[usable][:, :, None])[:, :, 0]
    return np.where(problem.fixed, 0.0, out)
