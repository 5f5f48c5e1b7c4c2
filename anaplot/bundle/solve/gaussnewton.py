"""The minimum of v'Pv by damped Gauss-Newton steps, or why there is none."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Progress
from anaplot.bundle.solve.datum import Anchor, anchor, relocate, rescaled
from anaplot.bundle.solve.eliminated import EliminatedPoints, eliminate
from anaplot.bundle.solve.factor import Factor, NotPositiveError
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import (
    Linearised,
    Unknowns,
    effect,
    linearise,
    move,
    objective,
    rounding,
)
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.offsetequations import OffsetsOpenError
from anaplot.bundle.solve.openmovement import undetermined
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reintersect import reintersected
from anaplot.bundle.solve.rightsides import right_sides
from anaplot.bundle.solve.structure import Structure
from anaplot.errors import NotComputableError

__all__ = [
    "LEFT",
    "Convergence",
    "Minimum",
    "NoConvergenceError",
    "Step",
    "change_of",
    "damped_step",
    "equations_at",
    "find_minimum",
    "led_by_factor",
]


LEFT = 1e-16
"""Of n: squared change of the whitened residuals that may be left at a minimum."""

MAX_ITERATIONS = 200
_CONVERGED = 1e-13  # of n: squared change of the whitened residuals in the last step
_CLOSE = 10.0  # of n: the same of a full step whose factor may serve again
_NEARER = 5e-3  # of the change before: where more is left, an earlier factor serves no longer
_WORTH = 10  # steps with an earlier factor that cost as much as equations and their factor
_LEAST = 1e-9  # damping below which there is none
_FADE = 0.1  # of the damping is left, at least, after a step as good as foreseen
_STRAINED = 0.25  # of what was foreseen: a step that brings less has strained the points
_STANDS = 1e-6  # of v'Pv: a step that brings less, while something is left open
_HARDLY = 1e-6  # damping that holds nothing but what is left open
_BEHIND = 1e2  # damping from which a step may put a point behind its photo
_RUNAWAY = 1e12  # damping at which no step downhill is left


class NoConvergenceError(NotComputableError):
    """The iteration found no minimum.

    Parameters
    ----------
    text
        What is said of it.
    state
        Where the iteration ended, or the place from which measurements were seen to disagree.
    advice
        What to do, said after it; "" for nothing.

    Attributes
    ----------
    reason
        The text without advice.
    state, advice
        As above.
    """

    def __init__(self, text: str, state: BlockState, advice: str = "") -> None:
        super().__init__(f"{text}; {advice}" if advice else text)
        self.reason, self.state, self.advice = text, state, advice


class Convergence(NamedTuple):
    """How the minimum was found.

    Attributes
    ----------
    iterations
        Accepted steps.
    damped
        Steps that had to be damped or taken back.
    first, last
        v'Pv at the approximate values and at the end.
    """

    iterations: int
    damped: int
    first: float
    last: float


class _Place(NamedTuple):
    """Where the search stands: derivatives, v'Pv, and rays whose points are behind their photos."""

    state: BlockState
    linear: Linearised
    value: float
    behind: int


def _place_at(problem: Problem, state: BlockState) -> _Place:
    """Return a state as a place of the search."""
    linear = linearise(problem, state)
    return _Place(state, linear, linear.vtpv, int((linear.depth <= 0.0).sum()))


class Step(NamedTuple):
    """A step, and what it was solved with, which is as large as the block.

    Attributes
    ----------
    dx
        Corrections of photos (n, d), points (p, 3) and shared parameters (q,).
    change
        The squared change of the whitened residuals.
    normal, factor
        The equations and their factor.
    """

    dx: Unknowns
    change: float
    normal: NormalEquations
    factor: Factor


class Minimum(NamedTuple):
    """A minimum and the equations there, or a place near it, see `find_minimum`."""

    state: BlockState
    normal: NormalEquations
    factor: Factor
    anchor: Anchor | None
    convergence: Convergence


