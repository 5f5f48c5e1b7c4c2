"""The bundle adjustment: a minimum, then exact reliability of everything."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Progress
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import check_datum, datum_change, rescaled
from anaplot.bundle.solve.gaussnewton import (
    Minimum,
    NoConvergenceError,
    find_minimum,
)
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.linearised import linearise, objective
from anaplot.bundle.solve.openmovement import held_by_noise, parameters_left_open
from anaplot.bundle.solve.problem import Datum, Problem, make_problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.structure import Structure, make_structure
from anaplot.bundle.start.approximate import (
    Way,
    approximate_ways,
    doubtful,
)
from anaplot.bundle.start.freenetwork import from_free_network
from anaplot.bundle.start.halfrays import (
    half_seen,
    settled_points,
    unchecked,
    without_doubtful,
)
from anaplot.bundle.start.pull import TORN, foreseen_torn, minimum_nearby, torn
from anaplot.bundle.start.robust import (
    RobustState,
    Waiting,
    no_minimum_error,
    robust_state,
    robust_suspects,
)
from anaplot.bundle.start.settling import settled
from anaplot.bundle.start.stated import led_from_stated, stated_remarks
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = [
    "adjust_block",
    "adjust_bundle",
    "adjust_problem",
    "calibrated",
    "evaluate",
    "points_settled",
    "with_additional",
]


_FITS = 4.0  # sigma0 up to which a minimum is not held against others
_SOFT = 1e-8  # pivot over diagonal below which a minimum may hang on rounding or noise
_TRIES = 40  # steps from a start that has waited and misses by far
_CHANCE = 100  # rays up to which such a start may still lead there, by a long way round


def adjust_block(
    block: Block,
    *,
    datum: Datum = "control",
    additional: AdditionalParameters | None = None,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Adjust a block as one bundle, from nothing but its measurements.

    Parameters
    ----------
    block
        The block.
    datum
        "control": control and priors as declared; "free": inner constraints over the points;
        "minimal": seven coordinates.
    additional
        Additional parameters for self-calibration.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    InputError
        The block cannot be a bundle at all (no image points, a sigma that is none).
    NotComputableError
        Something is not determined, or no solution is found; names photos and points.
    """
    problem = make_problem(block, datum=datum, additional=additional)
    return adjust_problem(problem, progress=progress)


def points_settled(
    problem: Problem, *, progress: Progress | None = None
) -> tuple[Problem, BlockState | None]:
    """Leave out the points that half rays do not determine, as the orientations tell.

    Parameters
    ----------
    problem
        The bundle.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    Bundle, and state or None
        The bundle without them, and approximate values of it without additional parameters; the
        bundle itself and None where no half rays are in doubt, or photos hang on such points.
    """
    every, few = half_seen(problem), unchecked(problem)
    for in_doubt in (every,) if bool((every == few).all()) else (every, few):
        firm = without_doubtful(problem, in_doubt)
        if firm is None:
            continue
        try:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                found, robust, _ = _searched(firm.bare, progress, firm)
                # gross errors bend photographs until planes meet that are the same
                state = found.state if robust is None else robust
                return _looked_at_again(problem, *settled_points(problem, firm, state))
        except (NotComputableError, np.linalg.LinAlgError):
            continue
    # they are not looked for again
    return (replace(problem, undetermined={}) if every.any() else problem), None


def _looked_at_again(
    problem: Problem, kept: Problem, start: BlockState
) -> tuple[Problem, BlockState]:
    """Take in what turns out to be determined once the points in doubt carry the photos, too."""
    if not kept.undetermined:
        return kept, start
    bare = kept.bare
    try:
        found = find_minimum(bare, start, make_structure(bare, start.centres))
    except (NotComputableError, np.linalg.LinAlgError):
        return kept, start
    if not _fits(bare, found):
        return kept, start
    more, there = settled_points(problem, kept, found.state)
    return (more, there) if len(more.points) > len(kept.points) else (kept, found.state)


