"""One epoch against all the others: which is the odd one.

Gruen 1978, eq. (55) to (58): B takes in what an epoch has for itself. Its R is what R of "no point
has moved" falls by when every point may be elsewhere in this one epoch and the others agree: no
difference from one epoch to the next is picked out, so that the test is the same whichever of them
it follows.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import (
    DependentConditionsError,
    bonferroni_alpha,
    quadratic_form,
)
from anaplot.aliases import Array, Index
from anaplot.bundle.epochs.series import EpochSeries
from anaplot.bundle.epochs.undertest import UnderTest
from anaplot.bundle.hypotheses.verdict import Verdict

__all__ = ["AgainstAll", "against_all"]


class AgainstAll(NamedTuple):
    """An epoch against all the others.

    Attributes
    ----------
    epoch
        Its number, from 1.
    points
        How many points it has coordinates of for itself.
    verdict
        "Its points are where they are in the others", which agree among themselves; all epochs
        together at alpha.
    rest
        R of the others among themselves.
    explains
        Whether "no point has moved" is rejected, and what is left without this epoch is within its
        limit: it is the odd one, or one of several that may be.
    """

    epoch: int
    points: int
    verdict: Verdict
    rest: float
    explains: bool


def against_all(
    series: EpochSeries, test: UnderTest, limit: float | None, alpha: float
) -> tuple[AgainstAll, ...]:
    """Test every epoch against all the others.

    Parameters
    ----------
    series, test
        The displacements.
    limit
        Of R of all of them.
    alpha
        Significance of all epochs together.

    Returns
    -------
    tuple
        The epochs that have something for themselves, but where the cofactors are singular.
    """
    live = test.rows
    d, cofactors = test.d[live], test.cofactors[np.ix_(live, live)]
    try:
        total = quadratic_form(d, cofactors)
    except DependentConditionsError:
        return ()
    own = [_own_coordinates(series, test, epoch) for epoch in range(len(series.epochs))]
    count = sum(len(into) > 0 for into, _, _ in own)
    if count == 0:
        return ()
    each = bonferroni_alpha(alpha, count)
    # a row of zeros for a movement that there is not
    information = np.zeros((len(live) + 1, len(live) + 1))
    information[:-1, :-1] = np.linalg.inv(cofactors)
    gradient = information[:, :-1] @ d
    out = []
    for epoch, (into, away, points) in enumerate(own):
        if not len(into):
            continue
        try:
            square = min(_drop(information, gradient, into, away), total)
        except DependentConditionsError:
            continue
        rest, left = total - square, len(live) - len(into)
        explains = limit is not None and total > limit
        if explains and left:
            # by as many conditions as the others have among themselves
            explains = not test.variance.test(rest, left, alpha).rejected
        verdict = test.variance.test(square, len(into), each)
        out.append(AgainstAll(epoch + 1, points, verdict, rest, explains))
    return tuple(out)


def _drop(information: Array, gradient: Array, into: Index, away: Index) -> float:
    """Return what R falls by when the coordinates between two differences each are free."""
    first, second = information[into], information[away]
    normal = first[:, into] - first[:, away] - second[:, into] + second[:, away]
    return quadratic_form(gradient[into] - gradient[away], normal)


def _own_coordinates(series: EpochSeries, test: UnderTest, epoch: int) -> tuple[Index, Index, int]:
    """Return the coordinates that an epoch has for itself, and of how many points they are.

    Each by the tested differences that come to it and go from it; -1 where there is none.
    """
    column = np.full(len(test.live), -1, dtype=np.intp)
    column[test.rows] = np.arange(len(test.rows))
    ends: dict[tuple[str, int], list[int]] = {}
    others: dict[str, set[int]] = {}
    for row, move in enumerate(series.moves):
        others.setdefault(move.point, set()).update((move.first, move.second))
        for side, at in enumerate((move.second, move.first)):
            for axis in range(3) if at == epoch else ():
                ends.setdefault((move.point, axis), [-1, -1])[side] = column[3 * row + axis]
    mine = {
        (point, axis): pair
        for (point, axis), pair in ends.items()
        if max(pair) >= 0 and not _shared(series, point, axis, epoch, others[point])
    }
    found = np.array(list(mine.values()), dtype=np.intp).reshape(-1, 2)
    return found[:, 0], found[:, 1], len({point for point, _ in mine})


def _shared(
    series: EpochSeries, point: str, axis: int, epoch: int, epochs: Collection[int]
) -> bool:
    """Whether a coordinate is that of another epoch as well."""
    return any(k != epoch and series.common.same(point, axis, epoch, k) for k in epochs)