def find_minimum(
    problem: Problem,
    start: BlockState,
    structure: Structure,
    *,
    tries: int | None = None,
    firm: bool = False,
    enough: float = 0.0,
    led: int = 0,
    progress: Progress | None = None,
) -> Minimum:
    """Minimise v'Pv by damped Gauss-Newton steps (Levenberg and Marquardt).

    A step is full until one would increase v'Pv or put more points behind their photos. Where a
    step brings much less than foreseen, the points are intersected again from its photos; where
    that does not help, damping grows, and it fades by the gain ratio as steps succeed (Nielsen
    1999, eq. 2.9). After a full step its factor serves for others, as long as they lead quickly
    nearer: that costs a fifth of new equations and their factor. Where they end, the equations of
    that place say whether it is the minimum; else these lead on.

    Parameters
    ----------
    problem, start, structure
        The bundle, approximate values, and the structure of its normal equations.
    tries
        Steps with equations of their own, also those taken back, after which the start is given
        up; None: as many as it takes.
    firm
        Whether the observations are known to determine all where it begins, unless too few of them
        are left: nothing is sought then by damping that the first step leaves open.
    enough
        Of n: squared change of the whitened residuals in a full step that is the last one. Where it
        leads is a place near the minimum; the equations are those of where it began, unless the
        datum has a defect.
    led
        Steps that have led to the start, which may be the minimum already; they count.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NoConvergenceError
        There is no minimum to be found from here; `no_minimum` says why.
    LeftOpenError
        The observations leave something open at the minimum, or, where it is `firm`, at the start.
    """
    state = start = rescaled(problem, start)
    value, depth = objective(problem, state)
    linear = linearise(problem, state)  # a condition that means nothing there is named
    if not value < float("inf"):
        raise NoConvergenceError(
            f"block {problem.block.name}: the approximate values put a point into a photo's centre",
            start,
        )
    first, behind = value, int((depth <= 0.0).sum())
    tie = anchor(problem, state) if problem.defect else None
    weights = None if tie is None else tie.weights
    damping, growth, accepted, damped, again = 0.0, 2.0, led, 0, led
    full = None  # a full step that is known already
    while accepted < MAX_ITERATIONS and (tries is None or accepted - again + damped < tries):
        # what rounding does to the sum cannot be told from a step
        noise = rounding(problem, state, linear.depth)
        tolerance = max(_CONVERGED * problem.observations, noise)
        slack = _slack(value, noise)
        open_here = False
        while True:
            if progress is not None:
                progress(f"iteration {accepted + 1}", 0.0)
            step = None  # its memory, before there is another
            step, full = full, None
            if step is None:
                step = damped_step(problem, structure, linear, damping, weights, progress)
            if step is not None:
                there = accepted == led > 0 and damping == 0.0 and not problem.defect
                if there and _no_change(problem, step):
                    ended = Convergence(accepted, damped, first, value)
                    return Minimum(state, step.normal, step.factor, tie, ended)
                trial = rescaled(problem, move(state, *step.dx))
                new_value, depth = objective(problem, trial)
                done = step.change <= tolerance
                if not done and not value - new_value > _STRAINED * step.change:
                    trial = reintersected(problem, trial)
                    new_value, depth = objective(problem, trial)
                new_behind = int((depth <= 0.0).sum())
                downhill = new_value <= value + (slack if done else 0.0)
                if downhill and (done or new_behind <= behind or damping > _BEHIND):
                    break
            damped += 1
            if tries is not None and accepted - again + damped >= tries:
                raise NoConvergenceError(_ended(problem, value, accepted), state)
            if step is None and damping == 0.0:
                open_here = True
                if firm and accepted == led:
                    _determined(problem, structure, state, linear, tie)
            damping, growth = max(damping * growth, _LEAST), 2.0 * growth
            if damping > _RUNAWAY:
                raise NoConvergenceError(_ended(problem, value, accepted), state)
        fallen = value - new_value
        gain = fallen / _foreseen(problem, linear, step.dx) if damping and step.change else 1.0
        state, value, behind = trial, new_value, new_behind
        accepted += 1
        settled = by_full = done and damping == 0.0
        if not settled:
            settled = damping == 0.0 and step.change <= enough * problem.observations
            if settled and not problem.defect:
                ended = Convergence(accepted, damped, first, value)
                return Minimum(state, step.normal, step.factor, tie, ended)
            linear = linearise(problem, state)
            if not settled and damping == 0.0 and step.change <= _CLOSE * problem.observations:
                here, using = (
                    [_Place(state, linear, value, behind)],
                    _Using(step.normal, step.factor),
                )
                del linear  # its memory, before there are others
                # popped, so that it is let go of as soon as there is another
                (state, linear, value, behind), steps, settled = _nearer(
                    problem, structure, using, here.pop(), step.change, accepted, progress
                )
                accepted, again = accepted + steps, again + steps
        if settled:
            known = None if by_full or problem.defect else linear
            del step, linear  # their memory, before there are others
            if problem.defect:
                state = rescaled(problem, relocate(problem, start, state))
            equations = equations_at(problem, structure, state, known)
            last = equations[0].linear.vtpv
            found = Minimum(state, *equations, Convergence(accepted, damped, first, last))
            del equations, known
            if by_full:
                return found
            # a point that hardly weighs hides its slow steps from an earlier factor, not from this
            linear, value = found.normal.linear, found.normal.linear.vtpv
            full = _solved(found.normal, found.factor)
            if full is not None and _no_change(problem, full, enough):
                return found
            del found  # its equations and their factor are those of the next full step
            continue
        if open_here and damping < _HARDLY and fallen < _STANDS * value:
            # what nothing determines runs away, the farther the better: there is no minimum
            raise NoConvergenceError(str(_open_part(problem, structure, state)), state)
        # Nielsen (1999): as good as foreseen, and the damping falls to a third or less
        damping *= max(_FADE, 1.0 - (2.0 * min(gain, 1.0) - 1.0) ** 3)
        growth = 2.0
        # a step that hardly moves is only believed without damping
        damping = 0.0 if damping < _LEAST or done else damping
    raise NoConvergenceError(_ended(problem, value, accepted), state)


