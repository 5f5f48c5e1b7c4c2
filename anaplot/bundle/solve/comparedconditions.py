"""Conditions between points that are compared with an adjusted block, and take no part in it."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.conditions import ConditionEquations, ConditionRow, Conditions
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
    independent, their_cofactors
        (b,) and (b, b) of the differences in a-priori sigmas, as many combinations as are not
        parameters: the rows of a line, a plane and equal distances depend on each other.
    """

    rows: tuple[ConditionRow, ...]
    units: tuple[Literal["m", "rad"], ...]
    differences: Array
    cofactors: Array
    given: Array
    independent: Array
    their_cofactors: Array


def checked_conditions(block: AdjustedBlock) -> CheckedConditions | None:
    """Return the conditions with `use` = check that mean something; None without any.

    Angles alone in a datum without scale, in which lengths mean nothing.
    """
    of = block.problem.compared
    if of is None:
        return None
    told = _told(block, of, _sound(block, of))
    checks = sorted(k for k in told if of.conditions[k].use == "check")
    if not checks:
        return None
    of = of.those(checks)
    equations, spread = _spread(block, of)
    units: list[Literal["m", "rad"]] = ["rad" if angular else "m" for angular in of.angular]
    return CheckedConditions(
        tuple(of.rows),
        tuple(units),
        equations.misclosure,
        _of_rows(equations, spread),
        equations.sigma,
        equations.contrasts.T @ (equations.misclosure / equations.sigma),
        spread,
    )


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


def _told(block: AdjustedBlock, of: Conditions, sound: set[int]) -> set[int]:
    """Return which of them have standard deviations: in a datum without scale angles alone."""
    change = block.cofactors.change
    if change is None or change.gives_scale:
        return sound
    return {k for k in sound if of.conditions[k].kind == "angle"}


def _compared(block: AdjustedBlock, of: Conditions) -> list[tuple[float | None, float | None]]:
    """Return differences of the rows of conditions, and their standard deviations."""
    differences = of.equations(block.state.points, block.problem.fixed).misclosure.tolist()
    told = sorted(_told(block, of, set(range(len(of.conditions)))))
    s: list[float | None] = [None] * len(differences)
    if told and block.sigma is not None:
        cofactors = _of_rows(*_spread(block, of.those(told)))
        found = np.sqrt(np.maximum(np.diag(cofactors), 0.0)) * block.sigma
        for row, one in zip(np.flatnonzero(np.isin(of.of_row, told)), found.tolist(), strict=True):
            s[row] = one
    return list(zip(differences, s, strict=True))


def _of_rows(equations: ConditionEquations, spread: Array) -> Array:
    """Return (k, k) cofactors of the rows of conditions, of those of their combinations."""
    contrasts = equations.contrasts
    whole = contrasts @ (contrasts @ spread).T
    cofactors: Array = whole * equations.sigma[:, None] * equations.sigma
    return cofactors


def _spread(block: AdjustedBlock, of: Conditions) -> tuple[ConditionEquations, Array]:
    """Return equations of conditions, and (b, b) cofactors of their combinations, whitened."""
    problem, normal = block.problem, block.cofactors.normal
    equations = of.equations(block.state.points, problem.fixed)
    change = block.cofactors.change
    q = equations.whitened.shape[0]
    photos = np.zeros((len(problem.photos), problem.per_photo, q))
    points = equations.whitened.toarray().T.reshape(len(problem.points), 3, q)
    shared = np.zeros((problem.in_border, q))
    spread = np.eye(q)
    if change is not None and change.gives_scale:
        # in the scale that distances give: what the differences take of the datum goes with it
        points, moves = change.of_functions(points)
        spread += (moves * change.variance) @ moves.T
    moved = normal.solve(block.cofactors.factor, photos, points, shared)
    spread += points.reshape(-1, q).T @ moved[1].reshape(-1, q)
    return equations, spread
