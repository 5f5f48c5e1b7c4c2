"""The covariance of any unknowns of an adjusted block, each with each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.crosscofactors import function_cofactors
from anaplot.bundle.solve.problem import Datum
from anaplot.bundle.solve.unknownnames import UnknownName
from anaplot.bundle.solve.unknowns import unknown_functions, unknown_values

__all__ = ["Covariance", "covariance_of", "unknown_cofactors"]


@dataclass(frozen=True, slots=True, eq=False)
class Covariance:
    """Unknowns with their covariance.

    Attributes
    ----------
    names
        Of k unknowns: `text`, `unit`, `kind`, `owner` and `unknown` of each.
    values
        (k,) [m, rad; of parameters their unit].
    cofactors
        (k, k) for the a-priori sigma0; zeros in the rows of what is free of error, or held by the
        datum.
    sigma
        The factor of the standard deviations; None where there is none, without redundancy.
    estimated
        Whether that is the estimated sigma0, as a test with an estimated sigma0 has it; otherwise
        it is 1, the a-priori one.
    datum
        In which all this is.
    """

    names: tuple[UnknownName, ...] = field(repr=False)
    values: Array = field(repr=False)
    cofactors: Array = field(repr=False)
    sigma: float | None
    estimated: bool
    datum: Datum

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the unknowns: "m", "rad", "mm" or ""."""
        return tuple(name.unit for name in self.names)

    @property
    def matrix(self) -> Array:
        """(k, k) sigma^2 times the cofactors; NaN where there is no sigma."""
        return self.cofactors * (np.nan if self.sigma is None else self.sigma**2)

    @property
    def deviations(self) -> Array:
        """(k,) standard deviations; NaN where there is no sigma."""
        sigma = np.nan if self.sigma is None else self.sigma
        out: Array = sigma * np.sqrt(np.maximum(np.diag(self.cofactors), 0.0))
        return out

    @property
    def correlations(self) -> Array:
        """(k, k); NaN in the rows of what is free of error or held."""
        size = np.sqrt(np.diag(self.cofactors))
        size = np.where(size > 0.0, size, np.nan)
        return np.clip(self.cofactors / size[:, None] / size, -1.0, 1.0)


def covariance_of(block: AdjustedBlock, names: Sequence[UnknownName]) -> Covariance:
    """Return the covariance of unknowns, with the factor of all standard deviations of the block.

    Parameters
    ----------
    block
        The adjusted block; the covariance is in its datum.
    names
        Which, from `unknowns_meant`.

    Raises
    ------
    NotComputableError
        omega or kappa of a photo with phi at 90 degrees.
    """
    return Covariance(
        tuple(names),
        unknown_values(block, names),
        unknown_cofactors(block, names),
        block.sigma,
        block.problem.test.kind == "tau",
        block.problem.datum,
    )


def unknown_cofactors(block: AdjustedBlock, names: Sequence[UnknownName]) -> Array:
    """Return (k, k) cofactors of k unknowns in the reported datum; see `covariance_of`."""
    functions, beside = unknown_functions(block, names)
    change = block.cofactors.change
    if change is not None:
        # what the datum holds does not vary: without the rounding of what cancels
        cofactors = block.cofactors
        free = np.ones(functions.shape[1])
        held = [np.einsum("nii->ni", q).ravel() for q in (cofactors.photos, cofactors.points)]
        free[: sum(map(len, held))] = np.concatenate(held) > 0.0
        functions = csr_array(functions.multiply(free))
    found = function_cofactors(block, functions, change)
    return found if beside is None else found + beside
