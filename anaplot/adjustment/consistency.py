"""Baarda's consistency: one significance for the global test, another for the single one.

Both tests see the same alternative, a gross error of noncentrality lambda, with the same power:
lambda(alpha, power, r) = lambda(alpha0, power, 1) (Baarda 1968; Gruen 1978; lambda without the
factor 1/2). Computed from the noncentral chi-square distribution instead of read from nomograms.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = [
    "GlobalTest",
    "SingleTest",
    "global_from_single",
    "single_test",
]


class SingleTest(NamedTuple):
    """The test of one observation (data snooping).

    Attributes
    ----------
    alpha
        Two-sided significance alpha0.
    power
        Power against an error of the noncentrality.
    critical
        Critical value of abs(w).
    noncentrality
        lambda0; its square root is delta0.
    """

    alpha: float
    power: float
    critical: float
    noncentrality: float


class GlobalTest(NamedTuple):
    """The test of the estimated variance factor against the a-priori one.

    Attributes
    ----------
    alpha
        Significance.
    power
        Power against an error of the noncentrality.
    redundancy
        r.
    critical
        Critical value of sigma0_hat^2 / sigma0^2.
    noncentrality
        lambda0.
    """

    alpha: float
    power: float
    redundancy: int
    critical: float
    noncentrality: float


def global_from_single(alpha: float, power: float, redundancy: int) -> GlobalTest:
    """Return the global test that goes with a test of single observations.

    Parameters
    ----------
    alpha, power
        Two-sided significance alpha0 and power of the single test.
    redundancy
        r of the adjustment.

    Raises
    ------
    ValueError
        Not 0 < alpha < power < 1, or no redundancy.

    Notes
    -----
    For alpha0 0.001 and power 0.80 lambda0 is 17.07; r = 39, 87, 135 give alpha 0.213, 0.369,
    0.450 (Gruen 1978: .22, .37, .45 from nomograms).
    """
    from scipy.special import chdtrc, chndtrix

    size = single_test(alpha, power).noncentrality
    _check(alpha, power, redundancy)
    limit = float(chndtrix(1.0 - power, redundancy, size))
    return GlobalTest(float(chdtrc(redundancy, limit)), power, redundancy, limit / redundancy, size)


def single_test(alpha: float, power: float) -> SingleTest:
    """Return the test of one observation with its noncentrality.

    Raises
    ------
    ValueError
        Not 0 < alpha < power < 1.
    """
    from scipy.special import chdtri, chndtrinc

    _check(alpha, power, 1)
    square = float(chdtri(1.0, alpha))
    return SingleTest(alpha, power, square**0.5, float(chndtrinc(square, 1.0, 1.0 - power)))


def _check(alpha: float, power: float, redundancy: int) -> None:
    if not 0.0 < alpha < power < 1.0:
        raise ValueError(f"significance {alpha} must lie above 0 and below the power {power} < 1")
    if redundancy < 1:
        raise ValueError("without redundancy there is no global test")
