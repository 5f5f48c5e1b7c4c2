"""Tests of displacements between two epochs: all, single points, single coordinates.

Gruen 1978, section D3, eq. (55) to (58). "Bonferroni" shares the significance among the tests of a
family, "Scheffe" keeps it for every combination of coordinates that anyone may choose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import fdtr, fdtrc

from anaplot.adjustment.hypothesis import (
    DependentConditionsError,
    bonferroni_alpha,
    critical_f,
    f_test,
    quadratic_form,
    scheffe_factor,
)
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.epochs.displacements import Agreement, EpochDifferences
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict
from anaplot.errors import NotComputableError

__all__ = [
    "CoordinateMove",
    "EpochTests",
    "Located",
    "Overall",
    "PointMove",
    "VarianceRatio",
    "epoch_tests",
]


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
    """

    point: str
    place: tuple[float, float, float]
    length: float
    s_length: float | None
    verdict: Verdict | None
    scheffe: bool | None
    coordinates: tuple[CoordinateMove, CoordinateMove, CoordinateMove]


class Located(NamedTuple):
    """A step of naming moved points.

    Attributes
    ----------
    point
        The point whose displacement explains most of what is left.
    square
        What R falls by when this point may move besides those named before: R of its displacement
        against what those not yet named, held at zero, let expect.
    rest
        R of all other points once this one may move.
    """

    point: str
    square: float
    rest: float


class VarianceRatio(NamedTuple):
    """Whether both epochs have the same variance factor.

    Attributes
    ----------
    ratio
        First over second.
    redundancies
        Of both.
    significance
        Two-sided probability of a ratio as far from one.
    """

    ratio: float
    redundancies: tuple[int, int]
    significance: float


class Overall(NamedTuple):
    """Whether anything has moved: all families of tests together, at one level.

    Attributes
    ----------
    families
        Names of the families that could be tested.
    significance
        Smallest probability of a family, times their number (Bonferroni): if nothing has moved it
        is below alpha with a probability of alpha at most, however the families hang together.
    alpha
        Of all families together.
    """

    families: tuple[str, ...]
    significance: float
    alpha: float

    @property
    def rejected(self) -> bool:
        """Whether something has moved."""
        return self.significance < self.alpha


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
        "No point has moved"; None when the cofactors are singular.
    agreement
        "The points that hold the datum have not moved"; None when control holds it.
    variance
        Of both epochs by themselves; None without redundancy in one, or where its residuals are
        rounding.
    points
        Every point.
    located
        Points that explain most of R, one after the other, until the rest is within the global
        limit. A search: that each named point has moved is not a test at alpha.
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
        families = {
            "all points": [self.everything],
            "stable points": [self.agreement],
            "points": [p.verdict for p in self.points],
            "coordinates": [c.verdict for p in self.points for c in p.coordinates],
        }
        smallest: dict[str, float] = {}
        for name, verdicts in families.items():
            tests = [v.decisive for v in verdicts if v is not None and v.decisive is not None]
            if tests:
                smallest[name] = len(tests) * min(test.significance for test in tests)
        if not smallest:
            return None
        significance = min(1.0, len(smallest) * min(smallest.values()))
        return Overall(tuple(smallest), significance, self.alpha)

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
    power = found.power
    variance = VarianceFactor(found.vtpv, found.redundancy, found.by_known)
    live = _with_variance(found)
    if not live.any():
        raise NotComputableError("no displacement has a variance: nothing can be tested")
    b = int(live.sum())
    total = _square(found, np.flatnonzero(live))
    everything = None if total is None else variance.test(total, b, alpha)
    limits = _limits(variance, alpha, power, b, len(found.points))
    moves = tuple(_point_move(found, k, live, variance, limits) for k in range(len(found.points)))
    agreement = _agreement_test(found, variance, alpha)
    located: tuple[Located, ...] = ()
    located_stable: tuple[Located, ...] = ()
    remarks = [*found.remarks, *_doubtful_epochs(found, alpha)]
    if found.agreement is not None and agreement is not None and agreement.rejected:
        located_stable = _located_stable(found, found.agreement, agreement)
        most = ", ".join(step.point for step in located_stable[:8])
        remarks.append(
            f"the stable points have moved ({most or 'which of them does not show'}): every "
            "displacement hangs on a refuted datum"
            + (": leave out of --stable what is named" if most else "")
        )
    if everything is not None and everything.rejected and limits.square is not None:
        located = _located(found, np.nonzero(live)[0].tolist(), limits.square)
    return EpochTests(
        found,
        alpha,
        power,
        everything,
        agreement,
        _ratio(found),
        moves,
        located,
        located_stable,
        tuple(remarks),
    )


