"""Critical values of the tests of single residuals, and their powers.

Only scipy.special is used, and loaded with the first test: importing scipy.stats costs more than a
whole model.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

import numpy as np

from anaplot.aliases import Array

__all__ = [
    "TESTABLE",
    "critical_normal",
    "critical_tau",
    "noncentral_f_power",
    "noncentrality",
    "normal_power",
    "tau_power",
]

TESTABLE = 1e-9
"""Redundancy number below which an observation cannot be tested."""

_LARGE = 1e6  # noncentrality beyond which an approximation has no error above 1e-7
_POISSON_REACH = 9.0  # standard deviations of a Poisson number, and as many where its mean is small


@lru_cache(maxsize=256)
def critical_normal(alpha: float) -> float:
    """Two-sided critical value of the normal distribution (Baarda's w-test); 3.29 at 0.001."""
    from scipy.special import ndtri

    return float(-ndtri(alpha / 2.0))


@lru_cache(maxsize=1024)
def critical_tau(alpha: float, redundancy: int) -> float | None:
    """Two-sided critical value of Pope's tau; None where the distribution has none (f < 2).

    tau = t sqrt(f) / sqrt(f - 1 + t^2) with t of f - 1 degrees of freedom.
    """
    from scipy.special import stdtrit

    f = redundancy
    if f < 2:
        return None
    t = float(-stdtrit(f - 1.0, alpha / 2.0))
    return t * sqrt(f) / sqrt(f - 1.0 + t * t)


def normal_power(delta: float, alpha: float) -> float:
    """Power of the two-sided normal test at noncentrality `delta`."""
    from scipy.special import ndtr

    k = critical_normal(alpha)
    return float(ndtr(delta - k) + ndtr(-delta - k))


@lru_cache(maxsize=256)
def tau_power(delta: float, alpha: float, redundancy: int) -> float | None:
    """Power of the two-sided tau test at noncentrality `delta`; None for f < 2.

    tau is a monotonic function of the t of f - 1 degrees of freedom whose sigma leaves the tested
    row out; under a single gross error the square of that t is F(1, f - 1), noncentral with
    delta^2.
    """
    from scipy.special import stdtrit

    f = redundancy
    if f < 2:
        return None
    t = float(-stdtrit(f - 1.0, alpha / 2.0))
    return noncentral_f_power(delta * delta, t * t, 1, f - 1)


def noncentral_f_power(
    noncentrality: float, critical: float, dimension: int, redundancy: int | None
) -> float:
    """Probability that a noncentral F exceeds a critical value.

    chi-square of b degrees of freedom and noncentrality lambda is one of b + 2 j degrees where j
    is a Poisson number of mean lambda / 2; the power is the mean of the central ones over j. It
    is finite everywhere, where the routines of scipy.special for noncentral distributions are not.

    Parameters
    ----------
    noncentrality
        lambda >= 0, without the factor 1/2.
    critical
        Of T = (chi-square_b / b) / (chi-square_r / r).
    dimension, redundancy
        b and r; redundancy None: the denominator is 1.
    """
    from scipy.special import betainc, chdtr, chdtrc, gammaln, ndtr, xlogy

    b, r = dimension, redundancy
    if noncentrality > _LARGE:
        # sqrt(lambda + b - 1) + normal, squared, differs by less than 1e-7 from chi-square there
        root = sqrt(noncentrality + b - 1.0)
        if r is None:
            return float(ndtr(root - sqrt(b * critical)))
        nodes, weights = _normal_quadrature()
        below = chdtr(r, r * np.square(root + nodes) / (b * critical))
        return min(1.0, float(weights @ below))
    mean = 0.5 * noncentrality
    reach = _POISSON_REACH * (sqrt(mean) + 1.0)
    j = np.arange(max(0.0, np.floor(mean - reach)), np.ceil(mean + reach) + 1.0)
    # the density's rounding grows with the mean and falls out of the quotient
    logarithm = xlogy(j, mean) - gammaln(j + 1.0)
    weights = np.exp(logarithm - logarithm.max())
    if r is None:
        beyond = chdtrc(b + 2.0 * j, b * critical)
    else:
        # of the share of the denominator, so that a tiny probability is not 1 less nearly 1
        beyond = betainc(0.5 * r, 0.5 * b + j, r / (b * critical + r))
    return min(1.0, float(weights @ beyond) / float(weights.sum()))


@lru_cache(maxsize=1)
def _normal_quadrature() -> tuple[Array, Array]:
    nodes, weights = np.polynomial.hermite_e.hermegauss(31)
    return nodes, weights / weights.sum()


@lru_cache(maxsize=256)
def noncentrality(alpha: float, power: float) -> float:
    """Noncentrality delta0 at which the two-sided normal test has the given power.

    4.132 for alpha 0.001 and power 0.80. Both tails are counted.

    Raises
    ------
    ValueError
        The power is not between alpha and 1.
    """
    from scipy.special import ndtri

    if not alpha < power < 1.0:
        raise ValueError(f"power {power} must lie between alpha {alpha} and 1")
    low, high = 0.0, critical_normal(alpha) + float(ndtri(power)) + 10.0
    while high - low > 1e-14 * max(1.0, high):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if normal_power(middle, alpha) < power:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
