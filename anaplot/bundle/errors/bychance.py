"""Whether what a block's test flags may be chance alone.

The rays of a point are flagged together: the four coordinates of a point of two photos have the
same abs(w), x of three photos in a row nearly so, and what checks a control coordinate goes with
it. Points are nearly independent of one another, so that these are counted.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.testdistribution import TestDistribution, distribution_of
from anaplot.aliases import Bools, Index
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.checkedrows import checked_rows
from anaplot.bundle.solve.observations import GROUND_KINDS

__all__ = ["ALARM", "exceeding_by_chance", "may_be_chance", "own_tests", "tested_count"]

ALARM = 0.05
"""Significance of what is said of a block as a whole: of good ones one in twenty is doubted."""

_ONCE = 1.0 + 1e-6  # sum of the redundancy numbers of a point whose rays check each other once


class OwnTests(NamedTuple):
    """How many tests say something of their own, and how many points and photos they flag."""

    tests: int
    flagged: int


def own_tests(block: AdjustedBlock) -> OwnTests:
    """Return how many tests of a block say something of their own, and what they flag.

    Tests are all that can be, but for points whose rays check each other once: each is one. What
    is flagged are points, with what is given of them, photos with stated places, and the like,
    however many of their rows exceed the critical value: alpha times the number of tests is no
    less than is expected.
    """
    tested, image, point = block.tested, block.observations.image, block.problem.point
    can_be = _testable(block)
    flagged = tested.flagged & can_be
    of_point = np.repeat(point, 2)
    points = len(block.problem.points)
    checks = np.bincount(of_point, np.where(can_be, tested.r, 0.0)[:image], points)
    single = (checks <= _ONCE)[of_point]

    def points_of(rows: Bools) -> Index:
        return np.flatnonzero(np.bincount(of_point[rows], minlength=points))

    of_rays = can_be[:image]
    own = int(np.count_nonzero(can_be)) - int(np.count_nonzero(of_rays & single))
    own += len(points_of(of_rays & single))
    its: set[Hashable] = {block.problem.points[k] for k in points_of(flagged[:image]).tolist()}
    for row in (image + np.flatnonzero(flagged[image:])).tolist():
        kind, *owner, _ = tested.keys[row]
        its.add(owner[-1] if kind in GROUND_KINDS else (kind, *owner))
    return OwnTests(own, len(its))


def _testable(block: AdjustedBlock) -> Bools:
    tested, first = block.tested, block.observations.starts[3]
    can_be: Bools = checked_rows(tested, block.problem.conditions, first, SPUR)
    return can_be & np.isfinite(tested.w)


def tested_count(block: AdjustedBlock) -> int:
    """Return how many observations take part and can be tested (`checked_rows`, with `SPUR`)."""
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
