"""Bundles without some of their observations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anaplot.aliases import Index
from anaplot.bundle.solve.observations import (
    GROUND_KINDS,
    ORIENTATION,
    ObservationName,
    Observations,
)
from anaplot.bundle.solve.problem import Problem

__all__ = ["missing", "rows_missing", "with_rows_of", "without"]


def without(rows: Observations, out: frozenset[int]) -> Problem:
    """Return a bundle without some of its rows: image coordinates of weight zero, unknown control.

    Raises
    ------
    ValueError
        A prior on an additional parameter, which is no measurement.
    """
    problem = rows.problem
    first, second, third, fourth = rows.starts
    rejected = np.zeros((len(problem.photo), 2), dtype=bool)
    if problem.off is not None:
        rejected |= problem.off
    ground = problem.ground_sigma
    position, rotation = problem.position_sigma.copy(), problem.rotation_sigma.copy()
    conditions: list[int] = []
    for row in sorted(out):
        if row < first:
            rejected[divmod(row, 2)] = True
        elif row < second:
            ground[tuple(rows.ground[row - first])] = np.nan
        elif row < third:
            photo, unknown = rows.priors[row - second].tolist()
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


def rows_missing(rows: Observations, reduced: Problem) -> Index:
    """Return which rows of a bundle a smaller one of the same rays lacks, without conditions."""
    image = reduced.newly_rejected.ravel() & ~rows.problem.newly_rejected.ravel()
    ground = np.isnan(reduced.ground_sigma[tuple(rows.ground.T)])
    priors = np.isnan(reduced.prior_sigma[tuple(rows.priors.T)])
    return np.flatnonzero(np.concatenate((image, ground, priors)))


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