def adjust_problem(
    problem: Problem, *, start: BlockState | None = None, progress: Progress | None = None
) -> AdjustedBlock:
    """Adjust a bundle from nothing but its measurements.

    One way after another to approximate values, until one leads to a minimum that fits the
    measurements. Where none does, because there are gross errors, the best minimum counts. Points
    that half rays do not determine are left out.

    Parameters
    ----------
    problem
        The bundle.
    start
        Approximate values to begin with, without additional parameters, where there are any.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NotComputableError
        As `adjust_block`.
    """
    try:
        # whatever bad data makes infinite on the way is looked at where it matters
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            if start is None:
                problem, start = points_settled(problem, progress=progress)
            return _adjusted(problem, start, progress)
    except np.linalg.LinAlgError as error:
        raise NotComputableError(
            f"block {problem.block.name}: no approximate values found: the measurements "
            "contradict each other"
        ) from error


def _adjusted(
    problem: Problem, start: BlockState | None, progress: Progress | None
) -> AdjustedBlock:
    bare = problem.bare
    found, robust, whole = _searched(bare, progress, problem, start)
    if bare is problem:
        return evaluate(problem, found, robust=robust, progress=progress)
    # orientations wait neither for additional parameters nor for conditions between points
    return calibrated(problem, found.state, robust=robust, found=whole, progress=progress)


