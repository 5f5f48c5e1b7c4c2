"""Adjustment with prior knowledge of the unknowns: the Bayesian estimators.

The linear(ised) model is v = A x + l with weights P, and v_x = x + l_x with weights Px: l and l_x
are the misclosures of observations and priors at the approximate values, x their corrections.
The estimators are those of the Bayesian phototriangulation paper (eq. 1 to 3, after Bossler); its
divisors of the variance factors are approximate, "rigorous" ones are the sums of the redundancy
numbers, r = n - tr(C A'PA / s^2) and r_x = p - tr(C Px / s_x^2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from anaplot.adjustment.leastsquares import adjust
from anaplot.aliases import Array
from anaplot.errors import NotComputableError

__all__ = [
    "BayesianEstimate",
    "Divisors",
    "LinearSystem",
    "classic_estimate",
    "common_estimate",
    "known_estimate",
    "separate_estimate",
]

Divisors = Literal["paper", "rigorous"]
Kind = Literal["classic", "known", "common", "separate"]

_CONDITION_LIMIT = 1e10  # priors are there to carry what the observations hardly determine
_VANISHED = 1e-12  # variance factor over its start that counts as zero


@dataclass(frozen=True, slots=True, eq=False)
class LinearSystem:
    """Observations and prior knowledge of u unknowns.

    Attributes
    ----------
    design
        (n, u) matrix A.
    misclosure
        (n,) vector l, computed minus observed.
    weights
        (n,) or (n, n) matrix P, positive definite.
    prior_misclosure
        (u,) vector l_x, approximate minus prior value.
    prior_weights
        (u,) or (u, u) matrix Px, positive semidefinite: zero where nothing is known beforehand.
    unknowns
        u names; numbered when empty.

    Raises
    ------
    ValueError
        Shapes disagree, a number is not finite or a weight matrix is not (semi)definite.
    """

    design: Array = field(repr=False)
    misclosure: Array = field(repr=False)
    weights: Array = field(repr=False)
    prior_misclosure: Array = field(repr=False)
    prior_weights: Array = field(repr=False)
    unknowns: Sequence[str] = ()

    def __post_init__(self) -> None:
        n, u = self.design.shape
        fits = (
            self.misclosure.shape == (n,)
            and self.weights.shape in ((n,), (n, n))
            and self.prior_misclosure.shape == (u,)
            and self.prior_weights.shape in ((u,), (u, u))
            and len(self.unknowns) in (0, u)
        )
        if not fits:
            raise ValueError(
                f"shapes disagree: {self.design.shape}, {self.misclosure.shape}, "
                f"{self.weights.shape}, {self.prior_misclosure.shape}, {self.prior_weights.shape}"
            )
        for part in (
            self.design,
            self.misclosure,
            self.weights,
            self.prior_misclosure,
            self.prior_weights,
        ):
            if not bool(np.isfinite(part).all()):
                raise ValueError("a number of the linear system is not finite")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(self.unknowns) or tuple(f"x{k + 1}" for k in range(self.design.shape[1]))


@dataclass(frozen=True, slots=True, eq=False)
class BayesianEstimate:
    """What prior knowledge and observations together say of the unknowns.

    Attributes
    ----------
    kind, divisors
        The estimator, and how its variance factors are divided.
    x
        (u,) corrections of the unknowns.
    covariance
        (u, u) their covariance matrix C.
    v, v_x
        (n,) and (u,) residuals A x + l and x + l_x.
    r, r_x
        (n,) redundancy numbers of the observations and (u,) of the priors, diagonals of Q_vv P;
        NaN for unknowns without a prior, and for all of them in the classic estimate.
    redundancy, prior_redundancy
        Their sums: together n + p - u for p priors, n when every unknown has one.
    variance, prior_variance
        Variance factors s^2 and s_x^2; the same number where they are common, NaN where a factor
        does not exist.
    divisor, prior_divisor
        What v'Pv and v_x'Px v_x were divided by; NaN where a factor is known. The common factor
        divides the sum of both by `divisor`.
    iterations, converged
        Solutions that were made, and whether the last one changed the factors by less than the
        tolerance.
    history
        (s^2, s_x^2) before the first and after every iteration.
    """

    kind: Kind
    divisors: Divisors
    x: Array
    covariance: Array = field(repr=False)
    v: Array = field(repr=False)
    v_x: Array = field(repr=False)
    r: Array = field(repr=False)
    r_x: Array = field(repr=False)
    redundancy: float
    prior_redundancy: float
    variance: float
    prior_variance: float
    divisor: float
    prior_divisor: float
    iterations: int
    converged: bool
    history: tuple[tuple[float, float], ...] = field(repr=False)

    @property
    def deviations(self) -> Array:
        """(u,) standard deviations of the unknowns."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Whitened:
    """The system with unit weights: root'root = P and prior_root'prior_root = Px."""

    system: LinearSystem
    root: Array  # (n,) or (n, n)
    prior_root: Array  # (p, u)
    priors: int

    def solve(self, variance: float, prior_variance: float, *, with_priors: bool) -> _Solved:
        system = self.system
        n, u = system.design.shape
        design = _times(self.root, system.design)
        misclosure = _times(self.root, system.misclosure)
        cofactors = np.full(n, variance)
        if with_priors:
            design = np.concatenate((design, self.prior_root))
            misclosure = np.concatenate((misclosure, self.prior_root @ system.prior_misclosure))
            cofactors = np.concatenate((cofactors, np.full(self.priors, prior_variance)))
        found = adjust(
            design,
            misclosure,
            cofactors,
            unknowns=system.names,
            condition_limit=_CONDITION_LIMIT,
        )
        v = system.design @ found.x + system.misclosure
        v_x = found.x + system.prior_misclosure
        whole = found.q_vv / np.sqrt(cofactors[:, None] * cofactors)
        r = np.diag(whole)[:n].copy()
        if self.root.ndim == 2:
            # Q_vv P of correlated observations: root^-1 (whitened) root
            r = np.einsum("ij,ji->i", np.linalg.solve(self.root, whole[:n, :n]), self.root)
        r_x = np.full(u, np.nan)
        sums = [float(found.w[:n] @ found.w[:n]), 0.0]
        prior_redundancy = 0.0
        if with_priors:
            prior = np.abs(self.prior_root).sum(axis=0) > 0.0
            weights = self.prior_root.T @ self.prior_root
            r_x = np.where(prior, 1.0 - np.diag(found.q_xx @ weights) / prior_variance, np.nan)
            sums[1] = float(found.w[n:] @ found.w[n:])
            prior_redundancy = float(found.r[n:].sum())
        return _Solved(
            found.x, found.q_xx, v, v_x, r, r_x, sums[0], sums[1],
            float(found.r[:n].sum()), prior_redundancy,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """One solution: inverse of the normal equations, v'Pv and v_x'Px v_x, redundancies."""

    x: Array
    q: Array
    v: Array
    v_x: Array
    r: Array
    r_x: Array
    vtpv: float
    prior_vtpv: float
    redundancy: float
    prior_redundancy: float


def _times(root: Array, values: Array) -> Array:
    if root.ndim == 2:
        return np.asarray(root @ values)
    return np.asarray(root[:, None] * values if values.ndim == 2 else root * values)


def _whitened(system: LinearSystem) -> _Whitened:
    if system.weights.ndim == 1:
        if not bool((system.weights > 0.0).all()):
            raise ValueError("weights must be positive")
        root = np.sqrt(system.weights)
    else:
        try:
            root = np.linalg.cholesky(system.weights).T
        except np.linalg.LinAlgError as error:
            raise ValueError("the weight matrix is not positive definite") from error
    if system.prior_weights.ndim == 1:
        if not bool((system.prior_weights >= 0.0).all()):
            raise ValueError("prior weights must not be negative")
        some = system.prior_weights > 0.0
        prior_root = np.diag(np.sqrt(system.prior_weights))[some]
    else:
        prior_root = _semidefinite_root(system.prior_weights)
    return _Whitened(system, root, prior_root, len(prior_root))


def _semidefinite_root(weights: Array) -> Array:
    """(p, u) with root'root = weights, p their rank."""
    size = np.sqrt(np.maximum(np.diag(weights), 0.0))
    safe = np.where(size > 0.0, size, 1.0)  # unknowns of different units: scaled to unit diagonal
    values, vectors = np.linalg.eigh(weights / safe[:, None] / safe)
    largest = max(float(np.abs(values).max(initial=0.0)), 1e-300)
    if float(values.min(initial=0.0)) < -1e-10 * largest:
        raise ValueError("the prior weight matrix is not positive semidefinite")
    keep = values > 1e-12 * largest
    root: Array = (vectors[:, keep] * np.sqrt(values[keep])).T * safe
    return root


def _positive(value: float, what: str) -> float:
    if not value > 0.0:
        raise NotComputableError(f"no variance factor of the {what}: its divisor is {value:.3g}")
    return value


def classic_estimate(system: LinearSystem, *, divisors: Divisors = "rigorous") -> BayesianEstimate:
    """Estimate without the priors (eq. 1).

    x = -(A'PA)^-1 A'P l, C = s^2 (A'PA)^-1; s^2 = v'Pv / (n - u - 2) with the paper's divisor,
    which is what unknown mean and variance cost, v'Pv / (n - u) with the rigorous one.

    Parameters
    ----------
    system
        Observations; its priors give v_x only.
    divisors
        "paper" or "rigorous".

    Raises
    ------
    RankDefectError
        The observations alone do not determine every unknown.
    NotComputableError
        The divisor is not positive.
    """
    found = _whitened(system).solve(1.0, 1.0, with_priors=False)
    n, u = system.design.shape
    divisor = _positive(float(n - u - (2 if divisors == "paper" else 0)), "observations")
    variance = found.vtpv / divisor
    nan = float("nan")
    return _estimate("classic", divisors, found, variance * found.q, (variance, nan),
                     (divisor, nan), 1, True, ((variance, nan),))  # fmt: skip


def known_estimate(
    system: LinearSystem, *, variance: float = 1.0, prior_variance: float = 1.0
) -> BayesianEstimate:
    """Estimate with variance factors that are known: the mean is all that is unknown.

    x = -(A'PA / s^2 + Px / s_x^2)^-1 (A'P l / s^2 + Px l_x / s_x^2), C that inverse.

    Parameters
    ----------
    system
        Observations and priors.
    variance, prior_variance
        Factors s^2 and s_x^2, positive.

    Raises
    ------
    RankDefectError
        Observations and priors together do not determine every unknown.
    ValueError
        A factor is not positive.
    """
    if not (0.0 < variance < float("inf") and 0.0 < prior_variance < float("inf")):
        raise ValueError(f"variance factors must be positive: {variance:g}, {prior_variance:g}")
    found = _whitened(system).solve(variance, prior_variance, with_priors=True)
    nan = float("nan")
    factors = (variance, prior_variance)
    return _estimate("known", "rigorous", found, found.q, factors, (nan, nan), 1, True, (factors,))


def common_estimate(system: LinearSystem, *, divisors: Divisors = "rigorous") -> BayesianEstimate:
    """Estimate with one unknown factor for observations and priors (eq. 2).

    x = -(A'PA + Px)^-1 (A'P l + Px l_x), C = s^2 (A'PA + Px)^-1,
    s^2 = (v'Pv + v_x'Px v_x) / d; the rigorous d is r + r_x = n + p - u, the paper's two less
    (n - 2 when every unknown has a prior).

    Parameters
    ----------
    system
        Observations and priors.
    divisors
        "paper" or "rigorous".

    Raises
    ------
    RankDefectError
        Observations and priors together do not determine every unknown.
    NotComputableError
        The divisor is not positive.
    """
    white = _whitened(system)
    found = white.solve(1.0, 1.0, with_priors=True)
    n, u = system.design.shape
    divisor = float(n + white.priors - u - (2 if divisors == "paper" else 0))
    variance = (found.vtpv + found.prior_vtpv) / _positive(divisor, "observations and priors")
    factors = (variance, variance)
    return _estimate("common", divisors, found, variance * found.q, factors,
                     (divisor, float("nan")), 1, True, (factors,))  # fmt: skip


def separate_estimate(
    system: LinearSystem,
    *,
    divisors: Divisors = "rigorous",
    start: tuple[float, float] = (1.0, 1.0),
    tolerance: float = 1e-8,
    limit: int = 500,
) -> BayesianEstimate:
    """Estimate with an unknown factor for the observations and another for the priors (eq. 3).

    x and C as with known factors, s^2 = v'Pv / d and s_x^2 = v_x'Px v_x / d_x, iterated. The
    paper divides both by n - u; the rigorous divisors are the redundancies r and r_x, which
    change with the factors.

    Parameters
    ----------
    system
        Observations and priors.
    divisors
        "paper" or "rigorous".
    start
        Factors of the first solution. (The paper starts from the classic estimate, which does
        not exist where the priors carry the datum.)
    tolerance
        Relative change of both factors that counts as none.
    limit
        Most iterations; an estimate that is not `converged` has used them up.

    Raises
    ------
    RankDefectError
        Observations and priors together do not determine every unknown.
    NotComputableError
        A divisor is not positive, or a factor vanishes: its variance cannot be determined.
    ValueError
        A starting factor is not positive.
    """
    if not (0.0 < start[0] < float("inf") and 0.0 < start[1] < float("inf")):
        raise ValueError(f"variance factors must be positive: {start[0]:g}, {start[1]:g}")
    if limit < 1:
        raise ValueError(f"at least one iteration is needed, not {limit}")
    white = _whitened(system)
    if white.priors == 0:
        raise NotComputableError("no variance factor of the priors: there are none")
    n, u = system.design.shape
    factors = (float(start[0]), float(start[1]))
    history = [factors]
    found = white.solve(*factors, with_priors=True)
    rounds, converged = 0, False
    parts = (float("nan"), float("nan"))
    while rounds < limit and not converged:
        rounds += 1
        if divisors == "paper":
            parts = (float(n - u), float(n - u))
        else:
            parts = (found.redundancy, found.prior_redundancy)
        _positive(parts[0], "observations")
        _positive(parts[1], "priors")
        new = (found.vtpv / parts[0], found.prior_vtpv / parts[1])
        for value, first, what in zip(new, start, ("observations", "priors"), strict=True):
            if not value > _VANISHED * first:
                raise NotComputableError(
                    f"the variance factor of the {what} is not determined: it becomes zero"
                )
        converged = all(
            abs(a - b) <= tolerance * max(a, b) for a, b in zip(new, factors, strict=True)
        )
        factors = new
        history.append(factors)
        found = white.solve(*factors, with_priors=True)
    return _estimate("separate", divisors, found, found.q, factors, parts,
                     rounds, converged, tuple(history))  # fmt: skip


def _estimate(
    kind: Kind,
    divisors: Divisors,
    found: _Solved,
    covariance: Array,
    factors: tuple[float, float],
    parts: tuple[float, float],
    iterations: int,
    converged: bool,
    history: tuple[tuple[float, float], ...],
) -> BayesianEstimate:
    return BayesianEstimate(
        kind, divisors, found.x, covariance, found.v, found.v_x, found.r, found.r_x,
        found.redundancy, found.prior_redundancy, factors[0], factors[1], parts[0], parts[1],
        iterations, converged, history,
    )  # fmt: skip
