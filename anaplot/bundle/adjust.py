"""The bundle adjustment: a minimum, then exact reliability of everything."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from math import sqrt

import numpy as np

from anaplot.aliases import Bools, Progress
from anaplot.bundle.imagesigma import SigmaDoubt, doubt_of
from anaplot.bundle.solve.additional import AdditionalParameters
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.datum import check_datum, datum_change, rescaled
from anaplot.bundle.solve.gaussnewton import (
    Minimum,
    NoConvergenceError,
    find_minimum,
)
from anaplot.bundle.solve.imaging import BlockState, RobustPlace, with_additional
from anaplot.bundle.solve.linearised import objective
from anaplot.bundle.solve.openmovement import parameters_left_open
from anaplot.bundle.solve.problem import Datum, Problem, make_problem
from anaplot.bundle.solve.reliability import Cofactors, compute_cofactors
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.bestminimum import Ahead, best_minimum, check_held, fits, soft
from anaplot.bundle.start.controlremark import WithoutControl, unsolved_error
from anaplot.bundle.start.halfrays import (
    half_seen,
    settled_points,
    unchecked,
    without_doubtful,
)
from anaplot.bundle.start.lockedangles import locked_angles
from anaplot.bundle.start.parallelrays import with_meeting, without_parallel
from anaplot.bundle.start.pull import TORN
from anaplot.bundle.start.robustsuspects import robust_suspects
from anaplot.bundle.start.stated import stated_remarks
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = [
    "adjust_block",
    "adjust_bundle",
    "adjust_problem",
    "calibrated",
    "evaluate",
    "points_settled",
]

_MOST_ROUNDS = 3  # of points whose rays are seen to be parallel
_MOST_BEHIND = 10  # remarks on points behind photos
_FEW_RAYS = 10_000  # up to which a block that does not fit is compared with its mirror image


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
                found, robust, _ = best_minimum(firm.bare, progress, firm)
                # gross errors bend photographs until planes meet that are the same
                state = found.state if robust is None else robust.state
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
    if not fits(bare, found):
        return kept, start
    more, there = settled_points(problem, kept, found.state)
    return (more, there) if len(more.points) > len(kept.points) else (kept, found.state)


def adjust_problem(
    problem: Problem,
    *,
    start: BlockState | None = None,
    ahead: Ahead | None = None,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Adjust a bundle from nothing but its measurements.

    One way after another to approximate values, until one leads to a minimum that fits the
    measurements. Where none does, because there are gross errors, the best minimum counts. Points
    that half rays do not determine are left out; so are, where there is no solution with them,
    points whose rays do not meet at an angle.

    Parameters
    ----------
    problem
        The bundle.
    start
        Approximate values to begin with, without additional parameters, where there are any.
    ahead
        As `best_minimum` has it.
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
            return _but_parallel(problem, start, ahead, progress)
    except np.linalg.LinAlgError as error:
        raise NotComputableError(
            f"block {problem.block.name}: no approximate values found: the measurements "
            "contradict each other"
        ) from error


def _but_parallel(
    problem: Problem, start: BlockState | None, ahead: Ahead | None, progress: Progress | None
) -> AdjustedBlock:
    """Adjust a bundle, and leave out the points of parallel rays where these leave it unsolved."""
    try:
        return _adjusted(problem, start, ahead, progress)
    except NotComputableError as error:
        smaller = without_parallel(problem, error)
        for _ in range(_MOST_ROUNDS):
            if smaller is None:
                break
            try:
                found = _adjusted(*smaller, None, progress)
            except np.linalg.LinAlgError:
                break
            except NotComputableError as other:
                smaller = without_parallel(smaller[0], other)
                continue
            more = with_meeting(problem, smaller[0], found.state)
            with contextlib.suppress(NotComputableError, np.linalg.LinAlgError):
                found = found if more is None else _adjusted(*more, None, progress)
            return found
        raise


def _adjusted(
    problem: Problem, start: BlockState | None, ahead: Ahead | None, progress: Progress | None
) -> AdjustedBlock:
    bare = problem.bare
    found, robust, whole = best_minimum(bare, progress, problem, start, ahead)
    there = None if robust is None else robust.place
    if bare is problem:
        return evaluate(problem, found, robust=there, progress=progress)
    # orientations wait neither for additional parameters nor for conditions between points
    return calibrated(problem, found.state, robust=there, found=whole, progress=progress)


def calibrated(
    problem: Problem,
    bare: BlockState,
    *,
    robust: RobustPlace | None = None,
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
            robust=None if robust is None else with_additional(problem, robust.state),
            found=found,
            progress=progress,
        )
    except NoConvergenceError as error:
        if not problem.frees_parameters:
            raise
        # there is a minimum without them
        there = with_additional(problem, bare)
        raise NoConvergenceError(parameters_left_open(problem, there), error.state) from error


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
    check_datum(problem, start)
    try:
        found = found or find_minimum(problem, start, structure, progress=progress)
    except NoConvergenceError as error:
        if not objective(problem, start)[0] < float("inf"):
            raise
        raise unsolved_error(problem, structure, start, error.state) from error
    # of additional parameters only the rank is judged: weak ones have large standard deviations
    if soft(found) and problem.additional is None:
        check_held(problem, found, start if robust is None else robust)
    there = None if robust is None else RobustPlace(robust)
    return evaluate(problem, found, robust=there, progress=progress)


def evaluate(
    problem: Problem,
    found: Minimum,
    *,
    robust: RobustPlace | None = None,
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
    doubt = doubt_of(linear.e, cofactors.r, problem.block.precision.image_um)
    warnings, of_control = _warnings(problem, found, sigma0, robust, doubt)
    return AdjustedBlock(
        problem=problem,
        state=found.state,
        cofactors=cofactors,
        convergence=found.convergence,
        vtpv=vtpv,
        redundancy=redundancy,
        v=linear.e,
        warnings=tuple(warnings),
        robust=robust,
        of_control=of_control,
    )


def _behind(problem: Problem, behind: Bools) -> list[str]:
    """Say which points lie behind their photos; where most of a photo's do, the photo is wrong."""
    rays, gone = (
        np.bincount(photos, minlength=len(problem.photos))
        for photos in (problem.photo, problem.photo[behind])
    )
    turned = 2 * gone > rays
    out = [
        f"{gone[photo]} of {rays[photo]} points of photo {problem.photos[photo]} lie behind it: it "
        "has another place, too little tells which"
        for photo in np.flatnonzero(turned)[:_MOST_BEHIND].tolist()
    ]
    out += [
        f"point {problem.points[problem.point[k]]} lies behind photo "
        f"{problem.photos[problem.photo[k]]}: remeasure it"
        for k in np.flatnonzero(behind & ~turned[problem.photo])[:_MOST_BEHIND].tolist()
    ]
    return out[:_MOST_BEHIND]


