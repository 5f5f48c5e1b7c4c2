"""The free network, and approximate values by way of it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.solve.datum import check_datum
from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import objective
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.approximate import approximate_ways, laid_onto_control, restricted
from anaplot.bundle.start.pull import foreseen_torn
from anaplot.bundle.start.robust import robust_state
from anaplot.errors import NotComputableError

__all__ = ["free_network", "from_free_network"]


_FITS = 4.0  # sigma0 up to which no other way is tried
_TRIES = 40  # steps: a robust solution lies next to the minimum, or there is none


def free_network(
    problem: Problem, start: BlockState, progress: Progress | None = None, *, anew: bool = False
) -> tuple[Problem, BlockState]:
    """Return the block without its datum, and its solution from a state.

    Where gross errors would tear its minimum it is the robust one.

    Parameters
    ----------
    problem, start
        The bundle, and a state of it.
    progress
        Called with what is being done and the fraction of it.
    anew
        Whether, where the state leads to no network or to a torn one, it is also begun from
        approximate values without control: wrong control may have torn the state.

    Raises
    ------
    NotComputableError
        There is no such network, or no minimum is found.
    numpy.linalg.LinAlgError
        Nor can its equations be solved.
    """
    free = make_problem(
        replace(problem.block, conditions=()), datum="free", undetermined=problem.undetermined
    )
    try:
        bare, is_torn = _solution(free, restricted(free, problem, start), progress)
    except (NotComputableError, np.linalg.LinAlgError):
        found = _solution_anew(free, progress) if anew else None
        if found is None:
            raise
        return free, found[0]
    if is_torn and anew:
        found = _solution_anew(free, progress)
        if found is not None and not found[1]:
            bare = found[0]
    return free, bare


def _solution(
    free: Problem, start: BlockState, progress: Progress | None
) -> tuple[BlockState, bool]:
    """Return the minimum from a state, or a robust solution and that gross errors tear it."""
    structure = make_structure(free, start.centres)
    check_datum(free, start)
    solution = robust_state(free, structure, start)
    if foreseen_torn(free, structure, solution):
        return solution.state, True
    found = find_minimum(free, solution.state, structure, tries=_TRIES, progress=progress)
    return found.state, False


def _solution_anew(free: Problem, progress: Progress | None) -> tuple[BlockState, bool] | None:
    """Return the solution from the first approximate values that lead to one that fits.

    Where none does, the one of the least v'Pv; None: none lead to any.
    """
    best: tuple[BlockState, bool] | None = None
    least = np.inf
    for way in approximate_ways(free):
        with suppress(NotComputableError, np.linalg.LinAlgError):
            state = way.find(progress)
            if state is None:
                continue
            found = _solution(free, state, progress)
            value = objective(free, found[0])[0]
            if value < least:
                best, least = found, value
            if not found[1] and value < _FITS**2 * free.observations:
                break
    return best


def from_free_network(
    problem: Problem, start: BlockState, progress: Progress | None
) -> BlockState | None:
    """Approximate values by way of the free network, in which control has no influence.

    Gross errors that would tear its minimum have little weight: that of a robust solution. What
    only control determines (a control point in one photo) is added after the network lies on
    control. None when there is no such network.
    """
    try:
        free, bare = free_network(problem, start, progress)
        return laid_onto_control(problem, free, bare)
    except (NotComputableError, np.linalg.LinAlgError):
        return None