def calibrated(
    problem: Problem,
    bare: BlockState,
    *,
    robust: BlockState | None = None,
    found: Minimum | None = None,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Adjust a bundle with additional parameters and conditions from its minimum without them.

    Parameters
    ----------
    problem
        The bundle.
    bare
        The minimum of `problem.bare`.
    robust
        A robust solution of `problem.bare`, if there is one.
    found
        The minimum that is reached from there, where it is known.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NotComputableError
        The parameters are not determined: as far as rounding tells, or they run away. Parameters
        that are only weak are adjusted, and their standard deviations say so.
    """
    try:
        return adjust_bundle(
            problem,
            with_additional(problem, bare),
            robust=None if robust is None else with_additional(problem, robust),
            found=found,
            progress=progress,
        )
    except NoConvergenceError as error:
        if not problem.frees_parameters:
            raise
        # there is a minimum without them
        there = with_additional(problem, bare)
        raise NoConvergenceError(parameters_left_open(problem, there), error.state) from error


def with_additional(problem: Problem, state: BlockState) -> BlockState:
    """Return the state of the bundle without additional parameters for the one that has some."""
    given, own = problem.additional_given, problem.photo_invariant
    return replace(
        state,
        own=given if own else np.zeros((len(problem.photos), 0)),
        shared=np.zeros(0) if own else given.ravel(),
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
    return explained if _fits(whole, explained) else None


def _searched(
    problem: Problem, progress: Progress | None, whole: Problem, first: BlockState | None = None
) -> tuple[Minimum, BlockState | None, Minimum | None]:
    """Return the best minimum, and a robust solution where one was looked for.

    The search begins from `first`, where that is known. `whole` is the bundle with the additional
    parameters that the search does without; its minimum is the third where that was found on the
    way.
    """
    best: Minimum | None = None
    closest: _Closest | None = None
    failure: NotComputableError | None = None
    reached: BlockState | None = None
    least = float("inf")

    def minimum(at: BlockState, structure: Structure, tries: int | None = None) -> Minimum | None:
        nonlocal best, failure, reached, least
        try:
            found = find_minimum(problem, at, structure, tries=tries, progress=progress)
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

    def robust(at: BlockState, structure: Structure) -> RobustState | None:
        nonlocal closest
        try:
            solution = robust_state(problem, structure, at, progress=progress)
        except (NotComputableError, np.linalg.LinAlgError):
            return None
        if closest is None or solution.off < closest.solution.off:
            closest = _Closest(solution, structure)
        return solution

    ways = approximate_ways(problem)
    if first is not None:
        ways.insert(0, Way(lambda _: first))
    waiting: list[Waiting] = []
    tried: RobustState | None = None  # the best from which everything was tried, if it orients
    while ways or waiting:
        # of those that have waited, the one from which most rays agree first
        new = bool(ways)
        waiting.sort(key=lambda one: one.rays_off)
        way = ways.pop(0) if new else None
        known = None if new else waiting[0].solution
        if known is not None and tried is not None and known.off >= tried.off:
            # most photos are oriented by both, and no fewer rays are off
            waiting.pop(0)
            continue
        try:
            start = way.find(progress) if way is not None else waiting.pop(0).start
            if start is None:
                continue
            structure = make_structure(problem, start.centres)
        except NotComputableError as error:
            failure = failure or error
            continue
        except np.linalg.LinAlgError:
            continue
        # what is not determined is so from every start
        check_datum(problem, start, linearise(problem, start))
        unsure = doubtful(problem, start)
        hopeless = unsure and len(problem.photo) > _CHANCE
        if unsure and closest is not None and closest.solution.agrees(problem):
            # what misses by far cannot fit better
            continue
        wait = new and (bool(ways) or bool(waiting))
        if known is not None and foreseen_torn(problem, structure, known):
            # gross errors alone keep it from fitting: what least squares make of them means nothing
            tried = known
            continue
        tries = _TRIES if way is None else way.tries
        found = minimum(start, structure, tries if wait or hopeless else None)
        if found is not None and _fits(problem, found):
            break
        if found is None and wait and unsure:
            waiting.append(Waiting(start, None))
            continue
        # no gross error is looked for where a lens that is unknown yet bends everything
        by_lens = None if found is None else _explained_by_lens(whole, found, progress)
        if found is not None and by_lens is not None:
            return found, None, by_lens
        # the start hangs less on the last digits than where a search among gross errors ended
        solution = robust(start, structure)
        if (
            found is not None
            and solution is not None
            and solution.control_off == 0
            and led_from_stated(problem, start, found.state)
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
            if solution is None or (other is not None and other.off < solution.off):
                solution = other
        in_vain = solution is not None and foreseen_torn(problem, structure, solution)
        if solution is not None and not in_vain and not _led_there(problem, solution, found):
            found = minimum(solution.state, structure)
            if found is not None and _fits(problem, found):
                break
        if problem.datum == "control" and (
            solution is None or solution.control_off > 0 or not solution.explains(problem)
        ):
            laid = from_free_network(problem, start, progress)
            if laid is not None:
                other = robust(laid, structure)
                found = minimum(laid, structure)
                if other is not None and (found is None or not _fits(problem, found)):
                    found = minimum(other.state, structure)
                if other is not None and (solution is None or other.off < solution.off):
                    solution = other
                if found is not None and _fits(problem, found):
                    break
        # gross errors explain it: other ways lead to the same, unless this one missed the ground
        explained = solution is not None and solution.explains(problem)
        missed = best is None and solution is not None and solution.control_off > 0
        if explained and not missed:
            break
        if solution is not None and solution.orients(problem):
            tried = solution
    if best is not None and not (
        closest and torn(problem, best.convergence.last, closest.solution)
    ):
        seen_from = None if closest is None else closest.solution.state
        _check_minimum(problem, best, seen_from)
        return best, seen_from, None
    if closest is not None and not (failure and closest.solution.misleads(problem)):
        return *_led_to(problem, closest, reached, progress), None
    if failure is None:
        failure = NotComputableError(
            f"block {problem.block.name}: no approximate values found: the measurements "
            "contradict each other"
        )
    raise failure


def _led_to(
    problem: Problem, closest: _Closest, reached: BlockState | None, progress: Progress | None
) -> tuple[Minimum, BlockState]:
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
        raise no_minimum_error(problem, structure, solution.state, best) from error
    if found is None:
        raise no_minimum_error(problem, structure, solution.state)
    _check_minimum(problem, found, solution.state)
    return found, solution.state


def _check_minimum(problem: Problem, found: Minimum, other: BlockState | None) -> None:
    """Raise NoConvergenceError where a minimum may hang on errors, and does."""
    soft = found.convergence.damped > 0 or found.factor.smallest < _SOFT
    if soft or not _fits(problem, found):
        _check_held(problem, found, other)


def _check_held(problem: Problem, found: Minimum, other: BlockState | None) -> None:
    """Raise NoConvergenceError where nothing but errors makes a minimum.

    Measurements without error would leave something open there. Gross errors may hide it: it is
    looked for at the minimum, and where they have lost their pull (or where the search began).
    """
    known = found.normal, found.factor
    places = [(found.state, known)] if other is None else [(other, None), (found.state, known)]
    for at, solved in places:
        by_noise = held_by_noise(problem, found.normal.structure, at, solved)
        if by_noise is not None:
            raise NoConvergenceError(by_noise, at)


class _Closest(NamedTuple):
    """The robust solution that fits best, and the structure of its equations."""

    solution: RobustState
    structure: Structure


def _fits(problem: Problem, found: Minimum) -> bool:
    return found.convergence.last <= _FITS**2 * max(problem.redundancy, 1)


def _led_there(problem: Problem, solution: RobustState, found: Minimum | None) -> bool:
    """Whether a minimum is the one that a robust solution with a few gross errors leads to."""
    if found is None or not solution.explains(problem):
        return False
    return found.convergence.last <= objective(problem, solution.state)[0]


def adjust_bundle(
    problem: Problem,
    start: BlockState,
    *,
    robust: BlockState | None = None,
    found: Minimum | None = None,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Adjust a bundle and compute the reliability of every observation.

    Parameters
    ----------
    problem
        The bundle.
    start
        Approximate values.
    robust
        A robust solution, if there is one: where the search for gross errors starts.
    found
        The minimum that is reached from there, where it is known.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NotComputableError
        The observations do not determine everything (photos, points or parts are named), or no
        minimum is found (the observations that disagree most are named); conditions free of error
        depend on each other or on control free of error.
    """
    start = rescaled(problem, start)
    robust = None if robust is None else rescaled(problem, robust)
    structure = make_structure(problem, start.centres)
    check_datum(problem, start, linearise(problem, start))
    try:
        found = found or find_minimum(problem, start, structure, progress=progress)
    except NoConvergenceError as error:
        if not objective(problem, start)[0] < float("inf"):
            raise
        raise no_minimum_error(problem, structure, start, error.state) from error
    soft = found.convergence.damped > 0 or found.factor.smallest < _SOFT
    # of additional parameters only the rank is judged: weak ones have large standard deviations
    if soft and problem.additional is None:
        _check_held(problem, found, start if robust is None else robust)
    return evaluate(problem, found, robust=robust, progress=progress)


def evaluate(
    problem: Problem,
    found: Minimum,
    *,
    robust: BlockState | None = None,
    cofactors: Cofactors | None = None,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Compute cofactors, tests and remarks at a minimum.

    Parameters
    ----------
    problem, found
        The bundle and its minimum.
    robust
        A robust solution, if there is one: where the search for gross errors starts.
    cofactors
        Those of the minimum in the datum of the solution, where they are known.
    progress
        Called with what is being done and the fraction of it.
    """
    change = None if found.anchor is None else datum_change(problem, found.state, found.anchor)
    if cofactors is None or change is not None:
        cofactors = compute_cofactors(
            found.normal,
            found.factor,
            change,
            None if progress is None else (lambda f: progress("reliability", f)),
        )
    linear = found.normal.linear
    redundancy = problem.redundancy
    vtpv = linear.vtpv
    sigma0 = sqrt(vtpv / redundancy) if redundancy > 0 else None
    return AdjustedBlock(
        problem=problem,
        state=found.state,
        cofactors=cofactors,
        convergence=found.convergence,
        vtpv=vtpv,
        redundancy=redundancy,
        v=linear.e,
        warnings=tuple(_warnings(problem, found, sigma0, robust)),
        robust=robust,
    )


def _warnings(
    problem: Problem, found: Minimum, sigma0: float | None, robust: BlockState | None
) -> list[str]:
    linear = found.normal.linear
    out = []
    behind = np.nonzero(linear.depth <= 0.0)[0]
    for k in behind[:10].tolist():
        out.append(
            f"point {problem.points[problem.point[k]]} lies behind photo "
            f"{problem.photos[problem.photo[k]]}: remeasure it"
        )
    out += stated_remarks(problem, found.state)
    if problem.redundancy == 0:
        out.append("no redundancy: nothing is checked")
    if sigma0 is not None and sigma0 > TORN:
        worst = robust_suspects(
            problem, found.normal.structure, found.state if robust is None else robust
        )
        out.append(
            f"sigma0 is {sigma0:.0f} times what was expected: there are gross errors"
            + "".join(f"; {suspect.what} is off by {suspect.size}" for suspect in worst[:3])
        )
    return out
