"""Tests of displacements between two epochs: all, single points, single coordinates.

Gruen 1978, section D3, eq. (55) to (58). "Bonferroni" shares the significance among the tests of a
family, "Scheffe" keeps it for every combination of coordinates that anyone may choose, and
orthogonal components are independent of each other, so that each can be tested by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Index
from anaplot.bundle.epochs.located import Located
from anaplot.bundle.epochs.othernames import exchanged_names
from anaplot.bundle.epochs.overall import Overall, overall
from anaplot.bundle.epochs.series import EpochDifferences
from anaplot.bundle.epochs.stabletests import datum_tests, held_points
from anaplot.bundle.epochs.undertest import (
    Limits,
    Orthogonal,
    UnderTest,
    length_of,
    limits_of,
    under_test,
)
from anaplot.bundle.epochs.variances import VarianceRatio, variance_ratio
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict

__all__ = ["CoordinateMove", "EpochTests", "PointMove", "epoch_tests", "pair_tests"]


class CoordinateMove(NamedTuple):
    """The displacement of one coordinate.

    Attributes
    ----------
    axis
        "X", "Y" or "Z".
    d, s
        Displacement [m] and its standard deviation with the sigma of the test; s None without.
    given
        Whether control gives the coordinate in both epochs: what differs is no movement, and is
        not tested.
    verdict
        Bonferroni over all coordinates; None where the displacement has no variance.
    scheffe
        Whether Scheffe's limit is exceeded; None where it cannot be tested.
    half_bonferroni, half_scheffe
        Half widths of the simultaneous confidence intervals [m]; None without.
    mdb
        Smallest displacement [m] found with the power asked for; None without variance.
    expected
        The given movement [m] that it is tested against.
    component, alike
        The orthogonal component that stands for it over its standard deviation, and the correlation
        of both, as `Orthogonal` has them; None where there is none.
    orthogonal
        Test of the component by itself; all components together keep the significance.
    """

    axis: str
    d: float
    s: float | None
    given: bool
    verdict: Verdict | None
    scheffe: bool | None
    half_bonferroni: float | None
    half_scheffe: float | None
    mdb: float | None
    expected: float = 0.0
    component: float | None = None
    alike: float | None = None
    orthogonal: Verdict | None = None


class PointMove(NamedTuple):
    """The displacement of one point.

    Attributes
    ----------
    point
        Name.
    place
        X, Y, Z in the first epoch [m].
    length
        Of the displacement [m], over the coordinates that are not given in both epochs.
    s_length
        Its standard deviation [m] along its own direction; None without sigma.
    verdict
        Bonferroni over all points; None where the cofactors are singular.
    scheffe
        Whether Scheffe's limit is exceeded; None where it cannot be tested.
    coordinates
        X, Y and Z.
    orthogonal
        Test of its orthogonal components together; all points together keep the significance.
    """

    point: str
    place: tuple[float, float, float]
    length: float
    s_length: float | None
    verdict: Verdict | None
    scheffe: bool | None
    coordinates: tuple[CoordinateMove, CoordinateMove, CoordinateMove]
    orthogonal: Verdict | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EpochTests:
    """The tested displacements.

    Attributes
    ----------
    differences
        What is tested.
    alpha, power
        Settings.
    everything
        "No point has moved", or with a given movement "every point has moved so"; None when the
        cofactors are singular.
    agreement
        "The points that hold the datum have not moved", stable ones or the control of all epochs;
        None where that is not tested.
    variance
        Of both epochs by themselves; None without redundancy in one, or where its residuals are
        rounding.
    points
        Every point.
    located
        Points without which the rest is accepted, as `free_one_by_one` finds them, the one that
        explains most of R first. A search: that each named point has moved is not a test at alpha.
    located_stable
        The same of the points that hold the datum, as long as three others are left.
    remarks
        Sentences for a person: those of the differences, and what the tests add.
    """

    differences: EpochDifferences = field(repr=False)
    alpha: float
    power: float
    everything: Verdict | None
    agreement: Verdict | None
    variance: VarianceRatio | None
    points: tuple[PointMove, ...] = field(repr=False)
    located: tuple[Located, ...]
    located_stable: tuple[Located, ...]
    remarks: tuple[str, ...]

    @property
    def overall(self) -> Overall | None:
        """All families at one level; None where nothing can be tested."""
        return overall(
            {
                "all points": [self.everything],
                held_points(self.differences.datum): [self.agreement],
                "points": [p.verdict for p in self.points],
                "coordinates": [c.verdict for p in self.points for c in p.coordinates],
            },
            self.alpha,
        )

    @property
    def any_moved(self) -> bool:
        """Whether something has moved, with the probability of alpha at most if nothing has."""
        return self.overall is not None and self.overall.rejected


def epoch_tests(found: EpochDifferences, *, alpha: float = 0.05) -> EpochTests:
    """Test displacements.

    Parameters
    ----------
    found
        Displacements and their covariance matrix.
    alpha
        Significance of the global test, of each family of single tests, and of all of them
        together in `EpochTests.overall`; also of the test of sigma0 of each epoch by itself.

    Raises
    ------
    NotComputableError
        No displacement has a variance.
    ValueError
        Not 0 < alpha < power < 1.
    """
    tested = pair_tests(found, alpha=alpha)
    datum = datum_tests(found, alpha)
    sigma = VarianceFactor(found.vtpv, found.redundancy, found.by_known).used
    return replace(
        tested,
        agreement=datum.agreement,
        located_stable=datum.located_stable,
        remarks=(*datum.remarks, *exchanged_names([found], sigma)),
    )


def pair_tests(found: EpochDifferences, *, alpha: float) -> EpochTests:
    """Test displacements between two epochs out of several: what concerns these two alone.

    Parameters and errors as `epoch_tests` has them; neither the datum nor the epochs by themselves
    are tested, and there are no remarks.
    """
    variance = VarianceFactor(found.vtpv, found.redundancy, found.by_known)
    test = under_test(found.deviation, found.cofactors, ~found.given.reshape(-1), variance)
    limits = limits_of(variance, alpha, found.power, len(test.rows), len(found.points))
    parts = test.orthogonal()
    moves = tuple(
        _point_move(found, k, test, limits, parts, alpha) for k in range(len(found.points))
    )
    everything = test.together(alpha)
    located: tuple[Located, ...] = ()
    refuted = None if everything is None else everything.decisive
    if refuted is not None and refuted.rejected:
        freed = test.freed(test.rows, (test.rows // 3).tolist(), refuted)
        located = tuple(Located(found.points[step.owner], step.square, step.rest) for step in freed)
    return EpochTests(
        found,
        alpha,
        found.power,
        everything,
        None,
        variance_ratio(*found.alone),
        moves,
        located,
        (),
        (),
    )


def _point_move(
    found: EpochDifferences,
    k: int,
    test: UnderTest,
    limits: Limits,
    parts: Orthogonal | None,
    alpha: float,
) -> PointMove:
    """Test the displacement of point `k` by itself, and its coordinates."""
    variance = test.variance
    rows = slice(3 * k, 3 * k + 3)
    mine: Index = 3 * k + np.flatnonzero(test.live[rows])
    verdict, beyond = None, None
    whole = test.square(mine) if len(mine) else None
    if whole is not None:
        verdict = variance.test(whole, len(mine), limits.point_alpha)
        if limits.square is not None:
            beyond = whole > limits.square
    free = np.where(found.given[k], 0.0, found.d[rows])
    length, s_length = length_of(free, found.cofactors[rows, rows], limits.sigma)
    x, y, z = found.places[k].tolist()
    first, second, third = (
        _coordinate_move(found, k, axis, test, limits, parts, alpha) for axis in range(3)
    )
    return PointMove(
        found.points[k],
        (x, y, z),
        length,
        s_length,
        verdict,
        beyond,
        (first, second, third),
        test.component_test(parts, mine, len(found.points), alpha),
    )


def _coordinate_move(
    found: EpochDifferences,
    k: int,
    axis: int,
    test: UnderTest,
    limits: Limits,
    parts: Orthogonal | None,
    alpha: float,
) -> CoordinateMove:
    at = 3 * k + axis
    name, d = "XYZ"[axis], float(found.d[at])
    if not test.live[at]:
        given = bool(found.given[k, axis])
        return CoordinateMove(name, d, None, given, None, None, None, None, None)
    root, deviation = sqrt(float(found.cofactors[at, at])), float(test.d[at])
    s = None if limits.sigma is None else limits.sigma * root
    half_bonferroni, half_scheffe = (
        None if s is None or limit is None else limit * s
        for limit in (limits.bonferroni, limits.scheffe)
    )
    return CoordinateMove(
        name,
        d,
        s,
        False,
        test.variance.test((deviation / root) ** 2, 1, limits.coordinate_alpha),
        None if half_scheffe is None else abs(deviation) > half_scheffe,
        half_bonferroni,
        half_scheffe,
        limits.reach * root,
        0.0 if found.expected is None else float(found.expected[at]),
        None if parts is None else float(parts.values[at]),
        None if parts is None else float(parts.alike[at]),
        test.component_test(parts, np.array([at]), len(test.rows), alpha),
    )
