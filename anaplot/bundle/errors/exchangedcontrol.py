"""Two control points that were interchanged: each lies where the other is said to be.

That is one mistake, however many coordinates it makes wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from anaplot.bundle.errors.wholecontrol import whole_control
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
from anaplot.bundle.solve.reliability import Cofactors
from anaplot.bundle.solve.upright import look_up

__all__ = ["ExchangedControl", "exchanged_control", "price_of"]

_NEAR = 0.02  # of their distance: as close each lies to the other's place
_UPSIDE_DOWN = 3.0  # rows that this costs: where control fits both ways, a block lies upright


class ExchangedControl(NamedTuple):
    """Two control points that are interchanged.

    Attributes
    ----------
    points
        Their names, in the order of the bundle's points.
    coordinates
        Which of their coordinates are out.
    otherwise
        Other pairs of which one may be interchanged instead: that explains as much.
    """

    points: tuple[str, str]
    coordinates: frozenset[ObservationName]
    otherwise: tuple[tuple[str, str], ...] = ()

    @property
    def sentence(self) -> str:
        """What is said of them."""
        first, second = self.points
        said = (
            f"control points {first} and {second} interchanged? Each lies where the other is said "
            "to be"
        )
        others = ", or ".join(" and ".join(pair) for pair in self.otherwise)
        return f"{said}; that {others} are explains as much" if others else said


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


def price_of(
    problem: Problem,
    state: BlockState,
    out: frozenset[ObservationName],
    each: float,
    cofactors: Cofactors | Callable[[], Cofactors | None],
) -> float:
    """Return what observations that are out cost.

    Two control points that are interchanged cost one, and what their coordinates miss the other's
    place by; photos that look up at their points cost three.

    Parameters
    ----------
    problem, state, out
        As `exchanged_control` has them.
    each
        The price of one by itself.
    cofactors
        Those of the block there, or what returns them where they are asked for; None where nobody
        knows them.
    """
    price = each * len(out)
    for pair in exchanged_control(problem, state, out):
        known = cofactors() if callable(cofactors) else cofactors
        misses = 0.0 if known is None else _misses(problem, state, pair, known)
        price -= max(0.0, each * (len(pair.coordinates) - 1) - misses)
    if look_up(problem, state.rotations):
        price += each * _UPSIDE_DOWN
    return price


def _misses(
    problem: Problem, state: BlockState, pair: ExchangedControl, cofactors: Cofactors
) -> float:
    """Sum of squares, in sigmas, of what coordinates that are out miss the other's place by."""
    at = whole_control(problem)
    here = np.array([at[point] for point in pair.points])
    out = np.array(
        [[("control", one, axis) in pair.coordinates for axis in "XYZ"] for one in pair.points]
    )
    off = (state.points[here] + state.origin - problem.known[here[::-1]])[out]
    variance = np.einsum("nii->ni", cofactors.points)[here]
    variance = variance + np.nan_to_num(problem.known_sigma[here[::-1]]) ** 2
    return float((off**2 / variance[out]).sum())
