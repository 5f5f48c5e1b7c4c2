"""Of every point of a block one number, from those of its image coordinates."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.reliability import SPUR
from anaplot.aliases import Array, Bools
from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = [
    "largest_detectable",
    "largest_effect",
    "point_deviations",
]


def point_deviations(block: AdjustedBlock) -> Array | None:
    """Return (p, 3) standard deviations in X, Y, Z [m]; None where sigma0 does not exist."""
    if block.sigma is None:
        return None
    return block.sigma * block.cofactors.point_deviations


def largest_detectable(block: AdjustedBlock) -> Array:
    """Return (p,) largest smallest detectable errors of a point's image coordinates [um].

    NaN where none can be tested; infinite where one of those that count cannot.
    """
    mdb = block.tested.mdb[: block.observations.image].reshape(-1, 2)
    use = block.tested.use[: block.observations.image].reshape(-1, 2)
    size = np.where(_testable(block), mdb, np.inf)
    return _largest(block, np.where(use, size, -np.inf).max(axis=1))


def largest_effect(block: AdjustedBlock) -> Array:
    """Return (p,) how far undetected errors of the size of `mdb` move a point at most [m].

    Of one error in one of its own image coordinates; infinite and NaN as `largest_detectable`.
    """
    tested, image = block.tested, block.observations.image
    if tested.ground is None:
        return np.full(len(block.problem.points), np.nan)
    moved = np.linalg.norm(tested.ground[:image], axis=1).reshape(-1, 2)
    size = np.where(_testable(block) & np.isfinite(moved), moved, np.inf)
    use = tested.use[:image].reshape(-1, 2)
    return _largest(block, np.where(use, size, -np.inf).max(axis=1))


def _testable(block: AdjustedBlock) -> Bools:
    """(m, 2) which image coordinates are no spurs: of these a finite number is rounding alone."""
    r = block.tested.r[: block.observations.image].reshape(-1, 2)
    mdb = block.tested.mdb[: block.observations.image].reshape(-1, 2)
    return np.asarray((r >= SPUR) & np.isfinite(mdb))


def _largest(block: AdjustedBlock, of_rays: Array) -> Array:
    out = np.full(len(block.problem.points), -np.inf)
    np.maximum.at(out, block.problem.point, of_rays)
    return np.where(out == -np.inf, np.nan, out)
