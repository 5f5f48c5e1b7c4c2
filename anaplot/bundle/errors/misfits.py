"""A block with errors so large that it has no minimum: what fits nowhere stays out at first.

A photo in which two points were interchanged, or a control point a kilometre off, leaves v'Pv
without a minimum near the approximate values. The search for gross errors needs a place where the
block can be linearised: here it is adjusted without all that is far off from a robust solution.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.adjust import adjust_problem, calibrated, evaluate, points_settled
from anaplot.bundle.errors.controlagreed import agreed_places, what_is_wrong
from anaplot.bundle.errors.leftout import missing, with_rows_of
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import anchor, check_datum
from anaplot.bundle.solve.gaussnewton import (
    Minimum,
    NoConvergenceError,
    find_minimum,
    led_by_factor,
)
from anaplot.bundle.solve.imaging import BlockState, RobustPlace, without_additional
from anaplot.bundle.solve.linearised import counted_misclosures, linearise
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.remade import among_points, without_points
from anaplot.bundle.solve.selection import FAR_APART
from anaplot.bundle.solve.structure import Structure, make_structure
from anaplot.bundle.start.bestminimum import Ahead, fits
from anaplot.bundle.start.halfrays import met_planes
from anaplot.bundle.start.pointknowledge import WIDE, equations_knowing
from anaplot.bundle.start.robust import FarOff, RobustState, far_off
from anaplot.bundle.start.robustsuspects import without_search
from anaplot.errors import NotComputableError

__all__ = [
    "PartialAdjustment",
    "WithoutFirst",
    "adjust_without_misfits",
    "minimum_without_misfits",
    "mismatched",
    "points_gone",
]


_ROUNDS = 4
_TELL = 7  # equations of a point from which it is told which of its rays is wrong
_VOTE = 6  # from which rays that all contradict what is known of it tell that this is wrong
_ENOUGH = 0.01  # of a point's weakest direction that must be left
_OFF = 10.0  # sigmas by which a coordinate of a ray is off that was meant for another point


class PartialAdjustment(NamedTuple):
    """What could be adjusted of a block.

    Attributes
    ----------
    block
        The adjustment without `left_out` and `points`.
    left_out
        Observations that fit nowhere; empty when all of them have a minimum.
    reason
        Why there is none with them, or "".
    points
        Points that are left out with all their rays: they are far apart, and too little tells what
        is wrong.
    """

    block: AdjustedBlock
    left_out: tuple[ObservationName, ...]
    reason: str
    points: tuple[str, ...] = ()


class WithoutFirst:
    """The way to a torn minimum through that without what is far off; see `best_minimum`.

    Of a large block with few wrong rays the photos' equations are nearly the same with and without
    them.

    Parameters
    ----------
    enough
        As `find_minimum` has it, of the minimum without them.
    progress
        Called with what is being done and the fraction of it.

    Attributes
    ----------
    found
        The robust solution from which the way was last taken, the bundle without what is far off,
        and its minimum; None: it was not taken.
    """

    def __init__(self, enough: float, progress: Progress | None = None) -> None:
        self._enough, self._progress = enough, progress
        self.found: tuple[RobustState, Problem, Minimum] | None = None

    def __call__(
        self, problem: Problem, structure: Structure, solution: RobustState
    ) -> tuple[BlockState, int] | None:
        """Return where the minimum is, or nearly, and how many steps lead there; or None."""
        self.found = None
        if not solution.explains(problem):
            return None
        least = minimum_without_misfits(
            problem, structure, solution.place, enough=self._enough, progress=self._progress
        )
        if least is None or least[1].normal.structure is not structure:
            return None
        self.found = solution, *least
        clean = least[1]
        return led_by_factor(problem, structure, clean.state, clean.factor, self._progress)


def adjust_without_misfits(
    problem: Problem,
    *,
    start: BlockState | None = None,
    ahead: Ahead | None = None,
    progress: Progress | None = None,
) -> PartialAdjustment:
    """Adjust a bundle; where no minimum is found, without the observations that fit nowhere.

    Parameters
    ----------
    problem
        The bundle.
    start
        Approximate values, as `adjust_problem` has them.
    ahead
        As `best_minimum` has it.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NotComputableError
        As `adjust_problem`: what is left out does not help, control free of error is to blame, or
        the block is not determined without it. As `what_is_wrong`: control points are exchanged.
    """
    if start is None:
        problem, start = points_settled(problem, progress=progress)
    try:
        block = adjust_problem(problem, start=start, ahead=ahead, progress=progress)
        return PartialAdjustment(block, (), "")
    except NoConvergenceError as error:
        failure, start = error, error.state
    # whether a minimum without some rays is found in such a block is a matter of its last digits
    what_is_wrong(problem, start, None)
    # orientations do not wait for additional parameters
    bare = problem.bare
    start = without_additional(start)
    structure = make_structure(bare, start.centres)
    try:
        least = minimum_without_misfits(bare, structure, RobustPlace(start), progress=progress)
        least = least or _on_agreed(bare, start, progress)
        if least is None:
            raise without_search(failure)
        reduced, found = least
        points, whole = points_gone(problem, reduced), problem
        if points:
            whole = without_points(problem, points, FAR_APART)
        if bare is problem:
            block = evaluate(reduced, found, progress=progress)
        else:
            reduced = with_rows_of(whole, reduced)
            block = calibrated(reduced, found.state, progress=progress)
    except np.linalg.LinAlgError:
        raise without_search(failure) from None
    # a search that begins without them needs no advice to let it
    return PartialAdjustment(block, missing(whole, reduced), failure.reason, points)


def _on_agreed(
    problem: Problem, start: BlockState, progress: Progress | None
) -> tuple[Problem, Minimum] | None:
    """Return the bundle on the control that agrees with the photos, and its minimum; None: none."""
    places = agreed_places(problem, start, problem.rejected, problem.test.alpha, progress)
    for place, *_ in places:
        if place.found is not None:
            return place.found.normal.problem, place.found
    return None


def points_gone(problem: Problem, reduced: Problem) -> tuple[str, ...]:
    """Return the points of a bundle that a smaller one of the same block lacks."""
    left = set(reduced.points)
    return tuple(name for name in problem.points if name not in left)


def minimum_without_misfits(
    problem: Problem,
    structure: Structure,
    start: RobustPlace,
    *,
    enough: float = 0.0,
    progress: Progress | None = None,
) -> tuple[Problem, Minimum] | None:
    """Return the bundle without what is far off from a robust solution, and its minimum.

    A robust solution that wrong rays at control have bent leaves that control off, or all rays of
    it, and without these little holds the block. Where that is no minimum, the rays that miss most
    are out alone, one of each point, as long as everything else fits then.

    Parameters
    ----------
    problem, structure
        The bundle.
    start
        Where robust steps begin.
    enough
        As `find_minimum` has it.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    (Problem, Found) or None
        The bundle also lacks the points of which too little is left. None where no minimum is found
        either, or control free of error is far off.
    """
    off = far_off(problem, structure, start)
    for worst_alone in (False, True):
        found = _minimum_without(problem, structure, off, enough, progress, worst_alone=worst_alone)
        if found is not None and (not worst_alone or fits(*found)):
            return found
    return None


def _minimum_without(
    problem: Problem,
    structure: Structure,
    off: FarOff,
    enough: float,
    progress: Progress | None,
    *,
    worst_alone: bool,
) -> tuple[Problem, Minimum] | None:
    """Return the bundle without what is far off, or the worst rays of it, and its minimum."""
    start = off.state
    runaway: BlockState | None = None
    for before in range(_ROUNDS):
        if before:
            off = far_off(problem, structure, RobustPlace(start))
        believed = _control_believed(problem, off)
        if believed is None:
            return None
        off = _worst_of_points(problem, off) if worst_alone else believed
        smaller, start = _without(problem, off), off.state
        apart = _far_apart(smaller, off)
        if runaway is not None:
            apart |= _open_points(problem, structure, runaway)
        left = _leaving(smaller, start, apart) if apart.any() else None
        if left is not None:
            smaller, start = left
            structure = make_structure(smaller, start.centres)
        elif smaller.observations == problem.observations:
            return None
        problem = smaller
        try:
            check_datum(problem, start)
            return problem, find_minimum(
                problem, start, structure, enough=enough, progress=progress
            )
        except NoConvergenceError as error:
            runaway = error.state
        except NotComputableError:
            return None
    return None


def _worst_of_points(problem: Problem, off: FarOff) -> FarOff:
    """Blame of every point the ray that misses most, and no control."""
    size = _sizes(problem, off.state)
    size = np.where(off.rays, np.nan_to_num(size, nan=np.inf), -1.0)
    most = np.full(len(problem.points), -1.0)
    np.maximum.at(most, problem.point, size)
    return off._replace(
        rays=off.rays & (size >= most[problem.point]),
        control=np.zeros_like(off.control),
        priors=np.zeros_like(off.priors),
        expected=np.zeros_like(off.expected),
    )


def _sizes(problem: Problem, state: BlockState) -> Array:
    """(m,) what rays are off [mm]."""
    e = counted_misclosures(problem, state)[0] * problem.sigma_xy
    return np.asarray(np.linalg.norm(e, axis=1))


def _control_believed(problem: Problem, off: FarOff) -> FarOff | None:
    """Blame rays, not control free of error; None where most rays of a point contradict it.

    Where they contradict each other as well, the point tells nothing of its control.
    """
    firm = off.control & problem.fixed.any(axis=1)
    if not firm.any():
        return off
    wrong = firm[problem.point] & ~(_sizes(problem, off.state) <= off.reach)
    count = np.bincount(problem.point, minlength=len(problem.points))
    # one ray is no majority: what is free of error tells that it is wrong
    majority = np.maximum(count // 2, 1)
    most = np.bincount(problem.point[wrong], minlength=len(problem.points)) > majority
    if (most & ~_undecided(problem, equations_knowing(problem, off.state), _VOTE)).any():
        return None
    rays = np.where(firm[problem.point], wrong, off.rays)
    return off._replace(rays=rays, control=off.control & ~firm)


def _without(problem: Problem, off: FarOff) -> Problem:
    """Return the bundle without what is far off.

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
    starts = np.searchsorted(problem.point, np.arange(len(problem.points) + 1))
    for point in np.unique(problem.point[off.rays]).tolist():
        free = ~problem.fixed[point]
        rays = np.arange(starts[point], starts[point + 1])
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
    return replace(smaller, rejected=rejected if rejected.any() else None)


