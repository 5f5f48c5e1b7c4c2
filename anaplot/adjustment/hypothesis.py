"""The general linear hypothesis B x = w: F test, power, and sets taken apart (Gruen 1978, D).

All lengths are in a-priori standard deviations of unit weight: cofactors are covariances for
sigma0 = 1. With d = B x_hat - w and its cofactors Q_d = B Q B', R = d' Q_d^-1 d (eq. 32) is

- chi-square with b degrees of freedom where sigma0 is known,
- b s^2 times F(b, r) where s^2 comes from r redundancies that R has no part in (eq. 31);

under an alternative both are noncentral with lambda = delta' Q_d^-1 delta. The paper's lambda of
eq. (33) and (38) is half of that, the one of its eq. (18) is not; here it never is.
"""

from __future__ import annotations

from functools import lru_cache
from math import exp, expm1, log, log1p, sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.significance import noncentral_f_power
from anaplot.aliases import Array

__all__ = [
    "Component",
    "DependentConditionsError",
    "FTest",
    "Removal",
    "bonferroni_alpha",
    "critical_f",
    "f_noncentrality",
    "f_power",
    "f_test",
    "nearest_components",
    "principal_components",
    "quadratic_form",
    "removable",
    "scheffe_factor",
    "sequential_components",
    "sidak_alpha",
    "variance_inflation",
]


_RANK = 1e-10  # smallest eigenvalue of a correlation matrix of full rank
_EQUAL = 1e-9  # relative difference below which two variances cannot be told apart


class DependentConditionsError(ValueError):
    """Conditions that repeat each other: their cofactors are not of full rank."""

    def __init__(self) -> None:
        super().__init__("the conditions are not of full rank")


class FTest(NamedTuple):
    """A tested hypothesis.

    Attributes
    ----------
    square
        R, for the a-priori sigma0.
    dimension
        b, the number of conditions.
    redundancy
        Degrees of freedom of the estimated variance factor; None where sigma0 is known.
    sigma
        The factor s that the test uses; 1 where sigma0 is known.
    statistic
        T = R / (b s^2).
    alpha, critical
        Significance, and the T that it is exceeded at.
    significance
        Probability of a larger T if the hypothesis is true.
    """

    square: float
    dimension: int
    redundancy: int | None
    sigma: float
    statistic: float
    alpha: float
    critical: float
    significance: float

    @property
    def rejected(self) -> bool:
        """Whether T exceeds the critical value."""
        return self.statistic > self.critical


class Component(NamedTuple):
    """One of several independent combinations of a correlated set.

    Attributes
    ----------
    member
        Index of the parameter that a sequential component belongs to; of a principal component,
        the parameter that it is made of most.
    loadings
        (p,) its coefficients at the parameters divided by their standard deviations.
    value
        The standardized component: normal with standard deviation 1 if the hypothesis is true.
    variance
        Sequential: share of the parameter's variance that is left once the earlier ones are held.
        Principal: eigenvalue of the correlation matrix, large where the set is badly determined.
    """

    member: int
    loadings: Array
    value: float
    variance: float


class Removal(NamedTuple):
    """A step of leaving parameters out, the least significant first.

    Attributes
    ----------
    member
        Index of the parameter.
    value
        Its standardized value with the earlier ones already left out (at their values w).
    square
        R of all that are left out so far.
    """

    member: int
    value: float
    square: float


def critical_f(alpha: float, dimension: int, redundancy: int | None = None) -> float:
    """Return the critical value of T = R / (b s^2), from F(b, r) or from chi-square / b.

    Raises
    ------
    ValueError
        Significance outside (0, 1) or too small for numbers of this size, no condition, or no
        redundancy.
    """
    from scipy.special import betaincinv, betaln, chdtri

    _check(alpha, dimension, redundancy)
    if redundancy is None:
        return float(chdtri(dimension, alpha)) / dimension
    # by the incomplete beta function: 1 - alpha would lose a small alpha
    a, b = redundancy / 2.0, dimension / 2.0
    x = float(betaincinv(a, b, alpha))
    if not x > 0.0:
        # far out the function does not get there, but its first term is all there is
        x = exp((log(alpha) + log(a) + float(betaln(a, b))) / a)
    critical = redundancy * (1.0 - x) / (dimension * x) if x > 0.0 else float("inf")
    if not critical < float("inf"):
        raise ValueError(f"the significance {alpha} is too small for redundancy {redundancy}")
    return critical


@lru_cache(maxsize=4096)
def f_power(
    noncentrality: float, alpha: float, dimension: int, redundancy: int | None = None
) -> float:
    """Return the power against an alternative of noncentrality lambda.

    Parameters
    ----------
    noncentrality
        lambda, without the factor 1/2.
    alpha, dimension, redundancy
        Of the test; redundancy None where sigma0 is known.

    Raises
    ------
    ValueError
        A negative or infinite noncentrality, or no such test.
    """
    _check(alpha, dimension, redundancy)
    if not 0.0 <= noncentrality < float("inf"):
        raise ValueError(f"the noncentrality {noncentrality} must be at least 0")
    if noncentrality == 0.0:
        return alpha
    critical = critical_f(alpha, dimension, redundancy)
    return noncentral_f_power(noncentrality, critical, dimension, redundancy)