def _no_change(problem: Problem, step: Step, enough: float = 0.0) -> bool:
    """Whether a full step changes so little that the place before it is the minimum."""
    return step.change <= max(LEFT, enough) * problem.observations


def _slack(value: float, noise: float) -> float:
    """Return by what v'Pv may seem to grow in a step that hardly moves."""
    return 2.0 * sqrt(value * noise) + noise


class _Using(NamedTuple):
    """Equations with which steps are solved for, and the factor of those of the photos."""

    equations: NormalEquations | EliminatedPoints
    factor: Factor


def _nearer(
    problem: Problem,
    structure: Structure,
    using: _Using,
    place: _Place,
    change: float,
    accepted: int,
    progress: Progress | None,
    *,
    most: int = 0,
) -> tuple[_Place, int, bool]:
    """Go nearer to the minimum with an earlier factor (the simplified Newton method).

    As long as each step leaves little of what the one before has left (Deuflhard 2004, sect.
    2.1.2), or as many as `most` more of the kind would reach the end; the gradient is that of where
    it begins, so that it is the same minimum. `change` is that of the step before; infinite where
    there was none.

    Returns
    -------
    place, int and bool
        Where that ends, the steps, and whether it seems to be the minimum.
    """
    steps, left = 0, LEFT * problem.observations
    while place.linear.conditions is None and accepted + steps < MAX_ITERATIONS:
        if progress is not None:
            progress(f"iteration {accepted + steps + 1}", 0.0)
        # what holds exactly would need its multipliers at the minimum
        state, linear, value, behind = place
        sides = right_sides(problem, structure, linear, linear)
        dx = using.equations.solution(using.factor, sides)
        before, change = change, change_of(sides, dx)
        quick = change <= _NEARER * before
        if not quick and (change <= left or not change * (change / before) ** most <= left):
            # what is left may be too little to be made less
            return place, steps, change <= left
        noise = rounding(problem, state, linear.depth)
        trial = rescaled(problem, move(state, *dx))
        del place, linear  # their memory, before there are others
        place = _place_at(problem, trial)
        if not (place.value <= value + _slack(value, noise) and place.behind <= behind):
            return _place_at(problem, state), steps, False
        steps += 1
        if before < float("inf") and change**2 <= before * noise:
            # what is left, as far as this factor can tell, is rounding
            return place, steps, True
    return place, steps, False


def led_by_factor(
    problem: Problem,
    structure: Structure,
    start: BlockState,
    factor: Factor,
    progress: Progress | None = None,
) -> tuple[BlockState, int]:
    """Go nearer to a minimum with the factor of the photos' equations of nearly the same bundle.

    Of one without some of the rows, where these are few of every photo's; the points have all of
    theirs. `find_minimum` goes on from there.

    Parameters
    ----------
    problem, structure, start
        The bundle, the structure of its normal equations, and where it begins.
    factor
        Of normal equations of the same structure.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    State and int
        Where that ends, and how many steps lead there: none where the first leads upwards, or where
        the datum hangs on where it begins.
    """
    here = [_place_at(problem, rescaled(problem, start))]
    if problem.defect or not here[0].value < float("inf"):
        return start, 0
    steps = 0
    # once more where the first steps, which move the points that are wrong farthest, have led
    for most in (0, _WORTH):
        try:
            using = _Using(eliminate(problem, structure, here[0].linear)[0], factor)
        except PointError:
            break
        there, more, ended = _nearer(
            problem, structure, using, here.pop(), float("inf"), steps, progress, most=most
        )
        here, steps = [there], steps + more
        if ended or not more:
            break
    return here[0].state if steps else start, steps