def _far_apart(problem: Problem, off: FarOff) -> Bools:
    """(points,) points with a ray that fits nowhere, of which too little tells which one it is.

    Any of three coordinates of two rays makes a point, and nothing tells which of the four is
    wrong. Where they miss each other by a large part of the field of view, or three of them do not
    meet before the photos, no such point is near the measured one. With a height either ray makes
    one: whatever is off in both coordinates of a ray, two equations of the point know nothing of,
    and three determine it.

    Parameters
    ----------
    problem
        The bundle without what is far off, as far as its points can do without.
    """
    kept = off.rays.copy()
    if problem.rejected is not None:
        kept &= ~problem.rejected.all(axis=1)
    out = np.zeros(len(problem.points), dtype=bool)
    out[problem.point[kept]] = True
    known = equations_knowing(problem, off.state)
    out &= known == 0
    doubtful = np.flatnonzero(out)
    wide = np.zeros(len(out), dtype=bool)
    wide[problem.point[off.rays & _wide(problem, _misses(problem, off.state))]] = True
    _, certain = met_planes(problem, off.state, doubtful)
    out[doubtful] = wide[doubtful] | ~certain
    return out | (wide & _undecided(problem, known))


def _undecided(problem: Problem, known: Index, tell: int = _TELL) -> Bools:
    """(points,) points of which too little is left over once one of the rays is out.

    One ray and three coordinates free of error leave no doubt which of them is wrong.
    """
    counted = np.full(len(problem.photo), 2)
    if problem.off is not None:
        counted = (~problem.off).sum(axis=1)
    equations = np.bincount(problem.point, counted, len(problem.points)) + known
    few: Bools = (known > 0) & (equations < tell) & ~problem.fixed.all(axis=1)
    return few


