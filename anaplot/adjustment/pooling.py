"""Pooled variances: what many small adjustments say together of one standard deviation.

A group is some rows of adjustments that share nothing. Its variance factor is

    s^2 = sum r w^2 / sum r,        r redundancy number, w residual over its a-priori deviation,

which for all rows of an adjustment is v'Pv / redundancy, and for some of them the first step of the
estimation of variance components (Foerstner 1979). Its degrees of freedom are those of a
chi-square with the same mean and variance (Satterthwaite 1946):

    nu = (sum r)^2 / sum_ij r_i r_j rho_ij^2,        rho correlation of residuals,

the redundancy where the rows are all those of an adjustment, as tr(Q_vv P Q_vv P) is.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.variancecomponents import CONFIDENCE
from anaplot.aliases import Array, Bools

__all__ = [
    "Pooled",
    "VarianceTest",
    "covariance_degrees",
    "equal_variances",
    "pooled_rows",
    "student_two_sided",
    "variance_interval",
]


class Pooled(NamedTuple):
    """Sums over a group of rows; those of groups that share nothing may be added.

    Attributes
    ----------
    rows
        How many.
    weighted
        Sum r w^2, or v'Pv.
    redundancy
        Sum r.
    spread
        Sum_ij r_i r_j rho_ij^2: half the variance of `weighted` where w has variance 1.
    """

    rows: int = 0
    weighted: float = 0.0
    redundancy: float = 0.0
    spread: float = 0.0

    def plus(self, other: Pooled) -> Pooled:
        """Return the sums over both."""
        return Pooled(
            self.rows + other.rows,
            self.weighted + other.weighted,
            self.redundancy + other.redundancy,
            self.spread + other.spread,
        )

    @property
    def degrees(self) -> float:
        """nu; 0 where nothing is redundant."""
        return self.redundancy**2 / self.spread if self.spread > 0.0 else 0.0

    @property
    def factor(self) -> float | None:
        """s^2, of the a-priori variance; None without redundancy."""
        return self.weighted / self.redundancy if self.redundancy > 0.0 else None


class VarianceTest(NamedTuple):
    """A test whether variances are equal.

    Attributes
    ----------
    kind
        "F" of two groups, two-sided; "Bartlett" (1937) of more.
    statistic
        The larger variance over the smaller one, or Bartlett's chi-square.
    degrees
        Of the statistic: two numbers, or one.
    probability
        With which the statistic is so large when the variances are equal.
    """

    kind: str
    statistic: float
    degrees: tuple[float, ...]
    probability: float


def pooled_rows(w: Array, r: Array, correlation: Array, rows: Bools) -> Pooled:
    """Return the sums over some rows of one adjustment.

    Parameters
    ----------
    w, r
        (n,) residuals over their a-priori standard deviations, and redundancy numbers.
    correlation
        (n, n) correlations of the residuals.
    rows
        (n,) which rows.
    """
    share = r[rows]
    square = correlation[np.ix_(rows, rows)] ** 2
    return Pooled(
        len(share), float(share @ w[rows] ** 2), float(share.sum()), float(share @ square @ share)
    )


def variance_interval(variance: float, degrees: float) -> tuple[float, float | None]:
    """Return the confidence interval (95 %) of a variance, by the chi-square distribution.

    The upper end is None where so little is known that there is none.
    """
    from scipy.special import chdtri

    tail = 0.5 * (1.0 - CONFIDENCE)
    above, below = chdtri(degrees, [tail, 1.0 - tail]).tolist()
    high = degrees * variance / below if below > 1e-12 * degrees else None
    return degrees * variance / above, high


def equal_variances(variances: Sequence[float], degrees: Sequence[float]) -> VarianceTest | None:
    """Test whether independent groups have one variance; None where there is nothing to compare.

    Parameters
    ----------
    variances, degrees
        Of each group.

    Notes
    -----
    Bartlett (1937): with N = sum nu and s^2 = sum nu s_g^2 / N,
    (N ln s^2 - sum nu ln s_g^2) / (1 + (sum 1 / nu - 1 / N) / 3 (k - 1)) is nearly chi-square of
    k - 1 degrees of freedom.
    """
    from scipy.special import chdtrc, fdtrc

    k = len(variances)
    if k < 2 or min(variances) <= 0.0 or min(degrees) < 1.0:
        return None
    if k == 2:
        (high, of_high), (low, of_low) = sorted(zip(variances, degrees, strict=True), reverse=True)
        ratio = high / low
        upper = float(fdtrc(of_high, of_low, ratio))
        return VarianceTest("F", ratio, (of_high, of_low), min(1.0, 2.0 * min(upper, 1.0 - upper)))
    total = sum(degrees)
    mean = sum(nu * s for nu, s in zip(degrees, variances, strict=True)) / total
    apart = total * log(mean) - sum(nu * log(s) for nu, s in zip(degrees, variances, strict=True))
    correction = 1.0 + (sum(1.0 / nu for nu in degrees) - 1.0 / total) / (3.0 * (k - 1))
    statistic = max(0.0, apart) / correction
    return VarianceTest("Bartlett", statistic, (k - 1.0,), float(chdtrc(k - 1.0, statistic)))


def student_two_sided(t: float, degrees: float) -> float:
    """Return the probability that abs(t) of Student's distribution is as large as that."""
    from scipy.special import stdtr

    return float(2.0 * stdtr(degrees, -abs(t)))


def covariance_degrees(covariance: Array, degrees: int) -> float:
    """Return the degrees of freedom of the mean variance of p coordinates that go together.

    Parameters
    ----------
    covariance
        (p, p), estimated.
    degrees
        Of each of its elements, n.

    Notes
    -----
    n tr(C)^2 / tr(C^2) (Satterthwaite 1946), from n where all coordinates err alike to n p where
    they are independent and equal; tr(C^2) without bias is n^2 (tr(S^2) - tr(S)^2 / n) /
    (n - 1)(n + 2) of the estimated S (Bai and Saranadasa 1996).
    """
    p, n = len(covariance), float(degrees)
    trace = float(np.trace(covariance))
    if degrees < 2 or trace <= 0.0:
        return n
    squares = float((covariance**2).sum())
    unbiased = n * n * (squares - trace * trace / n) / ((n - 1.0) * (n + 2.0))
    if unbiased <= 0.0:
        return n * p
    return float(min(max(n * trace * trace / unbiased, n), n * p))
