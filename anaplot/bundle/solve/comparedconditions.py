"""Conditions between points that are compared with an adjusted block, and take no part in it."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.conditions import ConditionRow, Conditions
from anaplot.errors import NotComputableError

__all__ = ["CheckedConditions", "ComparedRow", "checked_conditions", "compared_conditions"]


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
        Adjusted minus given; None where its points coincide, or lie on a line where something else
        is asked for.
    s
        Standard deviation of the difference, of the adjusted points and of what is given; None
        where it is off, without sigma0, and in a datum without scale, in which lengths mean
        nothing.
    """

    row: ConditionRow
    use: Literal["check", "off"]
    unit: Literal["m", "rad"]
    difference: float | None
    s: float | None

    @property
    def w(self) -> float | None:
        """The difference in its standard deviations."""
        return self.difference / self.s if self.s and self.difference is not None else None


class CheckedConditions(NamedTuple):
    """Conditions that check an adjusted block, all together.

    Attributes
    ----------
    rows, units
        What the k rows are called, "m" or "rad".
    differences
        (k,) adjusted minus given.
    cofactors
        (k, k) of the differences, of the adjusted points and of what is given.
    given
        (k,) standard deviations of what is given.
    """

    rows: tuple[ConditionRow, ...]
    units: tuple[Literal["m", "rad"], ...]
    differences: Array
    cofactors: Array
    given: Array


def checked_conditions(block: AdjustedBlock) -> CheckedConditions | None:
    """Return the conditions with `use` = check that mean something; None without any.

    Nor in a datum without scale, in which lengths mean nothing.
    """
    of = block.problem.compared
    if of is None:
        return None
    sound = [k for k in _sound(block, of) if of.conditions[k].use == "check"]
    if not sound:
        return None
    of = of.those(sound)
    differences, cofactors = _spread(block, of)
    if cofactors is None:
        return None
    units: list[Literal["m", "rad"]] = ["rad" if angular else "m" for angular in of.angular]
    given = of.equations(block.state.points, block.problem.fixed).sigma
    return CheckedConditions(tuple(of.rows), tuple(units), differences, cofactors, given)


def compared_conditions(block: AdjustedBlock) -> list[ComparedRow]:
    """Return the rows of the conditions that are compared only, or off."""
    of = block.problem.compared
    if of is None:
        return []
    sound = _sound(block, of)
    found = iter(_compared(block, of.those(sorted(sound))) if sound else [])
    out = []
    for row, k, angular in zip(of.rows, of.of_row.tolist(), of.angular.tolist(), strict=True):
        off = of.conditions[k].use == "off"
        difference, s = next(found) if k in sound else (None, None)
        out.append(
            ComparedRow(
                row,
                "off" if off else "check",
                "rad" if angular else "m",
                difference,
                None if off else s,
            )
        )
    return out


def _sound(block: AdjustedBlock, of: Conditions) -> set[int]:
    """Return which conditions mean something where the points are."""
    sound = set()
    for k in range(len(of.conditions)):
        with suppress(NotComputableError):
            of.those([k]).equations(block.state.points, block.problem.fixed)
            sound.add(k)
    return sound


def _compared(block: AdjustedBlock, of: Conditions) -> list[tuple[float | None, float | None]]:
    """Return differences of the rows of conditions, and their standard deviations."""
    differences, cofactors = _spread(block, of)
    if block.sigma is None or cofactors is None:
        return [(difference, None) for difference in differences.tolist()]
    s = np.sqrt(np.maximum(np.diag(cofactors), 0.0)) * block.sigma
    return list(zip(differences.tolist(), s.tolist(), strict=True))


def _spread(block: AdjustedBlock, of: Conditions) -> tuple[Array, Array | None]:
    """Return differences of the rows of conditions, and their cofactors; None without scale."""
    problem, normal = block.problem, block.cofactors.normal
    equations = of.equations(block.state.points, problem.fixed)
    change = block.cofactors.change
    if change is not None and not change.gives_scale:
        return equations.misclosure, None
    q = equations.whitened.shape[0]
    photos = np.zeros((len(problem.photos), problem.per_photo, q))
    points = equations.whitened.toarray().T.reshape(len(problem.points), 3, q)
    shared = np.zeros((problem.in_border, q))
    spread = np.eye(q)
    if change is not None:
        # in the scale that distances give: what the differences take of the datum goes with it
        points, moves = change.of_functions(points)
        spread += (moves * change.variance) @ moves.T
    moved = normal.solve(block.cofactors.factor, photos, points, shared)
    spread += points.reshape(-1, q).T @ moved[1].reshape(-1, q)
    contrasts = equations.contrasts
    whole = contrasts @ (contrasts @ spread).T
    cofactors: Array = whole * equations.sigma[:, None] * equations.sigma
    return equations.misclosure, cofactors
