"""The search for the minimum of a bundle, from nothing but its measurements."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.solve.datum import check_datum
from anaplot.bundle.solve.gaussnewton import (
    Minimum,
    NoConvergenceError,
    find_minimum,
)
from anaplot.bundle.solve.imaging import BlockState, with_additional
from anaplot.bundle.solve.linearised import objective
from anaplot.bundle.solve.openmovement import Solved, held_by_noise_at
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure, make_structure
from anaplot.bundle.start.approximate import (
    Way,
    approximate_ways,
    doubtful,
)
from anaplot.bundle.start.bysomepoints import oriented_by_some
from anaplot.bundle.start.controlremark import unsolved_error
from anaplot.bundle.start.freenetwork import from_free_network
from anaplot.bundle.start.otherplaces import at_other_places
from anaplot.bundle.start.pull import foreseen_torn, minimum_nearby, torn
from anaplot.bundle.start.regrown import regrown
from anaplot.bundle.start.robust import (
    RobustState,
    Waiting,
    robust_state,
)
from anaplot.bundle.start.settling import settled
from anaplot.bundle.start.stated import led_from_stated, without_stated
from anaplot.errors import NotComputableError

__all__ = ["Ahead", "best_minimum", "check_held", "fits", "soft"]


Ahead = Callable[[Problem, Structure, RobustState], tuple[BlockState, int] | None]
"""From a robust solution of a bundle that gross errors tear: where its minimum is, or nearly, and
how many steps lead there; None: not known."""


_FITS = 4.0  # sigma0 up to which a minimum is not held against others
_SOFT = 1e-4  # pivot over diagonal below which a minimum may hang on rounding or noise
_TRIES = 40  # steps from a start that has waited and misses by far
_CHANCE = 100  # rays up to which such a start may still lead there, by a long way round


def best_minimum(
    problem: Problem,
    progress: Progress | None,
    whole: Problem,
    first: BlockState | None = None,
    ahead: Ahead | None = None,
) -> tuple[Minimum, RobustState | None, Minimum | None]:
    """Return the best minimum of a bundle, from nothing but its measurements.

    One way after another to approximate values, until one leads to a minimum that fits the
    measurements. Where none does, because there are gross errors, the best minimum counts.

    Parameters
    ----------
    problem
        The bundle without additional parameters.
    progress
        Called with what is being done and the fraction of it.
    whole
        The bundle with those that the search does without.
    first
        Approximate values to begin with, where there are any.
    ahead
        Leads to the minimum of a large block that is torn where some of its points orient it.

    Returns
    -------
    Minimum, robust state or None, minimum or None
        The best minimum; a robust solution where one was looked for; the minimum of `whole`, where
        that was found on the way.

    Raises
    ------
    NotComputableError
        Something is not determined, or no solution is found; names photos and points.
    """
    try:
        return _searched(problem, progress, whole, first, ahead)
    except NotComputableError:
        # what is stated without a standard deviation has no part in a minimum, only in its search
        unled = without_stated(problem)
        if unled is None:
            raise
        with contextlib.suppress(NotComputableError):
            return _searched(unled, progress, whole, None, ahead)
        raise


def _searched(
    problem: Problem,
    progress: Progress | None,
    whole: Problem,
    first: BlockState | None,
    ahead: Ahead | None,
) -> tuple[Minimum, RobustState | None, Minimum | None]:
    best: Minimum | None = None
    closest: _Closest | None = None
    failure: NotComputableError | None = None
    reached: BlockState | None = None
    least = float("inf")

    def minimum(
        at: BlockState, structure: Structure, tries: int | None = None, led: int = 0
    ) -> Minimum | None:
        nonlocal best, failure, reached, least
        try:
            found = find_minimum(problem, at, structure, tries=tries, led=led, progress=progress)
        except NoConvergenceError as error:
            value = objective(problem, error.state)[0]
            if value < least:
                reached, least = error.state, value
            return None
        except NotComputableError as error:
            failure = failure or error
            return None
        except np.linalg.LinAlgError:
            return None
        if best is None or found.convergence.last < best.convergence.last:
            best = found
        return found

    def robust(at: BlockState, structure: Structure, of_some: bool = False) -> RobustState | None:
        nonlocal closest
        try:
            solution = robust_state(problem, structure, at, of_some=of_some, progress=progress)
        except (NotComputableError, np.linalg.LinAlgError):
            return None
        if closest is None or solution.better_than(closest.solution, problem):
            closest = _Closest(solution, structure)
        return solution

    def foreseen(structure: Structure, solution: RobustState | None) -> Minimum | None:
        if ahead is None or solution is None or solution.rays_off == 0:
            return None
        try:
            there = ahead(problem, structure, solution)
        except (NotComputableError, np.linalg.LinAlgError):
            return None
        return None if there is None else minimum(there[0], structure, led=there[1])

    def grown(solution: RobustState) -> BlockState | None:
        try:
            return regrown(problem, solution.state)
        except (NotComputableError, np.linalg.LinAlgError):
            return None

    ways = approximate_ways(problem)
    if first is not None:
        ways.insert(0, Way(lambda _: first))
    seen: list[BlockState] = []  # ways may end in the same place, as where all is stated
    waiting: list[Waiting] = []
    tried: RobustState | None = None  # the best from which everything was tried, if it orients
    while ways or waiting:
        # of those that have waited, the one from which most rays agree first
        new = bool(ways)
        waiting.sort(key=lambda one: one.rays_off)
        way = ways.pop(0) if new else None
        known = None if new else waiting[0].solution
        if known is not None and tried is not None and not known.better_than(tried, problem):
            # most photos are oriented by both, and no fewer rays are off
            waiting.pop(0)
            continue
        try:
            start = way.find(progress) if way is not None else waiting.pop(0).start
            if start is None or (new and any(_same(start, other) for other in seen)):
                continue
            if new:
                seen.append(start)
            structure = make_structure(problem, start.centres)
        except NotComputableError as error:
            failure = failure or error
            continue
        except np.linalg.LinAlgError:
            continue
        # what is not determined is so from every start
        check_datum(problem, start)
        unsure = doubtful(problem, start)
        hopeless = unsure and len(problem.photo) > _CHANCE
        if unsure and closest is not None and closest.solution.agrees(problem):
            # what misses by far cannot fit better
            continue
        wait = new and (bool(ways) or bool(waiting))
        if known is not None and known.grounded and foreseen_torn(problem, structure, known):
            # gross errors alone keep it from fitting: what least squares make of them means nothing
            tried = known
            continue
        begun = start
        some = oriented_by_some(problem, start, progress) if new else None
        if some is not None:
            start = some
        tries = _TRIES if way is None else way.tries
        solution, found = None, None
        if (
            some is not None
            and ahead is not None
            and not _fits(problem, objective(problem, some)[0])
        ):
            solution = robust(start, structure, of_some=True)
            found = foreseen(structure, solution)
        if found is None:
            found = minimum(start, structure, tries if wait or hopeless else None)
        if found is not None and fits(problem, found):
            break
        if found is None and wait and unsure:
            waiting.append(Waiting(start, None))
            continue
        # no gross error is looked for where a lens that is unknown yet bends everything
        by_lens = None if found is None else _explained_by_lens(whole, found, progress)
        if found is not None and by_lens is not None:
            return found, None, by_lens
        # the start hangs less on the last digits than where a search among gross errors ended
        if solution is None:
            solution = robust(start, structure, of_some=some is not None)
        while solution is not None and not solution.explains(problem):
            again = grown(solution)
            other = None if again is None else robust(again, structure)
            if again is None or other is None or not other.better_than(solution, problem):
                break
            start, solution = again, other
        if (
            found is not None
            and solution is not None
            and solution.control_off == 0
            and led_from_stated(problem, begun, found.state)
        ):
            # two witnesses for the orientations: what does not fit, does so for another reason
            break
        if wait and not (solution is not None and solution.agrees(problem)):
            waiting.append(Waiting(start, solution))
            continue
        if found is None and hopeless and solution is not None and solution.misleads(problem):
            continue
        if found is not None and not (solution and solution.explains(problem)):
            other = robust(found.state, structure)
            if solution is None or (other is not None and other.better_than(solution, problem)):
                solution = other
        in_vain = solution is not None and foreseen_torn(problem, structure, solution)
        if solution is not None and not in_vain and not _led_there(problem, solution, found):
            found = minimum(solution.state, structure)
            if found is not None and fits(problem, found):
                break
        if problem.datum == "control" and (
            solution is None or not solution.grounded or not solution.explains(problem)
        ):
            oriented = solution is not None and solution.orients(problem)
            beginning = solution.state if solution is not None and oriented else start
            laid = from_free_network(problem, beginning, progress)
            if laid is not None:
                other = robust(laid, structure)
                in_vain = other is not None and foreseen_torn(problem, structure, other)
                found = None if in_vain else minimum(laid, structure)
                if other and not in_vain and (found is None or not fits(problem, found)):
                    found = minimum(other.state, structure)
                if other and (solution is None or other.better_than(solution, problem)):
                    solution = other
                if found is not None and fits(problem, found):
                    break
        # gross errors explain it: other ways lead to the same, unless this one missed the ground
        explained = solution is not None and solution.explains(problem)
        missed = best is None and solution is not None and not solution.grounded
        if explained and not missed:
            break
        if solution is not None and solution.orients(problem):
            tried = solution
    if best is not None and not (
        closest and torn(problem, best.convergence.last, closest.solution)
    ):
        seen_from = None if closest is None else closest.solution
        elsewhere = at_other_places(problem, best, progress)
        if elsewhere is not best:
            best, seen_from = elsewhere, None
        _check_minimum(problem, best, None if seen_from is None else seen_from.state)
        return best, seen_from, None
    if closest is not None and not (failure and closest.solution.misleads(problem)):
        led, solution = _led_to(problem, closest, reached, progress)
        elsewhere = at_other_places(problem, led, progress)
        return elsewhere, (solution if elsewhere is led else None), None
    if failure is None:
        failure = NotComputableError(
            f"block {problem.block.name}: no approximate values found: the measurements "
            "contradict each other"
        )
    raise failure


def _same(start: BlockState, other: BlockState) -> bool:
    return np.array_equal(start.centres, other.centres) and np.array_equal(
        start.rotations, other.rotations
    )


def _explained_by_lens(whole: Problem, found: Minimum, progress: Progress | None) -> Minimum | None:
    """Return the minimum with a lens where nothing else is missing: with its parameters, all fits.

    None where something is.
    """
    if whole.lens_units is None or whole.photo_invariant:
        return None
    start = with_additional(whole, found.state)
    try:
        structure = make_structure(whole, start.centres)
        explained = find_minimum(whole, start, structure, progress=progress)
    except (NotComputableError, np.linalg.LinAlgError):
        return None
    return explained if fits(whole, explained) else None


def _led_to(
    problem: Problem, closest: _Closest, reached: BlockState | None, progress: Progress | None
) -> tuple[Minimum, RobustState]:
    """Return the minimum near the robust solution, and that.

    A few wild measurements may bend everything else out of shape. The search then goes round
    corners, and where it ends hangs on the last digits: such a minimum is none of the block's.
    """
    structure = closest.structure
    solution = settled(problem, structure, closest.solution)
    try:
        found = minimum_nearby(problem, structure, solution.state, progress=progress)
    except NoConvergenceError as error:
        best = error.state if reached is None else reached
        raise unsolved_error(problem, structure, solution.state, best) from error
    if found is None:
        raise unsolved_error(problem, structure, solution.state)
    _check_minimum(problem, found, solution.state)
    return found, solution


def _check_minimum(problem: Problem, found: Minimum, other: BlockState | None) -> None:
    """Raise NoConvergenceError where a minimum may hang on errors, and does."""
    if soft(found) or not fits(problem, found):
        check_held(problem, found, other)


def soft(found: Minimum) -> bool:
    """Whether a minimum may hang on rounding or noise."""
    return found.convergence.damped > 0 or found.factor.smallest < _SOFT


def check_held(problem: Problem, found: Minimum, other: BlockState | None) -> None:
    """Raise NoConvergenceError where nothing but errors makes a minimum.

    Measurements without error would leave something open there. Gross errors may hide it: it is
    looked for at the minimum, and where they have lost their pull (or where the search began).
    """
    places: list[tuple[BlockState, Solved | None]] = []
    if other is not None:
        places.append((other, None))
    places.append((found.state, (found.normal, found.factor)))
    by_noise = held_by_noise_at(problem, found.normal.structure, places)
    if by_noise is not None:
        raise NoConvergenceError(*by_noise)


class _Closest(NamedTuple):
    """The robust solution that fits best, and the structure of its equations."""

    solution: RobustState
    structure: Structure


def fits(problem: Problem, found: Minimum) -> bool:
    """Whether a minimum fits the measurements so well that it is not held against others."""
    return _fits(problem, found.convergence.last)


def _fits(problem: Problem, vtpv: float) -> bool:
    return vtpv <= _FITS**2 * max(problem.redundancy, 1)


def _led_there(problem: Problem, solution: RobustState, found: Minimum | None) -> bool:
    """Whether a minimum is the one that a robust solution with a few gross errors leads to."""
    if found is None or not solution.explains(problem):
        return False
    return found.convergence.last <= objective(problem, solution.state)[0]
