"""Coplanarity and XZ collinearity with their derivatives (Kratky and El-Hakim 1983, eq. 1).

Both conditions are bilinear in two vectors of each point: coplanarity in the rays x' and x'',
collinearity in (X, Z, 1) of the tie point and x''. Written out, a condition and its derivatives
are coefficients that depend on the unknowns alone, times products of components that depend on
the measurements alone. The products are formed once per model; a step of the iteration then costs
a handful of array operations however many points there are.

Rows of the results, in this order: derivatives with respect to ln bx, beta_y, beta_z and a small
right-handed rotation of x'' about the object axes (d1, d2, d3), then the misclosure itself.
"""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array

__all__ = [
    "ROWS",
    "coefficients",
    "coefficients_of_many",
    "misclosure_coefficients",
    "products",
    "products_of_many",
]


ROWS = 7
"""Six derivatives and the misclosure."""

# A term is (row, component of the first vector, component of x'', sign). First vectors: x' for
# coplanarity, (X, Z, 1) for collinearity. Each group is multiplied by one function of the unknowns,
# those of collinearity also by the weight of its rows.
_Terms = tuple[tuple[int, int, int, int], ...]

# F_p = (beta x x') . x'' ; with w = beta x x', a turn d of x'' changes it by d . (x'' x w)
_COPLANARITY: dict[str, _Terms] = {
    "1": (
        (1, 2, 0, 1), (1, 0, 2, -1),
        (2, 0, 1, 1), (2, 1, 0, -1),
        (3, 1, 1, 1), (3, 2, 2, 1),
        (4, 1, 0, -1),
        (5, 2, 0, -1),
        (6, 1, 2, 1), (6, 2, 1, -1),
    ),
    "beta_y": (
        (3, 0, 1, -1),
        (4, 0, 0, 1), (4, 2, 2, 1),
        (5, 2, 1, -1),
        (6, 2, 0, 1), (6, 0, 2, -1),
    ),
    "beta_z": (
        (3, 0, 2, -1),
        (4, 1, 2, -1),
        (5, 0, 0, 1), (5, 1, 1, 1),
        (6, 0, 1, 1), (6, 1, 0, -1),
    ),
}  # fmt: skip

# F_L = dX z'' - dZ x'' with dX = X - bx and dZ = Z - bx beta_z (reduced to the left centre)
_COLLINEARITY: dict[str, _Terms] = {
    "1": (
        (3, 0, 1, 1),
        (4, 0, 0, -1), (4, 1, 2, -1),
        (5, 1, 1, 1),
        (6, 0, 2, 1), (6, 1, 0, -1),
    ),
    "bx": (
        (0, 2, 2, -1),
        (2, 2, 0, 1),
        (3, 2, 1, -1),
        (4, 2, 0, 1),
        (6, 2, 2, -1),
    ),
    "bz": (
        (0, 2, 0, 1),
        (4, 2, 2, 1),
        (5, 2, 1, -1),
        (6, 2, 0, 1),
    ),
}  # fmt: skip


def _tensor() -> Array:
    """(7 * 6 * 3, 6): row, first component (x', then X, Z, 1), component of x''; function."""
    groups = [(0, terms) for terms in _COPLANARITY.values()]
    groups += [(3, terms) for terms in _COLLINEARITY.values()]
    out = np.zeros((ROWS, 6, 3, len(groups)))
    for function, (offset, terms) in enumerate(groups):
        for row, first, second, sign in terms:
            out[row, offset + first, second, function] += sign
    return out.reshape(-1, len(groups))


_TENSOR = _tensor()
_FIRST, _SECOND = np.divmod(np.arange(18), 3)
_TURNED = 6 * ROWS, 3
_COEFFICIENTS = ROWS, 18


def products(first: Array, second: Array) -> Array:
    """Return (3k, n) products of the components of a (k, n) and a (3, n) array.

    The first array's index is the slowest.
    """
    # of arrays of equal shape: to spread few numbers over one another takes several times as long
    count = 3 * len(first)
    return first.take(_FIRST[:count], axis=0) * second.take(_SECOND[:count], axis=0)


def products_of_many(first: Array, second: Array) -> Array:
    """Return the (m, 3k, n) `products` of m models, of (m, k, n) and (m, 3, n) arrays."""
    models, _, n = second.shape
    return (first[:, :, None] * second[:, None]).reshape(models, -1, n)


def coefficients(
    bx: float, beta_y: float, beta_z: float, rotation: Array, weight: float = 1.0
) -> Array:
    """Return the (7, 18) coefficients of the conditions at a state of the unknowns.

    Columns 0-8 times `products(x', p'')` give the seven rows of F_p = (beta x x') . x'', columns
    9-17 times `products((X, Z, 1), p'')` those of F_L = dX z'' - dZ x''; p'' is the right ray in
    the image system, x'' = R p''.

    Parameters
    ----------
    bx, beta_y, beta_z
        Base component [mm], by / bx and bz / bx.
    rotation
        (3, 3) rotation R of the right photo, image to object.
    weight
        Factor of the rows of F_L.
    """
    # `dot` rather than @, whose way to BLAS is twice as long
    factors = _TENSOR.dot(_functions(bx, beta_y, beta_z, weight)).reshape(_TURNED)
    out: Array = factors.dot(rotation).reshape(_COEFFICIENTS)
    return out


def misclosure_coefficients(
    bx: float, beta_y: float, beta_z: float, rotation: Array, weight: float = 1.0
) -> Array:
    """Return the (6, 3) matrix T of both conditions, F = a' T p'': the last row of `coefficients`.

    a is x' before three zeros (F_p), or (X, Z, 1) behind them (F_L); so T p'' are the derivatives
    by a, and a' T those by p''. Parameters as there.
    """
    factors = _TENSOR[-18:].dot(_functions(bx, beta_y, beta_z, weight))
    out: Array = factors.reshape(6, 3).dot(rotation)
    return out


def _functions(bx: float, beta_y: float, beta_z: float, weight: float) -> Array:
    """(6,) functions of the unknowns by which the terms of `_TENSOR` are multiplied."""
    along = weight * bx
    return np.array((1.0, beta_y, beta_z, weight, along, along * beta_z))


def coefficients_of_many(bx: Array, beta_y: Array, beta_z: Array, rotation: Array) -> Array:
    """Return the (m, 7, 18) `coefficients` of m models, of (m,) and (m, 3, 3) unknowns."""
    one = np.ones_like(bx)
    functions = np.stack((one, beta_y, beta_z, one, bx, bx * beta_z))
    factors = (_TENSOR @ functions).T.reshape(-1, 6 * ROWS, 3) @ rotation
    out: Array = factors.reshape(-1, ROWS, 18)
    return out
