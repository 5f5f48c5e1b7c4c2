"""Two control points that were interchanged: each lies where the other is said to be.

That is one mistake, however many coordinates it makes wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.bundle.errors.wholecontrol import whole_control
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem

__all__ = ["ExchangedControl", "exchanged_control"]

_NEAR = 0.02  # of their distance: as close each lies to the other's place


class ExchangedControl(NamedTuple):
    """Two control points that are interchanged.

    Attributes
    ----------
    points
        Their names, in the order of the bundle's points.
    coordinates
        Which of their coordinates are out.
    """

    points: tuple[str, str]
    coordinates: frozenset[ObservationName]

    @property
    def sentence(self) -> str:
        """What is said of them."""
        first, second = self.points
        return (
            f"control points {first} and {second} interchanged? Each lies where the other is said "
            "to be"
        )


def exchanged_control(
    problem: Problem, state: BlockState, out: frozenset[ObservationName]
) -> tuple[ExchangedControl, ...]:
    """Return which control points lie at each other's places, of those with coordinates out.

    Parameters
    ----------
    problem
        The bundle, with all observations.
    state
        The block adjusted without those that are out.
    out
        The observations that are out.
    """
    coordinates: dict[str, set[ObservationName]] = {}
    for name in out:
        if name[0] == "control":
            coordinates.setdefault(str(name[1]), set()).add(name)
    if len(coordinates) < 2:
        return ()
    at = [k for point, k in whole_control(problem).items() if point in coordinates]
    known, found = problem.known[at], state.points[at] + state.origin
    apart = np.linalg.norm(known[:, None] - known, axis=2)
    off = np.linalg.norm(found[:, None] - known, axis=2)
    there = (off <= _NEAR * apart) & (apart > 0.0)
    found_pairs = []
    for i, j in np.argwhere(np.triu(there & there.T)).tolist():
        first, second = problem.points[at[i]], problem.points[at[j]]
        # a point is in one pair, also where two others lie close together
        if first in coordinates and second in coordinates:
            wrong = frozenset(coordinates.pop(first) | coordinates.pop(second))
            found_pairs.append(ExchangedControl((first, second), wrong))
    return tuple(found_pairs)
