"""Tested observations: residual, test and reliability of every observation, of any kind.

A fiducial's coordinate, a row of a model, an image or control coordinate, a prior: of each there is
the same to be said. A `Tested` holds it as arrays and gives it out as `Observation`; here alone it
is asked whether the test takes the a-priori sigma0 (Baarda 1968) or the estimated one (Pope 1976).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat
from math import exp, inf, isfinite, isnan, log, sqrt
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from anaplot.adjustment.reliability import (
    ERROR_PRIOR_SIGMAS,
    HARD_TO_TELL,
    NONE_PRIOR,
    error_transfers,
    is_critical,
    residual_correlations,
)
from anaplot.adjustment.scalars import HALF, NONE, ONE, ZERO
from anaplot.adjustment.significance import (
    TESTABLE,
    critical_normal,
    critical_tau,
    noncentrality,
    tau_power,
)
from anaplot.aliases import Array, Bools, Index, TestKind

__all__ = [
    "AppliedTest",
    "Dense",
    "Observation",
    "Odds",
    "Partner",
    "Tested",
    "TestedInMicrometres",
    "Transfer",
    "critical_value",
    "error_odds",
    "examine",
    "log_bayes_factor",
    "sigma0_known",
    "sum_by_point",
]

Key = tuple[str | None, ...]
K = TypeVar("K", bound=Key)


class _Settings(Protocol):
    """What is asked of a test: kind, significance of one row, power of detectable errors."""

    @property
    def kind(self) -> TestKind: ...
    @property
    def alpha(self) -> float: ...
    @property
    def power(self) -> float: ...


def sigma0_known(kind: TestKind) -> bool:
    """Return whether a test takes the a-priori sigma0: "baarda" does, "tau" the estimated one."""
    return kind == "baarda"


def critical_value(kind: TestKind, alpha: float, redundancy: int) -> float | None:
    """Return the two-sided critical value of one row; None where there is none."""
    return critical_normal(alpha) if sigma0_known(kind) else critical_tau(alpha, redundancy)


class AppliedTest(NamedTuple):
    """The two-sided test applied to every row.

    Attributes
    ----------
    kind
        "baarda": w by the a-priori sigma0, normal; "tau": by the estimated one, Pope's tau.
    alpha
        Significance of one row.
    critical
        Critical value of abs(w); None when there is no such value.
    power
        Power that smallest detectable errors refer to.
    """

    kind: TestKind
    alpha: float
    critical: float | None
    power: float = 0.80

    @classmethod
    def of(cls, settings: _Settings, redundancy: int) -> AppliedTest:
        """Return a test as it is applied with a redundancy."""
        kind, alpha = settings.kind, settings.alpha
        critical = critical_value(kind, alpha, redundancy) if redundancy > 0 else None
        return cls(kind, alpha, critical, settings.power)

    @property
    def delta0(self) -> float:
        """Noncentrality that smallest detectable errors refer to."""
        return noncentrality(self.alpha, self.power)

    def factor(self, sigma0: float | None) -> float | None:
        """Return the sigma0 that the test uses, in a-priori ones; None when it does not exist.

        Parameters
        ----------
        sigma0
            The estimated one, in a-priori ones; None without redundancy.
        """
        return 1.0 if sigma0_known(self.kind) else sigma0

    def real_power(self, redundancy: int) -> float | None:
        """Return the power against smallest detectable errors; None where there is no test.

        Under "tau" with few redundancies less than was asked.
        """
        if not sigma0_known(self.kind):
            return tau_power(self.delta0, self.alpha, redundancy)
        return self.power if redundancy > 0 else None


class Observation(NamedTuple, Generic[K]):
    """Residual, test and reliability of one observation; None where something does not exist.

    Attributes
    ----------
    key
        Its identity; the last two elements are what was observed (a point, a fiducial, the owner
        of a prior) and of it the axis or unknown.
    unit
        Of residual, expected and mdb: "um", "m", "rad" or "mm".
    use
        Whether it counts; where it is off, the residual is what it is off from all the others.
    residual
        Adjusted minus observed: - r times an error of the observation. Of a model's row the
        parallax that is left: + r times an error.
    r
        Redundancy number.
    expected
        Expected standard deviation of the residual, for the sigma0 of the test.
    w
        residual / expected: Baarda's w or Pope's tau; None when it cannot be tested.
    mdb
        Smallest detectable error, for the a-priori sigma0; None when it cannot be tested.
    effect
        External reliability: no function of the unknowns changes by more of its standard
        deviations by an undetected error of the size `mdb`.
    flagged
        Whether abs(w) exceeds the critical value.
    probability
        Posterior probability that this observation holds the one gross error.
    ground
        What an undetected error of the size `mdb` does to the observation's own point: X, Y, Z [m];
        None where it has none.
    """

    key: K
    unit: str
    use: bool
    residual: float
    r: float
    expected: float | None
    w: float | None
    mdb: float | None
    effect: float | None
    flagged: bool
    probability: float
    ground: tuple[float, float, float] | None = None

    @classmethod
    def off(cls, key: K, unit: str, residual: float) -> Observation[K]:
        """Return one that is switched off: nothing is said of it but what it is off."""
        return cls(key, unit, False, residual, 0.0, None, None, None, None, False, 0.0)

    @property
    def point(self) -> str:
        """What was observed: the last but one element of the key."""
        return str(self.key[-2])

    @property
    def axis(self) -> str:
        """Which coordinate of it: the last element of the key."""
        return str(self.key[-1])

    @property
    def size(self) -> float | None:
        """abs(w)."""
        return None if self.w is None else abs(self.w)


class Partner(NamedTuple, Generic[K]):
    """Two rows whose residuals are correlated by 0.9 or more: hard to tell apart."""

    first: K
    second: K
    correlation: float


class Transfer(NamedTuple, Generic[K]):
    """A transfer: an error in `source` shows nearly as large, or larger, in `target`.

    Attributes
    ----------
    source, target
        The rows.
    value, own
        What a unit error of `source` shows in `target` and in `source` itself: elements of
        Q_vv P.
    """

    source: K
    target: K
    value: float
    own: float

    @property
    def share(self) -> float:
        """How much of what the error shows in its own row shows in the target."""
        return abs(self.value) / self.own

    @property
    def critical(self) -> bool:
        """Whether it shows there at least as large; else it is serious."""
        return is_critical(self.value, self.own)


@dataclass(frozen=True, slots=True, eq=False)
class Odds:
    """Posterior probabilities of a single gross error.

    Attributes
    ----------
    rows
        (n,) probability that row i holds the one gross error; a row that cannot be tested keeps
        its prior against none.
    none
        Probability that no row does.
    """

    rows: Array
    none: float


class Dense(NamedTuple):
    """Matrices of all rows: (n, n) Q_vv, the cofactors of the residuals, and Q_vv P."""

    q_vv: Array
    influence: Array


@dataclass(frozen=True, eq=False)
class Tested(Generic[K]):
    """The tested observations of an adjustment; iterating gives an `Observation` each.

    Attributes
    ----------
    keys, units
        n identities, and units as `Observation` has them.
    test
        The test that flags.
    redundancy
        f.
    sigma0
        Estimated standard deviation of unit weight, in a-priori ones; None without redundancy.
    residual, r
        (n,) residuals and redundancy numbers.
    deviation
        (n,) standard deviations of the residuals for the a-priori sigma0.
    expected, w, mdb, effect
        (n,) as `Observation` has them; NaN where they do not exist.
    flagged, use
        (n,) which rows are flagged, and which count.
    evidence
        (n,) g of `error_odds`: variance of the residual by an error of the width of its prior,
        over that without an error; NaN where a row cannot be tested.
    ground
        (n, 3) as `Observation` has it; None where no observation has any.
    dense
        Computes Q_vv and Q_vv P, which few ask for; None where they are not kept.
    """

    __test__ = False  # not a test class, whatever a test runner may think of its name

    keys: Sequence[K]
    units: Sequence[str]
    test: AppliedTest
    redundancy: int
    sigma0: float | None
    residual: Array
    r: Array
    deviation: Array
    expected: Array
    w: Array
    mdb: Array
    effect: Array
    flagged: Bools
    use: Bools
    evidence: Array
    ground: Array | None = field(default=None, repr=False)
    dense: Callable[[], Dense] | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.residual)

    def __iter__(self) -> Iterator[Observation[K]]:
        return iter(self.rows())

    def rows(self, at: Index | None = None) -> list[Observation[K]]:
        """Return the observations of some rows; None: of all."""
        keys, units, ground = self.keys, self.units, self.ground
        numbers = [self.use, self.residual, self.r, self.flagged, self.odds.rows]
        unsure = [self.expected, self.w, self.mdb, self.effect]
        if at is not None:
            index = at.tolist()
            keys, units = [keys[k] for k in index], [units[k] for k in index]
            numbers, unsure = [one[at] for one in numbers], [one[at] for one in unsure]
            ground = None if ground is None else ground[at]
        use, residual, r, flagged, odds = [one.tolist() for one in numbers]
        columns = (
            *(keys, units, use, residual, r),
            *map(_numbers, unsure),
            *(flagged, odds, [None] * len(keys) if ground is None else _triples(ground)),
        )
        # what `_make` does but for counting every row: they are as long as there are columns
        rows = zip(*columns, strict=True)
        return list(map(tuple.__new__, repeat(Observation), rows))

    @cached_property
    def odds(self) -> Odds:
        """Probabilities of a gross error in each row, and of none."""
        return error_odds(self.evidence, self.w, self.redundancy, self.test.kind)

    @property
    def worst(self) -> list[Observation[K]]:
        """The flagged observations, those with the largest abs(w) first."""
        at = np.flatnonzero(self.flagged)
        return self.rows(at[np.argsort(-np.abs(self.w[at]), kind="stable")])

    @property
    def power(self) -> float | None:
        """Power that the test really has against errors of the size `mdb`."""
        return self.test.real_power(self.redundancy)

    def point_odds(self) -> dict[str, float]:
        """Return the probability of every point to hold the gross error: the sum over its rows."""
        return sum_by_point(self.keys, self.odds.rows)

    @property
    def q_vv(self) -> Array:
        """(n, n) cofactors of the residuals; ValueError where they are not kept."""
        return self._kept.q_vv

    @property
    def influence(self) -> Array:
        """(n, n) Q_vv P, column i what a unit error in row i does to every residual; likewise."""
        return self._kept.influence

    @cached_property
    def _kept(self) -> Dense:
        if self.dense is None:
            raise ValueError("the cofactors of all residuals are not kept")
        return self.dense()

    def correlations(self) -> Array:
        """Return (n, n) correlations of the residuals; NaN in rows that cannot be tested."""
        return residual_correlations(self.q_vv, self.r)

    def partners(self) -> tuple[Partner[K], ...]:
        """Return the pairs of rows that are hard to tell apart."""
        rho, keys = self.correlations(), self.keys
        first, second = np.nonzero(np.abs(rho) >= HARD_TO_TELL)
        pairs = zip(first.tolist(), second.tolist(), strict=True)
        return tuple(Partner(keys[i], keys[j], float(rho[i, j])) for i, j in pairs if i < j)

    def transfers(self) -> tuple[Transfer[K], ...]:
        """Return the critical and the serious transfers (Kratky and El-Hakim 1983, Figure 2)."""
        keys, influence = self.keys, self.influence
        return tuple(
            Transfer(keys[i], keys[j], value, float(influence[i, i]))
            for i, j, value in error_transfers(influence)
        )


class TestedInMicrometres(Generic[K]):
    """A result whose observations are weighted by one a-priori sigma0 in micrometres: base class.

    Attributes
    ----------
    apriori_um
        A-priori sigma0 [um].
    tested
        The observations.
    """

    __test__ = False

    apriori_um: float
    tested: Tested[K]

    @property
    def sigma0_um(self) -> float | None:
        """Estimated sigma0 [um]; None without redundancy."""
        sigma0 = self.tested.sigma0
        return None if sigma0 is None else sigma0 * self.apriori_um

    @property
    def redundancy(self) -> int:
        """Redundancy."""
        return self.tested.redundancy

    @property
    def test(self) -> AppliedTest:
        """The test that flags rows."""
        return self.tested.test


def examine(
    keys: Sequence[K],
    units: Sequence[str],
    residual: Array,
    r: Array,
    sigma: Array,
    *,
    vtpv: float,
    redundancy: int,
    test: _Settings,
    left: Array | None = None,
    moved: Array | None = None,
    use: Bools | None = None,
    firm: Bools | None = None,
    moved_ground: Array | None = None,
    rounding: float = 0.0,
    dense: Callable[[], Dense] | None = None,
) -> Tested[K]:
    """Test the rows of an adjustment.

    Parameters
    ----------
    keys, units
        n identities and units.
    residual, r
        (n,) residuals and redundancy numbers.
    sigma
        (n,) a-priori standard deviations of the observations, in the units.
    vtpv
        v'Pv for the a-priori sigma0 one.
    redundancy
        f.
    test
        Kind, significance of one row, and power of smallest detectable errors.
    left
        (n,) standard deviations of the residuals over those of the observations; None: sqrt(r).
    moved
        (n,) how far an error of one sigma moves a function of the unknowns at most, in its standard
        deviations; None: sqrt(1 - r), likewise.
    use
        (n,) which rows count; None: all.
    firm
        (n,) rows that stand for something free of error, with a sigma of next to nothing: they are
        tested however small r is, in the limit by their Lagrange multipliers, and an error of the
        size `mdb` has no bound in standard deviations; None: none.
    moved_ground
        (n, 3) how an error of one unit moves the observation's own point [m]; NaN where it has
        none, None where no observation has any.
    rounding
        Residuals up to this size are never flagged.
    dense
        As `Tested` has it.

    Notes
    -----
    nabla = delta0 sigma_v / r (delta0 sigma / sqrt(r) where observations are uncorrelated), for the
    a-priori sigma0 whatever the test; effect delta0 sqrt((1 - r) / r) (Baarda 1968).
    """
    applied = AppliedTest.of(test, redundancy)
    sigma0 = sqrt(vtpv / redundancy) if redundancy > 0 else None
    factor = applied.factor(sigma0)
    testable = r >= TESTABLE
    if firm is not None:
        testable |= firm & (r > 0.0)
    spread = np.sqrt(np.maximum(r, ZERO)) if left is None else left
    tested = np.where(testable, spread, NONE)
    # an error of one sigma shows with r of its size: in standard deviations of the residual
    shown = tested if left is None else r / tested
    deviation = sigma * spread
    expected = np.full(len(r), np.nan) if factor is None else factor * deviation
    # a residual that is exactly zero with sigma estimated as zero: nothing deviates from anything
    w = residual / (sigma * (factor or np.nan) * tested)
    detectable = applied.delta0 / shown
    mdb = detectable * sigma
    effect = detectable * (np.sqrt(np.maximum(ONE - r, ZERO)) if moved is None else moved)
    flagged = np.abs(w) > (np.inf if applied.critical is None else applied.critical)
    if rounding:
        flagged &= np.abs(residual) > rounding
    return Tested(
        keys=keys,
        units=units,
        test=applied,
        redundancy=redundancy,
        sigma0=sigma0,
        residual=residual,
        r=r,
        deviation=deviation,
        expected=expected,
        w=w,
        mdb=mdb,
        effect=effect if firm is None else np.where(firm, np.nan, effect),
        flagged=flagged,
        use=~np.zeros(len(r), dtype=np.bool_) if use is None else use,
        evidence=ERROR_PRIOR_SIGMAS**2 * (shown * shown),
        ground=None if moved_ground is None else moved_ground * mdb[:, None],
        dense=dense,
    )


def log_bayes_factor(g: Array, square: Array, redundancy: int, kind: TestKind) -> Array:
    """Return log BF of one gross error in each row against none.

    sigma known: BF = (1 + g)^(-1/2) exp((w^2 / 2) g / (1 + g)); sigma estimated from f
    redundancies: BF = (1 + g)^(-1/2) (1 - (w^2 / f) g / (1 + g))^(-f/2).

    Parameters
    ----------
    g
        (n,) variance of the residual by the error over that without.
    square
        (n,) w^2 of the test.
    redundancy
        f.
    kind
        "baarda": sigma known; "tau": sigma estimated.
    """
    shrink = g / (ONE + g)
    if sigma0_known(kind):
        return np.asarray(HALF * (square * shrink - np.log1p(g)))
    # w^2 cannot exceed f but for rounding; the bracket stays positive because shrink < 1
    less = np.maximum(square / -redundancy, -1.0) * shrink
    return np.asarray(-0.5 * (np.log1p(g) + redundancy * np.log1p(less)))


def error_odds(g: Array, size: Array, redundancy: int, kind: TestKind) -> Odds:
    """Weigh a gross error in each row against every other row and against none.

    Prior: none 0.9, the rest shared equally by the rows.

    Parameters
    ----------
    g
        (n,) variance of the residual by an error of the width of its prior (20 standard deviations
        of the observation) over that without an error: 400 r of uncorrelated observations.
    size
        (n,) w, of either sign; NaN where a row cannot be tested.
    redundancy
        f; without any the prior is returned.
    kind
        "baarda": sigma known; "tau": sigma estimated.
    """
    n = len(g)
    if redundancy < 1 or not n:
        return Odds(np.full(n, (1.0 - NONE_PRIOR) / max(n, 1)), NONE_PRIOR)
    logs = log_bayes_factor(g, size * size, redundancy, kind)
    largest = float(np.maximum.reduce(logs))
    if isnan(largest):
        logs = np.where(np.isfinite(size), logs, 0.0)
        largest = float(np.maximum.reduce(logs))
    prior, none = log((1.0 - NONE_PRIOR) / n), log(NONE_PRIOR)
    most = max(largest + prior, none)
    terms, rest = np.exp(logs + (prior - most)), exp(none - most)
    total = float(np.add.reduce(terms)) + rest
    return Odds(terms / total, rest / total)


def sum_by_point(keys: Iterable[Key], rows: Array) -> dict[str, float]:
    """Return the sums of (n,) values over the rows of every point, the last but one of a key."""
    out: dict[str, float] = {}
    for key, one in zip(keys, rows.tolist(), strict=True):
        point = str(key[-2])
        out[point] = out.get(point, 0.0) + one
    return out


def _triples(values: Array) -> list[tuple[float, float, float] | None]:
    return [(x, y, z) if x == x else None for x, y, z in values.tolist()]


def _numbers(values: Array) -> list[float | None]:
    numbers: list[float] = values.tolist()
    if isfinite(sum(numbers)):
        return list(numbers)
    return [value if abs(value) < inf else None for value in numbers]