def _ended(problem: Problem, value: float, steps: int) -> str:
    """Say that no minimum was reached, and how far it got."""
    sigma0 = sqrt(value / max(problem.redundancy, 1))
    return (
        f"block {problem.block.name}: no minimum was reached in {steps} steps; the best state has "
        f"sigma0 {sigma0:.3g}"
    )


def _open_part(problem: Problem, structure: Structure, state: BlockState) -> NotComputableError:
    """Return the error where the full step cannot be solved for."""
    try:
        equations_at(problem, structure, state)
    except NotComputableError as error:
        return error
    return NotComputableError(f"block {problem.block.name}: nearly not determined")


def _foreseen(problem: Problem, linear: Linearised, dx: Unknowns) -> float:
    """Return what v'Pv would fall by if the observations were linear."""
    moved = effect(problem, linear, dx)
    pairs = zip(linear.misclosures, moved.misclosures, strict=True)
    along = sum(float(np.vdot(e, change)) for e, change in pairs)
    return max(-2.0 * along - moved.vtpv, np.finfo(float).tiny)


def damped_step(
    problem: Problem,
    structure: Structure,
    linear: Linearised,
    damping: float,
    weights: Array | None,
    progress: Progress | None,
) -> Step | None:
    """Return a damped step with what it was solved with; None when nothing can be solved for.

    Parameters
    ----------
    problem, structure, linear
        The bundle, and where it is linearised.
    damping
        Of Levenberg and Marquardt; 0: the full step.
    weights
        Of the datum's anchor, or None.
    progress
        Called with what is being done and the fraction of it.
    """
    try:
        normal = NormalEquations(problem, structure, linear, damping, weights)
        factor = normal.factor(None if progress is None else (lambda f: progress("factor", f)))
        normal.offset_update(factor)
    except (NotPositiveError, PointError, OffsetsOpenError):
        return None
    return _solved(normal, factor)


def _solved(normal: NormalEquations, factor: Factor) -> Step | None:
    """Return the step that these equations lead to; None when it is not finite."""
    dx = normal.step(factor)
    change = change_of(normal.own_gradient, dx)
    conditions = normal.linear.conditions
    if conditions is not None:
        change -= float(conditions.e @ conditions.effect(dx[1]).e)
    if not change < float("inf"):
        return None
    return Step(dx, max(change, 0.0), normal, factor)


def change_of(sides: Unknowns, dx: Unknowns) -> float:
    """Return the squared change of the whitened residuals that solves for these sides."""
    return sum(float(np.vdot(side, of)) for side, of in zip(sides, dx, strict=True))


def equations_at(
    problem: Problem, structure: Structure, state: BlockState, linear: Linearised | None = None
) -> tuple[NormalEquations, Factor, Anchor | None]:
    """Return the equations at a state, their factor, and what holds a datum that is missing.

    Parameters
    ----------
    problem, structure, state
        The bundle, the structure of its normal equations, and where it is linearised.
    linear
        The bundle linearised there, where it is already.

    Raises
    ------
    LeftOpenError
        The observations leave something open there.
    """
    tie = anchor(problem, state) if problem.defect else None
    if linear is None:
        linear = linearise(problem, state)
    normal, factor = _determined(problem, structure, state, linear, tie)
    normal.offset_update(factor)
    return normal, factor, tie


def _determined(
    problem: Problem,
    structure: Structure,
    state: BlockState,
    linear: Linearised,
    tie: Anchor | None,
) -> tuple[NormalEquations, Factor]:
    """Return equations without damping and their factor, or say what is left open."""
    try:
        normal = NormalEquations(
            problem, structure, linear, 0.0, None if tie is None else tie.weights
        )
        return normal, normal.factor()
    except (PointError, NotPositiveError) as error:
        raise undetermined(problem, structure, state, linear, tie, error) from error
