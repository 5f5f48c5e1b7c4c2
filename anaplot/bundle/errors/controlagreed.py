"""Control that contradicts itself: where most of it agrees with the photos, a place to begin at.

Two wrong control points of six, or two that were interchanged, draw the block along, and hide
behind each other: a search that begins with all of them rejects right ones. The photos alone know
nothing of them. Their free network says which control points lie to each other as the photos see
them; the block that lies on these tells of the others, coordinate by coordinate, which are wrong.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.significance import critical_normal
from anaplot.aliases import Array, Bools, Index, Progress
from anaplot.bundle.errors.blockplace import BlockPlace
from anaplot.bundle.errors.exchangedcontrol import price_of
from anaplot.bundle.errors.wholecontrol import plan_control, whole_control
from anaplot.bundle.solve.datum import check_datum
from anaplot.bundle.solve.gaussnewton import Minimum, find_minimum
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.structure import make_structure
from anaplot.bundle.start.approximate import laid_onto_control
from anaplot.bundle.start.controlremark import WithoutControl
from anaplot.bundle.start.freenetwork import free_network
from anaplot.errors import NotComputableError
from anaplot.photogrammetry.exchangedpoints import exchanged_pairs
from anaplot.photogrammetry.similarity import agreeing_sets

__all__ = [
    "AgreedPlace",
    "agreed_places",
    "contradicted",
    "control_out",
    "doubtful",
    "what_is_wrong",
]

_FEWEST = 4  # control points, of which one may be told by the others
_SHARE = 1 / 3  # of the control points may be wrong without a doubt about the others
_LOOSE = 100.0  # times its extent: sigma of control that hardly holds anything
_TRIES = 40  # steps: control that agrees lies nearly where the network says
_MOST = 3  # sets of control that are tried


class AgreedPlace(NamedTuple):
    """A place to begin at.

    Attributes
    ----------
    place
        The block adjusted on the control that agrees.
    out
        The coordinates of other control that are wrong then.
    score
        v'Pv there plus what these cost, c^2 for one by itself.
    """

    place: BlockPlace
    out: frozenset[ObservationName]
    score: float

    @property
    def points(self) -> frozenset[str]:
        """The control points of which coordinates are out."""
        return frozenset(str(name[1]) for name in self.out)


def contradicted(problem: Problem, out: frozenset[ObservationName]) -> bool:
    """Whether so much control is out that the rest of it may be what is wrong.

    Parameters
    ----------
    problem
        The bundle, with all observations.
    out
        The observations that a search has left out.
    """
    return control_out(problem, out) > _SHARE


def doubtful(problem: Problem, out: frozenset[ObservationName]) -> bool:
    """Whether control may be the mirror image of what the photos show, by what a search left out.

    Its parameters are those of `contradicted`; in a flat block less of it is out.
    """
    return control_out(problem, out) >= _SHARE


def control_out(problem: Problem, out: frozenset[ObservationName]) -> float:
    """Return the share of the control points that are out: 0 where they are too few to tell.

    A control point is out with any of its coordinates, or with most of its rays.
    """
    at = whole_control(problem)
    if len(at) < _FEWEST or problem.defect:
        return 0.0
    gone = np.zeros(len(problem.points), dtype=bool)
    coordinates = np.zeros(len(problem.points), dtype=np.intp)
    for name in out:
        point = at.get(str(name[2])) if name[0] == "image" else at.get(str(name[1]))
        if point is None:
            continue
        if name[0] == "control":
            gone[point] = True
        elif name[0] == "image":
            coordinates[point] += 1
    rays = np.bincount(problem.point, minlength=len(problem.points))
    gone |= coordinates > rays
    return int(gone[list(at.values())].sum()) / len(at)


def what_is_wrong(
    problem: Problem, state: BlockState, out: frozenset[ObservationName] | None
) -> str | None:
    """Say what is wrong with control as a whole, where so much of it is out that it may be wrong.

    Parameters
    ----------
    problem
        The bundle, with all observations.
    state
        Where its free network begins.
    out
        The observations that a search has left out; None: before it, what no search gets over.

    Raises
    ------
    NotComputableError
        Two control points are exchanged, and no search may go on without them: the others do not
        hold the block, or they are free of error.
    """
    doubted = _beyond_search(problem) if out is None else doubtful(problem, out)
    remark = WithoutControl(problem, state).remark if doubted else None
    if remark is None:
        return None
    for pair in remark.exchanged:
        why = _why_not_without(problem, state, pair)
        if why:
            raise NotComputableError(
                f"block {problem.block.name}: {remark.text}; {why}: correct control"
            )
    return remark.text


def _beyond_search(problem: Problem) -> bool:
    """Whether two exchanged control points cannot be searched for: few others, or free of error."""
    whole, plan = whole_control(problem), plan_control(problem)
    count = len(whole) if len(whole) >= _FEWEST else len(plan)
    free_of_error = bool(problem.fixed[list(plan.values())].any())
    return count == _FEWEST or (count > _FEWEST and free_of_error)


def _why_not_without(problem: Problem, state: BlockState, pair: tuple[str, str]) -> str:
    """Return why no search may go on without two exchanged control points; "": it may."""
    points = plan_control(problem)
    at = [points[point] for point in pair if point in points]
    if len(at) < len(pair):
        return ""
    if problem.fixed[at].any():
        return "control free of error is not searched for gross errors"
    sigma = problem.known_sigma.copy()
    sigma[at] = np.nan
    try:
        check_datum(replace(problem, known_sigma=sigma), state)
    except NotComputableError:
        return "without them the others do not hold the block"
    in_plan = len(whole_control(problem)) < _FEWEST
    return "without them nothing checks the others" if in_plan and len(points) <= _FEWEST else ""


def agreed_places(
    problem: Problem,
    start: BlockState,
    rejected: Bools | None,
    alpha: float,
    progress: Progress | None = None,
) -> list[AgreedPlace]:
    """Adjust a block on those of its control points that lie to each other as the photos say.

    Two that were interchanged leave too few others to be found by these alone: it is asked with
    which two exchanged all of them agree.

    Parameters
    ----------
    problem
        The bundle, with all observations.
    start
        Where its free network begins.
    rejected
        (m, 2) image coordinates that are out; None: none. Those of control points come in again.
    alpha
        Significance above which a coordinate of the other control points is wrong.
    progress
        Called with what is being done and the fraction of it.

    Returns
    -------
    list of AgreedPlace
        Of every set of control that may be right, that of the least score first. There is none
        where the photos make no free network, or control free of error would be wrong.
    """
    control = whole_control(problem)
    if rejected is not None:
        # a ray of wrong control was rejected for it
        rejected = rejected & ~np.isin(problem.point, list(control.values()))[:, None]
        rejected = rejected if problem.off is None else rejected | problem.off
    try:
        free, network = free_network(problem, start, progress, anew=True)
    except (NotComputableError, np.linalg.LinAlgError):
        return []
    at = {point: k for k, point in enumerate(free.points)}
    known = np.array([k for point, k in control.items() if point in at], dtype=np.intp)
    if len(known) < _FEWEST:
        return []
    seen = network.points[[at[problem.points[k]] for k in known.tolist()]]
    ground = problem.known[known] - problem.known[known].mean(axis=0)
    places = []
    for agree in _agreeing(seen, ground):
        others = known[~agree]
        if problem.fixed[others].any():
            continue
        agreed = problem.known.copy()
        agreed[others] = np.nan
        try:
            laid = laid_onto_control(replace(problem, known=agreed), free, network)
        except (NotComputableError, np.linalg.LinAlgError):
            continue
        if laid is None:
            continue
        # a point that its rays do not determine alone needs its control, however loosely
        for loose in (np.nan, _LOOSE * float(np.ptp(ground, axis=0).max())):
            sigma = problem.known_sigma.copy()
            sigma[others] = loose
            reduced = replace(problem, known_sigma=sigma, rejected=rejected)
            try:
                found = _adjusted(reduced, laid, progress)
                place = BlockPlace.of(found)
                wrong = _wrong(problem, place, others, alpha)
            except (NotComputableError, np.linalg.LinAlgError):
                continue
            price = price_of(problem, place, wrong, critical_normal(alpha) ** 2)
            if np.isfinite(loose):
                place = BlockPlace(found.state)
            place.let_go()  # as large as the block
            places.append(AgreedPlace(place, wrong, found.convergence.last + price))
            break
    return sorted(places, key=lambda one: one.score)


def _agreeing(seen: Array, ground: Array) -> list[Bools]:
    """Return which control may be right: all but two that were exchanged, and what agrees."""
    sets = []
    for pair in exchanged_pairs(seen, ground)[0]:
        others = np.ones(len(seen), dtype=bool)
        others[[pair.first, pair.second]] = False
        sets.append(others)
    agreeing = agreeing_sets(seen, ground, _MOST)
    return sets + [
        one for one in agreeing if not any(np.array_equal(one, others) for others in sets)
    ]


def _adjusted(reduced: Problem, laid: BlockState, progress: Progress | None) -> Minimum:
    """Return the minimum of a bundle on the control that it has left."""
    check_datum(reduced, laid)
    structure = make_structure(reduced, laid.centres)
    return find_minimum(reduced, laid, structure, tries=_TRIES, progress=progress)


def _wrong(
    problem: Problem, place: BlockPlace, others: Index, alpha: float
) -> frozenset[ObservationName]:
    """Return the coordinates of control that a block without it says are wrong.

    By the difference over its standard deviation, that of control and of the point together.
    """
    state, cofactors = place.state, place.cofactors
    assert cofactors is not None  # a minimum has them
    variance = np.einsum("nii->ni", cofactors.points)[others]
    off: Array = state.points[others] + state.origin - problem.known[others]
    sigma = np.sqrt(variance + problem.known_sigma[others] ** 2)
    wrong = np.abs(off) > critical_normal(alpha) * sigma
    return frozenset(
        ("control", problem.points[others[k]], "XYZ"[axis]) for k, axis in np.argwhere(wrong)
    )
