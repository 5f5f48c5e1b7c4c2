"""Displacements under a null hypothesis: what all tests of them go by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.hypothesis import (
    DependentConditionsError,
    FTest,
    bonferroni_alpha,
    critical_f,
    nearest_components,
    quadratic_form,
    scheffe_factor,
    sidak_alpha,
)
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.epochs.located import Freed, free_one_by_one
from anaplot.bundle.hypotheses.verdict import VarianceFactor, Verdict
from anaplot.errors import NotComputableError

__all__ = ["Limits", "Orthogonal", "UnderTest", "length_of", "limits_of", "under_test"]


class Limits(NamedTuple):
    """What single displacements are tested with.

    Attributes
    ----------
    sigma
        Of unit weight; None where there is none: then all that follows from it is None.
    point_alpha, coordinate_alpha
        Bonferroni's significance of one point and of one coordinate.
    bonferroni, scheffe
        Limits of a displacement over its standard deviation.
    square
        Scheffe's limit of a quadratic form for the a-priori sigma0.
    reach
        Smallest detectable displacement over the root of its cofactor.
    """

    sigma: float | None
    point_alpha: float
    coordinate_alpha: float
    bonferroni: float | None
    scheffe: float | None
    square: float | None
    reach: float


def limits_of(
    variance: VarianceFactor, alpha: float, power: float, coordinates: int, points: int
) -> Limits:
    """Return what `coordinates` differences of `points` points are tested with."""
    sigma, degrees = variance.used, variance.degrees
    sharp = bonferroni_alpha(alpha, coordinates)
    scheffe = None if sigma is None else scheffe_factor(alpha, coordinates, degrees)
    return Limits(
        sigma,
        bonferroni_alpha(alpha, points),
        sharp,
        None if sigma is None else sqrt(critical_f(sharp, 1, degrees)),
        scheffe,
        None if sigma is None or scheffe is None else (scheffe * sigma) ** 2,
        sqrt(variance.detectable(sharp, power)),
    )


class Orthogonal(NamedTuple):
    """Displacements taken apart into independent components (Gruen 1978, D1 and D3).

    Attributes
    ----------
    values
        (n,) the component that stands for each difference, normal with standard deviation 1 if the
        hypothesis is true and sigma0 is one; NaN of one that is not tested. All are independent,
        and their squares add up to R.
    alike
        (n,) its correlation with the difference; NaN likewise.
    """

    values: Array
    alike: Array


@dataclass(frozen=True, slots=True, eq=False)
class UnderTest:
    """Differences that are zero under the null hypothesis.

    Attributes
    ----------
    d
        (n,) the differences, minus the given movement [m].
    cofactors
        (n, n) their covariance matrix [m^2] for the a-priori sigma0.
    live
        (n,) which are tested.
    variance
        The variance factor.
    """

    d: Array = field(repr=False)
    cofactors: Array = field(repr=False)
    live: Bools = field(repr=False)
    variance: VarianceFactor

    @property
    def rows(self) -> Index:
        """The rows that are tested."""
        return np.flatnonzero(self.live)

    def square(self, rows: Index) -> float | None:
        """Return R of some differences; None where their cofactors are singular."""
        try:
            return quadratic_form(self.d[rows], self.cofactors[np.ix_(rows, rows)])
        except DependentConditionsError:
            return None

    def together(self, alpha: float) -> Verdict | None:
        """Test all of them; None where the cofactors are singular."""
        square = self.square(self.rows)
        return None if square is None else self.variance.test(square, len(self.rows), alpha)

    def freed(self, rows: Index, owners: Sequence[int], refuted: FTest) -> list[Freed]:
        """Let owners of some differences move one by one, until the rest is accepted.

        Parameters
        ----------
        rows
            Of the differences: all that `refuted` is of; their cofactors are not singular.
        owners
            What each of them belongs to.
        refuted
            As `free_one_by_one` has it.
        """
        cofactors = self.cofactors[np.ix_(rows, rows)]
        information = np.asarray(np.linalg.inv(cofactors), dtype=np.float64)
        return free_one_by_one(owners, self.d[rows], information, refuted)

    def orthogonal(self) -> Orthogonal | None:
        """Take all that is tested apart; None where the cofactors are singular."""
        rows = self.rows
        out = Orthogonal(np.full(len(self.d), np.nan), np.full(len(self.d), np.nan))
        try:
            values, alike = nearest_components(self.d[rows], self.cofactors[np.ix_(rows, rows)])
        except DependentConditionsError:
            return None
        out.values[rows], out.alike[rows] = values, alike
        return out

    def component_test(
        self, parts: Orthogonal | None, rows: Index, tests: int, alpha: float
    ) -> Verdict | None:
        """Test the components of some differences, one of `tests` independent families.

        Together the families have the significance alpha, exactly where sigma0 is known.
        """
        if parts is None or not len(rows):
            return None
        square = float(np.sum(parts.values[rows] ** 2))
        return self.variance.test(square, len(rows), sidak_alpha(alpha, tests))


def length_of(movement: Array, cofactors: Array, sigma: float | None) -> tuple[float, float | None]:
    """Return the length [m] of a (3,) movement and its standard deviation along its own direction.

    None without sigma, and of a movement of zero.
    """
    length = float(np.linalg.norm(movement))
    if sigma is None or not length > 0.0:
        return length, None
    square = float(movement @ cofactors @ movement)
    return length, sigma * sqrt(max(square, 0.0)) / length


def under_test(d: Array, cofactors: Array, free: Bools, variance: VarianceFactor) -> UnderTest:
    """Return differences under test: the free ones that have a variance.

    Raises
    ------
    NotComputableError
        None has.
    """
    q = np.diag(cofactors)
    live = np.asarray(free & (q > 1e-12 * float(q[free].max(initial=0.0))))
    if not live.any():
        raise NotComputableError("no displacement has a variance: nothing can be tested")
    return UnderTest(d, cofactors, live, variance)
