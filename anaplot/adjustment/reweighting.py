"""Robust adjustment by re-weighting.

A system that can be adjusted with other weights (`Reweightable`: a block, by its own normal
equations) is. Of any other the columns of R say as much: a row of weight p < 1 is a row with an
additional error of variance g = 1/p - 1. With V the rows of reduced weight the estimate of that
error is z = (R_VV + diag(1/g))^-1 e_V, and the misclosures of the weighted adjustment are
e - R[:, V] z, plus z in V: what a new adjustment with these weights would give (Woodbury), for the
price of the columns of V.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import log
from typing import Literal

import numpy as np

from anaplot.adjustment.findings import SearchStep
from anaplot.adjustment.residualsystem import ResidualSystem, Reweightable, WeightedAdjustments
from anaplot.adjustment.watch import Watch
from anaplot.aliases import Array, Bools

__all__ = [
    "DANISH_LIMIT",
    "HUBER_LIMIT",
    "SETTLED",
    "Reweighting",
    "reweight",
    "robust_adjustment",
    "weighted_adjustments",
    "weighted_misclosures",
]


HUBER_LIMIT = 1.345
"""k of Huber's weights: 95 % efficiency under the normal distribution (Holland, Welsch 1977)."""

DANISH_LIMIT = 2.0
"""Size [sigma] up to which the Danish method leaves a weight as it is (Krarup et al. 1980)."""

SETTLED = 1e-6
"""Change of a weight below which the iteration has ended."""

_DANISH_FACTOR = 0.05
_FIRST = 3  # iterations from ones
_FIRST_DANISH_POWER = 4.4  # in these
_DANISH_POWER = 3.0  # after them, and where other weights have been begun with
_MOST_ITERATIONS = 200
_SMALLEST_WEIGHT = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Reweighting:
    """A robust adjustment.

    Attributes
    ----------
    weights
        (n,) factors of the a-priori weights; zero of what is left out.
    misclosures
        (n,) of the weighted adjustment, in a-priori sigmas of the rows with their full weights.
    changes
        Largest change of a weight in every iteration.
    sums
        Sum of weight times squared misclosure after every iteration, the first before any.
    converged
        Whether the last change was below `SETTLED`.
    """

    weights: Array
    misclosures: Array
    changes: tuple[float, ...]
    sums: tuple[float, ...]
    converged: bool

    @property
    def steps(self) -> list[SearchStep]:
        """What every iteration did."""
        # what is left out has none at all
        fallen = (self.weights > 0.0) & (self.weights < 1.0)
        rows = tuple(np.flatnonzero(fallen).tolist())
        return [
            SearchStep("reweight", rows, change, SETTLED, self.sums[k], self.sums[k + 1])
            for k, change in enumerate(self.changes)
        ]

    @property
    def remarks(self) -> tuple[str, ...]:
        """What limited it."""
        if self.converged:
            return ()
        return (
            f"the weights did not settle in {len(self.changes)} iterations: the last ones count, "
            f"which still change by up to {self.changes[-1]:.1g} of a full weight",
        )


def weighted_adjustments(system: ResidualSystem) -> WeightedAdjustments:
    """Return what adjusts a system with weights multiplied by factors from 0 to 1."""
    own = system.reweighting() if isinstance(system, Reweightable) else None
    return (lambda weights: weighted_misclosures(system, weights)) if own is None else own


def weighted_misclosures(system: ResidualSystem, weights: Array) -> Array:
    """Return (n,) misclosures of the adjustment with weights multiplied by factors.

    From the columns of R of the reduced weights.

    Parameters
    ----------
    system
        All rows.
    weights
        (n,) factors from 0 to 1; below 1e-12 that is meant.
    """
    e = np.asarray(system.e, dtype=float)
    low = np.flatnonzero(weights < 1.0)
    if not len(low):
        return e.copy()
    p = np.maximum(weights[low], _SMALLEST_WEIGHT)
    columns = system.columns(low)
    # symmetric form (D R D + I) with D = sqrt(g): definite whatever the weights
    root = np.sqrt(1.0 / p - 1.0)
    inner = columns[low] * root[:, None] * root + np.eye(len(low))
    z = root * np.linalg.solve(inner, root * e[low])
    out = e - columns @ z
    out[low] += z
    return np.asarray(out, dtype=float)


