"""How the hypotheses of a block are tested: significance, power, and which sigma decides."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

from anaplot.adjustment.hypothesis import FTest, f_noncentrality, f_test
from anaplot.adjustment.tested import sigma0_known
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["CORRELATED", "USUAL", "HypothesisSettings", "VarianceFactor", "Verdict"]

CORRELATED = 0.7
"""Correlation from which on parameters are tested in pairs and taken apart as sets."""

_ROUNDING = 1e-6  # sigma0 below which residuals are rounding, not measurement


@dataclass(frozen=True, slots=True)
class HypothesisSettings:
    """How hypotheses are tested.

    Attributes
    ----------
    alpha
        Significance of every global test, and of each family of single tests together.
    power
        Power that smallest detectable deviations refer to.

    Raises
    ------
    ValueError
        Not 0 < alpha < power < 1.
    """

    alpha: float = 0.05
    power: float = 0.80

    def __post_init__(self) -> None:
        if not 0.0 < self.alpha < self.power < 1.0:
            raise ValueError(
                f"significance {self.alpha} must lie above 0 and below the power {self.power} < 1"
            )


USUAL = HypothesisSettings()
"""How hypotheses are tested where nothing else is asked for."""


class Verdict(NamedTuple):
    """A hypothesis tested with the estimated and with the a-priori sigma0.

    Attributes
    ----------
    estimated
        None without redundancy of its own.
    known
        With sigma0 = 1.
    by_known
        Whether the a-priori sigma0 decides (test "baarda").
    """

    estimated: FTest | None
    known: FTest
    by_known: bool

    @property
    def decisive(self) -> FTest | None:
        """The test that the block's settings go by; None when it does not exist."""
        return self.known if self.by_known else self.estimated

    @property
    def rejected(self) -> bool | None:
        """Whether the hypothesis is rejected; None when it cannot be tested."""
        return None if self.decisive is None else self.decisive.rejected


class VarianceFactor(NamedTuple):
    """The variance factor of an adjustment.

    Attributes
    ----------
    vtpv, redundancy
        Weighted sum of squares and redundancy of the adjustment.
    by_known
        Whether tests go by the a-priori sigma0.
    """

    vtpv: float
    redundancy: int
    by_known: bool

    @classmethod
    def of(cls, block: AdjustedBlock) -> VarianceFactor:
        """Return that of an adjusted block, with which the block's settings test."""
        return cls(block.vtpv, block.redundancy, sigma0_known(block.problem.test.kind))

    @property
    def sigma(self) -> float | None:
        """Return the estimated factor; None without redundancy, or if residuals are rounding."""
        if self.redundancy < 1 or not self.vtpv > _ROUNDING**2 * self.redundancy:
            return None
        return sqrt(self.vtpv / self.redundancy)

    @property
    def degrees(self) -> int | None:
        """Degrees of freedom that tests have; None where sigma0 counts as known."""
        return None if self.by_known or self.sigma is None else self.redundancy

    @property
    def used(self) -> float | None:
        """The factor that the tests go by; None when it does not exist."""
        return 1.0 if self.by_known else self.sigma

    def without(self, square: float, dimension: int) -> VarianceFactor:
        """Return what is left when conditions that cost a square are given up."""
        return VarianceFactor(
            max(self.vtpv - square, 0.0), self.redundancy - dimension, self.by_known
        )

    def estimated_with(self, degrees: int) -> VarianceFactor:
        """Return the same factor as an estimate with so many degrees of freedom."""
        return VarianceFactor(self.vtpv * degrees / self.redundancy, degrees, by_known=False)

    def test(self, square: float, dimension: int, alpha: float) -> Verdict:
        """Test a quadratic form that this adjustment's residuals have no part in."""
        sigma = self.sigma
        estimated = None
        if sigma is not None:
            estimated = f_test(
                square, dimension, alpha=alpha, sigma=sigma, redundancy=self.redundancy
            )
        return Verdict(estimated, f_test(square, dimension, alpha=alpha), self.by_known)

    def detectable(self, alpha: float, power: float) -> float:
        """Return the noncentrality that is found with the given power by the deciding test.

        Without redundancy it is that of the a-priori sigma0.
        """
        return f_noncentrality(alpha, power, 1, self.degrees)
