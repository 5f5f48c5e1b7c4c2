"""Variance components of groups of observations, from sums per group.

Iterated until the factors stay: with s_g^2 the variance factor of group g, v'Pv_g its weighted sum
of squares and r_g its share of the redundancy, both with the variances of the last step,

    s_g^2  becomes  s_g^2 v'Pv_g / r_g                                    (Foerstner 1979),

which is the solution of Helmert's equations at the point where nothing changes any more, and never
turns negative on the way. Only sums are needed, so an adjustment may be as sparse as it likes.

The factors' covariance matrix is that of Helmert's equations, 2 s_g^2 s_h^2 (S^-1)_gh with
S_gh = tr(Q_vv P_g Q_vv P_h). S follows from sums as well: d r_g / d ln s_h^2 = delta_gh r_g - S_gh.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.errors import InputError

__all__ = [
    "CONFIDENCE",
    "LEAST_REDUNDANCY",
    "GroupSums",
    "VarianceComponent",
    "VarianceComponents",
    "estimate_components",
]

ComponentStatus = Literal["estimated", "undetermined", "vanishing"]

CONFIDENCE = 0.95
"""Probability with which an interval holds the true factor."""

LEAST_REDUNDANCY = 0.5
"""Redundancy below which a group's own variance is not determined: its factor is held."""
_STEP = 1e-3  # of ln s^2, where redundancies are differentiated
_APART = 1e-6  # smallest eigenvalue of S, scaled to a unit diagonal, that tells groups apart
_NO_END = 1e-12  # estimate over the upper limit of an interval below which it has no end
_VANISHING = 1e-8  # factor below which nothing is left of a group's variance


class GroupSums(NamedTuple):
    """Sums over each of k groups in an adjustment with given variance factors.

    Attributes
    ----------
    vtpv
        (k,) sums v'Pv of the groups, P from the given variances.
    redundancy
        (k,) sums of redundancy numbers.
    """

    vtpv: Array
    redundancy: Array


@dataclass(frozen=True, slots=True)
class VarianceComponent:
    """The variance of one group.

    Attributes
    ----------
    name, observations
        Of the group.
    redundancy
        Its share of the redundancy, at the end.
    vtpv
        Its v'Pv with the variances at the end.
    factor
        Factor of its a-priori variance.
    deviation
        Standard deviation of that factor; None when it is held, or when the groups cannot be told
        apart.
    state
        "undetermined": less redundancy than LEAST_REDUNDANCY, with the stated variance or as it
        falls in the iteration, held at 1; "vanishing": its
        residuals vanish faster than its redundancy (an estimate of zero or less), held where it
        was when that showed.
    """

    name: str
    observations: int
    redundancy: float
    vtpv: float
    factor: float
    deviation: float | None
    state: ComponentStatus

    @property
    def sigma_factor(self) -> float:
        """Factor of the a-priori standard deviation."""
        return sqrt(self.factor)

    @property
    def degrees(self) -> float | None:
        """Degrees of freedom of the estimate; None where it has no standard deviation.

        A group alone has r s^2 / sigma^2 distributed as chi-square; among others it is as good as
        one with 2 factor^2 / deviation^2 degrees of freedom.
        """
        return None if self.deviation is None else 2.0 * (self.factor / self.deviation) ** 2

    @property
    def interval(self) -> tuple[float, float] | None:
        """Confidence interval (95 %) of the factor; None where it has no standard deviation.

        None also where the group says so little that the interval has no end. It is that of the
        chi-square of `degrees`: symmetric intervals of few degrees hold the true value far less
        often than they say.
        """
        from scipy.special import chdtri

        degrees = self.degrees
        if degrees is None:
            return None
        tail = 0.5 * (1.0 - CONFIDENCE)
        above, below = chdtri(degrees, [tail, 1.0 - tail]).tolist()
        if not below > _NO_END * degrees:
            return None
        return degrees * self.factor / above, degrees * self.factor / below


@dataclass(frozen=True, slots=True)
class VarianceComponents:
    """Variance components of all groups.

    Attributes
    ----------
    components
        One per group, in the order given.
    iterations
        Adjustments made.
    converged
        Whether the last one changed no factor by more than the tolerance.
    """

    components: tuple[VarianceComponent, ...]
    iterations: int
    converged: bool

    @property
    def factors(self) -> Array:
        """(k,) variance factors."""
        return np.array([c.factor for c in self.components])

    def remarks(self) -> list[str]:
        """Return sentences for a person: undetermined factors, no convergence."""
        out = []
        for c in self.components:
            if c.state == "undetermined":
                why = (
                    f"redundancy {c.redundancy:.2f}"
                    if c.redundancy < LEAST_REDUNDANCY
                    else "its redundancy fades as its variance falls"
                )
                out.append(f"{c.name}: {why}: its variance is not determined and is held")
            elif c.state == "vanishing":
                out.append(
                    f"{c.name}: the estimate is zero or negative: its variance is held at "
                    f"{c.factor:.2g} times the a-priori one"
                )
        alike = [c.name for c in self.components if c.state == "estimated" and c.deviation is None]
        if alike:
            out.append(
                f"{', '.join(alike)}: nothing tells their variances apart: they have no standard "
                "deviation"
            )
        if not self.converged:
            out.append(f"no convergence after {self.iterations} adjustments")
        return out