@lru_cache(maxsize=1024)
def f_noncentrality(
    alpha: float, power: float, dimension: int, redundancy: int | None = None
) -> float:
    """Return the noncentrality lambda at which a test has the given power.

    17.07 for alpha 0.001, power 0.80, one condition and sigma0 known.

    Raises
    ------
    ValueError
        Not 0 < alpha < power < 1, or no such test.
    """
    _check(alpha, dimension, redundancy)
    if not alpha < power < 1.0:
        raise ValueError(f"significance {alpha} must lie below the power {power} < 1")
    low, high = 0.0, 10.0
    while f_power(high, alpha, dimension, redundancy) < power:
        low, high = high, 2.0 * high
    while high - low > 1e-12 * high:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if f_power(middle, alpha, dimension, redundancy) < power:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def f_test(
    square: float,
    dimension: int,
    *,
    alpha: float,
    sigma: float = 1.0,
    redundancy: int | None = None,
) -> FTest:
    """Test a hypothesis by its quadratic form (eq. 31).

    Parameters
    ----------
    square, dimension
        R for the a-priori sigma0, and the number of conditions b.
    alpha
        Significance.
    sigma, redundancy
        Estimated factor s and its degrees of freedom, from what R has no part in; left out, sigma0
        is known.

    Raises
    ------
    ValueError
        A negative or infinite R, a factor that is not positive, or no such test.
    """
    from scipy.special import chdtrc, fdtrc

    _check(alpha, dimension, redundancy)
    if not 0.0 <= square < float("inf"):
        raise ValueError(f"the quadratic form {square} must be at least 0")
    if not 0.0 < sigma < float("inf"):
        raise ValueError(f"the factor {sigma} must be positive")
    if redundancy is None and sigma != 1.0:
        raise ValueError("an estimated factor needs its redundancy")
    statistic = square / (dimension * sigma * sigma)
    if redundancy is None:
        significance = float(chdtrc(dimension, square))
    else:
        significance = float(fdtrc(dimension, redundancy, statistic))
    critical = critical_f(alpha, dimension, redundancy)
    return FTest(square, dimension, redundancy, sigma, statistic, alpha, critical, significance)


def quadratic_form(difference: Array, cofactors: Array) -> float:
    """Return R = d' Q^-1 d.

    Raises
    ------
    DependentConditionsError
        The cofactors are not of full rank: conditions repeat each other.
    """
    scale, rho = _correlation(cofactors)
    z = np.asarray(difference, dtype=np.float64) / scale
    y = np.linalg.solve(np.linalg.cholesky(rho), z)
    return float(y @ y)


def sidak_alpha(alpha: float, tests: int) -> float:
    """Return the significance of each of several tests (eq. 41): 1 - (1 - alpha)^(1/p).

    Exact for independent tests; with a common estimated sigma, or with correlated ones of one
    condition each, alpha is kept from above.

    Raises
    ------
    ValueError
        Significance outside (0, 1), or no test.
    """
    _check(alpha, tests, None)
    return -expm1(log1p(-alpha) / tests)


def bonferroni_alpha(alpha: float, tests: int) -> float:
    """Return alpha / p: keeps alpha for any tests, however they depend on each other.

    Raises
    ------
    ValueError
        Significance outside (0, 1), or no test.
    """
    _check(alpha, tests, None)
    return alpha / tests


def scheffe_factor(alpha: float, dimension: int, redundancy: int | None = None) -> float:
    """Return sqrt(b F(alpha; b, r)): limit of abs(d) / s_d for all combinations of b values.

    Raises
    ------
    ValueError
        No such test.
    """
    return sqrt(dimension * critical_f(alpha, dimension, redundancy))


def variance_inflation(cofactors: Array) -> Array:
    """Return (p,) q_ii (Q^-1)_ii: 1 for an uncorrelated parameter, large for a badly separated one.

    Raises
    ------
    DependentConditionsError
        The cofactors are not of full rank.
    """
    _, rho = _correlation(cofactors)
    out: Array = np.diag(np.linalg.inv(rho)).copy()
    return out


def sequential_components(difference: Array, cofactors: Array) -> list[Component]:
    """Take a set apart, parameter by parameter.

    Every component is one parameter with the earlier ones held at their hypothesis and the later
    ones free; the squares of all add up to R. The order depends on the geometry alone (the
    parameter that the others explain best comes first), so that each is normal, and independent of
    the others, if the hypothesis is true.

    Raises
    ------
    DependentConditionsError
        The cofactors are not of full rank.
    """
    from scipy.linalg import solve_triangular

    scale, rho = _correlation(cofactors)
    p = len(scale)
    # holding parameters leaves the inverse of the others' cofactors as it is
    information = np.diag(np.linalg.inv(rho))
    # rho = U'U, a row for each component; what is left of each variance beside the rows so far
    rows = np.zeros((p, p))
    left = np.ones(p)
    variances = np.ones(p)
    free = np.arange(p)
    order = np.zeros(p, dtype=np.intp)
    for step in range(p):
        inflation = left[free] * information[free]
        # of equals the first: the last two always are
        at = int(np.argmax(inflation >= inflation.max() * (1.0 - _EQUAL)))
        k = order[step] = free[at]
        free = np.delete(free, at)
        variances[step] = left[k]
        rows[step] = (rho[k] - rows[:step, k] @ rows[:step]) / sqrt(left[k])
        left = left - rows[step] ** 2
    loadings = np.zeros((p, p))
    # what stands before a component's own parameter is rounding
    loadings[:, order] = solve_triangular(rows[:, order].T, np.eye(p), lower=True)
    values = loadings @ (np.asarray(difference, dtype=np.float64) / scale)
    return [
        Component(int(k), loadings[step], float(values[step]), float(variances[step]))
        for step, k in enumerate(order)
    ]


