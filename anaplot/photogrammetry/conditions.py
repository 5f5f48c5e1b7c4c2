"""Coplanarity and XZ collinearity with their derivatives (Kratky and El-Hakim 1983, eq. 1).

Both conditions are bilinear in two vectors: coplanarity in the rays x', x'' (given beta),
collinearity in (dX, dZ, 1) and x''. Each is therefore evaluated, together with all its
derivatives, as one small matrix of coefficients times the products of the two vectors' components;
that is what keeps a model within a few dozen array operations.

Rows of the results, in this order: derivatives with respect to bx, beta_y, beta_z and a small
right-handed rotation of x'' about the object axes (d1, d2, d3), then the misclosure itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ROWS", "collinearity_rows", "coplanarity_rows", "products"]

Array = NDArray[np.float64]

ROWS = 7
"""Six derivatives and the misclosure."""


def _bilinear(terms: dict[int, dict[tuple[int, int], float]]) -> Array:
    """(7, 9) coefficients from {row: {(component of first, component of second): factor}}."""
    out = np.zeros((ROWS, 9))
    for row, factors in terms.items():
        for (i, j), factor in factors.items():
            out[row, 3 * i + j] += factor
    return out


# F_p = beta . (x' x x''); with w = beta x x', dF_p = w . (d x x'') = d . (x'' x w)
_PLAIN = {
    1: {(2, 0): 1.0, (0, 2): -1.0},
    2: {(0, 1): 1.0, (1, 0): -1.0},
}
_COPLANARITY_X = _bilinear(
    _PLAIN
    | {
        3: {(1, 1): 1.0, (2, 2): 1.0},
        4: {(1, 0): -1.0},
        5: {(2, 0): -1.0},
        6: {(1, 2): 1.0, (2, 1): -1.0},
    }
)
_COPLANARITY_Y = _bilinear(
    {
        3: {(0, 1): -1.0},
        4: {(0, 0): 1.0, (2, 2): 1.0},
        5: {(2, 1): -1.0},
        6: {(2, 0): 1.0, (0, 2): -1.0},
    }
)
_COPLANARITY_Z = _bilinear(
    {
        3: {(0, 2): -1.0},
        4: {(1, 2): -1.0},
        5: {(0, 0): 1.0, (1, 1): 1.0},
        6: {(0, 1): 1.0, (1, 0): -1.0},
    }
)

# F_L = dX z'' - dZ x'' with dX = X - bx, dZ = Z - bx beta_z (reduced to the left centre)
_COLLINEARITY = _bilinear(
    {
        0: {(2, 2): -1.0},
        3: {(0, 1): 1.0},
        4: {(0, 0): -1.0, (1, 2): -1.0},
        5: {(1, 1): 1.0},
        6: {(0, 2): 1.0, (1, 0): -1.0},
    }
)
_COLLINEARITY_BX = _bilinear({2: {(2, 0): 1.0}})
_COLLINEARITY_BETA_Z = _bilinear({0: {(2, 0): 1.0}})


def products(first: Array, second: Array) -> Array:
    """Return (9, n) products of the components of two (3, n) arrays, first index slowest."""
    return (first[:, None, :] * second).reshape(9, -1)


def coplanarity_rows(beta_y: float, beta_z: float, rays: Array) -> Array:
    """Return (7, n): derivatives and value of F_p = (beta x x') . x''.

    Parameters
    ----------
    beta_y, beta_z
        Base components divided by bx.
    rays
        (9, n) products of x' and x''.
    """
    out: Array = (_COPLANARITY_X + beta_y * _COPLANARITY_Y + beta_z * _COPLANARITY_Z) @ rays
    return out


def collinearity_rows(bx: float, beta_z: float, rays: Array) -> Array:
    """Return (7, m): derivatives and value of F_L = dX z'' - dZ x''.

    Parameters
    ----------
    bx, beta_z
        Base component, and bz / bx.
    rays
        (9, m) products of (dX, dZ, 1) and x''.
    """
    out: Array = (_COLLINEARITY + bx * _COLLINEARITY_BX + beta_z * _COLLINEARITY_BETA_Z) @ rays
    return out
