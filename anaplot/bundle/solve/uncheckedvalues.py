"""Given lengths that next to nothing checks: control, priors and conditions in metres."""

from __future__ import annotations

import numpy as np

from anaplot.adjustment.reliability import SPUR
from anaplot.adjustment.tested import Observation
from anaplot.aliases import Array
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.bundle.solve.observations import ObservationName

__all__ = ["unchecked_values"]


def unchecked_values(
    block: AdjustedBlock, limit: float = SPUR
) -> list[Observation[ObservationName]]:
    """Return the coordinates and distances in which no error of a size that occurs can be seen.

    The redundancy number alone does not say so: it is as small where a value is stated far sharper
    than the photographs determine it, and there an error shows when it is large for them. Against
    the deviations of the block's points, where these are the larger ones, `SPUR` is a smallest
    detectable error of some hundred deviations, as it is of an image coordinate.

    Parameters
    ----------
    block
        An adjusted block.
    limit
        Redundancy number below which an error is not seen.

    Returns
    -------
    list of Observation
        Control and priors of points in the order of their files, positions of photos, conditions.
    """
    rows, tested = block.observations, block.tested
    position = rows.starts[1] + np.flatnonzero(rows.priors[:, 1] < 3)
    conditions = block.problem.conditions
    angular = np.zeros(0, dtype=bool) if conditions is None else conditions.angular
    order = np.concatenate(
        (
            rows.image + rows.in_file_order(0),
            rows.image + rows.in_file_order(1),
            position,
            rows.starts[3] + np.flatnonzero(~angular),
        )
    )
    order = order[tested.use[order] & (tested.r[order] < limit) & (rows.sigma[order] > 0.0)]
    sharper = np.maximum(1.0, _typical(block) / rows.sigma[order])
    return tested.rows(order[tested.r[order] * sharper**2 < limit])


def _typical(block: AdjustedBlock) -> float:
    """Return the median standard deviation [m] of a coordinate, for the a-priori sigma0."""
    free: Array = block.cofactors.point_deviations[~block.problem.fixed]
    return float(np.median(free)) if free.size else 0.0
