"""What redundancy says beyond the residual: detectable errors, correlations, transfers, odds."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.leastsquares import Adjustment
from anaplot.adjustment.significance import TESTABLE, critical_normal, critical_tau, noncentrality
from anaplot.aliases import Array, Bools, TestKind

__all__ = [
    "ERROR_PRIOR_SIGMAS",
    "HARD_TO_TELL",
    "NONE_PRIOR",
    "SPUR",
    "AppliedTest",
    "Odds",
    "Standardized",
    "beyond_model",
    "critical_transfers",
    "error_odds",
    "residual_correlations",
    "smallest_detectable_errors",
    "standardize",
    "undetected_effects",
]


ERROR_PRIOR_SIGMAS = 20.0
"""Prior of a gross error: normal, this many standard deviations of the observation wide."""

HARD_TO_TELL = 0.9
"""Residual correlation from which two rows are named as hard to tell apart."""

SPUR = 1e-4
"""Redundancy number below which no error of a size that occurs can be seen."""

NONE_PRIOR = 0.9
"""Prior probability that there is no gross error at all."""


class AppliedTest(NamedTuple):
    """The test applied to every row; critical is None when there is no such value."""

    kind: TestKind
    alpha: float
    critical: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Standardized:
    """Standardized residuals of an adjustment.

    Attributes
    ----------
    kind, alpha
        The test.
    critical
        Critical value; None where there is none.
    sigma
        Standard deviation of unit weight used; None where it does not exist.
    expected
        (n,) expected standard deviations of the residuals; None without sigma.
    ratio
        (n,) abs(residual) / expected, NaN where a row cannot be tested; None without sigma.
    """

    kind: TestKind
    alpha: float
    critical: float | None
    sigma: float | None
    expected: Array | None
    ratio: Array | None


def standardize(
    adjustment: Adjustment,
    *,
    kind: TestKind,
    alpha: float,
    apriori: float,
    cofactors: Array | None = None,
    vtpv: float | None = None,
) -> Standardized:
    """Standardize the residuals: Baarda's w with the a-priori sigma, Pope's tau with the estimated.

    Parameters
    ----------
    adjustment
        The adjustment.
    kind
        "baarda" or "tau".
    alpha
        Two-sided significance of one row.
    apriori
        A-priori standard deviation of unit weight, in the unit of the residuals.
    cofactors, vtpv
        (n,) diagonal of the residuals' cofactors, and v'Pv by their inverse; None: as the weights
        of the adjustment have them.
    """
    f = adjustment.redundancy
    q_v = adjustment.q_v if cofactors is None else cofactors
    square = adjustment.vtpv if vtpv is None else vtpv
    if kind == "tau":
        sigma, critical = sqrt(square / f) if f > 0 else None, critical_tau(alpha, f)
    else:
        sigma, critical = apriori, critical_normal(alpha) if f > 0 else None
    if sigma is None:
        return Standardized(kind, alpha, critical, None, None, None)
    expected = sigma * np.sqrt(q_v)
    testable = (adjustment.r >= TESTABLE) & (expected > 0.0)
    # a residual that is exactly zero with sigma estimated as zero: nothing deviates from anything
    ratio = np.full(len(expected), np.nan)
    np.divide(np.abs(adjustment.w), expected, out=ratio, where=testable)
    return Standardized(kind, alpha, critical, sigma, expected, ratio)


def smallest_detectable_errors(
    r: Array, q_l: Array, *, apriori: float, alpha: float, power: float
) -> Array:
    """Return (n,) nabla_i = delta0 sigma0 sqrt(q_l,i / r_i); NaN where a row cannot be tested."""
    out = np.full(len(r), np.nan)
    testable = r >= TESTABLE
    out[testable] = noncentrality(alpha, power) * apriori * np.sqrt(q_l[testable] / r[testable])
    return out


def undetected_effects(r: Array, *, alpha: float, power: float) -> Array:
    """Return (n,) external reliability delta0 sqrt((1 - r_i) / r_i); NaN where r is too small.

    An error as large as the smallest detectable one changes no function of the unknowns by more
    than this many of its standard deviations (Baarda 1968).
    """
    out = np.full(len(r), np.nan)
    testable = r >= TESTABLE
    kept = np.maximum(1.0 - r[testable], 0.0)
    out[testable] = noncentrality(alpha, power) * np.sqrt(kept / r[testable])
    return out


def beyond_model(r: Array, root: Array | float, tolerance: float) -> Bools:
    """Return where the exact sqrt(q_vv) is farther from its model value than the tolerance.

    Parameters
    ----------
    r
        (n,) exact redundancy numbers.
    root
        (n,) model values of sqrt(q_vv), or one of all; NaN where there is none.
    tolerance
        Share of the model value. Both count as zero below `SPUR`: they are next to nothing, and
        how far apart they are says nothing.
    """
    exact = np.sqrt(np.where(r >= SPUR, r, 0.0))
    model = np.where(np.greater(root, sqrt(SPUR)), root, 0.0)
    beyond: Bools = np.isfinite(root) & (np.abs(exact - model) > tolerance * model)
    return beyond


def residual_correlations(q_vv: Array, r: Array) -> Array:
    """Return (n, n) rho_ij = q_ij / sqrt(q_ii q_jj); NaN in rows that cannot be tested."""
    diagonal = np.einsum("ii->i", q_vv)
    root = np.sqrt(np.where((r >= TESTABLE) & (diagonal > 0.0), diagonal, np.nan))
    out: Array = np.clip(q_vv / root[:, None] / root, -1.0, 1.0)
    return out


def critical_transfers(influence: Array) -> list[tuple[int, int, float]]:
    """Return (i, j, (Q_vv P)_ji) wherever an error in i shows at least as large in j.

    Column i of `influence`, (n, n) Q_vv P, is what a unit error in row i does to every residual:
    abs((Q_vv P)_ji) >= (Q_vv P)_ii - 1e-9 (Kratky and El-Hakim 1983, heavy arrows of Figure 2).
    Rows that cannot be tested are sources of nothing that could be compared and are left out.
    """
    own = np.einsum("ii->i", influence)
    critical = (np.abs(influence) >= own - 1e-9) & (own >= TESTABLE)
    np.einsum("ii->i", critical)[:] = False
    targets, sources = np.nonzero(critical)
    found = [
        (int(i), int(j), float(influence[j, i])) for j, i in zip(targets, sources, strict=True)
    ]
    return sorted(found)


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


def error_odds(r: Array, ratio: Array | None, redundancy: int, kind: TestKind) -> Odds:
    """Weigh a gross error in each row against every other row and against none.

    With g = 400 r_i: sigma known, BF_i = (1 + g)^(-1/2) exp((w^2 / 2) g / (1 + g)); sigma
    estimated from f redundancies, BF_i = (1 + g)^(-1/2) (1 - (w^2 / f) g / (1 + g))^(-f/2).
    Prior: none 0.9, the rest shared equally by the rows.

    Parameters
    ----------
    r
        (n,) redundancy numbers.
    ratio
        (n,) standardized residuals, NaN where a row cannot be tested; None without sigma.
    redundancy
        f.
    kind
        "baarda": sigma known; "tau": sigma estimated.
    """
    n = len(r)
    f = redundancy
    if ratio is None or f < 1:
        return Odds(np.full(n, (1.0 - NONE_PRIOR) / n), NONE_PRIOR)
    testable = np.isfinite(ratio)
    w2 = np.where(testable, ratio, 0.0) ** 2
    g = np.where(testable, ERROR_PRIOR_SIGMAS**2 * r, 0.0)
    shrink = g / (1.0 + g)
    if kind == "baarda":
        log_factor = -0.5 * np.log1p(g) + 0.5 * w2 * shrink
    else:
        # w^2 cannot exceed f but for rounding; the bracket stays positive because shrink < 1
        log_factor = -0.5 * np.log1p(g) - 0.5 * f * np.log1p(-np.minimum(w2 / f, 1.0) * shrink)
    terms = np.append(log_factor + log((1.0 - NONE_PRIOR) / n), log(NONE_PRIOR))
    terms = np.exp(terms - terms.max())
    terms /= terms.sum()
    return Odds(terms[:-1], float(terms[-1]))
