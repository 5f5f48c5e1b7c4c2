"""A block with errors so large that it has no minimum: what fits nowhere stays out at first.

A photo in which two points were interchanged, or a control point a kilometre off, leaves v'Pv
without a minimum near the approximate values. The search for gross errors needs a place where the
block can be linearised: here it is adjusted without all that is far off from a robust solution.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Progress
from anaplot.bundle.adjust import adjust_problem, calibrated, evaluate, points_settled
from anaplot.bundle.errors.leftout import missing, with_rows_of
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import check_datum
from anaplot.bundle.solve.gaussnewton import Minimum, NoConvergenceError, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import counted_misclosures, linearise
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure, make_structure
from anaplot.bundle.start.robust import FarOff, far_off
from anaplot.errors import NotComputableError

__all__ = ["PartialAdjustment", "adjust_without_misfits", "minimum_without_misfits"]


_ROUNDS = 4
_ENOUGH = 0.01  # of a point's weakest direction that must be left


class PartialAdjustment(NamedTuple):
    """What could be adjusted of a block.

    Attributes
    ----------
    block
        The adjustment without `left_out`.
    left_out
        Observations that fit nowhere; empty when all of them have a minimum.
    reason
        Why there is none with them, or "".
    """

    block: AdjustedBlock
    left_out: tuple[ObservationName, ...]
    reason: str


def adjust_without_misfits(
    problem: Problem, *, start: BlockState | None = None, progress: Progress | None = None
) -> PartialAdjustment:
    """Adjust a bundle; where no minimum is found, without the observations that fit nowhere.

    Parameters
    ----------
    problem
        The bundle.
    start
        Approximate values, as `adjust_problem` has them.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NotComputableError
        As `adjust_problem`: what is left out does not help, control free of error is to blame, or
        the block is not determined without it.
    """
    if start is None:
        problem, start = points_settled(problem, progress=progress)
    try:
        block = adjust_problem(problem, start=start, progress=progress)
        return PartialAdjustment(block, (), "")
    except NoConvergenceError as error:
        failure, start = error, error.state
    # orientations do not wait for additional parameters
    bare = problem.bare
    start = replace(start, own=start.own[:, :0], shared=start.shared[:0])
    structure = make_structure(bare, start.centres)
    try:
        least = minimum_without_misfits(bare, structure, start, progress=progress)
        if least is None:
            raise failure
        reduced, found = least
        if bare is problem:
            block = evaluate(reduced, found, progress=progress)
        else:
            reduced = with_rows_of(problem, reduced)
            block = calibrated(reduced, found.state, progress=progress)
    except np.linalg.LinAlgError:
        raise failure from None
    return PartialAdjustment(block, missing(problem, reduced), str(failure))


def minimum_without_misfits(
    problem: Problem, structure: Structure, start: BlockState, *, progress: Progress | None = None
) -> tuple[Problem, Minimum] | None:
    """Return the bundle without what is far off from a robust solution, and its minimum.

    Parameters
    ----------
    problem, structure
        The bundle.
    start
        Where robust steps begin.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    (Problem, Found) or None
        None where no minimum is found either, or control free of error is far off.
    """
    for _ in range(_ROUNDS):
        off = _control_believed(problem, far_off(problem, structure, start))
        if off is None:
            return None
        smaller, start = _without(problem, off), off.state
        if smaller is None:
            return None
        problem = smaller
        try:
            check_datum(problem, start, linearise(problem, start))
            return problem, find_minimum(problem, start, structure, progress=progress)
        except NoConvergenceError:
            continue
        except NotComputableError:
            return None
    return None


def _control_believed(problem: Problem, off: FarOff) -> FarOff | None:
    """Blame rays, not control free of error; None where most rays of a point contradict it."""
    firm = off.control & problem.fixed.any(axis=1)
    if not firm.any():
        return off
    size = np.linalg.norm(counted_misclosures(problem, off.state)[0] * problem.sigma_xy, axis=1)
    wrong = firm[problem.point] & ~(size <= off.reach)
    count = np.bincount(problem.point, minlength=len(problem.points))
    if (np.bincount(problem.point[wrong], minlength=len(problem.points)) > count // 2).any():
        return None
    rays = np.where(firm[problem.point], wrong, off.rays)
    return off._replace(rays=rays, control=off.control & ~firm)


def _without(problem: Problem, off: FarOff) -> Problem | None:
    """Return the bundle without what is far off; None when that is nothing more.

    A point keeps the coordinates without which it would not be determined.
    """
    smaller = replace(
        problem,
        known_sigma=np.where(off.control[:, None], np.nan, problem.known_sigma),
        expected_sigma=np.where(off.expected[:, None], np.nan, problem.expected_sigma),
        position_sigma=np.where(off.priors[:, :1], np.nan, problem.position_sigma),
        rotation_sigma=np.where(off.priors[:, 1:], np.nan, problem.rotation_sigma),
    )
    linear = linearise(smaller, off.state)
    before = np.zeros((len(problem.photo), 2), dtype=bool)
    if problem.rejected is not None:
        before |= problem.rejected
    rejected = before.copy()
    for point in np.unique(problem.point[off.rays]).tolist():
        free = ~problem.fixed[point]
        rays = np.flatnonzero(problem.point == point)
        b = linear.b[rays][:, :, free]
        weight = np.diag(linear.point_weight[:, point, free].sum(axis=0))
        out = rejected[rays]
        enough = _ENOUGH * _weakest(b[~out], weight)
        size = np.where(off.rays[rays][:, None] & ~out, np.abs(linear.e[rays]), 0.0)
        for k in np.argsort(-size, axis=None, kind="stable").tolist():
            if size.flat[k] > 0.0:
                out.flat[k] = True
                out.flat[k] = _weakest(b[~out], weight) >= enough
        rejected[rays] = out
    smaller = replace(smaller, rejected=rejected if rejected.any() else None)
    return None if smaller.observations == problem.observations else smaller


def _weakest(b: Array, weight: Array) -> float:
    """Smallest eigenvalue of a point's normal equations, from k rows of derivatives."""
    if len(weight) == 0:
        return 0.0
    return float(np.linalg.eigvalsh(b.T @ b + weight)[0])