def principal_components(difference: Array, cofactors: Array) -> list[Component]:
    """Take a set apart along the eigenvectors of its correlation matrix, best determined first.

    The components are independent and their squares add up to R.

    Raises
    ------
    DependentConditionsError
        The cofactors are not of full rank.
    """
    scale, rho = _correlation(cofactors)
    values, vectors = np.linalg.eigh(rho)
    z = np.asarray(difference, dtype=np.float64) / scale
    out = []
    for value, vector in zip(values.tolist(), vectors.T, strict=True):
        member = int(np.argmax(np.abs(vector)))
        vector = vector * (1.0 if vector[member] >= 0.0 else -1.0)
        loadings = vector / sqrt(value)
        out.append(Component(member, loadings, float(loadings @ z), value))
    return out


def nearest_components(difference: Array, cofactors: Array) -> tuple[Array, Array]:
    """Take a set apart into the independent components that lie nearest to its members.

    With rho the correlation matrix and z the members over their standard deviations: rho^(-1/2) z.
    Of all components that are independent, and normal with standard deviation 1 if the hypothesis
    is true, these are closest to z in the mean of the squares; their squares add up to R. What a
    member has in common with others is shared out evenly among them, in no order.

    Parameters
    ----------
    difference, cofactors
        (p,) and (p, p).

    Returns
    -------
    tuple
        (p,) the components, and (p,) their correlation with the members that they stand for:
        1 for one that is correlated with no other.

    Raises
    ------
    DependentConditionsError
        The cofactors are not of full rank.
    """
    scale, rho = _correlation(cofactors)
    values, vectors = np.linalg.eigh(rho)
    roots = np.sqrt(values)
    z = np.asarray(difference, dtype=np.float64) / scale
    components: Array = vectors @ ((vectors.T @ z) / roots)
    alike: Array = (vectors * vectors) @ roots
    return components, alike


def removable(
    difference: Array, cofactors: Array, *, alpha: float, sigma: float, redundancy: int | None
) -> list[Removal]:
    """Return the parameters that may be left out together, the least significant first.

    Each step leaves out the parameter that R grows least by. It ends before R of all left out
    exceeds b F(alpha; b, r) of the whole set. With that one limit the probability that any set of
    parameters that are truly zero is kept back is at most alpha, however the set was chosen
    (Gabriel's simultaneous test).

    Parameters
    ----------
    difference, cofactors
        (p,) and (p, p).
    alpha
        Significance of the global test.
    sigma, redundancy
        As for `f_test`.

    Raises
    ------
    DependentConditionsError
        The cofactors are not of full rank.
    ValueError
        No such test.
    """
    scale, rho = _correlation(cofactors)
    p = len(scale)
    limit = p * critical_f(alpha, p, redundancy) * sigma * sigma
    left = rho.copy()
    z = np.asarray(difference, dtype=np.float64) / scale
    free = list(range(p))
    out: list[Removal] = []
    total = 0.0
    while free:
        value = z[free] / np.sqrt(np.diag(left)[free])
        at = int(np.argmin(np.abs(value)))
        total += float(value[at]) ** 2
        if total > limit:
            break
        k = free.pop(at)
        out.append(Removal(k, float(value[at]), total))
        share = left[:, k] / left[k, k]
        z = z - share * z[k]
        left = left - np.outer(share, left[k])
    return out


def _check(alpha: float, dimension: int, redundancy: int | None) -> None:
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"the significance {alpha} must lie between 0 and 1")
    if dimension < 1:
        raise ValueError("a hypothesis needs at least one condition")
    if redundancy is not None and redundancy < 1:
        raise ValueError("without redundancy sigma0 cannot be estimated")


def _correlation(cofactors: Array) -> tuple[Array, Array]:
    q = np.asarray(cofactors, dtype=np.float64)
    if q.ndim != 2 or q.shape[0] != q.shape[1] or not q.shape[0]:
        raise ValueError(f"cofactors of shape {q.shape} are not square")
    diagonal = np.diag(q)
    if not bool((diagonal > 0.0).all()):
        raise DependentConditionsError
    scale = np.sqrt(diagonal)
    rho = q / scale[:, None] / scale
    rho = 0.5 * (rho + rho.T)
    if not float(np.linalg.eigvalsh(rho)[0]) > _RANK:
        raise DependentConditionsError
    return scale, rho
