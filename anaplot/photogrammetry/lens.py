"""The lens: from ideal to measured image coordinates (conventions, Pixels).

With u = (x, y) / c the ideal coordinates about the principal point, y up as everywhere here, and
r^2 = u_x^2 + u_y^2, the measured coordinates are

    x = x0 + c (u_x L + 2 p1' u_x u_y + p2 (r^2 + 2 u_x^2)) + b1 c u_x + b2 c u_y
    y = y0 + c (u_y L + p1' (r^2 + 2 u_y^2) + 2 p2 u_x u_y),   L = 1 + k1 r^2 + k2 r^4 + k3 r^6,

Brown's (1971) model in the sense of COLMAP's OPENCV family. There y is down; p1' = -p1 turns it.
Every term is taken about the principal point, and follows it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array

__all__ = ["LENS_PARAMETERS", "LensImage", "through_lens"]


LENS_PARAMETERS = ("c", "x0", "y0", "k1", "k2", "k3", "p1", "p2", "b1", "b2")
"""Camera constant and principal point [mm], and seven numbers without a unit."""


class LensImage(NamedTuple):
    """Measured image coordinates and their derivatives.

    Attributes
    ----------
    xy
        (n, 2) measured coordinates [mm].
    by_direction
        (n, 2, 2) derivatives by the ideal coordinates divided by c [mm].
    by_parameter
        (n, 2, 10) derivatives by `LENS_PARAMETERS` [1 for lengths, mm for the others].
    """

    xy: Array
    by_direction: Array
    by_parameter: Array


def through_lens(direction: Array, parameters: Array) -> LensImage:
    """Return where rays are measured through a lens.

    Parameters
    ----------
    direction
        (n, 2) ideal coordinates divided by c, about the principal point, y up.
    parameters
        (10,) or (n, 10) `LENS_PARAMETERS`. A longer c stretches the image; x0, y0 shift it; k1,
        k2, k3 > 0 push measured points outwards.
    """
    n = len(direction)
    x, y = direction.T
    c, x0, y0, k1, k2, k3, p1, p2, b1, b2 = np.broadcast_to(parameters, (n, 10)).T
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))  # d radial / d x = slope x
    xy2 = 2.0 * x * y
    rx, ry = r2 + 2.0 * x * x, r2 + 2.0 * y * y
    u = x * radial - p1 * xy2 + p2 * rx + b1 * x + b2 * y
    v = y * radial - p1 * ry + p2 * xy2
    by_direction = np.empty((n, 2, 2))
    by_direction[:, 0, 0] = c * (radial + slope * x * x - 2.0 * p1 * y + 6.0 * p2 * x + b1)
    by_direction[:, 0, 1] = c * (slope * x * y - 2.0 * p1 * x + 2.0 * p2 * y + b2)
    by_direction[:, 1, 0] = c * (slope * x * y - 2.0 * p1 * x + 2.0 * p2 * y)
    by_direction[:, 1, 1] = c * (radial + slope * y * y - 6.0 * p1 * y + 2.0 * p2 * x)
    by_parameter = np.zeros((n, 2, 10))
    by_parameter[:, :, 0] = np.stack((u, v), axis=1)
    by_parameter[:, 0, 1] = by_parameter[:, 1, 2] = 1.0
    for k in range(3):
        by_parameter[:, :, 3 + k] = (c * r2 ** (k + 1))[:, None] * direction
    by_parameter[:, 0, 6], by_parameter[:, 1, 6] = -c * xy2, -c * ry
    by_parameter[:, 0, 7], by_parameter[:, 1, 7] = c * rx, c * xy2
    by_parameter[:, 0, 8], by_parameter[:, 0, 9] = c * x, c * y
    xy = np.stack((x0 + c * u, y0 + c * v), axis=1)
    return LensImage(xy, by_direction, by_parameter)
