"""How far gross errors pull a bundle from its robust solution: where least squares stop meaning it.

Gross errors move the minimum of v'Pv away from the place where all other measurements agree. As
long as they turn no ray far, the minimum is reached in a few steps and tells of the block. Farther
off it is a matter of chance whether the search reaches it, and by which digits of the measurements.
"""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array, Progress
from anaplot.bundle.solve.datum import anchor
from anaplot.bundle.solve.gaussnewton import Minimum, Step, damped_step, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import Linearised, linearise, move
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure
from anaplot.bundle.start.robust import RobustState

__all__ = [
    "MOST_TURNED",
    "TORN",
    "foreseen_torn",
    "full_step",
    "minimum_nearby",
    "torn",
    "turn_cosines",
    "turned",
]


TORN = 50.0
"""sigma0 above which a robust solution is asked for the culprit."""

MOST_TURNED = 0.35
"""What a photo or ray may turn [rad]: blocks that converge directly stay below 0.27 in our tests;
those where the search goes round corners turn by 0.45 and more."""


def turned(problem: Problem, one: BlockState, other: BlockState) -> float:
    """Return by how much photos and rays in space turn at most from one state to another [rad].

    What moves or scales a block as a whole turns nothing.
    """
    cosine = turn_cosines(one.rotations, other.rotations)
    first, second = (_to_points(problem, state) for state in (one, other))
    size = np.sqrt(np.einsum("ni,ni->n", first, first) * np.einsum("ni,ni->n", second, second))
    cosine = np.append(cosine, np.einsum("ni,ni->n", first, second) / size)
    if not bool(np.isfinite(cosine).all()):
        return float("inf")
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).max())


def turn_cosines(one: Array, other: Array) -> Array:
    """Return (n,) cosines of the angles between (n, 3, 3) rotations."""
    relative = np.einsum("nji,njk->nik", one, other)
    cosine: Array = (np.trace(relative, axis1=1, axis2=2) - 1.0) / 2.0
    return cosine


def _to_points(problem: Problem, state: BlockState) -> Array:
    """(m, 3) vectors from the photos to their points."""
    away = state.points.take(problem.point, axis=0)
    away -= state.centres.take(problem.photo, axis=0)
    return away


def full_step(problem: Problem, structure: Structure, state: BlockState) -> BlockState | None:
    """Return where the step without damping leads; None where it cannot be solved for."""
    step = _full(problem, structure, state, linearise(problem, state))
    return None if step is None else move(state, *step.dx)


def _full(
    problem: Problem, structure: Structure, state: BlockState, linear: Linearised
) -> Step | None:
    """Return the step without damping; None where it cannot be solved for."""
    tie = anchor(problem, state) if problem.defect else None
    weights = None if tie is None else tie.weights
    return damped_step(problem, structure, linear, 0.0, weights, None)


def foreseen_torn(problem: Problem, structure: Structure, solution: RobustState) -> bool:
    """Whether the orientations are right, and gross errors tear every minimum near them.

    In themselves: where control is off, the block may lie on the ground wrongly.
    """
    return solution.orients(problem) and torn(
        problem, _foreseen(problem, structure, solution.state), solution
    )


def torn(problem: Problem, least: float, solution: RobustState) -> bool:
    """Whether a minimum, by its v'Pv, fits so badly that it may mean nothing for the block.

    Where sigmas are too small, it does not: it is compared with what most measurements are off.
    """
    scale = max(solution.misfit / float(np.median(problem.sigma)), 1.0)
    return least > (TORN * scale) ** 2 * max(problem.redundancy, 1)


def _foreseen(problem: Problem, structure: Structure, state: BlockState) -> float:
    """Return v'Pv after the step without damping, if the observations were linear.

    Infinite where the step cannot be solved for.
    """
    linear = linearise(problem, state)
    step = _full(problem, structure, state, linear)
    return float("inf") if step is None else linear.vtpv - step.change


def minimum_nearby(
    problem: Problem, structure: Structure, state: BlockState, *, progress: Progress | None = None
) -> Minimum | None:
    """Return the minimum to which a robust solution leads; None where gross errors pull too far.

    The first step and the minimum itself may turn photos and rays by `MOST_TURNED`. Neither hangs
    on the last digits: the first because it is one step, the second because it is the same minimum
    whatever the way to it.

    Parameters
    ----------
    problem, structure
        The bundle.
    state
        A robust solution.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NoConvergenceError
        No minimum is found although the first step is small.
    NotComputableError
        Something is left open at the minimum.
    """
    ahead = full_step(problem, structure, state)
    if ahead is not None and turned(problem, state, ahead) > MOST_TURNED:
        return None
    found = find_minimum(problem, state, structure, progress=progress)
    return None if turned(problem, state, found.state) > MOST_TURNED else found
