"""What a robust adjustment leaves far off, rejected place by place.

A place is seen with all of its own rows in and all others as their weights have them: with v the
misclosures of the weighted adjustment and p the factors of the weights, z = (1 - p) v are the
estimated errors of the rows of reduced weight (`reweighting`), and with these taken back

    e = v - z + R z

are the misclosures of the place with its own rows at full weight. So which of several rows of a
place goes is decided as if all that is wrong elsewhere were known.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from anaplot.adjustment.apart import FarOff
from anaplot.adjustment.elimination import Elimination, NotSeparableError
from anaplot.adjustment.findings import SearchStep
from anaplot.adjustment.nothingbetter import explained
from anaplot.adjustment.places import Places
from anaplot.adjustment.reweighting import Reweighting
from anaplot.adjustment.significance import critical_normal
from anaplot.adjustment.stepwise import beyond_limit, reject_sizes
from anaplot.adjustment.watch import Watch
from anaplot.adjustment.withoutrows import RowsGiven, WithoutRows, places_without
from anaplot.aliases import Bools

__all__ = ["far_off"]


def far_off(
    without: WithoutRows,
    robust: Reweighting,
    alpha: float,
    suspects: Bools,
    most: int,
    left_out: Collection[int],
) -> list[FarOff]:
    """Return what a robust adjustment leaves beyond its limit, the largest first.

    Parameters
    ----------
    without
        Sees the adjustment without some rows.
    robust
        The weights and misclosures of the robust adjustment.
    alpha
        Two-sided significance of one row.
    suspects
        (n,) rows that may be rejected.
    most
        Largest number of rows rejected at a place.
    left_out
        Rows that are out for good.

    Raises
    ------
    NotComputableError
        Something is not determined without all of that.
    """
    given = without.drafted(sorted({*without.begun, *left_out}))
    found = _at_places(given, robust, critical_normal(alpha), suspects, most, left_out)
    del given  # as large as the adjustment
    if not found:
        return []
    out = {row for there in found for step in there.steps for row in there.gone(step)}
    return _checked(without.drafted(sorted(out.union(left_out))), found, left_out)


def _at_places(
    given: RowsGiven,
    robust: Reweighting,
    critical: float,
    suspects: Bools,
    most: int,
    left_out: Collection[int],
) -> list[FarOff]:
    size = np.abs(robust.misclosures)
    beyond = beyond_limit(size, critical, suspects)
    numbers = np.unique(given.places_of(beyond))
    found: list[FarOff] = []
    for places in places_without(given, numbers[numbers >= 0], left_out):
        there = _at_full_weight(places, robust)
        for at, rows in enumerate(places.rows):
            state = Elimination(there.place(at).system)
            mine = size[rows]
            going = beyond_limit(mine, critical, suspects[rows])
            steps = reject_sizes(state, mine, going, critical, suspects[rows], most, Watch())
            if steps:
                found.append(FarOff(rows, steps))
    found.sort(key=lambda one: -(one.steps[0].statistic or 0.0))
    return found


def _checked(given: RowsGiven, found: Sequence[FarOff], left_out: Collection[int]) -> list[FarOff]:
    """Return the steps whose rows others still check where all of it has gone elsewhere."""
    numbers = given.places_of(np.array([there.rows[0] for there in found], dtype=np.intp))
    at = {number: k for k, number in enumerate(numbers.tolist())}
    kept: list[list[SearchStep]] = [[] for _ in found]
    for places in places_without(given, numbers, left_out):
        for one, number in enumerate(places.numbers.tolist()):
            state, k = Elimination(places.place(one).system), at[number]
            for step in found[k].steps:
                before = set(state.rows)
                try:
                    for row in step.rows:
                        state.add(row)
                except NotSeparableError:
                    state.drop_all(set(state.rows) - before)
                else:
                    kept[k].append(step)
    return [FarOff(there.rows, steps) for there, steps in zip(found, kept, strict=True) if steps]


def _at_full_weight(places: Places, robust: Reweighting) -> Places:
    """Return places with all of their own rows at full weight, all others as they are weighted."""
    p, v = robust.weights[places.rows], robust.misclosures[places.rows]
    z = (1.0 - p) * v
    e = p * v + np.einsum("cij,cj->ci", places.matrix, z)
    pairs = zip(e, places.matrix, strict=True)
    return places._replace(e=e, vtpv=np.array([explained(one, matrix) for one, matrix in pairs]))
