"""Two control points that were interchanged: each lies where the other is said to be.

That is one mistake, however many coordinates it makes wrong.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.bundle.errors.blockplace import BlockPlace
from anaplot.bundle.errors.wholecontrol import plan_control
from anaplot.bundle.solve.imaging import BlockState
from anaplot.bundle.solve.observations import ObservationName
from anaplot.bundle.solve.problem import Problem
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
    at = [k for point, k in plan_control(problem).items() if point in coordinates]
    known, found = problem.known[at], state.points[at] + state.origin
    # in space where both heights are known, else in plan
    common = problem.controlled[at][:, None] & problem.controlled[at]
    apart = np.linalg.norm(np.where(common, known[:, None] - known, 0.0), axis=2)
    off = np.linalg.norm(np.where(common, found[:, None] - known, 0.0), axis=2)
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
    problem: Problem, place: BlockPlace, out: frozenset[ObservationName], each: float
) -> float:
    """Return what observations that are out cost.

    Two control points that are interchanged cost one, and what their coordinates miss the other's
    place by, where the other has them; photos that look up at their points cost three.

    Parameters
    ----------
    problem, out
        As `exchanged_control` has them.
    place
        The block adjusted without those that are out.
    each
        The price of one by itself.
    """
    price = each * len(out)
    for pair in exchanged_control(problem, place.state, out):
        exchanged, square = _misses(problem, place, pair)
        price -= max(0.0, each * (exchanged - 1) - square)
    if look_up(problem, place.state.rotations):
        price += each * _UPSIDE_DOWN
    return price


def _misses(problem: Problem, place: BlockPlace, pair: ExchangedControl) -> tuple[int, float]:
    """Return what coordinates that are out miss the other's place by: how many, sum of squares.

    In sigmas; 0 at a place that was given. A coordinate that the other does not have is none.
    """
    at = plan_control(problem)
    here = np.array([at[point] for point in pair.points])
    out = np.array(
        [[("control", one, axis) in pair.coordinates for axis in "XYZ"] for one in pair.points]
    )
    out &= problem.controlled[here[::-1]]
    cofactors = place.cofactors
    if cofactors is None:
        return int(out.sum()), 0.0
    state = place.state
    off = (state.points[here] + state.origin - problem.known[here[::-1]])[out]
    variance = np.einsum("nii->ni", cofactors.points)[here]
    variance = variance + np.nan_to_num(problem.known_sigma[here[::-1]]) ** 2
    return int(out.sum()), float((off**2 / variance[out]).sum())
