"""Approximate values by way of the free network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.solve.datum import check_datum
from anaplot.bundle.solve.gaussnewton import find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.approximate import laid_onto_control, restricted
from anaplot.bundle.start.pull import foreseen_torn
from anaplot.bundle.start.robust import robust_state
from anaplot.errors import NotComputableError

__all__ = ["from_free_network"]


def from_free_network(
    problem: Problem, start: BlockState, progress: Progress | None
) -> BlockState | None:
    """Approximate values by way of the free network, in which control has no influence.

    Gross errors that would tear its minimum have little weight: that of a robust solution. What
    only control determines (a control point in one photo) is added after the network lies on
    control. None when there is no such network.
    """
    try:
        free = make_problem(
            replace(problem.block, conditions=()), datum="free", undetermined=problem.undetermined
        )
        bare = restricted(free, problem, start)
        structure = make_structure(free, bare.centres)
        check_datum(free, bare)
        solution = robust_state(free, structure, bare)
        bare = solution.state
        if not foreseen_torn(free, structure, solution):
            bare = find_minimum(free, bare, structure, progress=progress).state
        return laid_onto_control(problem, free, bare)
    except (NotComputableError, np.linalg.LinAlgError):
        return None
