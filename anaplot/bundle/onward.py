"""A bundle adjusted from the solution of an earlier one, or of nearly the same."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.adjust import adjust_bundle, adjust_problem
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.gaussnewton import NoConvergenceError
from anaplot.bundle.solve.openmovement import LeftOpenError
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.start.approximate import extended_state
from anaplot.bundle.start.halfrays import half_seen, settled_points, without_doubtful

__all__ = ["adjust_onward"]


def adjust_onward(
    problem: Problem, last: AdjustedBlock, *, progress: Progress | None = None
) -> AdjustedBlock:
    """Adjust a bundle from another's solution as far as that goes, else from nothing.

    Parameters
    ----------
    problem
        The bundle.
    last
        A block with most of its photos and points, in the same system.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NotComputableError
        As `adjust_problem`.
    """
    firm = without_doubtful(problem, half_seen(problem))
    extended = extended_state(firm or problem, last.problem, last.state)
    if extended is None:
        return adjust_problem(problem, progress=progress)
    settled = problem
    if firm is not None:
        settled, extended = settled_points(problem, firm, extended)
    try:
        # whatever bad data makes infinite on the way is looked at where it matters
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return adjust_bundle(settled, extended, progress=progress)
    except (NoConvergenceError, LeftOpenError, np.linalg.LinAlgError):
        return adjust_problem(problem, progress=progress)
