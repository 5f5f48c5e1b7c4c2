"""Bundles without some of their observations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from anaplot.aliases import Index
from anaplot.bundle.solve.observations import GROUND_KINDS, ORIENTATION, ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.residuals import BlockResiduals

__all__ = ["missing", "with_priors_of", "with_rows_of", "without", "without_same"]


def without(system: BlockResiduals, rows: frozenset[int]) -> Problem:
    """Return the bundle without some rows: image coordinates of weight zero, unknown control.

    Raises
    ------
    ValueError
        A prior on an additional parameter, which is no measurement.
    """
    problem = system.problem
    first, second, third, fourth = system.rows.starts
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    if problem.off is not None:
        rejected |= problem.off
    ground = problem.ground_sigma
    position, rotation = problem.position_sigma.copy(), problem.rotation_sigma.copy()
    conditions: list[int] = []
    for row in sorted(rows):
        if row < first:
            rejected[divmod(row, 2)] = True
        elif row < second:
            ground[tuple(system.rows.ground[row - first])] = np.nan
        elif row < third:
            photo, unknown = system.rows.priors[row - second].tolist()
            (position if unknown < 3 else rotation)[photo, unknown % 3] = np.nan
        elif row >= fourth:
            conditions.append(row - fourth)
        else:
            raise ValueError("a prior on an additional parameter cannot be rejected")
    return replace(
        problem,
        known_sigma=ground[0],
        expected_sigma=ground[1],
        position_sigma=position,
        rotation_sigma=rotation,
        rejected=rejected if rejected.any() else None,
        conditions=None if problem.conditions is None else problem.conditions.without(conditions),
    )


def missing(problem: Problem, reduced: Problem) -> tuple[ObservationName, ...]:
    """Return the names of what a smaller bundle lacks, in the order of the rows."""
    names: list[ObservationName] = []
    if reduced.rejected is not None:
        new = reduced.rejected.copy()
        if problem.rejected is not None:
            new &= ~problem.rejected
        for ray, axis in np.argwhere(new).tolist():
            row = problem.block.image_points[int(problem.source[ray])]
            names.append(("image", row.photo, row.point, row.model, "xy"[axis]))
    gone = np.isfinite(problem.ground_sigma) & ~np.isfinite(reduced.ground_sigma)
    names += [
        (GROUND_KINDS[kind], problem.points[k], "XYZ"[axis])
        for kind, k, axis in np.argwhere(gone).tolist()
    ]
    gone = np.isfinite(problem.prior_sigma) & ~np.isfinite(reduced.prior_sigma)
    names += [("prior", problem.photos[k], ORIENTATION[i]) for k, i in np.argwhere(gone).tolist()]
    if problem.conditions is not None and reduced.conditions is not None:
        gone = reduced.conditions.rejected & ~problem.conditions.rejected
        rows = problem.conditions.rows
        names += [("condition", *rows[k]) for k in np.flatnonzero(gone).tolist()]
    return tuple(names)


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


def with_rows_of(problem: Problem, other: Problem) -> Problem:
    """Return a bundle with what takes part in another one of the same photos, points and rays.

    Conditions between points are not asked for.
    """
    return replace(
        problem,
        rejected=other.rejected,
        known_sigma=other.known_sigma,
        expected_sigma=other.expected_sigma,
        position_sigma=other.position_sigma,
        rotation_sigma=other.rotation_sigma,
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
