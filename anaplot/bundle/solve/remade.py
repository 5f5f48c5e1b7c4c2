"""Bundles laid out anew: of a changed block, or without some points.

What takes part stays, and so do weights that were estimated: a block states the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.bundle.solve.estimatedfactors import EstimatedFactors
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.measuredrays import measured_xy
from anaplot.bundle.solve.problem import Problem, make_problem
from anaplot.bundle.solve.selection import FAR_APART, HALF_RAYS, NO_ANGLE
from anaplot.photogrammetry.block import Block, ImagePoint

__all__ = [
    "among_points",
    "laid_out_again",
    "laid_out_like",
    "laid_out_without_same",
    "remeasured",
    "with_given_back",
    "with_priors_of",
    "with_rejected_of",
    "with_variances",
    "without_points",
    "without_same",
]

_WHATEVER_CHANGES = (FAR_APART, NO_ANGLE)  # why points stay out when other rows change


def laid_out_again(problem: Problem, block: Block) -> Problem:
    """Lay out a changed block as its bundle was, without the same control, priors and conditions.

    Image coordinates rejected are not looked for, they may have changed; nor are points that half
    rays did not determine. Points whose rays are far apart stay out, unless their rays changed.

    Raises
    ------
    InputError, NotComputableError
        As `make_problem`.
    """
    out = {
        name: why for name, why in (problem.undetermined or {}).items() if why in _WHATEVER_CHANGES
    }
    if out:
        before, now = (_rows_of(one, out) for one in (problem.block, block))
        out = {name: why for name, why in out.items() if before[name] == now[name]}
    return without_same(laid_out_like(problem, block, out or None), problem)


def laid_out_like(
    problem: Problem, block: Block, undetermined: Mapping[str, str] | None
) -> Problem:
    """Lay out a block in the datum of a bundle, with its parameters and its estimated weights.

    Parameters
    ----------
    problem
        The bundle.
    block
        Nearly its block.
    undetermined
        As `make_problem` has it.

    Raises
    ------
    InputError, NotComputableError
        As `make_problem`.
    """
    anew = make_problem(
        block, datum=problem.datum, additional=problem.additional, undetermined=undetermined
    )
    if problem.axis_factor is None and problem.estimated is None:
        return anew
    return with_variances(anew, _image_factors(anew, problem), problem.estimated)


def _image_factors(problem: Problem, other: Problem) -> Array:
    """(m, 2) factors of image coordinates as another bundle has them.

    They are estimated of whole photos, whose rays may be others now. Those of photos that it has
    not are as all of its are.
    """
    if other.axis_factor is None:
        return np.ones((len(problem.photo), 2))
    squares, n = other.axis_factor**2, len(other.photos)
    rays = np.bincount(other.photo, minlength=n)
    sums = np.column_stack([np.bincount(other.photo, one, minlength=n) for one in squares.T])
    out = np.tile(squares.mean(axis=0), (len(problem.photos), 1))
    mine, its = _in_both(problem.photos, other.photos)
    out[mine] = (sums / rays[:, None])[its]
    return np.asarray(np.sqrt(out)[problem.photo])


def with_variances(problem: Problem, image: Array, factors: EstimatedFactors | None) -> Problem:
    """Return a bundle with other standard deviations.

    Parameters
    ----------
    problem
        The bundle.
    image
        (m, 2) factors of those of its image coordinates.
    factors
        Of all others; None: they stay.
    """
    before = problem.axis_factor
    problem = replace(problem, axis_factor=image if before is None else image * before)
    if factors is None:
        return problem
    return replace(
        problem,
        known_sigma=problem.known_sigma * factors.control,
        expected_sigma=problem.expected_sigma * factors.expected,
        position_sigma=problem.position_sigma * factors.position,
        rotation_sigma=problem.rotation_sigma * factors.rotation,
        additional_sigma=problem.additional_sigma * factors.additional,
        estimated=factors if problem.estimated is None else problem.estimated.times(factors),
    )


def remeasured(problem: Problem, block: Block, ideal: Array) -> Problem:
    """Return a bundle with other image coordinates.

    Parameters
    ----------
    problem
        The bundle, without additional parameters: those belong to what is measured.
    block
        The block that has them.
    ideal
        (m, 2) image coordinates without their lenses [mm].
    """
    if problem.stated_lens is None:
        return replace(problem, block=block, xy=ideal)
    xy = measured_xy(block, problem.cameras[problem.photo], ideal)
    return replace(problem, block=block, xy=xy, without_lens=ideal)


def _rows_of(block: Block, points: Iterable[str]) -> dict[str, list[ImagePoint]]:
    """Return the rows of some points; a point without any has none."""
    found: dict[str, list[ImagePoint]] = {name: [] for name in points}
    for row in block.image_points:
        if row.point in found:
            found[row.point].append(row)
    return found


def without_points(problem: Problem, names: Iterable[str], why: str = HALF_RAYS) -> Problem:
    """Return the bundle with points left out that are not determined, beside those left out before.

    Raises
    ------
    NotComputableError
        Nothing is left.
    """
    out = {**(problem.undetermined or {}), **dict.fromkeys(names, why)}
    return laid_out_without_same(problem, problem.block, out)


def laid_out_without_same(
    problem: Problem, block: Block, undetermined: Mapping[str, str] | None
) -> Problem:
    """Return what `laid_out_like` does, without all that the bundle is without.

    Its image coordinates are those of the block, or more behind them.
    """
    anew = laid_out_like(problem, block, undetermined)
    return with_rejected_of(without_same(anew, problem), problem)


def with_given_back(problem: Problem) -> Problem:
    """Return the bundle with all control and priors of its block, rejected before or not."""
    anew = laid_out_like(problem, problem.block, problem.undetermined)
    return with_rejected_of(replace(anew, conditions=problem.conditions), problem)


def among_points(problem: Problem, smaller: Problem, state: BlockState) -> BlockState:
    """Return the state of a bundle of which another one lacks some points, for that one."""
    place = {name: k for k, name in enumerate(problem.points)}
    return replace(state, points=state.points[[place[name] for name in smaller.points]])


def with_rejected_of(problem: Problem, other: Problem) -> Problem:
    """Return a bundle without the image coordinates that another one is without.

    Of the same block, or of one that has fewer: those of the other come first.
    """
    if other.rejected is None:
        return problem
    of_row = np.zeros((len(problem.block.image_points), 2), dtype=bool)
    of_row[other.source] = other.rejected
    rejected = of_row[problem.source]
    if problem.off is not None:
        rejected |= problem.off
    return replace(problem, rejected=rejected if rejected.any() else None)


def with_priors_of(problem: Problem, other: Problem) -> Problem:
    """Return the bundle with the priors that another one of its photos and points has left.

    A coordinate that control knows free of error has no prior.
    """
    mine, its = _in_both(problem.photos, other.photos)
    position, rotation = problem.position_sigma.copy(), problem.rotation_sigma.copy()
    position[mine], rotation[mine] = other.position_sigma[its], other.rotation_sigma[its]
    expected = problem.expected_sigma.copy()
    mine, its = _in_both(problem.points, other.points)
    expected[mine] = np.where(np.isfinite(expected[mine]), other.expected_sigma[its], np.nan)
    return replace(
        problem, position_sigma=position, rotation_sigma=rotation, expected_sigma=expected
    )


def _in_both(names: Sequence[str], others: Sequence[str]) -> Index:
    """(2, k) places of the names that are in both."""
    place = {name: k for k, name in enumerate(names)}
    both = [(place[name], k) for k, name in enumerate(others) if name in place]
    return np.array(both, dtype=np.intp).reshape(-1, 2).T


def without_same(problem: Problem, other: Problem) -> Problem:
    """Return a bundle without the control, priors and conditions that another one is without.

    Parameters
    ----------
    problem
        The bundle.
    other
        One of nearly the same block: its points may stand in another order.
    """
    place = {name: k for k, name in enumerate(other.points)}
    control = problem.known_sigma.copy()
    for k, name in enumerate(problem.points):
        if name in place:
            control[k] = other.known_sigma[place[name]]
    conditions, others = problem.conditions, other.conditions
    if conditions is not None and others is not None:
        gone = {others.rows[k] for k in np.flatnonzero(others.rejected).tolist()}
        conditions = conditions.without([k for k, row in enumerate(conditions.rows) if row in gone])
    return with_priors_of(replace(problem, known_sigma=control, conditions=conditions), other)
