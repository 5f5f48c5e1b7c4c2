"""What a cleaning did to the ground: how far points have moved, and how much surer they are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anaplot.bundle.adjusted import AdjustedBlock

__all__ = ["GroundChange", "ground_change"]

Array = NDArray[np.float64]


class GroundChange(NamedTuple):
    """The largest changes of ground coordinates between two adjustments of a block.

    Attributes
    ----------
    point, axis, change
        The coordinate that has moved farthest, and how far [m].
    sigma_point, sigma_axis, sigma_before, sigma_after
        The coordinate whose standard deviation has changed most, and both [m], with the a-priori
        sigma0.
    rms
        (3,) root mean square of the changes in X, Y, Z [m].
    """

    point: str
    axis: str
    change: float
    sigma_point: str
    sigma_axis: str
    sigma_before: float
    sigma_after: float
    rms: tuple[float, float, float]


def ground_change(before: AdjustedBlock, after: AdjustedBlock) -> GroundChange | None:
    """Compare the points of two adjustments of one block; None where they share no point.

    Parameters
    ----------
    before, after
        With all observations, and without some; in the same datum.
    """
    place = {name: k for k, name in enumerate(after.problem.points)}
    pairs = [(k, place[name]) for k, name in enumerate(before.problem.points) if name in place]
    if not pairs:
        return None
    old, new = np.array(pairs, dtype=np.intp).T
    moved = (after.state.points[new] + after.state.origin) - (
        before.state.points[old] + before.state.origin
    )
    sigma = _deviations(before)[old], _deviations(after)[new]
    names = [before.problem.points[k] for k in old.tolist()]
    at, axis = np.unravel_index(int(np.argmax(np.abs(moved))), moved.shape)
    spread = np.abs(sigma[1] - sigma[0])
    there, along = np.unravel_index(int(np.argmax(spread)), spread.shape)
    x, y, z = np.sqrt((moved**2).mean(axis=0)).tolist()
    return GroundChange(
        names[int(at)],
        "XYZ"[int(axis)],
        float(moved[at, axis]),
        names[int(there)],
        "XYZ"[int(along)],
        float(sigma[0][there, along]),
        float(sigma[1][there, along]),
        (x, y, z),
    )


def _deviations(block: AdjustedBlock) -> Array:
    """(n, 3) standard deviations of the points [m], a-priori sigma0."""
    variances = np.einsum("nii->ni", block.cofactors.points)
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))
