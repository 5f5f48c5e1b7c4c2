"""Whether what a block's test flags may be chance alone."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.testdistribution import TestDistribution, distribution_of
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["ALARM", "exceeding_by_chance", "may_be_chance", "tested_count"]

ALARM = 0.05
"""Significance of what is said of a block as a whole: of good ones one in twenty is doubted."""


def tested_count(block: AdjustedBlock) -> int:
    """Return how many observations take part and can be tested (redundancy number of `SPUR`)."""
    tested = block.tested
    can_be = tested.use & (tested.r >= SPUR) & np.isfinite(tested.w)
    return int(np.count_nonzero(can_be))


def exceeding_by_chance(of: TestDistribution, w: float, tested: int) -> float:
    """Return how many of so many tested observations exceed abs(w) in the mean by chance.

    Parameters
    ----------
    of
        The distribution of their standardized residuals.
    w
        One of these.
    tested
        Count.
    """
    return 2.0 * tested * float(of.below(np.array([-abs(w)]))[0])


def may_be_chance(block: AdjustedBlock) -> bool:
    """Return whether one of twenty good blocks has so many flagged, and as far out.

    False as well where nothing is flagged.
    """
    tested = block.tested
    flagged = int(np.count_nonzero(tested.flagged))
    distribution = distribution_of(block.test, block.redundancy)
    if not flagged or distribution is None:
        return False
    from scipy.special import pdtrc

    worst = float(np.nanmax(np.abs(tested.w[tested.flagged])))
    return (
        float(pdtrc(flagged - 1, block.flagged_by_chance)) > ALARM
        and exceeding_by_chance(distribution, worst, tested_count(block)) > ALARM
    )
