"""Photos of one place: a rotation alone leads from one to the other, and there is no base.

One photo laid in twice, or a camera that was only turned. Nothing in common can be intersected:
whatever orientation fits, fits noise, and its table looks like any other.
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np

from anaplot.aliases import Array

__all__ = ["turned_alone"]

_FREEDOM = 7  # as of five points
_SPREAD = 0.01  # rad: rays of one place, or one line, follow a rotation whatever the base is
_AGREE = 3.0  # sigmas


def turned_alone(left: Array, right: Array, sigma: float) -> float | None:
    """Return by how many sigmas a rotation alone misses one photo's rays with the other's, if few.

    Parameters
    ----------
    left, right
        (3, n) rays (x, y, -c) of the same points in two photos [mm].
    sigma
        Of an image coordinate [mm].

    Returns
    -------
    float or None
        The root mean square of the angles left; None where rays are off by more than three sigmas,
        or where points too few, or on one line, would say so.
    """
    freedom = 2 * left.shape[1] - 3
    if freedom < _FREEDOM:
        return None
    with np.errstate(all="ignore"):
        one, other = (rays / np.sqrt((rays * rays).sum(axis=0)) for rays in (left, right))
        both = one @ other.T
    if not np.isfinite(both).all():
        return None
    u, spread, v = np.linalg.svd(both)  # Kabsch: the rotation that least squares find
    if spread[2] < _SPREAD**2 * left.shape[1]:
        return None
    u[:, 2] *= np.linalg.det(u @ v)
    off = one - u @ v @ other
    # seen inclined to the axis, an image coordinate turns its ray by less
    turns = sigma * hypot(1.0 / left[2, 0], 1.0 / right[2, 0])
    found = sqrt(float((off * off).sum()) / freedom) / turns
    return found if found < _AGREE else None
