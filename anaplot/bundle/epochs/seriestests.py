"""Tests of displacements through more than two epochs: whether a point moved at all, and when.

Gruen 1978, section D3, eq. (55) to (58), whose B takes in every movement from one epoch to the
next: "a point is the same in all its epochs" is one composite hypothesis of three conditions for
each movement. Any two epochs are tested against each other as two alone are, with the covariances
and the variance factor of all.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import bonferroni_alpha
from anaplot.aliases import Bools, Index
from anaplot.bundle.epochs.againstall import AgainstAll, against_all
from anaplot.bundle.epochs.displacementtests import EpochTests, pair_tests
from anaplot.bundle.epochs.located import Located
from anaplot.bundle.epochs.othernames import exchanged_names
from anaplot.bundle.epochs.overall import Overall, overall
from anaplot.bundle.epochs.series import EpochSeries
from anaplot.bundle.epochs.stabletests import datum_tests, held_points
from anaplot.bundle.epochs.undertest import (
    Limits,
    Orthogonal,
    UnderTest,
    length_of,
    limits_of,
    under_test,
)
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict

__all__ = ["PointSeries", "SeriesTests", "StepMove", "series_tests"]


class StepMove(NamedTuple):
    """A point's movement from one epoch to the next that it is in.

    Attributes
    ----------
    first, second
        Numbers of the epochs, from 1.
    d
        Displacement in X, Y, Z [m].
    s
        Its standard deviations [m]; None without sigma, and of what control gives in both epochs.
    expected
        The given movement [m] that it is tested against.
    length, s_length
        As `PointMove` has them.
    """

    first: int
    second: int
    d: tuple[float, float, float]
    s: tuple[float | None, float | None, float | None]
    expected: tuple[float, float, float]
    length: float
    s_length: float | None


class PointSeries(NamedTuple):
    """A point through its epochs.

    Attributes
    ----------
    point
        Name.
    place
        X, Y, Z in the first of its epochs [m].
    epochs
        Numbers of the epochs that it is in, from 1.
    verdict
        "It is the same in all of them", or has moved as given; Bonferroni over all points; None
        where the cofactors are singular.
    scheffe
        Whether Scheffe's limit is exceeded; None where it cannot be tested.
    orthogonal
        Test of its orthogonal components together; all points together keep the significance.
    moved
        From which epoch to which it has moved: the movements that explain a rejected verdict, one
        after the other until the rest agrees, and those by which it comes back from there, in the
        order of time. A search: that each of them is a movement is not a test at alpha.
    steps
        Its movements.
    """

    point: str
    place: tuple[float, float, float]
    epochs: tuple[int, ...]
    verdict: Verdict | None
    scheffe: bool | None
    orthogonal: Verdict | None
    moved: tuple[tuple[int, int], ...]
    steps: tuple[StepMove, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SeriesTests:
    """The tested displacements of more than two epochs.

    Attributes
    ----------
    series
        What is tested.
    alpha, power
        Settings.
    everything
        "No point has moved in any epoch", or every point as given; None when the cofactors are
        singular.
    agreement
        As `EpochTests` has it.
    points
        Every point.
    pairs
        Any two epochs that have points to compare; all pairs together at alpha.
    against
        Every epoch against all the others; all epochs together at alpha.
    located
        Points that explain most of R, as `EpochTests` has them: each with all its movements.
    located_stable
        The same of the points that hold the datum, as long as three others are left.
    remarks
        Sentences for a person: those of the series, and what the tests add.
    """

    series: EpochSeries = field(repr=False)
    alpha: float
    power: float
    everything: Verdict | None
    agreement: Verdict | None
    points: tuple[PointSeries, ...] = field(repr=False)
    pairs: tuple[EpochTests, ...] = field(repr=False)
    against: tuple[AgainstAll, ...]
    located: tuple[Located, ...]
    located_stable: tuple[Located, ...]
    remarks: tuple[str, ...]

    @property
    def overall(self) -> Overall | None:
        """All families at one level; None where nothing can be tested."""
        return overall(
            {
                "all points": [self.everything],
                held_points(self.series.datum): [self.agreement],
                "points": [p.verdict for p in self.points],
                "pairs of epochs": [pair.everything for pair in self.pairs],
                "single epochs": [one.verdict for one in self.against],
            },
            self.alpha,
        )

    @property
    def any_moved(self) -> bool:
        """Whether something has moved, with the probability of alpha at most if nothing has."""
        return self.overall is not None and self.overall.rejected


def series_tests(series: EpochSeries, *, alpha: float = 0.05) -> SeriesTests:
    """Test the displacements of a series of epochs.

    Parameters
    ----------
    series
        Displacements and their covariance matrix.
    alpha
        Significance of the global test, of all points together, of all pairs of epochs together, of
        all epochs against the others together, and of all these families in `SeriesTests.overall`;
        also of the test of sigma0 of each epoch by itself.

    Raises
    ------
    NotComputableError
        No displacement has a variance.
    ValueError
        Not 0 < alpha < power < 1.
    """
    variance = VarianceFactor(series.vtpv, series.redundancy, series.by_known)
    test = under_test(series.deviation, series.cofactors, ~series.bound.reshape(-1), variance)
    limits = limits_of(variance, alpha, series.power, len(test.rows), len(series.points))
    everything = test.together(alpha)
    parts = test.orthogonal()
    rows: dict[str, list[int]] = {}
    for row, move in enumerate(series.moves):
        rows.setdefault(move.point, []).append(row)
    given, undone = series.given, series.undone
    points = tuple(
        _point_series(series, name, rows[name], test, limits, parts, given, undone, alpha)
        for name in series.points
    )
    located: tuple[Located, ...] = ()
    refuted = None if everything is None else everything.decisive
    if refuted is not None and refuted.rejected:
        number = {name: k for k, name in enumerate(series.points)}
        owners = [number[series.moves[row // 3].point] for row in test.rows.tolist()]
        freed = test.freed(test.rows, owners, refuted)
        located = tuple(
            Located(series.points[step.owner], step.square, step.rest) for step in freed
        )
    between = [series.between(*pair) for pair in combinations(range(len(series.epochs)), 2)]
    compared = [pair for pair in between if pair.points]
    each = bonferroni_alpha(alpha, len(compared))
    datum = datum_tests(series, alpha)
    return SeriesTests(
        series,
        alpha,
        series.power,
        everything,
        datum.agreement,
        points,
        tuple(pair_tests(pair, alpha=each) for pair in compared),
        against_all(series, test, limits.square, alpha),
        located,
        datum.located_stable,
        (*datum.remarks, *exchanged_names(compared, variance.used)),
    )


def _point_series(
    series: EpochSeries,
    name: str,
    moves: list[int],
    test: UnderTest,
    limits: Limits,
    parts: Orthogonal | None,
    given: Bools,
    undone: Mapping[tuple[int, int], Sequence[int]],
    alpha: float,
) -> PointSeries:
    """Test a point through its epochs."""
    every = (3 * np.array(moves)[:, None] + np.arange(3)).reshape(-1)
    mine: Index = every[test.live[every]]
    verdict, beyond = None, None
    whole = test.square(mine) if len(mine) else None
    moved: tuple[tuple[int, int], ...] = ()
    if whole is not None:
        verdict = test.variance.test(whole, len(mine), limits.point_alpha)
        if limits.square is not None:
            beyond = whole > limits.square
        decisive = verdict.decisive
        if decisive is not None and decisive.rejected:
            freed = test.freed(mine, (mine // 3).tolist(), decisive)
            named = {step.owner for step in freed}
            named |= _coming_back(moves, named, undone, test, limits.point_alpha)
            at = (series.moves[row] for row in sorted(named))
            moved = tuple((move.first + 1, move.second + 1) for move in at)
    x, y, z = series.places[moves[0]].tolist()
    epochs = (series.moves[moves[0]].first + 1, *(series.moves[k].second + 1 for k in moves))
    return PointSeries(
        name,
        (x, y, z),
        epochs,
        verdict,
        beyond,
        test.component_test(parts, mine, len(series.points), alpha),
        moved,
        tuple(_step_move(series, row, ~given[row], limits.sigma) for row in moves),
    )


def _coming_back(
    moves: Sequence[int],
    named: Collection[int],
    undone: Mapping[tuple[int, int], Sequence[int]],
    test: UnderTest,
    alpha: float,
) -> set[int]:
    """Return the movements of a point that undo some of those named.

    A movement that follows from one that is named, while all others agree, is one as well. Several
    may undo each other, and of a movement that is bound in part the named one may be another part:
    there the difference itself decides.
    """
    out: set[int] = set()
    for row in moves:
        bound = [axis for axis in range(3) if undone.get((row, axis))]
        after = {k for axis in bound for k in undone[row, axis]} & set(named)
        if row in named or not after:
            continue
        mine = 3 * row + np.array(bound)
        if len(after) > 1 or test.live[3 * row : 3 * row + 3].any():
            square = test.square(mine)
            if square is None or not test.variance.test(square, len(mine), alpha).rejected:
                continue
        out.add(row)
    return out


def _step_move(series: EpochSeries, row: int, free: Bools, sigma: float | None) -> StepMove:
    rows = slice(3 * row, 3 * row + 3)
    d, q = series.d[rows], series.cofactors[rows, rows]
    length, s_length = length_of(np.where(free, d, 0.0), q, sigma)
    x, y, z = d.tolist()
    sx, sy, sz = (
        sigma * sqrt(max(float(q[k, k]), 0.0)) if sigma is not None and free[k] else None
        for k in range(3)
    )
    move = series.moves[row]
    wx, wy, wz = (0.0,) * 3 if series.expected is None else series.expected[rows].tolist()
    return StepMove(
        move.first + 1, move.second + 1, (x, y, z), (sx, sy, sz), (wx, wy, wz), length, s_length
    )