def robust_adjustment(
    system: ResidualSystem,
    method: Literal["huber", "danish"],
    suspects: Bools,
    watch: Watch,
    near: Collection[int] | None,
    left_out: Collection[int] = (),
) -> Reweighting:
    """Re-weight from where the weights of a pass begin.

    Parameters
    ----------
    system, method, suspects, watch, left_out
        As `reweight` has them.
    near
        What "danish" rejected where the rows were linearised near by, as `find_gross_errors` has
        it.
    """
    begin: Array | None = None
    if method == "danish" and near:
        begin = np.ones(len(suspects))
        begin[list(near)] = 0.0
    elif method == "danish" and near is not None:
        begin = reweight(system, "huber", suspects, watch, left_out=left_out).weights
    return reweight(system, method, suspects, watch, begin, left_out)


def reweight(
    system: ResidualSystem,
    method: Literal["huber", "danish"],
    suspects: Bools,
    watch: Watch | None = None,
    begin: Array | None = None,
    left_out: Collection[int] = (),
) -> Reweighting:
    """Iterate weights and adjustment until the weights stand still.

    Parameters
    ----------
    system
        All rows.
    method
        "huber": p = min(1, k / abs(v)); "danish": p = exp(-0.05 abs(v)^4.4) beyond the limit in
        the first three iterations, exp(-0.05 abs(v)^3) after them.
    suspects
        (n,) rows whose weights may fall.
    watch
        Told how far it is; where it asks for the end, the last weights are returned.
    begin
        (n,) weights to begin with; None: ones.
    left_out
        Rows that have no weight, whatever they are off.
    """
    seen = Watch() if watch is None else watch
    every, gone = weighted_adjustments(system), list(left_out)

    def adjusted(weights: Array) -> Array:
        v = every(weights)
        v[gone] = 0.0
        return v

    weights = np.ones(len(suspects))
    if begin is not None:
        weights = np.where(suspects, np.maximum(begin, _SMALLEST_WEIGHT), 1.0)
    weights[gone] = 0.0
    v = np.array(system.e, dtype=float) if begin is None and not gone else adjusted(weights)
    changes: list[float] = []
    sums = [float((weights * v) @ v)]
    for iteration in range(_MOST_ITERATIONS):
        size = np.abs(v)
        if method == "huber":
            new = np.minimum(1.0, HUBER_LIMIT / np.maximum(size, HUBER_LIMIT))
        else:
            # with other weights what is far off has hardly any say already
            steep = begin is None and iteration < _FIRST
            power = _FIRST_DANISH_POWER if steep else _DANISH_POWER
            with np.errstate(over="ignore", under="ignore"):
                fallen = np.exp(-_DANISH_FACTOR * np.minimum(size, 1e3) ** power)
            new = np.where(size > DANISH_LIMIT, fallen, 1.0)
        new = np.where(suspects, np.maximum(new, _SMALLEST_WEIGHT), 1.0)
        new[gone] = 0.0
        changes.append(float(np.abs(new - weights).max(initial=0.0)))
        settled = -log(min(max(changes[-1], SETTLED), 1.0)) / -log(SETTLED)
        seen("re-weighting", max(settled, iteration / _MOST_ITERATIONS))
        weights = new
        v = adjusted(weights)
        sums.append(float((weights * v) @ v))
        if changes[-1] < SETTLED and iteration >= _FIRST:
            return Reweighting(weights, v, tuple(changes), tuple(sums), True)
        if seen.stopped:
            break
    return Reweighting(weights, v, tuple(changes), tuple(sums), False)