def _misses(problem: Problem, state: BlockState) -> Array:
    """(m, 2) what all rays are off [mm], those that are rejected as well."""
    misses: Array = counted_misclosures(problem.every, state)[0] * problem.sigma_xy
    return misses


def _wide(problem: Problem, misses: Array) -> Bools:
    """(m,) which rays miss so far that they were taken for another point's."""
    out: Bools = ~(np.linalg.norm(misses, axis=1) <= WIDE * problem.c[problem.photo])
    return out


def mismatched(problem: Problem, reduced: Problem, state: BlockState) -> frozenset[ObservationName]:
    """Return the image coordinates that a smaller bundle lacks and that are no errors of measuring.

    They belong to rays that miss their points by a large part of the field of view: to another
    point, that is. Linearised so far from their places they say nothing of their point, but that
    its other rays were as wrong as they. Where only x or y misses, the other one is none of them.

    Parameters
    ----------
    problem
        The bundle, with all observations.
    reduced, state
        The bundle without what fits nowhere, and its minimum.
    """
    misses = _misses(reduced, state)
    off = _wide(reduced, misses)[:, None] & (np.abs(misses) > _OFF * problem.sigma_xy)
    off &= reduced.newly_rejected & ~problem.newly_rejected
    rejected = off if problem.rejected is None else off | problem.rejected
    return frozenset(missing(problem, replace(problem, rejected=rejected)))


def _open_points(problem: Problem, structure: Structure, state: BlockState) -> Bools:
    """(points,) points that ran away where no minimum was found: their rays do not meet."""
    out = np.zeros(len(problem.points), dtype=bool)
    tie = anchor(problem, state) if problem.defect else None
    weights = None if tie is None else tie.weights
    try:
        NormalEquations(problem, structure, linearise(problem, state), 0.0, weights)
    except PointError as error:
        out[error.points] = True
    known = equations_knowing(problem, state)
    out &= (known == 0) | _undecided(problem, known)
    return out


def _leaving(
    problem: Problem, state: BlockState, points: Bools
) -> tuple[Problem, BlockState] | None:
    """Return the bundle without some points, and its state; None where photos hang on them."""
    if problem.left_open is not None:
        return None
    names = [problem.points[k] for k in np.flatnonzero(points).tolist()]
    try:
        smaller = without_points(problem, names, FAR_APART)
    except NotComputableError:
        return None
    if smaller.photos != problem.photos:
        return None
    if problem.conditions is None:
        smaller = replace(smaller, conditions=None)
    return smaller, among_points(problem, smaller, state)


def _weakest(b: Array, weight: Array) -> float:
    """Smallest eigenvalue of a point's normal equations, from k rows of derivatives."""
    if len(weight) == 0:
        return 0.0
    return float(np.linalg.eigvalsh(b.T @ b + weight)[0])
