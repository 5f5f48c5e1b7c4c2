"""The lens: from ideal to measured image coordinates (conventions, Pixels).

With u = (x, y) / c the ideal coordinates about the principal point, y up as everywhere here, and
r^2 = u_x^2 + u_y^2, the measured coordinates are

    d_x = u_x L + 2 p1' u_x u_y + p2 (r^2 + 2 u_x^2),   L = 1 + k1 r^2 + k2 r^4 + k3 r^6,
    d_y = u_y L + p1' (r^2 + 2 u_y^2) + 2 p2 u_x u_y
    x = x0 + c (d_x + b1 d_x + b2 d_y)
    y = y0 + c d_y,

Brown's (1971) model in the sense of COLMAP's OPENCV family, where f_x = c (1 + b1) and f_y = c, and
of Metashape's. There y is down; p1' = -p1 turns it, and b2 changes its sign as well in Metashape's.
Every term is taken about the principal point, and follows it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from anaplot.aliases import Array
from anaplot.photogrammetry.planar import as_points, solve_pairs

__all__ = [
    "LENS_PARAMETERS",
    "LensImage",
    "lens_fold",
    "lens_places",
    "through_lens",
    "without_lens",
]

_HALVINGS = 20  # of the interval in which a radius lies; Newton's steps do the rest
_STEPS = 20
_SETTLED = 1e-15  # of a step, relative to 1 + |direction|: what is left is rounding
_AT_A_TIME = 8192  # rays: their arrays stay in the processor's cache
_FAR = 1e4  # times c: beyond it no lens images anything
_CLOSED = 1e-12  # between a place and that of its direction, relative to c


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


class _Bent(NamedTuple):
    """What a lens makes of directions, and what its derivatives are made of; arrays of (n,)."""

    x: Array
    y: Array
    r2: Array
    radial: Array
    xy2: Array
    rx: Array
    ry: Array
    dx: Array
    u: Array
    v: Array  # d_y, too


def _bent(direction: Array, parameters: Array) -> _Bent:
    x, y = direction.T
    _, _, _, k1, k2, k3, p1, p2, b1, b2 = parameters
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xy2 = 2.0 * x * y
    rx, ry = r2 + 2.0 * x * x, r2 + 2.0 * y * y
    dx = x * radial - p1 * xy2 + p2 * rx
    dy = y * radial - p1 * ry + p2 * xy2
    return _Bent(x, y, r2, radial, xy2, rx, ry, dx, dx + b1 * dx + b2 * dy, dy)


def _places(bent: _Bent, parameters: Array) -> Array:
    c, x0, y0, *_ = parameters
    return np.stack((x0 + c * bent.u, y0 + c * bent.v), axis=1)


def _by_direction(bent: _Bent, parameters: Array) -> Array:
    c, _, _, k1, k2, k3, p1, p2, b1, b2 = parameters
    x, y, r2, radial = bent.x, bent.y, bent.r2, bent.radial
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))  # d radial / d x = slope x
    across = slope * x * y - 2.0 * p1 * x + 2.0 * p2 * y
    x_by_x = radial + slope * x * x - 2.0 * p1 * y + 6.0 * p2 * x
    y_by_y = radial + slope * y * y - 6.0 * p1 * y + 2.0 * p2 * x
    out = np.empty((len(x), 2, 2))
    out[:, 0, 0] = c * ((1.0 + b1) * x_by_x + b2 * across)
    out[:, 0, 1] = c * ((1.0 + b1) * across + b2 * y_by_y)
    out[:, 1, 0] = c * across
    out[:, 1, 1] = c * y_by_y
    return out


def _by_parameter(bent: _Bent, parameters: Array) -> Array:
    c, _, _, _, _, _, _, _, b1, b2 = parameters
    x, y, r2, xy2, rx, ry, dx, dy = *bent[:3], *bent[4:8], bent.v
    out = np.zeros((len(x), 2, 10))
    out[:, :, 0] = np.stack((bent.u, bent.v), axis=1)
    out[:, 0, 1] = out[:, 1, 2] = 1.0
    skewed = (1.0 + b1) * x + b2 * y
    for k in range(3):
        power = c * r2 ** (k + 1)
        out[:, 0, 3 + k], out[:, 1, 3 + k] = power * skewed, power * y
    out[:, 0, 6], out[:, 1, 6] = -c * ((1.0 + b1) * xy2 + b2 * ry), -c * ry
    out[:, 0, 7], out[:, 1, 7] = c * ((1.0 + b1) * rx + b2 * xy2), c * xy2
    out[:, 0, 8], out[:, 0, 9] = c * dx, c * dy
    return out


def _columns(parameters: Array) -> Array:
    """Return (10,) numbers, or (10, n), of `LENS_PARAMETERS`."""
    return np.asarray(parameters, dtype=np.float64).T


def through_lens(direction: Array, parameters: Array) -> LensImage:
    """Return where rays are measured through a lens, with the derivatives.

    Parameters
    ----------
    direction
        (n, 2) ideal coordinates divided by c, about the principal point, y up.
    parameters
        (10,) or (n, 10) `LENS_PARAMETERS`. A longer c stretches the image; x0, y0 shift it; k1,
        k2, k3 > 0 push measured points outwards.
    """
    lens = _columns(parameters)
    bent = _bent(direction, lens)
    return LensImage(_places(bent, lens), _by_direction(bent, lens), _by_parameter(bent, lens))


def lens_places(direction: Array, parameters: Array) -> Array:
    """Return (n, 2) coordinates [mm] at which rays are measured, as `through_lens`, alone."""
    lens = _columns(parameters)
    return _places(_bent(direction, lens), lens)


def without_lens(xy: Array, parameters: Array) -> Array:
    """Return the directions of rays that are measured through a lens: `through_lens` undone.

    Parameters
    ----------
    xy
        (n, 2) measured coordinates [mm].
    parameters
        (10,) `LENS_PARAMETERS` of one lens.

    Returns
    -------
    ndarray
        (n, 2) ideal coordinates divided by c, y up; NaN where no direction within the lens's
        first fold, beyond which it sees everything twice, is measured there. What is found of a
        ray does not hang on those beside it.
    """
    measured = as_points(xy)
    out = np.empty(measured.shape)
    with np.errstate(all="ignore"):  # what parameters out of a damaged file do is NaN
        for begin in range(0, len(out), _AT_A_TIME):
            some = slice(begin, begin + _AT_A_TIME)
            out[some] = _without_lens(measured[some], _columns(parameters))
    return out


def _without_lens(measured: Array, lens: Array) -> Array:
    c, x0, y0, k1, k2, k3, _, _, b1, b2 = lens
    dy = (measured[:, 1] - y0) / c
    bent = np.column_stack((((measured[:, 0] - x0) / c - b2 * dy) / (1.0 + b1), dy))
    if not np.any(lens[3:8]):
        return bent
    fold = lens_fold(k1, k2, k3)
    radius = np.hypot(*bent.T)
    low, high = np.zeros(len(bent)), np.full(len(bent), min(fold, _FAR))
    if not np.isfinite(fold):
        # without a fold the measured radius grows with the true one: twice as far until it holds
        high = np.maximum(2.0 * radius, 1e-9)
        for _ in range(60):
            short = _radial(high, k1, k2, k3) < radius
            if not short.any():
                break
            high[short] *= 2.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        short = _radial(middle, k1, k2, k3) < radius
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    scale = np.divide(0.5 * (low + high), radius, out=np.ones_like(radius), where=radius > 0.0)
    direction = bent * scale[:, None]
    moving = np.arange(len(direction))
    for _ in range(_STEPS):
        now = direction[moving]
        seen = _bent(now, lens)
        step = solve_pairs(_by_direction(seen, lens), _places(seen, lens) - measured[moving])
        direction[moving] = now - step
        far = (np.abs(step) > _SETTLED * (1.0 + np.abs(now))).any(axis=1)
        moving = moving[far]
        if not moving.size:
            break
    seen = _bent(direction, lens)
    gap = np.abs(_places(seen, lens) - measured).max(axis=1, initial=0.0)
    reach = np.abs(measured).max(axis=1, initial=0.0) + abs(c)
    upright = np.linalg.det(_by_direction(seen, lens)) * (1.0 + b1) > 0.0
    good = (gap <= _CLOSED * reach) & upright & (np.hypot(*direction.T) <= 1.001 * fold)
    return np.where(good[:, None], direction, np.nan)


def _radial(r: Array, k1: float, k2: float, k3: float) -> Array:
    r2 = r * r
    out: Array = r * (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)))
    return out


@lru_cache(maxsize=256)  # photos by the thousand have a camera or two
def lens_fold(k1: float, k2: float, k3: float) -> float:
    """Return the radius, divided by c, from which on a lens folds the image back; or infinity.

    It is where 1 + 3 k1 q + 5 k2 q^2 + 7 k3 q^3 is 0 first, q the square of the radius. The
    largest root of s = 1 / q is looked for, whose polynomial begins with 1 whatever the lens.
    """
    try:
        inverse = np.roots([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
    except np.linalg.LinAlgError:  # numbers beyond all measure: nothing is imaged
        return 0.0
    real = inverse.real[np.abs(inverse.imag) < 1e-9 * np.abs(inverse)]
    largest = float(real.max(initial=0.0))
    return 1.0 / float(np.sqrt(largest)) if largest > _FAR**-2 else np.inf