def _square(found: EpochDifferences, rows: Index) -> float | None:
    """Return R of some differences; None where their cofactors are singular."""
    try:
        return quadratic_form(found.d[rows], found.cofactors[np.ix_(rows, rows)])
    except DependentConditionsError:
        return None


def _with_variance(found: EpochDifferences) -> Bools:
    """Return (3 m,) which differences are tested: no given ones, none without variance."""
    q = np.diag(found.cofactors)
    free = ~found.given.reshape(-1)
    return np.asarray(free & (q > 1e-12 * float(q[free].max(initial=0.0))))


class _Limits(NamedTuple):
    """What single displacements are tested with.

    Attributes
    ----------
    sigma
        Of unit weight; None where there is none: then all that follows from it is None.
    point_alpha, coordinate_alpha
        Bonferroni's significance of one point and of one coordinate.
    bonferroni, scheffe
        Limits of a displacement over its standard deviation.
    square
        Scheffe's limit of a quadratic form for the a-priori sigma0.
    reach
        Smallest detectable displacement over the root of its cofactor.
    """

    sigma: float | None
    point_alpha: float
    coordinate_alpha: float
    bonferroni: float | None
    scheffe: float | None
    square: float | None
    reach: float


def _limits(
    variance: VarianceFactor, alpha: float, power: float, coordinates: int, points: int
) -> _Limits:
    sigma, degrees = variance.used, variance.degrees
    sharp = bonferroni_alpha(alpha, coordinates)
    scheffe = None if sigma is None else scheffe_factor(alpha, coordinates, degrees)
    return _Limits(
        sigma,
        bonferroni_alpha(alpha, points),
        sharp,
        None if sigma is None else sqrt(critical_f(sharp, 1, degrees)),
        scheffe,
        None if sigma is None or scheffe is None else (scheffe * sigma) ** 2,
        sqrt(variance.detectable(sharp, power)),
    )


def _point_move(
    found: EpochDifferences,
    k: int,
    live: Bools,
    variance: VarianceFactor,
    limits: _Limits,
) -> PointMove:
    """Test the displacement of point `k` by itself, and its coordinates."""
    rows = slice(3 * k, 3 * k + 3)
    mine = 3 * k + np.flatnonzero(live[rows])
    verdict, beyond = None, None
    whole = _square(found, mine) if len(mine) else None
    if whole is not None:
        verdict = variance.test(whole, len(mine), limits.point_alpha)
        if limits.square is not None:
            beyond = whole > limits.square
    free = np.where(found.given[k], 0.0, found.d[rows])
    length = float(np.linalg.norm(free))
    s_length = None
    if limits.sigma is not None and length > 0.0:
        square = float(free @ found.cofactors[rows, rows] @ free)
        s_length = limits.sigma * sqrt(max(square, 0.0)) / length
    x, y, z = found.places[k].tolist()
    first, second, third = (_coordinate_move(found, k, axis, live, variance, limits)
                            for axis in range(3))  # fmt: skip
    return PointMove(
        found.points[k],
        (x, y, z),
        length,
        s_length,
        verdict,
        beyond,
        (first, second, third),
    )


def _coordinate_move(
    found: EpochDifferences,
    k: int,
    axis: int,
    live: Bools,
    variance: VarianceFactor,
    limits: _Limits,
) -> CoordinateMove:
    at = 3 * k + axis
    name, d = "XYZ"[axis], float(found.d[at])
    if not live[at]:
        given = bool(found.given[k, axis])
        return CoordinateMove(name, d, None, given, None, None, None, None, None)
    root = sqrt(float(found.cofactors[at, at]))
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
        variance.test((d / root) ** 2, 1, limits.coordinate_alpha),
        None if half_scheffe is None else abs(d) > half_scheffe,
        half_bonferroni,
        half_scheffe,
        limits.reach * root,
    )


