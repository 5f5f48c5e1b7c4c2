"""A residual system some rows of which are left out for good."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence

import numpy as np
from scipy.sparse import csr_array

from anaplot.adjustment.elimination import Elimination
from anaplot.adjustment.residualsystem import (
    Designed,
    ResidualSystem,
    Reweightable,
    WeightedAdjustments,
    diagonal,
)
from anaplot.aliases import Array, Index

__all__ = ["ReducedSystem", "remaining", "spread"]


class ReducedSystem:
    """What a system is without some of its rows, in the same numbering; a `ResidualSystem`.

    Parameters
    ----------
    system
        All rows.
    rows
        Those left out: nothing checks them any more (r = 0).

    Raises
    ------
    NotSeparableError
        The other rows do not check one of them.
    """

    def __init__(self, system: ResidualSystem, rows: Collection[int]) -> None:
        self._names = system.names
        self._state = Elimination(system)
        for row in sorted(rows):
            self._state.add(row)
        self._known: dict[int, Array] = {}

    @property
    def names(self) -> Sequence[Hashable]:
        """Identity of each of the n rows."""
        return self._names

    @property
    def e(self) -> Array:
        """(n,) misclosures left, without the rows left out; zero in these."""
        return self._state.e

    @property
    def r(self) -> Array:
        """(n,) redundancy numbers, zero in the rows left out."""
        return self._state.r

    @property
    def vtpv(self) -> float:
        """The v'Pv of the others."""
        return self._state.vtpv

    @property
    def redundancy(self) -> int:
        """Redundancy of the others."""
        return self._state.redundancy

    def columns(self, rows: Index) -> Array:
        """Return (n, k): the columns of R that belong to k rows, without those left out."""
        missing = [row for row in dict.fromkeys(rows.tolist()) if row not in self._known]
        self._state.system.columns(np.array(missing, dtype=np.intp))  # all of them at once
        for row in missing:
            self._known[row] = self._state.column(row)
        out = np.empty((len(rows), len(self._names)))
        for at, row in enumerate(rows.tolist()):
            out[at] = self._known[row]
        return out.T

    def design(self) -> csr_array | None:
        """Return (n, u) derivatives, zero in the rows left out; None: not known."""
        system = self._state.system
        every = system.design() if isinstance(system, Designed) else None
        if every is None:
            return None
        there = np.ones(len(self._names))
        there[list(self._state.rows)] = 0.0
        return csr_array(diagonal(there) @ every)

    def reweighting(self) -> WeightedAdjustments | None:
        """Return the adjustments with other weights; None: not known. See `Reweightable`."""
        system, out = self._state.system, list(self._state.rows)
        adjusted = system.reweighting() if isinstance(system, Reweightable) else None
        if adjusted is None:
            return None

        def without(weights: Array) -> Array:
            there = weights.copy()
            there[out] = 0.0
            return adjusted(there)

        return without


def remaining(n: int, left_out: Collection[int]) -> Index:
    """Return the rows that are not left out."""
    there = np.ones(n, dtype=bool)
    there[list(left_out)] = False
    return np.flatnonzero(there)


def spread(values: Array, rows: Index, n: int) -> Array:
    """Return (n,) the values of some rows, zero in all others."""
    out = np.zeros(n)
    out[rows] = values
    return out
