"""Conditions between points that are compared with an adjusted block, and take no part in it."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.conditions import ConditionRow

__all__ = ["ComparedRow", "compared_conditions"]


class ComparedRow(NamedTuple):
    """A row of a condition that takes no part.

    Attributes
    ----------
    row
        What it is called.
    use
        "check" or "off".
    unit
        "m" or "rad".
    difference
        Adjusted minus given.
    s
        Standard deviation of the difference, of the adjusted points and of what is given; None
        where it is off, without sigma0, and outside the datum of control, in which lengths mean
        nothing.
    """

    row: ConditionRow
    use: Literal["check", "off"]
    unit: Literal["m", "rad"]
    difference: float
    s: float | None

    @property
    def w(self) -> float | None:
        """The difference in its standard deviations."""
        return self.difference / self.s if self.s else None


def compared_conditions(block: AdjustedBlock) -> list[ComparedRow]:
    """Return the rows of the conditions that are compared only, or off.

    Raises
    ------
    NotComputableError
        Points of one of them coincide, or lie on a line where a plane is asked for.
    """
    problem, normal = block.problem, block.cofactors.normal
    of = problem.compared
    if of is None:
        return []
    equations = of.equations(block.state.points, problem.fixed)
    q = equations.whitened.shape[0]
    photos = np.zeros((len(problem.photos), problem.per_photo, q))
    points = equations.whitened.toarray().T.reshape(len(problem.points), 3, q)
    shared = np.zeros((problem.in_border, q))
    moved = normal.solve(block.cofactors.factor, photos, points, shared)
    spread = np.eye(q) + equations.whitened @ moved[1].reshape(-1, q)
    contrasts = equations.contrasts
    variance = (contrasts @ (contrasts @ spread).T).diagonal() * equations.sigma**2
    known = problem.datum == "control" and block.sigma is not None
    deviations = (np.sqrt(np.maximum(variance, 0.0)) * (block.sigma or 0.0)).tolist()
    out = []
    for row, condition, angular, difference, s in zip(
        of.rows,
        of.of_row.tolist(),
        of.angular.tolist(),
        equations.misclosure.tolist(),
        deviations,
        strict=True,
    ):
        off = of.conditions[condition].use == "off"
        out.append(
            ComparedRow(
                row,
                "off" if off else "check",
                "rad" if angular else "m",
                difference,
                s if known and not off else None,
            )
        )
    return out