def _agreement_test(
    found: EpochDifferences, variance: VarianceFactor, alpha: float
) -> Verdict | None:
    """Test "the stable points have not moved"; None where nothing is left to agree in."""
    if found.agreement is None or not found.agreement.dimension > 0:
        return None
    square, dimension = found.agreement.square, found.agreement.dimension
    # jointly adjusted, the quadratic form is a part of v'Pv
    left = variance.without(square, dimension) if found.joint else variance
    return left.test(square, dimension, alpha)


def _located(found: EpochDifferences, live: list[int], limit: float) -> tuple[Located, ...]:
    cofactors = found.cofactors[np.ix_(live, live)]
    total = quadratic_form(found.d[live], cofactors)
    information = np.asarray(np.linalg.inv(cofactors), dtype=np.float64)
    return _search(found.points, found.d, live, information, total, limit, least=0)


def _located_stable(
    found: EpochDifferences, agreement: Agreement, verdict: Verdict
) -> tuple[Located, ...]:
    test = verdict.decisive
    if test is None:
        return ()
    limit = test.critical * test.dimension * test.sigma**2
    d, information = agreement.d, agreement.information
    total = float(d @ information @ d)
    # three points fit each other up to two conditions: which of them moved does not show
    return _search(found.common, d, list(range(len(d))), information, total, limit, least=9)


def _search(
    names: Sequence[str],
    d: Array,
    live: list[int],
    information: Array,
    total: float,
    limit: float,
    *,
    least: int,
) -> tuple[Located, ...]:
    """Let one point after the other move until R of the rest is within the limit.

    R of the rest with the moved points free is that of the rest by itself: free points take no
    part in it.

    Parameters
    ----------
    names, d
        All points, and their 3 coordinates each.
    live, information
        Rows of `d` that take part, and the inverse of their cofactors, or their pseudo-inverse.
    total, limit
        R of all of them, and what it may be.
    least
        Rows that stay.
    """
    rest = list(live)
    out: list[Located] = []
    while len(rest) > least and total > limit:
        gradient = information @ d[rest]
        at: dict[int, list[int]] = {}
        for position, row in enumerate(rest):
            at.setdefault(row // 3, []).append(position)
        drops = {
            point: float(gradient[mine] @ _inverse(information[np.ix_(mine, mine)])
                         @ gradient[mine])
            for point, mine in at.items()
        }  # fmt: skip
        point = max(drops, key=lambda name: drops[name])
        mine = at[point]
        stay = [k for k in range(len(rest)) if k not in set(mine)]
        # the information of the rest alone is the Schur complement
        side = information[np.ix_(stay, mine)]
        core = _inverse(information[np.ix_(mine, mine)])
        information = information[np.ix_(stay, stay)] - side @ core @ side.T
        rest = [rest[k] for k in stay]
        total = max(total - drops[point], 0.0)
        out.append(Located(names[point], drops[point], total))
    return tuple(out)


def _inverse(core: Array) -> Array:
    # a direction in which the others leave a stable point open is none in which it can be seen
    return np.asarray(np.linalg.pinv(core, rcond=1e-9, hermitian=True))


def _doubtful_epochs(found: EpochDifferences, alpha: float) -> list[str]:
    """Name the epochs whose sigma0 by itself is too large for its a-priori value."""
    by_itself = (
        " (by itself, without additional parameters)"
        if found.joint and found.own_parameters is not None
        else ""
    )
    out = []
    for number, (vtpv, redundancy) in enumerate(found.alone, start=1):
        if redundancy < 1:
            continue
        test = f_test(vtpv, redundancy, alpha=alpha)
        if test.rejected:
            out.append(
                f"epoch {number}: its global test is rejected{by_itself}: sigma0^2 "
                f"{test.statistic:.3f} against {test.critical:.3f} (alpha {alpha:g})"
            )
    return out


def _ratio(found: EpochDifferences) -> VarianceRatio | None:
    (a, f), (b, g) = found.alone
    if any(VarianceFactor(*each, by_known=False).sigma is None for each in found.alone):
        return None
    ratio = (a / f) / (b / g)
    upper = float(fdtrc(f, g, ratio))
    lower = float(fdtr(f, g, ratio))
    return VarianceRatio(ratio, (f, g), min(1.0, 2.0 * min(upper, lower)))
