"""What a point pattern is worth, and which further point would help it most (1983, Figures 2-7)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from anaplot.errors import NotComputableError
from anaplot.orientation.model import WrongPointsError
from anaplot.orientation.patterns import Pattern, ideal_model
from anaplot.orientation.results import ModelSolution

__all__ = [
    "USUAL_BASE",
    "USUAL_C",
    "USUAL_D",
    "Advice",
    "PlannedPattern",
    "Span",
    "advise",
    "from_pattern",
    "grid",
    "solve",
]

USUAL_BASE, USUAL_D, USUAL_C = 90.0, 100.0, 152.0
"""Base at photo scale, half the model in y and camera constant [mm], where none are asked for."""

Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class PlannedPattern:
    """Points of an ideal model: vertical photos, flat ground.

    Attributes
    ----------
    points
        (label, x, y) of every point in the left photo [mm].
    ties
        Labels of the points shared with the preceding model.
    base, c
        Base at photo scale and camera constant [mm].
    """

    points: tuple[tuple[str, float, float], ...]
    ties: tuple[str, ...]
    base: float
    c: float


@dataclass(frozen=True, slots=True)
class Advice:
    """One candidate point, and the weakest redundancy number before and after.

    Attributes
    ----------
    x, y
        Where the point would lie in the left photo [mm].
    doubles
        Label of the point that it doubles, or None.
    tie
        Whether it is shared with the preceding model.
    before, after
        Weakest redundancy number of the rows that are there already.
    """

    x: float
    y: float
    doubles: str | None
    tie: bool
    before: float
    after: float


def from_pattern(pattern: Pattern, base: float, d: float, c: float) -> PlannedPattern:
    """Return a named pattern as planned points; lengths in mm."""
    points = tuple((label, x, y) for label, (x, y) in pattern.positions(base, d).items())
    return PlannedPattern(points, pattern.ties, base, c)


def solve(
    plan: PlannedPattern, tie_variance: Literal["paper", "propagated"] = "paper"
) -> ModelSolution:
    """Orient the planned model by the code that orients measured ones.

    Raises
    ------
    NotComputableError
        The points do not determine the model.
    """
    at = {label: (x, y) for label, x, y in plan.points}
    try:
        return ideal_model(at, plan.ties, plan.base, plan.c, tie_variance)
    except WrongPointsError:
        # nothing is wrong with a planned point: double precision ends here
        raise NotComputableError(
            f"not determined: base {plan.base:g} mm, c {plan.c:g} mm and the extent of the points "
            "are too far apart"
        ) from None


def grid(x: Span, y: Span, steps: int = 5) -> tuple[tuple[float, float], ...]:
    """Return steps x steps positions over the model, between the ends of x and of y [mm]."""
    places = ((float(px), float(py)) for px in np.linspace(*x, steps)
              for py in np.linspace(*y, steps))  # fmt: skip
    return tuple(dict.fromkeys(places))


def advise(
    plan: PlannedPattern,
    extra: Iterable[tuple[float, float]],
    tie_variance: Literal["paper", "propagated"] = "paper",
) -> tuple[Advice, ...]:
    """Try every doubled point and every extra position; the most helpful comes first.

    Where there are ties, what lies no further along the flight than they do is tried as a tie
    too: the preceding model has it.

    Raises
    ------
    NotComputableError
        The points do not determine the model.
    """
    rows = {row.key: row.redn for row in solve(plan, tie_variance).table}
    before = min(rows.values())
    used = {label for label, _, _ in plan.points}
    new = next(f"new{k}" for k in range(len(used) + 1) if f"new{k}" not in used)
    places = [(x, y, label) for label, x, y in plan.points]
    taken = {(x, y) for x, y, _ in places}
    candidates = [*places, *((x, y, None) for x, y in extra if (x, y) not in taken)]
    reach = max((x for label, x, _ in plan.points if label in plan.ties), default=-np.inf)
    out = []
    for x, y, doubles in candidates:
        for tie in (False, True) if x <= reach else (False,):
            wider = replace(
                plan,
                points=(*plan.points, (new, x, y)),
                ties=(*plan.ties, new) if tie else plan.ties,
            )
            try:
                table = solve(wider, tie_variance).table
            except NotComputableError:
                # so far off that the others lie in one place beside it: no advice
                continue
            after = min(row.redn for row in table if row.key in rows)
            out.append(Advice(x, y, doubles, tie, before, after))
    return tuple(sorted(out, key=lambda a: -a.after))
