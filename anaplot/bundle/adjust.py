"""The bundle adjustment: a minimum, then exact reliability of everything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import sqrt

import numpy as np

from anaplot.adjustment.significance import critical_normal, critical_tau
from anaplot.bundle.additional import AdditionalParameters
from anaplot.bundle.adjusted import AdjustedBlock
from anaplot.bundle.approximate import approximate_state, laid_onto_control
from anaplot.bundle.datum import check_datum, datum_change
from anaplot.bundle.minimum import Found, NoConvergenceError, find_minimum, robust_suspects
from anaplot.bundle.normal import State, Structure, linearise, make_structure
from anaplot.bundle.problem import Datum, Problem, make_problem
from anaplot.bundle.reliability import compute_cofactors
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.block import Block

__all__ = ["adjust_block", "adjust_bundle", "evaluate"]

Progress = Callable[[str, float], None]

_TORN = 50.0  # sigma0 above which a robust solution is asked for the culprit


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
    try:
        # whatever bad data makes infinite on the way is looked at where it matters
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return _adjusted(block, datum, additional, progress)
    except np.linalg.LinAlgError as error:
        raise NotComputableError(
            f"block {block.name}: no approximate values found: the measurements contradict each "
            "other"
        ) from error


def _adjusted(
    block: Block,
    datum: Datum,
    additional: AdditionalParameters | None,
    progress: Progress | None,
) -> AdjustedBlock:
    problem = make_problem(block, datum=datum, additional=additional)
    failure: NotComputableError | None = None
    for bridging in (True, False) if block.strips else (False,):
        try:
            start = approximate_state(problem, progress, bridging=bridging)
        except NotComputableError as error:
            failure = failure or error
            continue
        try:
            return adjust_bundle(problem, start, progress=progress)
        except NoConvergenceError as error:
            failure = failure or error
            if datum != "control":
                continue
        better = _from_free_network(problem, start, progress)
        if better is not None:
            try:
                return adjust_bundle(problem, better, progress=progress)
            except NoConvergenceError:
                continue
    assert failure is not None
    raise failure


def _from_free_network(problem: Problem, start: State, progress: Progress | None) -> State | None:
    """Approximate values by way of the free network, in which control pulls at nothing.

    None when there is none.
    """
    block = problem.block
    free = make_problem(block, datum="free")
    if free.photos != problem.photos or free.points != problem.points:
        return None
    try:
        structure = make_structure(free, start.centres)
        bare = replace(start, own=start.own[:, :0], shared=start.shared[:0])
        check_datum(free, bare, linearise(free, bare))
        found = find_minimum(free, bare, structure, progress=progress)
    except NotComputableError:
        return None
    return laid_onto_control(problem, found.state)


def adjust_bundle(
    problem: Problem,
    start: State,
    *,
    structure: Structure | None = None,
    progress: Progress | None = None,
) -> AdjustedBlock:
    """Adjust a bundle and compute the reliability of every observation.

    Parameters
    ----------
    problem
        The bundle.
    start
        Approximate values.
    structure
        Of the normal equations, when it is already known.
    progress
        Called with what is being done and the fraction of it.

    Raises
    ------
    NotComputableError
        The observations do not determine everything (photos, points or parts are named), or no
        minimum is found (the observations that disagree most are named).
    """
    if structure is None:
        structure = make_structure(problem, start.centres)
    check_datum(problem, start, linearise(problem, start))
    found = find_minimum(problem, start, structure, progress=progress)
    return evaluate(problem, found, progress=progress)


def evaluate(problem: Problem, found: Found, *, progress: Progress | None = None) -> AdjustedBlock:
    """Compute cofactors, tests and remarks at a minimum."""
    change = None if found.anchor is None else datum_change(problem, found.state, found.anchor)
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
    test = problem.test
    if test.kind == "tau":
        sigma, critical = sigma0, critical_tau(test.alpha, redundancy)
    else:
        sigma, critical = 1.0, critical_normal(test.alpha) if redundancy > 0 else None
    return AdjustedBlock(
        problem=problem,
        state=found.state,
        cofactors=cofactors,
        convergence=found.convergence,
        vtpv=vtpv,
        redundancy=redundancy,
        sigma0=sigma0,
        sigma=sigma,
        critical=critical,
        v=linear.e,
        remarks=tuple(_remarks(problem, found, sigma0)),
    )


def _remarks(problem: Problem, found: Found, sigma0: float | None) -> list[str]:
    linear = found.normal.linear
    out = [f"{o.kind} {o.name} is left out: it {o.reason}" for o in problem.left_out[:20]]
    if len(problem.left_out) > 20:
        out.append(f"{len(problem.left_out) - 20} more are left out")
    behind = np.nonzero(linear.depth <= 0.0)[0]
    for k in behind[:10].tolist():
        out.append(
            f"point {problem.points[problem.point[k]]} lies behind photo "
            f"{problem.photos[problem.photo[k]]}: remeasure it"
        )
    if problem.redundancy == 0:
        out.append("no redundancy: nothing is checked")
    if sigma0 is not None and sigma0 > _TORN:
        worst = robust_suspects(problem, found.normal.structure, found.state)
        out.append(
            f"sigma0 is {sigma0:.0f} times what was expected: there are gross errors"
            + "".join(f"; {suspect.what} is off by {suspect.size}" for suspect in worst[:3])
        )
    return out
