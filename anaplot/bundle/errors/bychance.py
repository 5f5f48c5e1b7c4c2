"""Whether what a block's test flags may be chance alone.

The rays of a point of two photos check each other once: its four coordinates have the same abs(w),
and are flagged together or not at all. What is counted are tests that say something of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.testdistribution import TestDistribution, distribution_of
from anaplot.aliases import Bools
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["ALARM", "exceeding_by_chance", "may_be_chance", "own_tests", "tested_count"]

ALARM = 0.05
"""Significance of what is said of a block as a whole: of good ones one in twenty is doubted."""

_ONCE = 1.0 + 1e-6  # sum of the redundancy numbers of a point whose rays check each other once


class OwnTests(NamedTuple):
    """How many tests say something of their own, and how many of them flag something."""

    tests: int
    flagged: int


def own_tests(block: AdjustedBlock) -> OwnTests:
    """Return how many tests of a block say something of their own, and flag something.

    All that can be tested, but for points whose rays check each other once: each of these is one
    test, however many of its coordinates exceed the critical value.
    """
    tested, image, point = block.tested, block.observations.image, block.problem.point
    can_be = _testable(block)
    flagged = tested.flagged & can_be
    of_point = np.repeat(point, 2)
    points = len(block.problem.points)
    checks = np.bincount(of_point, np.where(can_be, tested.r, 0.0)[:image], points)
    once = checks <= _ONCE
    single = np.zeros(len(can_be), dtype=np.bool_)
    single[:image] = once[of_point]

    def counted(rows: Bools) -> int:
        alike = np.bincount(of_point, (rows & single)[:image], points) > 0.0
        return int(np.count_nonzero(rows & ~single) + np.count_nonzero(alike))

    return OwnTests(counted(can_be), counted(flagged))


def _testable(block: AdjustedBlock) -> Bools:
    tested = block.tested
    can_be: Bools = tested.use & (tested.r >= SPUR) & np.isfinite(tested.w)
    return can_be


def tested_count(block: AdjustedBlock) -> int:
    """Return how many observations take part and can be tested (redundancy number of `SPUR`)."""
    return int(np.count_nonzero(_testable(block)))


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
    """Return whether one of twenty good blocks has so much flagged, or as far out.

    How many are flagged and how far the worst is out are asked with half of `ALARM` each. False as
    well where nothing is flagged.
    """
    tested = block.tested
    distribution = distribution_of(block.test, block.redundancy)
    if not tested.flagged.any() or distribution is None:
        return False
    from scipy.special import pdtrc

    own = own_tests(block)
    worst = float(np.nanmax(np.abs(tested.w[tested.flagged])))
    return (
        float(pdtrc(own.flagged - 1, block.problem.test.alpha * own.tests)) > ALARM / 2.0
        and exceeding_by_chance(distribution, worst, own.tests) > ALARM / 2.0
    )
