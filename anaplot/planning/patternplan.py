"""Reliability of a point pattern, and which further point improves it most (1983, Figures 2-7)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array, Index
from anaplot.errors import NotComputableError
from anaplot.orientation.conditionequations import ConditionEquations, ModelUnknowns
from anaplot.orientation.idealmodel import ideal_model
from anaplot.orientation.model import WrongPointsError
from anaplot.orientation.pair import Stereopair
from anaplot.orientation.patterns import Pattern
from anaplot.orientation.results import ModelSolution
from anaplot.photogrammetry.block import TieVariance

__all__ = [
    "PatternReliability",
    "Place",
    "PlannedPattern",
    "PointAdvice",
    "PointSetAdvice",
    "Span",
    "advise_point_sets",
    "advise_points",
    "from_pattern",
    "grid",
    "pattern_reliability",
    "solve",
]

Span = tuple[float, float]
Place = tuple[float, float, str | None, bool]

_PARTS = 60  # best pairs that fours are made of
_SYMMETRIC = 240  # symmetric pairs that they are made of, doubled points first
_AT_ONCE = 4096  # sets
_EQUAL = 1e-9  # between redundancy numbers


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
class PointAdvice:
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


class PointSetAdvice(NamedTuple):
    """Several points together, and the weakest redundancy number before and after.

    Attributes
    ----------
    places
        x, y in the left photo [mm], the label of the point that it doubles or None, and whether
        it is a tie, of each of them.
    symmetric
        Whether the set is its own mirror image.
    before, after
        As `PointAdvice` has them.
    """

    places: tuple[Place, ...]
    symmetric: bool
    before: float
    after: float


class PatternReliability(NamedTuple):
    """What a pattern is worth, and what would help it.

    Attributes
    ----------
    plan
        The pattern.
    solution
        Its model.
    advice
        Further points, the most helpful first.
    sets
        The best two and the best four together.
    """

    plan: PlannedPattern
    solution: ModelSolution
    advice: tuple[PointAdvice, ...]
    sets: tuple[PointSetAdvice, ...]


def from_pattern(pattern: Pattern, base: float, d: float, c: float) -> PlannedPattern:
    """Return a named pattern as planned points; lengths in mm."""
    points = tuple((label, x, y) for label, (x, y) in pattern.positions(base, d).items())
    return PlannedPattern(points, pattern.ties, base, c)


def solve(plan: PlannedPattern, tie_variance: TieVariance = "paper") -> ModelSolution:
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


def pattern_reliability(
    plan: PlannedPattern, x: Span, y: Span, tie_variance: TieVariance = "exact"
) -> PatternReliability:
    """Return what a pattern is worth, and which further points would help it most.

    Parameters
    ----------
    plan
        The pattern.
    x, y
        Where a further point may lie: from, to [mm].
    tie_variance
        How the ties err.

    Raises
    ------
    NotComputableError
        The points do not determine the model.
    """
    places = grid(x, y)
    return PatternReliability(
        plan,
        solve(plan, tie_variance),
        advise_points(plan, places, tie_variance),
        advise_point_sets(plan, places, tie_variance),
    )


def grid(x: Span, y: Span, steps: int = 5) -> tuple[tuple[float, float], ...]:
    """Return steps x steps positions over the model, between the ends of x and of y [mm]."""
    places = ((float(px), float(py)) for px in np.linspace(*x, steps)
              for py in np.linspace(*y, steps))  # fmt: skip
    return tuple(dict.fromkeys(places))


def advise_points(
    plan: PlannedPattern,
    extra: Iterable[tuple[float, float]],
    tie_variance: TieVariance = "paper",
) -> tuple[PointAdvice, ...]:
    """Try every doubled point and every extra position; the most helpful comes first.

    Where there are ties, what lies no further along the flight than they do is tried as a tie
    too: the preceding model has it.

    Raises
    ------
    NotComputableError
        The points do not determine the model.
    """
    tried = _Candidates(plan, extra, tie_variance)
    weakest = tried.weakest(np.arange(len(tried.places))[:, None])
    out = [
        PointAdvice(*place, tried.before, after)
        for place, after in zip(tried.places, weakest.tolist(), strict=True)
        if np.isfinite(after)
    ]
    return tuple(sorted(out, key=lambda a: -a.after))


def advise_point_sets(
    plan: PlannedPattern,
    extra: Iterable[tuple[float, float]],
    tie_variance: TieVariance = "paper",
) -> tuple[PointSetAdvice, ...]:
    """Look for the two and the four further points that help most together.

    All pairs are tried. Of fours, those made of two of the best pairs, and of two symmetric ones:
    in a symmetric pattern the weakest rows come in pairs or fours, and nothing less than a point
    for each of them helps. Of equal sets a symmetric one is preferred.

    Parameters
    ----------
    plan, extra, tie_variance
        As `advise_points` has them.

    Returns
    -------
    tuple of SetAdvice
        The best two points, then the best four; none where no so many places were tried.

    Raises
    ------
    NotComputableError
        The points do not determine the model.
    """
    tried = _Candidates(plan, extra, tie_variance)
    pairs = tried.apart(np.array(list(combinations(range(len(tried.places)), 2))).reshape(-1, 2))
    if not len(pairs):
        return ()
    order = np.argsort(-tried.weakest(pairs), kind="stable")
    symmetric = np.array([tried.symmetric(pair) for pair in pairs.tolist()])
    parts = np.concatenate((pairs[order[:_PARTS]], pairs[symmetric][:_SYMMETRIC]))
    fours = tried.apart(
        np.array([[*a, *b] for a, b in combinations(parts.tolist(), 2)]).reshape(-1, 4)
    )
    return tuple(tried.best(sets) for sets in (pairs, fours) if len(sets))


class _Candidates:
    """Places for further points, and what sets of them do to the rows that are there already.

    Redundancy numbers of the ideal model need no solution: its unknowns are known.
    """

    def __init__(
        self, plan: PlannedPattern, extra: Iterable[tuple[float, float]], tie_variance: TieVariance
    ) -> None:
        solve(plan, "propagated" if tie_variance == "exact" else tie_variance)  # is determined
        doubled = [(x, y, label) for label, x, y in plan.points]
        taken = {(x, y) for x, y, _ in doubled}
        reach = max((x for label, x, _ in plan.points if label in plan.ties), default=-np.inf)
        self.places: list[Place] = [
            (x, y, doubles, tie)
            for x, y, doubles in (
                *doubled,
                *((x, y, None) for x, y in extra if (x, y) not in taken),
            )
            for tie in ((False, True) if x <= reach else (False,))
        ]
        own = [(x, y, label in plan.ties) for label, x, y in plan.points]
        rows, _ = _design(plan, own, tie_variance)
        more, of_place = _design(plan, [(x, y, tie) for x, y, _, tie in self.places], tie_variance)
        scale = np.linalg.norm(rows, axis=0)
        self._rows = rows / scale
        more = more / scale
        self._normal = self._rows.T @ self._rows
        self._added = np.zeros((len(self.places), *self._normal.shape))
        np.add.at(self._added, of_place, more[:, :, None] * more[:, None, :])
        self.before = float(self.weakest(np.zeros((1, 0), dtype=np.intp))[0])
        ys = [y for _, _, y in plan.points]
        self._middle = 0.5 * plan.base, 0.5 * (min(ys) + max(ys))

    def weakest(self, sets: Index) -> Array:
        """Return (k,) the weakest redundancy number with each of k sets of places; NaN: none."""
        out = np.empty(len(sets))
        for begin in range(0, len(sets), _AT_ONCE):
            part = sets[begin : begin + _AT_ONCE]
            normal = self._normal + self._added[part].sum(axis=1)
            rows = np.broadcast_to(self._rows.T, (len(normal), *self._rows.T.shape))
            solved = np.linalg.solve(normal, rows)
            # none is below zero but by rounding
            r = np.maximum(1.0 - np.einsum("ni,kin->kn", self._rows, solved), 0.0)
            # a place far out of all measure leaves nothing to solve with
            lost = np.linalg.cond(normal) > 1e8
            out[begin : begin + _AT_ONCE] = np.where(lost, np.nan, r.min(axis=1))
        return out

    def apart(self, sets: Index) -> Index:
        """Return the sets in which no place comes twice, as a tie or not."""
        xy = np.array([place[:2] for place in self.places])
        kept = np.ones(len(sets), dtype=bool)
        for a, b in combinations(range(sets.shape[1]), 2):
            kept &= (xy[sets[:, a]] != xy[sets[:, b]]).any(axis=1)
        found = np.unique(np.sort(sets[kept], axis=1), axis=0)
        return np.asarray(found, dtype=np.intp).reshape(-1, sets.shape[1])

    def symmetric(self, members: Sequence[int]) -> bool:
        """Whether a set is its own mirror image: across x, along x, or both."""
        x0, y0 = self._middle
        at = {(round(x, 6), round(y, 6)) for x, y, _, _ in (self.places[k] for k in members)}
        images = (
            {(x, round(2.0 * y0 - y, 6)) for x, y in at},
            {(round(2.0 * x0 - x, 6), y) for x, y in at},
            {(round(2.0 * x0 - x, 6), round(2.0 * y0 - y, 6)) for x, y in at},
        )
        return any(image == at for image in images)

    def best(self, sets: Index) -> PointSetAdvice:
        """Return the set that helps most, of equal ones a symmetric one."""
        after = self.weakest(sets)
        most = float(np.nanmax(after))
        equal = sets[after >= most - _EQUAL].tolist()
        chosen = max(equal, key=self.symmetric)
        return PointSetAdvice(
            tuple(self.places[k] for k in chosen), self.symmetric(chosen), self.before, most
        )


def _design(
    plan: PlannedPattern, points: Sequence[tuple[float, float, bool]], tie_variance: TieVariance
) -> tuple[Array, Index]:
    """Return weighted rows of points (x, y, tie) in the ideal model, and each row's point."""
    xl = np.array([(x, y) for x, y, _ in points]).reshape(-1, 2)
    names = tuple(map(str, range(len(points))))
    pair = Stereopair(
        left="left",
        right="right",
        points=names,
        xl=xl,
        xr=xl - [plan.base, 0.0],
        c_left=plan.c,
        c_right=plan.c,
        ties={
            name: (x, y, -plan.c)
            for name, (x, y, tie) in zip(names, points, strict=True)
            if tie
        } if plan.ties else None,
        preceding_bx=plan.base if plan.ties else None,
    )  # fmt: skip
    conditions = ConditionEquations(pair, tie_variance)
    rows = conditions.evaluate(ModelUnknowns(plan.base, 0.0, 0.0, np.eye(3)))
    return rows[conditions.unknown_rows()].T, np.array(
        [*conditions.y_index, *conditions.x_index], dtype=np.intp
    )