def _warnings(
    problem: Problem,
    found: Minimum,
    sigma0: float | None,
    robust: RobustPlace | None,
    doubt: SigmaDoubt | None,
) -> tuple[list[str], str | None]:
    """Return what is said of a solution, and of it what is wrong with control as a whole."""
    linear = found.normal.linear
    out = []
    out += _behind(problem, linear.depth <= 0.0)
    out += stated_remarks(problem, found.state)
    locked = locked_angles(problem)
    if locked is not None:
        out.append(locked)
    if problem.redundancy == 0:
        out.append("no redundancy: nothing is checked")
    torn = sigma0 is not None and sigma0 > TORN
    start = RobustPlace(found.state) if robust is None else robust
    remark, without = None, WithoutControl(problem, start.state)
    # the free network takes about as long as the adjustment
    if torn or (len(problem.photo) <= _FEW_RAYS and not fits(problem, found)):
        remark = without.remark
    if torn and (doubt is None or remark is not None):
        worst = robust_suspects(problem, found.normal.structure, start)
        out.append(
            f"sigma0 is {sigma0:.0f} times what was expected: there are gross errors"
            + "".join(f"; {suspect.what} is off by {suspect.size}" for suspect in worst[:3])
        )
    of_control = None if remark is None else remark.text
    if of_control is not None:
        out.append(of_control)
    elif doubt is not None:
        # control makes no residual smaller
        bent = doubt.factor > 1.0 and without.agree
        stated = bool(np.isfinite(problem.prior_sigma).any())
        out.append(doubt.of_given(stated=stated) if bent else str(doubt))
    return out, of_control
