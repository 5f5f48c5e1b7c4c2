"""An adjustment seen from the side of its residuals: all that a search for gross errors needs.

With every observation divided by its a-priori standard deviation, e = R (l - l0) are the
misclosures left and R = Q_vv P is symmetric and idempotent. An error of size z in row i changes e
by column i of R times z, so that every question about rejected rows is answered by those columns
alone (Gruen 1980, eq. 12 to 17; exact for a linear model).

Of correlated observations, e = P v and R = P Q_vv P, each row in units of its standard deviation
given the others, 1 / sqrt(p_ii): what an error changes, and the covariance of e, is R again, though
it is not idempotent, and v'Pv no longer e'e.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from anaplot.aliases import Array, Index

if TYPE_CHECKING:
    from scipy.sparse import csr_array, dia_array

__all__ = [
    "DenseResiduals",
    "Designed",
    "MeasuredSystem",
    "ResidualSystem",
    "Reweightable",
    "WeightedAdjustments",
    "diagonal",
]


class ResidualSystem(Protocol):
    """What a strategy for gross errors asks of an adjustment; whitened, without units."""

    @property
    def names(self) -> Sequence[Hashable]:
        """Identity of each of the n rows."""
        ...

    @property
    def e(self) -> Array:
        """(n,) misclosures left, in a-priori sigmas of their row; + r times an error of the row."""
        ...

    @property
    def r(self) -> Array:
        """(n,) redundancy numbers, the diagonal of R."""
        ...

    @property
    def vtpv(self) -> float:
        """v'Pv, over all rows (also over those that are never suspected); e'e if uncorrelated."""
        ...

    @property
    def redundancy(self) -> int:
        """Number of observations minus number of unknowns."""
        ...

    def columns(self, rows: Index) -> Array:
        """Return (n, k): the columns of R that belong to k rows.

        They are asked for again and again: a system that has to compute them keeps them.
        """
        ...


class MeasuredSystem(ResidualSystem, Protocol):
    """A residual system whose rows have units."""

    @property
    def units(self) -> Sequence[str]:
        """Units of the n rows."""
        ...

    @property
    def sigma(self) -> Array:
        """(n,) a-priori standard deviations of the rows in their units."""
        ...


@runtime_checkable
class Designed(Protocol):
    """A residual system that may have the derivatives of its rows as well."""

    def design(self) -> csr_array | None:
        """Return (n, u) derivatives, each row divided by its sigma; None where they are not known.

        Its columns span all that R takes away, and may depend on each other.
        """
        ...


WeightedAdjustments = Callable[[Array], Array]
"""Of (n,) factors of the weights, from 0 to 1, the (n,) misclosures that an adjustment with them
leaves, in a-priori sigmas of the full weights; zero where the weight is."""


@runtime_checkable
class Reweightable(Protocol):
    """A residual system that may be adjusted with other weights, without its columns."""

    def reweighting(self) -> WeightedAdjustments | None:
        """Return what adjusts it with one set of weights after another; None: not known."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class DenseResiduals:
    """A residual system that holds all of R; see `ResidualSystem` and `Designed`."""

    names: Sequence[Hashable]
    e: Array
    r: Array
    vtpv: float
    redundancy: int
    matrix: Array = field(repr=False)
    derivatives: csr_array | None = field(default=None, repr=False)

    def design(self) -> csr_array | None:
        """Return (n, u) derivatives, each row divided by its sigma; None: not known."""
        return self.derivatives

    def columns(self, rows: Index) -> Array:
        """Return (n, k): the columns of R that belong to k rows."""
        return self.matrix[:, rows]


def diagonal(values: Array) -> dia_array:
    """Return (n, n) the sparse matrix with n values on its diagonal."""
    from scipy.sparse import dia_array  # loaded with the first design

    return dia_array((values[None, :].astype(float), [0]), shape=(len(values), len(values)))
