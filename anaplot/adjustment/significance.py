"""Critical values of the tests of single residuals, and their powers.

Only scipy.special is used, and loaded with the first test: importing scipy.stats costs more than a
whole model.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt

__all__ = [
    "TESTABLE",
    "critical_normal",
    "critical_tau",
    "noncentrality",
    "normal_power",
    "tau_power",
    "tau_significance",
]

TESTABLE = 1e-9
"""Redundancy number below which an observation cannot be tested."""


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


def tau_significance(tau: float, redundancy: int) -> float | None:
    """Two-sided probability of a larger tau under no error; None for f < 2."""
    from scipy.special import stdtr

    f = redundancy
    if f < 2:
        return None
    room = f - tau * tau
    if room <= 0.0:
        return 0.0
    t = tau * sqrt((f - 1.0) / room)
    return float(2.0 * stdtr(f - 1.0, -t))


def normal_power(delta: float, alpha: float) -> float:
    """Power of the two-sided normal test at noncentrality `delta`."""
    from scipy.special import ndtr

    k = critical_normal(alpha)
    return float(ndtr(delta - k) + ndtr(-delta - k))


@lru_cache(maxsize=256)
def tau_power(delta: float, alpha: float, redundancy: int) -> float | None:
    """Power of the two-sided tau test at noncentrality `delta`; None for f < 2.

    tau is a monotonic function of the t of f - 1 degrees of freedom whose sigma leaves the tested
    row out; under a single gross error that t is noncentral with `delta`.
    """
    from scipy.special import nctdtr, stdtrit

    f = redundancy
    if f < 2:
        return None
    t = float(-stdtrit(f - 1.0, alpha / 2.0))
    upper = 1.0 - float(nctdtr(f - 1.0, delta, t))
    return upper + float(nctdtr(f - 1.0, delta, -t))


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