def estimate_components(
    names: Sequence[str],
    observations: Sequence[int],
    readjust: Callable[[Array], GroupSums],
    *,
    redundancies: Callable[[Array], Array] | None = None,
    most: int = 100,
    tolerance: float = 1e-4,
) -> VarianceComponents:
    """Estimate the variance factors of groups.

    Parameters
    ----------
    names, observations
        Names of the k groups, and the number of observations of each.
    readjust
        Called with (k,) variance factors; adjusts with them and returns the sums per group.
    redundancies
        Called with (k,) factors next to the final ones, twice for every estimated group but one;
        returns their redundancies. None: those that `readjust` returns.
    most
        Largest number of adjustments.
    tolerance
        Relative change of a factor at which the iteration ends.

    Raises
    ------
    InputError
        No groups, or names and numbers do not match.
    """
    k = len(names)
    if k == 0 or len(observations) != k:
        raise InputError("variance components need groups of observations")
    factors = np.ones(k)
    vanishing, undetermined = np.zeros(k, dtype=bool), np.zeros(k, dtype=bool)
    found = readjust(factors)
    runs, converged = 1, False
    while True:
        # once without redundancy, held from then on: its factor would swing for ever
        undetermined |= (found.redundancy < LEAST_REDUNDANCY) & ~vanishing
        held = undetermined | vanishing
        ratio = np.ones(k)
        np.divide(found.vtpv, found.redundancy, out=ratio, where=~held)
        new = factors * ratio
        gone = ~held & ~(new > _VANISHING)
        vanishing |= gone
        new = np.where(gone, factors, new)
        new = np.where(undetermined, 1.0, new)
        change = float(np.abs(new / factors - 1.0).max())
        converged = change <= tolerance and not bool(gone.any())
        if converged or runs >= most:
            break
        factors = new
        found = readjust(factors)
        runs += 1
    states: list[ComponentStatus] = [
        "vanishing" if vanishing[g] else ("undetermined" if undetermined[g] else "estimated")
        for g in range(k)
    ]
    estimated = [g for g in range(k) if states[g] == "estimated"]
    deviations: list[float | None] = [None] * k
    ask = redundancies or (lambda factors: readjust(factors).redundancy)
    traces = _traces(ask, factors, found.redundancy, estimated)
    for g, relative in zip(estimated, _deviations(traces), strict=True):
        deviations[g] = None if relative is None else float(factors[g]) * relative
    return VarianceComponents(
        tuple(
            VarianceComponent(
                names[g],
                int(observations[g]),
                float(found.redundancy[g]),
                float(found.vtpv[g]),
                float(factors[g]),
                deviations[g],
                states[g],
            )
            for g in range(k)
        ),
        runs,
        converged,
    )


def _traces(
    redundancies: Callable[[Array], Array], factors: Array, at: Array, estimated: list[int]
) -> Array:
    """Return S between the estimated groups, by central differences of the redundancies."""
    k = len(factors)
    columns = np.zeros((k, k))
    # the columns of all groups add up to the redundancies: one need not be asked for
    asked = estimated[:-1] if len(estimated) == k else estimated
    for h in asked:
        up, down = factors.copy(), factors.copy()
        up[h] *= np.exp(_STEP)
        down[h] *= np.exp(-_STEP)
        columns[:, h] = (redundancies(down) - redundancies(up)) / (2.0 * _STEP)
        columns[h, h] += at[h]
    if len(asked) < len(estimated):
        columns[:, estimated[-1]] = at - columns.sum(axis=1)
    out = columns[np.ix_(estimated, estimated)]
    return 0.5 * (out + out.T)


def _deviations(traces: Array) -> list[float | None]:
    """Return sqrt(2 (S^-1)_gg): standard deviations of the factors' logarithms."""
    if not len(traces):
        return []
    size = np.sqrt(np.maximum(np.diag(traces), 0.0))
    if not bool((size > 0.0).all()):
        return [None] * len(traces)
    scaled = traces / size[:, None] / size
    if not float(np.linalg.eigvalsh(scaled)[0]) > _APART:
        return [None] * len(traces)
    variances = np.diag(np.linalg.inv(scaled)) / size**2
    return [sqrt(2.0 * value) for value in variances.tolist()]
