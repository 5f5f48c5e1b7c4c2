"""What a cleaning did to the points: how far they have moved, and how much surer they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array

__all__ = ["PointChange", "SigmaChange", "point_change"]


class SigmaChange(NamedTuple):
    """The coordinate whose standard deviation has changed most.

    Attributes
    ----------
    point, axis
        The coordinate.
    before, after
        Its standard deviations, in the unit of the coordinates.
    """

    point: str
    axis: str
    before: float
    after: float


class PointChange(NamedTuple):
    """The largest changes of coordinates between two adjustments.

    Attributes
    ----------
    point, axis, change
        The coordinate that has moved farthest, and how far, in the unit of the coordinates.
    rms
        Root mean squares of the changes in X, Y and Z.
    sigma
        The largest change of a standard deviation; None where there are none.
    """

    point: str
    axis: str
    change: float
    rms: tuple[float, float, float]
    sigma: SigmaChange | None


def point_change(
    names: Sequence[str],
    before: Array,
    after: Array,
    sigmas: tuple[Array, Array] | None = None,
) -> PointChange | None:
    """Compare the points of two adjustments; None where they share none.

    Parameters
    ----------
    names
        n points.
    before, after
        (n, 3) their coordinates; points with a coordinate that is not finite are passed over.
    sigmas
        (n, 3) standard deviations before and after, with the a-priori sigma0; None: not known.
    """
    moved = after - before
    good = np.asarray(np.isfinite(moved)).all(axis=1)
    if not np.any(good):
        return None
    size = np.where(np.isfinite(moved), np.abs(moved), -1.0)
    at, axis = divmod(int(np.argmax(size)), 3)
    x, y, z = np.sqrt((moved[good] ** 2).mean(axis=0)).tolist()
    sigma = None
    if sigmas is not None:
        old, new = sigmas
        spread = np.nan_to_num(np.abs(new - old), nan=-1.0, posinf=-1.0)
        there, along = divmod(int(np.argmax(spread)), 3)
        if spread[there, along] >= 0.0:
            sigma = SigmaChange(
                names[there], "XYZ"[along], float(old[there, along]), float(new[there, along])
            )
    return PointChange(names[at], "XYZ"[axis], float(moved[at, axis]), (x, y, z), sigma)
