"""The distribution that standardized residuals have where nothing is wrong: normal, or Pope's tau.

tau = t sqrt(f) / sqrt(f - 1 + t^2) with t of f - 1 degrees of freedom, f the redundancy (Pope
1976); its values lie between - sqrt(f) and sqrt(f).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from anaplot.adjustment.tested import AppliedTest, sigma0_known
from anaplot.aliases import Array

__all__ = ["TestDistribution", "distribution_of"]


@dataclass(frozen=True, slots=True)
class TestDistribution:
    """A distribution of standardized residuals.

    Attributes
    ----------
    redundancy
        f of Pope's tau; None: the normal distribution.
    """

    __test__ = False  # not a test class, whatever a test runner may think of its name

    redundancy: int | None

    @property
    def name(self) -> str:
        """What it is called."""
        if self.redundancy is None:
            return "normal distribution"
        return f"tau distribution, f = {self.redundancy}"

    def below(self, values: Array) -> Array:
        """Return (n,) probabilities of a smaller value."""
        from scipy.special import ndtr, stdtr

        f = self.redundancy
        if f is None:
            return np.asarray(ndtr(values))
        inside = np.clip(values, -sqrt(f), sqrt(f))
        with np.errstate(divide="ignore"):
            t = inside * sqrt(f - 1.0) / np.sqrt(np.maximum(f - inside**2, 0.0))
        return np.asarray(stdtr(f - 1.0, t))

    def quantiles(self, probabilities: Array) -> Array:
        """Return (n,) values below which a value lies with probabilities between 0 and 1."""
        from scipy.special import ndtri, stdtrit

        f = self.redundancy
        if f is None:
            return np.asarray(ndtri(probabilities))
        t = stdtrit(f - 1.0, probabilities)
        return np.asarray(t * sqrt(f) / np.sqrt(f - 1.0 + t * t))


def distribution_of(test: AppliedTest, redundancy: int) -> TestDistribution | None:
    """Return the distribution of a test's w or tau; None where tau has none (f < 2)."""
    if sigma0_known(test.kind):
        return TestDistribution(None)
    return TestDistribution(redundancy) if redundancy > 1 else None
