"""A block as its adjustment has it: without the image points that were rejected there."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from anaplot.photogrammetry.block import Block

if TYPE_CHECKING:
    from anaplot.bundle.solve.adjusted import AdjustedBlock

__all__ = ["without_rejected"]


def without_rejected(adjusted: AdjustedBlock) -> Block:
    """Return the block without image points of which the adjustment rejects a coordinate.

    Models and numbering that are looked at beside an adjustment are to be those of its
    observations: a gross error that it took out accuses nobody any more.
    """
    problem = adjusted.problem
    gone = problem.newly_rejected.any(axis=1)
    if not gone.any():
        return problem.block
    rows = set(problem.source[gone].tolist())
    kept = (row for k, row in enumerate(problem.block.image_points) if k not in rows)
    return replace(problem.block, image_points=tuple(kept))
