"""What a robust solution leaves far off, and why nothing is found: in words."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.bundle.solve.datum import anchor
from anaplot.bundle.solve.factor import NotPositiveError
from anaplot.bundle.solve.gaussnewton import NoConvergenceError
from anaplot.bundle.solve.imaging import BlockState, RobustPlace
from anaplot.bundle.solve.knownvalues import as_likely_wrong
from anaplot.bundle.solve.linearised import Linearised, linearise
from anaplot.bundle.solve.normal import NormalEquations, PointError
from anaplot.bundle.solve.openmovement import held_by_noise, undetermined
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import Structure
from anaplot.bundle.start.lockedangles import locked_angles
from anaplot.bundle.start.robust import FAR, ClearestSolution, clearest_solution, with_fixed
from anaplot.errors import NotComputableError

__all__ = ["RobustSuspect", "no_minimum_error", "robust_suspects", "without_search"]


_ADVICE = (
    "remeasure what is named or switch it off (use = off), or let --errors search begin without it"
)
_NO_SEARCH = "nor is there a solution without it: remeasure what is named"
_REMEASURE = "nothing tells which: remeasure what is named"

_AGREED = "where most measurements agree, sigma0 is"


def no_minimum_error(
    problem: Problem, structure: Structure, start: BlockState, state: BlockState | None = None
) -> NotComputableError:
    """Return the error with the reason why `find_minimum` finds nothing.

    It names what is not determined, or only by the noise of the measurements; else the observations
    farthest from a robust solution. How good the best state is, what fits worst there and what to
    try is said with it.

    Parameters
    ----------
    problem, structure, start
        As `find_minimum` had them.
    state
        The best that it reached; None: the start, which is a robust solution.
    """
    clearest = clearest_solution(problem, structure, RobustPlace(start))
    # where gross errors have bent the start, it is seen without them
    for at in (start, with_fixed(problem, clearest.state)):
        by_noise = held_by_noise(problem, structure, at)
        if by_noise is not None:
            # not final: without what is far off there may be a minimum all the same
            return NoConvergenceError(by_noise, start)
    tie = anchor(problem, start) if problem.defect else None
    best = start if state is None else state
    linear = linearise(problem, best)
    open_part: NotComputableError | None = None
    try:
        weights = None if tie is None else tie.weights
        NormalEquations(problem, structure, linear, 0.0, weights).factor()
    except (PointError, NotPositiveError) as error:
        open_part = undetermined(problem, structure, best, linear, tie, error)
    worst = _suspects(problem, clearest)
    if not worst and open_part is not None:
        return open_part
    said = [f"block {problem.block.name}: no solution found"]
    if worst:
        others = "".join(f"; then {suspect.what}" for suspect in worst[1:3])
        said[0] += f": {worst[0].what} disagrees by {worst[0].size} with all others{others}"
    said.append(
        _fit(problem, linear, "the best state has sigma0" if state is not None else _AGREED)
    )
    locked = locked_angles(problem)
    if locked is not None:
        said.append(locked)
    if open_part is not None:
        said.append(f"there {str(open_part).removeprefix(f'block {problem.block.name}: ')}")
    if not worst:
        said.append(
            "look at these, or state where the photos are ([[photo]] position and rotation)"
        )
    advice = ""
    if worst:
        advice = _REMEASURE if worst[0].one_of_several else _ADVICE
    return NoConvergenceError("; ".join(said), start, advice)


def _fit(problem: Problem, linear: Linearised, where: str) -> str:
    """Say how well a state fits, and name the rays that fit worst there."""
    size = np.linalg.norm(linear.e * problem.sigma_xy, axis=1)
    order = np.argsort(-np.nan_to_num(size, nan=np.inf), kind="stable")[:3]
    sigma0 = np.sqrt(linear.vtpv / max(problem.redundancy, 1))
    named = ", ".join(
        f"{problem.points[problem.point[k]]} in {problem.photos[problem.photo[k]]} "
        f"({size[k]:.3g} mm)"
        for k in order.tolist()
    )
    return f"{where} {sigma0:.3g}, the worst rays {named}"


class RobustSuspect(NamedTuple):
    """A measurement far from a robust solution.

    Attributes
    ----------
    what
        "point P in photo F", "control point P" or "the stated position of photo F".
    size
        How far it is off, with its unit.
    times
        The same, in units of what the measurements of its kind are off in the median.
    one_of_several
        Whether several are named because any of them may be wrong.
    """

    what: str
    size: str
    times: float
    one_of_several: bool = False


def without_search(failure: NoConvergenceError) -> NoConvergenceError:
    """Return what is said instead where a search has begun without what is named, in vain."""
    if failure.advice != _ADVICE:
        return failure
    return NoConvergenceError(failure.reason, failure.state, _NO_SEARCH)


def robust_suspects(
    problem: Problem, structure: Structure, start: RobustPlace
) -> list[RobustSuspect]:
    """Return the measurements that a robust adjustment leaves far off, the worst first.

    As `robust_state`; where that leaves many rays off, photos that fit badly are resected to the
    points of the others first.

    Parameters
    ----------
    problem, structure, start
        The bundle, and where the robust steps begin.
    """
    return _suspects(problem, clearest_solution(problem, structure, start))


def _suspects(problem: Problem, clearest: ClearestSolution) -> list[RobustSuspect]:
    """Return what a robust solution leaves far off, the worst first."""
    image, control, priors, expected = clearest.misfits
    held = clearest.held
    found = []
    alike = as_likely_wrong(problem)
    scale = clearest.misfits.ray_scale(problem)
    rays = np.bincount(problem.point, minlength=len(problem.points))
    bad = np.bincount(problem.point[image > FAR * scale], minlength=len(problem.points))
    named: set[str] = set()
    for k in np.argsort(-image, kind="stable")[:20].tolist():
        p = int(problem.point[k])
        photo, point = problem.photos[problem.photo[k]], problem.points[p]
        what, several = f"point {point} in photo {photo}", False
        if held[p].any() and rays[p] == 1:
            # a single ray and control contradict each other: nothing tells which is wrong
            what = f"control point {point} or {what}"
        elif held[p].any() and bad[p] > rays[p] // 2:
            what, several = _control_in_words(point, alike), point in alike
        if what in named:
            continue
        named.add(what)
        size = f"{image[k]:.3g} mm in the image"
        found.append(RobustSuspect(what, size, image[k] / scale, several))
    if held.any():
        scale = clearest.misfits.control_scale(held, clearest.least)
        for k in np.argsort(-control, kind="stable")[:10].tolist():
            point = problem.points[k]
            what, several = _control_in_words(point, alike), point in alike
            if what in named:
                continue
            named.add(what)
            found.append(RobustSuspect(what, f"{control[k]:.3g} m", control[k] / scale, several))
    scale = clearest.misfits.prior_scale()
    for k, group in np.argwhere(priors > FAR * scale).tolist():
        what = f"the stated {('position', 'rotation')[group]} of photo {problem.photos[k]}"
        found.append(RobustSuspect(what, f"{priors[k, group]:.3g} sigma", priors[k, group] / scale))
    for k in np.flatnonzero(expected > FAR * scale).tolist():
        what = f"the prior of point {problem.points[k]}"
        found.append(RobustSuspect(what, f"{expected[k]:.3g} sigma", expected[k] / scale))
    found = [suspect for suspect in found if suspect.times > FAR]
    found.sort(key=lambda suspect: -suspect.times)
    return found


def _control_in_words(point: str, alike: list[str]) -> str:
    """Return "control point A", or with it those that are `as_likely_wrong`."""
    *others, last = alike if point in alike else [point]
    return f"control point {', '.join(others)} or {last}" if others else f"control point {last}"
